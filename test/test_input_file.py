"""Files that people hand in: only regular ones of a limited size are opened."""

import os
from pathlib import Path

import pytest

from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.input_files import read_input


def test_a_regular_file_is_read_up_to_the_limit(tmp_path):
    file = tmp_path / 'a'
    file.write_bytes(b'x' * 1024)
    (tmp_path / 'link').symlink_to(file)
    assert read_input(tmp_path / 'link', 1024, 'mesh') == b'x' * 1024
    with pytest.raises(PartError) as caught:
        read_input(file, 1023, 'mesh', PartError)
    assert str(caught.value) == f"mesh '{file}' is too large: expected at most 0 KiB"


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ('make', 'expected'),
    [
        (os.mkfifo, 'is a pipe, a device or a socket: expected a regular file'),
        (os.mkdir, 'is a folder: expected a regular file'),
        (lambda path: path.symlink_to('/dev/zero'), 'is a pipe, a device or a socket: expected'),
        (lambda path: path.symlink_to(path), 'cannot be read: Too many levels of symbolic links'),
        (lambda path: None, 'does not exist'),
    ],
)
def test_only_regular_files_are_opened(tmp_path, make, expected):
    path = tmp_path / 'a.stl'
    make(path)
    with pytest.raises(InvalidValueError) as caught:
        read_input(path, 100, 'mesh')
    assert str(caught.value).startswith(f"mesh '{path}' {expected}")


@pytest.mark.parametrize('name', ['a\0b', 'x' * 5000, '\x1b[31m\n'])
def test_error_for_an_invalid_path(name):
    with pytest.raises(InvalidValueError) as caught:
        read_input(Path(name), 100, 'mesh')
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500


def test_growing_file_is_read_up_to_the_limit():
    """Files of /proc have the size 0 regardless of their content."""
    with pytest.raises(InvalidValueError, match='is too large'):
        read_input(Path('/proc/cpuinfo'), 10, 'mesh')

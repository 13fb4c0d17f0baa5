"""The last message of a type is found in complete and in truncated logs."""

import dataclasses
import importlib
import struct

import pytest

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.message_reader import is_log, messages
from resting_aspects_ros.logs.run_writer import RunLog
from resting_aspects_ros.logs.topic_metadata import Qos, Topic

INTERFACES = 'resting_aspects_interfaces/msg'
TYPE = f'{INTERFACES}/AspectDistribution'
POSES = Topic('/resting_poses', f'{INTERFACES}/RestingPoses', Qos(2000))
NUT = Topic('/aspect_distributions/nut', TYPE, Qos(1))


def data(k):
    return bytes([k]) * 40


def last_message(path, type_name):
    return ([None, *messages(path, type_name)])[-1]


@pytest.fixture
def log(tmp_path):
    """Write a log of poses 0 to 5, each but the first with a distribution 100 + k after it."""
    ends = {}
    with RunLog(tmp_path, 'run') as log:
        log.add_metadata('run', {'note': 'café'})
        log.attach('nut.stl', 'model/stl', b'mesh', 1)
        for k in range(6):
            log.write(POSES, data(k), 10 * k)
            if k:
                log.write(NUT, data(100 + k), 10 * k + 1)
            log.flush()
            ends[k] = log.path.stat().st_size
    log.ends = ends
    return log


def test_last_message_is_read_from_file_and_folder(log):
    for place in (log.path, log.path.parent):
        assert is_log(place)
        assert last_message(place, TYPE) == data(105)
        assert last_message(place, POSES.type) == data(5)
        assert last_message(place, f'{INTERFACES}/PartDescription') is None


def test_open_log_has_the_flushed_messages(tmp_path):
    log = RunLog(tmp_path, 'run')
    assert last_message(log.path, TYPE) is None
    for k in range(3):
        log.write(NUT, data(k), k)
        log.flush()
        assert last_message(log.path.parent, TYPE) == data(k)
    log.close()


def test_truncated_file_has_its_complete_messages(log, tmp_path):
    content = log.path.read_bytes()
    cut = tmp_path / 'cut.mcap'
    near_ends = {end + near for end in log.ends.values() for near in (-1, 0, 1)}
    for size in sorted(near_ends | set(range(0, len(content), 41))):
        cut.write_bytes(content[:size])
        flushed = [data(100 + k) for k, end in log.ends.items() if k and end <= size]
        # A chunk is whole a few bytes before its index is.
        after = [data(100 + len(flushed) + 1)] if len(flushed) < 5 else []
        assert last_message(cut, TYPE) in [(flushed or [None])[-1], *after]
    assert last_message(cut, TYPE) == data(105)  # without its index


def test_zeros_after_a_power_failure_are_ignored(log, tmp_path):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(log.path.read_bytes()[: log.ends[3]] + bytes(1000))
    assert last_message(cut, TYPE) == data(103)


def test_damaged_file_is_rejected(log):
    content = bytearray(log.path.read_bytes())
    at = log.ends[3] + 100  # within the chunk of the distribution 104
    content[at : at + 8] = struct.pack('<Q', 2**64 - 1)
    log.path.write_bytes(content)
    with pytest.raises(LogError, match=r'is damaged: found .*"mcap recover"') as caught:
        last_message(log.path, TYPE)
    assert repr(str(log.path)) in str(caught.value)


def test_other_definition_of_a_type_is_rejected(tmp_path, monkeypatch):
    schemas = importlib.import_module('resting_aspects_ros.logs.run_writer')
    installed = schemas.load_schema(TYPE)
    older = dataclasses.replace(installed, type_hash='RIHS01_older')
    with monkeypatch.context() as patch:
        patch.setattr(schemas, 'load_schema', lambda _: older)
        with RunLog(tmp_path, 'run') as log:
            log.write(NUT, data(1), 1)
    with pytest.raises(LogError) as caught:
        last_message(log.path, TYPE)
    expected = f'log {str(log.path)!r} was recorded by another version of resting_aspects_ros'
    assert str(caught.value).startswith(expected)
    for word in (TYPE, "'RIHS01_older'", repr(installed.type_hash)):
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('nowhere.mcap', "log '{}' cannot be read: No such file or directory"),
        ('folder', "folder '{}' is not a log: it has no .mcap file"),
        ('other.mcap', "log '{}' is damaged, or not an MCAP file: it begins with b'aspect,c'"),
    ],
)
def test_invalid_logs_are_rejected(tmp_path, name, expected):
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'other.mcap').write_text('aspect,count\n1,2\n')
    path = tmp_path / name
    assert is_log(path)  # meant to be one
    with pytest.raises(LogError) as caught:
        last_message(path, TYPE)
    assert str(caught.value).startswith(expected.format(path))


def test_empty_file_has_no_messages(tmp_path):
    (tmp_path / 'a.mcap').touch()
    assert last_message(tmp_path / 'a.mcap', TYPE) is None


def test_logs_are_detected_by_their_first_bytes(log, tmp_path):
    renamed = log.path.rename(tmp_path / 'renamed')
    assert is_log(renamed)
    assert last_message(renamed, TYPE) == data(105)
    (tmp_path / 'a.csv').write_text('aspect,count\n')
    assert not is_log(tmp_path / 'a.csv')
    assert not is_log(tmp_path / 'nowhere')

"""Damaged input files of every kind are refused in one line, or read."""

import pytest
from fuzz.input_kinds import made_kinds
from fuzz.inputs import findings

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def kinds(tmp_path_factory):
    folder = tmp_path_factory.mktemp('kinds')
    return folder, made_kinds(folder)


def test_valid_files_of_every_kind_are_read(kinds):
    folder, made = kinds
    for kind in made.values():
        for seed in kind.seeds:
            (folder / kind.file).write_bytes(seed)
            kind.load(folder / kind.file)
            (folder / kind.file).unlink()


def test_damaged_files_are_refused_in_one_line(kinds):
    folder, made = kinds
    assert list(findings(made, folder, 60, 1)) == []

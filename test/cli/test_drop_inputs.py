"""Inputs of `drop`: mesh files with units and YAML, and numbers in any notation."""

import argparse
import json

import pytest

from resting_aspects_ros.api import model_range
from resting_aspects_ros.cli.options import parse_integer, parse_share

BOX = [0.005, 0.005, 0.01, 0.01, 0.015, 0.015]


@pytest.fixture
def dropped(run):
    """Drop a part once; returns the document."""

    def document(*words):
        ended = run('drop', *words, '--drops', 1, '--json')
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return document


def heights(document):
    return [aspect['com_height'] for aspect in document['aspects']]


@pytest.mark.slow
def test_a_mesh_file_has_the_unit_of_its_flag(dropped, box, tmp_path):
    (tmp_path / 'in.here').mkdir()
    box.export(tmp_path / 'in.here' / 'my-box.ply')
    document = dropped(tmp_path / 'in.here' / 'my-box.ply', '--unit', 'in')
    assert heights(document) == pytest.approx([25.4 * height for height in BOX])


@pytest.mark.slow
def test_warnings_do_not_go_to_stdout(run, box, tmp_path):
    box.invert()
    box.export(tmp_path / 'box.stl')
    ended = run('drop', 'box.stl', '--drops', 1, '--json')
    (warning,) = [line for line in ended.stderr.splitlines() if line.startswith('warning: ')]
    assert "'box.stl'" in warning
    assert json.loads(ended.stdout)['part'] == 'box'


@pytest.mark.slow
def test_height_in_the_wrong_unit_is_refused_unless_forced(
    refused, run, box, tmp_path, monkeypatch
):
    monkeypatch.setattr(model_range, 'DROPS', 1)  # they fall for long
    # The limit depends on the size of the part.
    box.export(tmp_path / 'box.stl')
    words = ('drop', 'box.stl', '--drops', 1)
    assert run(*words, '--height', '8').returncode == 0
    assert '--force' in refused(*words, '--height', '11')
    assert run(*words, '--height', '11', '--force').returncode == 0


def test_numbers_in_any_notation():
    assert [parse_integer(text) for text in ('1e1', '10', '1.0e1', '1_0', '10.0')] == [10] * 5
    for text in ('1.5', '1e-1', 'inf', '1e-999999999', ''):
        with pytest.raises(argparse.ArgumentTypeError):
            parse_integer(text)
    assert [parse_share('x', text) for text in ('25%', '0.25', '25 %', '.25')] == [0.25] * 4

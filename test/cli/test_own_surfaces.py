"""`--surfaces FILE`: surfaces of one's own beside those of the suite, for every command."""

import json

import pytest
import yaml

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.cli.main import make_parser
from resting_aspects_ros.cli.verbs import COMMANDS
from resting_aspects_ros.simulation.conditions import QUANTITIES

DRAWS = {'friction': [0.3 + k / 100 for k in range(8)]}


@pytest.fixture
def own(tmp_path):
    """A file with one surface, ice, as `calibrate` writes it: without those of the suite."""
    mat = shipped_surfaces().get()
    entry = {name: getattr(mat, name) for name in QUANTITIES} | {
        'height_of': 'LOWEST_POINT',
        'friction': 0.02,
        'uncertainty': DRAWS,
    }
    path = tmp_path / 'own.yaml'
    path.write_text(yaml.safe_dump({'ice': entry}), encoding='utf-8')
    return path


def test_each_command_with_a_surface_takes_a_file_of_surfaces():
    flags = {}
    for name in COMMANDS:
        (choices,) = (a.choices for a in make_parser([name])._actions if a.choices)
        flags[name] = set(choices[name]._option_string_actions)
    with_surface = [name for name in flags if '--surface' in flags[name]]
    assert {'drop', 'study', 'optimise', 'request', 'reorient'} <= set(with_surface)
    assert [name for name in flags if '--surfaces' in flags[name]] == with_surface


@pytest.mark.slow
def test_uncertainty_of_the_file_is_carried_through(run, own):
    words = ('--surfaces', own, '--surface', 'ice', '--drops', '16', '--json')
    ended = run('drop', 'tetrahedron', *words)
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)['model_uncertain'] == list(DRAWS)


@pytest.mark.slow
def test_study_on_an_own_surface_is_continued_without_the_file(run, own, tmp_path):
    words = ['--points', '2', '--drops', '2', '--out', tmp_path / 's']
    given = ['study', 'tetrahedron', '--vary', 'height=20mm:40mm', '--surface', 'ice']
    assert run(*given, '--surfaces', own, *words).returncode == 0
    written = yaml.safe_load((tmp_path / 's' / 'study.yaml').read_text(encoding='utf-8'))
    assert (written['surface'], written['conditions']['friction']) == ('ice', 0.02)
    own.unlink()
    ended = run('study', tmp_path / 's' / 'study.yaml')
    assert ended.returncode == 0, ended.stderr

"""`drop --surroundings`: errors of one line, tables with contacts, and hints for the outcome."""

import json

import pytest

from resting_aspects_ros.simulation.surroundings import surroundings_names


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        (['--surroundings', 'l_chut'], ["'l_chut'", "did you mean 'l_chute'"]),
        (['--surroundings'], surroundings_names()),
        (['--surroundings', 'none.yaml'], ["'none.yaml'", 'does not exist']),
        (['--surroundings', 'slope', '--set', 'angle'], ["'angle'", 'NAME=VALUE']),
        (['--surroundings', 'slope', '--set', 'angle=90deg'], ['angle', '0 to 85 deg']),
        (['--surroundings', 'slope', '--set', 'angle=9mm'], ["'9mm'", 'rad, deg']),
        (['--surroundings', 'slope', '--set', 'angel=9deg'], ["'angel'", "mean 'angle'"]),
        (['--surroundings', 'l_chute', '--set', 'wal.friction=1'], ["'wal'", 'belt, wall']),
        (['--surroundings', 'l_chute', '--set', 'kind=wall'], ['kind', 'another value']),
        (['--surroundings', 'l_chute', '--set', 'belt.speed=3rpm'], ["'3rpm'", 'mm/s']),
        (['--surroundings', 'l_chute', '--set', 'belt.speed=50m/s'], ['m/s of', 'at most']),
        (['--surroundings', 'slope', '--set', 'angle=20'], ['angle 20', '85 deg']),
        (['--surroundings', 'wall', '--set', 'release.y_min=-5mm'], ['-5 mm', 'hull radius']),
        (['--surroundings', 'tray', '--set', 'width=9mm'], ['9 mm between', 'hull radius']),
        (['--surroundings', 'tray', '--set', 'width=90mm'], ['release', 'hull radius']),
        (['--surroundings', 'mesh'], ['mesh', 'missing']),
        (['--surroundings', 'pocket', '--set', 'x=1m'], ['release', 'above the mesh']),
        (['--surroundings', 'pocket', '--set', 'unit=um'], ['unit']),
        (['--set', 'angle=9deg'], ["'angle=9deg'", 'only with --surroundings']),
    ],
    ids=' '.join,
)
def test_invalid_surroundings_are_refused(refused, words, says):
    line = refused('drop', 'tetrahedron', *words)
    for word in says:
        assert word in line


@pytest.mark.slow
def test_a_part_in_a_steep_groove_lies_on_both_of_its_planes(run):
    groove = ['--surroundings', 'v_groove', '--set', 'opening=60deg']
    ended = run('drop', 'box_10x20x30', '--drops', '20', *groove, '--json')
    document = json.loads(ended.stdout)
    outside = ('unclassified', 'unsettled', 'failed', 'lost', 'sliding')
    counted = sum(aspect['count'] for aspect in document['aspects'])
    assert counted + sum(document[name] for name in outside) == 20
    assert document['failed'] == 0
    assert document['contacts']
    for row in document['contacts']:
        assert None not in row['contacts'].values()

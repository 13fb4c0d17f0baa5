"""`drop --surroundings`: errors of one line, tables with contacts, and hints for the outcome."""

import json

import pytest

from resting_aspects_ros.api import conditions
from resting_aspects_ros.errors import InvalidValueError
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


def test_contacts_are_shown_and_every_drop_is_counted(run):
    words = ['drop', 'tetrahedron', '--drops', '20', '--surroundings', 'l_chute', '--json']
    document = json.loads(run(*words).stdout)
    assert document['conditions']['surroundings']['kind'] == 'chute'
    outside = ('unclassified', 'unsettled', 'failed', 'lost', 'sliding')
    counted = sum(aspect['count'] for aspect in document['aspects'])
    assert counted + sum(document[name] for name in outside) == 20
    at_rest = counted + document['unclassified']
    assert sum(row['count'] for row in document['contacts']) == at_rest
    assert {tuple(row['contacts']) for row in document['contacts']} == {('belt', 'wall')}


@pytest.mark.slow
def test_too_steep_a_slope_is_explained(run):
    slope = ['--surroundings', 'slope', '--set', 'angle=20deg']
    lines = run('drop', 'tetrahedron', '--drops', '20', *slope).stdout.splitlines()
    assert (
        'All 20 parts slide or roll until the end: the slope of 20 degrees exceeds the friction '
        'angle of 14 degrees (friction 0.25).'
    ) in ' '.join(line.strip() for line in lines)


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


def test_wedging_is_named_before_the_drops(refused, monkeypatch):
    # The warning ends the command here, so that the drops, which take minutes, do not begin.
    def end(text):
        raise InvalidValueError(text)

    monkeypatch.setattr(conditions, 'warn', end)
    groove = ['--surroundings', 'v_groove', '--set', 'opening=28deg']
    assert 'parts can wedge in the groove' in refused('drop', 'tetrahedron', *groove)


@pytest.mark.slow
def test_lost_parts_are_explained(run):
    track = ['--surroundings', 'bowl_track', '--set', 'width=10mm']
    ended = run('drop', 'tetrahedron', '--drops', '20', *track)
    assert 'All 20 parts are lost: they fell over the edge of the track.' in ended.stdout


@pytest.mark.slow
def test_shapes_on_a_mesh_are_stated(run):
    words = ['drop', 'l_bracket', '--drops', '5', '--surroundings', 'pocket']
    shown = ' '.join(run(*words).stdout.split())
    assert 'The mesh meets the part as 2 convex pieces: at most' in shown
    assert 'The mesh of 28 triangles is simulated as 14 convex prisms, into which the' in shown
    document = json.loads(run(*words, '--json').stdout)
    assert document['convex_pieces']['number'] == 2
    # An L is two boxes; CoACD shifts corners by up to 1e-3 R.
    assert abs(document['convex_pieces']['volume_error']) < 1e-3
    assert document['mesh_surface'] == {
        'triangles': 28,
        'flat_sides': 11,
        'prisms': 14,
        'remaining_triangles': 0,
        'distance': 0.0,
    }


@pytest.mark.slow
def test_shapes_on_a_track_are_stated(run):
    words = ['drop', 'tetrahedron', '--drops', '5', '--surroundings', 'bowl_track']
    assert 'The edge meets the part as 1 convex piece' in ' '.join(run(*words).stdout.split())
    document = json.loads(run(*words, '--json').stdout)
    assert document['convex_pieces']['number'] == 1
    assert 'mesh_surface' not in document

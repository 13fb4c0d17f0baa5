"""Wrong, implausible and contradictory tracks: a clear error, a warning, or a counted outcome."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

import resting_aspects_ros as ra
from resting_aspects_ros.api.track import given_track
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.tracks.description import read_track
from resting_aspects_ros.tracks.traps import AirJet

DROPS = 50
TRACKS = sorted((Path(__file__).parents[2] / 'config' / 'tracks').glob('*.yaml'))


def flags(result):
    return {each['flag']: each['orientations'] for each in result.flags}


def tracked(traps=(), want=(), part='hex_nut', **values):
    on = {'width': '40mm', **values, 'traps': list(traps)}
    return ra.track(part, on, want, drops=DROPS, model_range=False)


def trap(kind, **values):
    return {'width': '40mm', 'traps': [{'kind': kind, **values}]}


@pytest.mark.parametrize(
    ('document', 'says'),
    [
        ({}, 'missing width'),
        ({'width': '40mm', 'wall': {'height': 0}}, 'wall: invalid height 0'),
        ([1], 'expected a mapping'),
        ({'width': '40mm', 'trap': []}, "invalid value 'trap' of a track"),
        (trap('wipe'), "invalid kind of trap 'wipe'"),
        (trap('balcony', width='50mm'), 'width 50 mm of a balcony: expected at most'),
        (trap('canyon', start='45mm', end='50mm'), 'start 45 mm of a canyon'),
        (trap('projection', depth='41mm'), 'depth 41 mm of a projection'),
        (trap('cut_out', points=[[0, 0.05], [0.01, 0.05], [0.01, 0.06]]), 'cuts into the track'),
        (trap('cut_out', points='abc'), "invalid points 'abc'"),
        (trap('cut_out', points=[[0, 0], [0.01, 0], [0.01]]), 'invalid points'),
        (trap('wiper', height='0mm'), 'trap 1: invalid height 0'),
        (trap('wiper', height='12.7 parsecs'), "invalid height '12.7 parsecs'"),
    ],
)
def test_wrong_tracks_are_refused(document, says):
    with pytest.raises(InvalidValueError, match=says):
        read_track(document)


def test_a_track_is_read_with_units_and_written_in_si():
    points = [['0mm', '0mm'], ['30mm', 0], ['30mm', '20mm']]
    traps = [
        {'kind': 'cut_out', 'points': points},
        {'kind': 'air_jet', 'height': 0.005, 'force': '100mN'},
    ]
    track = read_track({'width': '40mm', 'roll': '5deg', 'speed': '50mm/s', 'traps': traps})
    assert track.surface.width == pytest.approx(0.04)
    cut, jet = track.traps
    assert cut.points == ((0, 0), (0.03, 0), (0.03, 0.02))
    assert jet == AirJet(0.005, 0.1)
    assert read_track(track.document) == track


@pytest.mark.parametrize('file', TRACKS, ids=lambda f: f.stem)
def test_shipped_tracks_are_read_and_name_their_source(file):
    document = yaml.safe_load(file.read_text(encoding='utf-8'))
    assert document['source']
    assert read_track(document).traps == given_track(file.stem).traps


@pytest.mark.slow
def test_wanted_rows_that_cannot_be_are_refused():
    for wrong in (0, True, 'a'):
        with pytest.raises(InvalidValueError, match=f'wanted orientation {wrong!r}'):
            tracked(want=wrong)
    # The centre of mass of the flat nut is 8.5 mm from the wall.
    with pytest.raises(InvalidValueError, match=r'wanted orientation 1: .* 8 mm .* 8\.50 mm'):
        tracked(want=1, width='8mm')


@pytest.mark.slow
def test_rows_that_fall_off_or_jam_are_counted():
    found = tracked([{'kind': 'wiper', 'height': '30mm'}], width='9mm')
    assert flags(found)['falls_off'] == [3]  # its centre of mass is 9.8 mm from the wall
    assert found.passage.passing[1].tolist() == [1, 1, 0]
    assert found.passage.ends == ['pass', 'pass', 'reject']
    # The wiper passes what is lower than 10 mm, and the cover holds what is higher than 5 mm.
    traps = [{'kind': 'wiper', 'height': '10mm'}, {'kind': 'hold_down', 'height': '5mm'}]
    found = tracked(traps, want=np.array([1]))
    assert found.passage.good == (0, 0)
    assert found.passage.jams == pytest.approx(found.rows[0].probability)
    assert found.document()['passes_per_part'] == [None, None]
    assert any('No part in row 1' in text and 'Trap 2' in text for text in found.sentences)


@pytest.mark.slow
def test_dimensions_in_a_wrong_unit_are_warned_of():
    with pytest.warns(ra.RestingAspectsWarning, match='1000 mm.*numbers without a unit are in m'):
        tracked([{'kind': 'wiper', 'height': 1}])
    with pytest.warns(ra.RestingAspectsWarning, match=r'0\.0127 mm'):
        tracked([{'kind': 'wiper', 'height': 12.7e-6}])


@pytest.mark.slow
def test_a_wall_that_is_lower_than_all_but_the_foot_of_a_part(solid):
    # A pin of 2 mm below a plate of 20 x 20 mm, which tips over no wall above 0.
    pin = trimesh.creation.cylinder(radius=8, height=10)
    plate = trimesh.creation.box((30, 30, 4)).apply_translation((0, 0, 7))
    mesh = trimesh.boolean.union([pin, plate])
    found = tracked(part=solid(mesh), wall={'height': '2mm'}, width='60mm')
    # It stands on its pin, whose outline at the wall is round: one row.
    standing = [row for row in found.rows if row.contact.area > 0.9 * 3.14 * 0.008**2]
    assert min(row.yaw.distance for row in standing) == pytest.approx(0.008, rel=0.02)


def test_the_number_of_simulated_parts_is_checked():
    for wrong in (-1, 1.5, True, 10**9):
        with pytest.raises(InvalidValueError, match='number of simulated parts'):
            ra.track('hex_nut', {'width': '40mm'}, simulate=wrong)

"""Wrong, implausible and contradictory tracks: a clear error, a warning, or a counted outcome."""

from pathlib import Path

import pytest
import yaml

import resting_aspects_ros as ra
from resting_aspects_ros.api.track import given_track
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.tracks.description import read_track
from resting_aspects_ros.tracks.rate import pass_traps
from resting_aspects_ros.tracks.traps import AirJet

TRACKS = sorted((Path(__file__).parents[2] / 'config' / 'tracks').glob('*.yaml'))


def tracked(traps, width='40mm'):
    on = {'width': width, 'traps': traps}
    return ra.track('hex_nut', on, 1, drops=50, model_range=False)


def trap(kind, **values):
    return {'width': '40mm', 'traps': [{'kind': kind, **values}]}


@pytest.mark.parametrize(
    ('document', 'says'),
    [
        ({'width': '40mm', 'wall': {'height': 0}}, 'wall: invalid height 0'),
        ({'width': '40mm', 'trap': []}, "invalid value 'trap' of a track"),
        (trap('wipe'), "invalid kind of trap 'wipe'"),
        (trap('balcony', width='50mm'), 'width 50 mm of a balcony: expected at most'),
        (trap('cut_out', points=[[0, 0.05], [0.01, 0.05], [0.01, 0.06]]), 'cuts into the track'),
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


def test_wanted_rows_that_cannot_be_are_refused(part, rows_of):
    nut = part('hex_nut')
    rows = rows_of(nut)
    for wrong in (9, True, 'a'):
        with pytest.raises(InvalidValueError, match=f'wanted orientation {wrong!r}'):
            pass_traps(nut, rows, read_track({'width': '40mm'}), [wrong])
    # The centre of mass of the flat nut is 8.5 mm from the wall.
    with pytest.raises(InvalidValueError, match=r'wanted orientation 1: .* 8 mm .* 8\.50 mm'):
        pass_traps(nut, rows, read_track({'width': '8mm'}), [1])


@pytest.mark.slow
def test_rows_that_fall_off_before_the_traps_are_counted():
    found = tracked([{'kind': 'wiper', 'height': '30mm'}], width='9mm')
    # The centre of mass of the third row is 9.8 mm from the wall.
    assert {each['flag']: each['orientations'] for each in found.flags}['falls_off'] == [3]
    assert found.passage.passing[1].tolist() == [1, 1, 0]
    assert found.passage.ends == ['pass', 'pass', 'reject']


@pytest.mark.slow
def test_contradictory_traps_let_nothing_pass():
    """The cover holds what the wiper passes; a wiper of a meter is probably meant in mm."""
    traps = [{'kind': 'wiper', 'height': '10mm'}, {'kind': 'hold_down', 'height': '5mm'}]
    with pytest.warns(ra.RestingAspectsWarning, match='1000 mm.*numbers without a unit are in m'):
        found = tracked([*traps, {'kind': 'wiper', 'height': 1}])
    on = found.passage
    assert on.good == on.rate == (0, 0)
    assert on.jams == pytest.approx(found.rows[0].probability)
    assert on.returned == pytest.approx([on.arrivals * (1 - on.jams)] * 2)
    assert found.document()['passes_per_part'] == [None, None]
    assert any('No part in row 1' in text and 'Trap 2' in text for text in found.sentences)


def test_the_number_of_simulated_parts_is_checked():
    for wrong in (-1, 1.5, 10**9):
        with pytest.raises(InvalidValueError, match='number of simulated parts'):
            ra.track('hex_nut', {'width': '40mm'}, simulate=wrong)

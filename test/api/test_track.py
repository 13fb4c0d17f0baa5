"""The public functions of a track: documents, actions before the traps, runs, designs, errors."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.track import given_track
from resting_aspects_ros.tracks.description import read_track
from resting_aspects_ros.tracks.traps import AirJet

NUT = {'width': '40mm', 'roll': '5deg', 'speed': '300mm/s', 'fill': 0.5}
WIPER = {'kind': 'wiper', 'height': '12.7mm'}
FEW = {'drops': 20, 'model_range': False}


@pytest.fixture(scope='module')
def simulated():
    return ra.track('hex_nut', {**NUT, 'traps': [WIPER]}, 1, drops=100, simulate=1)


@pytest.mark.slow
def test_numbers_of_a_document_follow_from_each_other(simulated):
    document = json.loads(simulated.to_json())
    (trap,) = document['traps']
    assert document['simulated']['parts'] == 1
    for row, result in zip(document['orientations'], trap['results'], strict=True):
        assert result['id'] == row['id']
        assert result['margin'] == pytest.approx(trap['height'] - result['critical'])
        assert row['lower'] <= row['probability'] <= row['upper']
        assert row['wall_low'] <= row['probability'] <= row['wall_high']
        assert row['model_lower'] <= row['wall_low'] <= row['wall_high'] <= row['model_upper']
        counts = result['simulated']
        assert sum(counts[name] for name in ('pass', 'turn', 'reject', 'jam')) == 1
        assert counts['pass'] == (result['outcome'] == 'pass')
        assert 0 <= counts['lower'] <= counts['pass'] <= counts['upper'] <= 1
    flat = document['orientations'][0]
    good = flat['probability']
    assert document['model_efficiency'] == [flat['model_lower'], flat['model_upper']]
    model = simulated.drop.distribution.model.by_aspect[np.array(flat['aspects']) - 1]
    assert flat['model_upper'] == pytest.approx(min(model[:, 1].sum(), 1))
    assert document['efficiency'] == pytest.approx([good, good])
    assert document['passes_per_part'] == pytest.approx([1 / good, 1 / good])
    length = sum(row['probability'] * row['length'] for row in document['orientations'])
    assert document['arrivals'] == pytest.approx(60 * 0.3 * 0.5 / length)
    assert document['rate'] == pytest.approx([good * document['arrivals']] * 2)
    returned = document['returned_per_minute']
    assert np.add(document['rate'], returned[::-1]) == pytest.approx([document['arrivals']] * 2)


@pytest.mark.slow
def test_csv_has_each_row(simulated, tmp_path):
    simulated.save_csv(tmp_path / 'rows.csv')
    with (tmp_path / 'rows.csv').open(encoding='utf-8') as file:
        lines = list(csv.DictReader(file))
    assert [int(line['id']) for line in lines] == [row.id for row in simulated.rows]
    assert [line['trap_1_outcome'] for line in lines] == ['pass', 'reject', 'reject']
    assert [float(line['trap_1_simulated']) for line in lines] == [1, 0, 0]


@pytest.mark.slow
def test_simulated_parts_do_not_depend_on_the_workers():
    # Of some rows, only some parts pass this balcony.
    track, reported = {**NUT, 'traps': [{'kind': 'balcony', 'width': '8mm'}]}, []
    given = {**FEW, 'simulate': 3, 'progress': lambda *found: reported.append(found)}
    one, two = (ra.track('hex_nut', track, 1, workers=n, **given) for n in (1, 2))
    assert one.runs.counts.tolist() == two.runs.counts.tolist()
    # 3 parts in each of 3 rows, after the drops.
    assert reported[-1] == (9, 9)


@pytest.mark.slow
def test_interrupted_runs_leave_a_result_that_is_not_complete():
    options = {'simulate': 2, 'stopped': lambda: True, **FEW}
    stopped = ra.track('hex_nut', {**NUT, 'traps': [WIPER]}, 1, **options)
    assert not stopped.complete
    assert stopped.runs is None
    design = ra.design_track('hex_nut', 1, traps=1, **options)
    assert not design.complete
    assert design.runs is None


def test_an_unknown_action_is_refused_before_the_drops():
    with pytest.raises(ra.InvalidValueError, match="'shake'"):
        ra.track('t_prism', {'width': '60mm'}, before=['shake'], progress=pytest.fail)


@pytest.mark.slow
def test_an_action_before_the_traps_changes_the_shares():
    acted = ra.track('t_prism', {'width': '60mm'}, drops=300, before=['toss'])
    (action,) = acted.before
    counts = ra.drop('t_prism', 300, model_range=False).distribution.counts
    expected = counts / counts.sum() @ action.matrix.transitions
    for k, share in enumerate(expected, 1):
        found = sum(row.probability for row in acted.rows if row.aspects == (k,))
        assert found <= share + 1e-9
    assert sum(row.probability for row in acted.rows) == pytest.approx(expected.sum())
    assert acted.document()['before'][0]['action'] == 'toss'
    assert acted.drop.range_text in acted.sentences  # why there is no model range


@pytest.mark.slow
def test_a_sensor_passes_what_it_identifies():
    sensor = {'kind': 'sensor', 'spacing': '5mm'}
    found = ra.track('hex_nut', {**NUT, 'traps': [sensor]}, 1, **FEW)
    assert [each.share for each in found.passage.outcomes[0]] == [1, 0, 0]
    assert found.passage.model_good is None


@pytest.mark.slow
def test_a_design_tells_what_it_does_not_separate_and_what_would():
    designed = ra.design_track('l_bracket', 1, drops=50, model_range=False)
    designs = designed.design.designs
    assert designs[0].margin == max(each.margin for each in designs)
    assert any('cut-out' in text or 'camera' in text for text in designed.advice)
    document = json.loads(designed.to_json())['design']
    assert len(document['proposals']) == len(designs)
    # A mirror image is another row, and pure only if it is wanted, too.
    assert document['alike'] == list(designed.alike) == [1, 2]
    assert designed.rows[0].aspects != designed.rows[1].aspects
    one, other = (row.probability for row in designed.rows[:2])
    assert designed.passage.purity == pytest.approx([one / (one + other)] * 2)
    assert replace(designed.passage, wanted=(1, 2)).purity == pytest.approx((1, 1))


@pytest.mark.slow
def test_proposed_traps_find_a_place_after_many_of_ones_own():
    traps = [{'kind': 'wiper', 'height': '40mm'}] * 19
    found = ra.design_track('hex_nut', 2, {**NUT, 'traps': traps}, **FEW)
    assert len(found.passage.track.traps) == 20


@pytest.mark.slow
def test_without_a_design_other_rows_are_named():
    # Row 1 passes each trap that row 3 passes.
    found = ra.design_track('hex_nut', 3, **FEW)
    assert not found.design.designs
    assert any('No set of traps' in text for text in found.advice)
    assert any('these wanted rows' in text for text in found.advice)


# -- wrong, implausible and contradictory tracks -------------------------------------------------


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
    with pytest.raises(ra.InvalidValueError, match=says):
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


@pytest.mark.parametrize('name', ['bracket_on_its_side', 'camera_and_jet', 'wiper_and_balcony'])
def test_shipped_tracks_are_read(name):
    assert given_track(name).traps


def test_wanted_rows_that_cannot_be_are_refused():
    for wrong in (9, True, 'a'):
        with pytest.raises(ra.InvalidValueError, match=f'wanted orientation {wrong!r}'):
            ra.track('hex_nut', NUT, [wrong], **FEW)
    # The centre of mass of the flat nut is 8.5 mm from the wall.
    with pytest.raises(ra.InvalidValueError, match=r'wanted orientation 1: .* 8 mm .* 8\.50 mm'):
        ra.track('hex_nut', {'width': '8mm'}, 1, **FEW)


@pytest.mark.slow
def test_rows_that_fall_off_before_the_traps_are_counted():
    harmless = {'kind': 'wiper', 'height': '30mm'}
    found = ra.track('hex_nut', {'width': '9mm', 'traps': [harmless]}, 1, **FEW)
    # The centre of mass of the third row is 9.8 mm from the wall.
    assert {each['flag']: each['orientations'] for each in found.flags}['falls_off'] == [3]
    assert found.passage.passing[1].tolist() == [1, 1, 0]
    assert found.passage.ends == ['pass', 'pass', 'reject']


@pytest.mark.slow
def test_contradictory_traps_let_nothing_pass():
    """The cover holds what the wiper passes; a wiper of a meter is probably meant in mm."""
    kinds = {'wiper': '10mm', 'hold_down': '5mm'}
    traps = [{'kind': kind, 'height': height} for kind, height in kinds.items()]
    traps.append({'kind': 'wiper', 'height': 1})
    with pytest.warns(ra.RestingAspectsWarning, match='1000 mm.*numbers without a unit are in m'):
        found = ra.track('hex_nut', {**NUT, 'traps': traps}, 1, **FEW)
    on = found.passage
    assert on.good == on.rate == (0, 0)
    assert on.jams == pytest.approx(found.rows[0].probability)
    assert on.returned == pytest.approx([on.arrivals * (1 - on.jams)] * 2)
    assert found.document()['passes_per_part'] == [None, None]
    assert any('No part in row 1' in text and 'Trap 2' in text for text in found.sentences)


def test_the_number_of_simulated_parts_is_checked():
    for wrong in (-1, 1.5, 10**9):
        with pytest.raises(ra.InvalidValueError, match='number of simulated parts'):
            ra.track('hex_nut', {'width': '40mm'}, simulate=wrong)

"""The public functions of a track: documents, actions before the traps, runs, designs."""

import csv
import json

import numpy as np
import pytest

import resting_aspects_ros as ra
import resting_aspects_ros.tracks.design

NUT = {'width': '40mm', 'roll': '5deg', 'speed': '300mm/s'}
WIPER = {'kind': 'wiper', 'height': '12.7mm'}
ROW_KEYS = {
    'id', 'aspects', 'orientation', 'yaw', 'probability', 'lower', 'upper', 'wall_low',
    'wall_high', 'model_lower', 'model_upper', 'com_to_wall', 'com_height', 'height', 'length',
    'lever', 'alike',
}  # fmt: skip
KEYS = {
    'schema_version', 'part', 'track', 'orientations', 'traps', 'efficiency', 'purity', 'rate',
    'passes_per_part', 'returned_per_minute', 'flags',
}  # fmt: skip


@pytest.fixture(scope='module')
def simulated():
    return ra.track('hex_nut', {**NUT, 'traps': [WIPER]}, 1, drops=100, simulate=3)


@pytest.fixture(scope='module')
def designed():
    return ra.design_track('l_bracket', 1, drops=200)


@pytest.mark.slow
def test_document_has_what_its_reference_names(simulated):
    document = json.loads(simulated.to_json())
    assert set(document) >= KEYS
    assert all(set(row) >= ROW_KEYS for row in document['orientations'])
    (trap,) = document['traps']
    for row, result in zip(document['orientations'], trap['results'], strict=True):
        assert result['id'] == row['id']
        assert result['outcome'] in ('pass', 'reject')
        assert result['margin'] == pytest.approx(trap['height'] - result['critical'])
        assert row['lower'] <= row['probability'] <= row['upper']
        assert row['wall_low'] <= row['probability'] <= row['wall_high']
        assert row['model_lower'] <= row['wall_low'] <= row['wall_high'] <= row['model_upper']


@pytest.mark.slow
def test_numbers_of_a_document_follow_from_each_other(simulated):
    document = json.loads(simulated.to_json())
    good = document['orientations'][0]['probability']
    assert document['efficiency'] == pytest.approx([good, good])
    assert document['passes_per_part'] == pytest.approx([1 / good, 1 / good])
    low, high = document['rate']
    returned = document['returned_per_minute']
    assert np.add([low, high], returned[::-1]) == pytest.approx([document['arrivals']] * 2)


@pytest.mark.slow
def test_model_range_of_a_row_is_that_of_its_aspects(simulated):
    flat = simulated.rows[0]
    assert flat.yaw.low == 1  # with any friction of the wall
    model = simulated.drop.distribution.model.by_aspect[np.array(flat.aspects) - 1]
    assert flat.model == pytest.approx(np.minimum(model.sum(axis=0), 1))
    assert simulated.passage.model_good == pytest.approx(flat.model)
    assert simulated.drop.range_text in simulated.sentences


@pytest.mark.slow
def test_rows_without_model_range_say_why():
    exact = ra.track('hex_nut', NUT, 1, drops=20, model_range=False)
    acted = ra.track('hex_nut', NUT, 1, drops=20, before=['tap'])
    assert (exact.passage.model_good, acted.passage.model_good) == (None, None)
    assert exact.drop.range_text == ''
    assert acted.document()['no_model_range']
    assert acted.drop.range_text in acted.sentences


@pytest.mark.slow
def test_simulated_parts_stand_beside_the_static_outcomes(simulated):
    document = json.loads(simulated.to_json())
    assert document['simulated']['parts'] == 3
    (trap,) = document['traps']
    for result in trap['results']:
        counts = result['simulated']
        assert sum(counts[name] for name in ('pass', 'turn', 'reject', 'jam')) == 3
        assert 0 <= counts['lower'] <= counts['pass'] / 3 <= counts['upper'] <= 1
    assert trap['results'][0]['simulated']['pass'] == 3
    assert any('simulated parts' in text for text in simulated.sentences)


@pytest.mark.slow
def test_simulated_parts_are_repeated_by_the_seed_for_any_number_of_workers():
    track, reported = {**NUT, 'traps': [{'kind': 'balcony', 'width': '9mm'}]}, []
    given = {'drops': 50, 'model_range': False, 'simulate': 7}
    given['progress'] = lambda *found: reported.append(found)
    one, three = (ra.track('hex_nut', track, 1, workers=n, **given) for n in (1, 3))
    assert one.runs.counts.tolist() == three.runs.counts.tolist()
    # 7 parts in each of 3 rows, after the drops.
    assert reported[-1] == (21, 21)


@pytest.mark.slow
def test_interrupted_runs_leave_a_result_that_is_not_complete():
    given = {'drops': 50, 'model_range': False}
    assert ra.track('hex_nut', {**NUT, 'traps': [WIPER]}, 1, **given).complete
    stopped = ra.track(
        'hex_nut', {**NUT, 'traps': [WIPER]}, 1, simulate=2, stopped=lambda: True, **given
    )
    assert not stopped.complete
    assert stopped.runs is None


def test_an_unknown_action_is_refused_before_the_drops():
    made = []
    with pytest.raises(ra.InvalidValueError, match="'shake'"):
        ra.track(
            't_prism',
            {'width': '60mm'},
            before=['shake'],
            progress=lambda *found: made.append(found),
        )
    assert not made


@pytest.mark.slow
def test_an_action_before_the_traps_changes_the_shares_by_its_matrix():
    acted = ra.track('t_prism', {'width': '60mm'}, drops=300, before=['toss'])
    (action,) = acted.before
    counts = ra.drop('t_prism', 300, model_range=False).distribution.counts
    expected = counts / counts.sum() @ action.matrix.transitions
    for k, share in enumerate(expected, 1):
        found = sum(row.probability for row in acted.rows if row.aspects == (k,))
        assert found <= share + 1e-9
    assert sum(row.probability for row in acted.rows) == pytest.approx(expected.sum())
    assert acted.document()['before'][0]['action'] == 'toss'
    assert 'toss' in acted.title


@pytest.mark.slow
def test_a_sensor_passes_what_it_identifies():
    sensor = {'kind': 'sensor', 'spacing': '5mm'}
    found = ra.track('hex_nut', {**NUT, 'traps': [sensor]}, 1, drops=100, model_range=False)
    assert [each.share for each in found.passage.outcomes[0]] == [1, 0, 0]


@pytest.mark.slow
def test_csv_has_a_line_for_each_row(simulated, tmp_path):
    simulated.save_csv(tmp_path / 'rows.csv')
    with (tmp_path / 'rows.csv').open(encoding='utf-8') as file:
        lines = list(csv.DictReader(file))
    assert [int(line['id']) for line in lines] == [row.id for row in simulated.rows]
    assert [line['trap_1_outcome'] for line in lines] == ['pass', 'reject', 'reject']
    assert [float(line['trap_1_simulated']) for line in lines] == [1, 0, 0]
    assert set(lines[0]) >= ROW_KEYS


@pytest.mark.slow
def test_page_has_rows_track_and_flow(simulated, tmp_path):
    page = simulated.report(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} >= {
        'track.html', 'orientations.png', 'track.png', 'flow.png',
    }  # fmt: skip
    text = page.read_text(encoding='utf-8')
    assert '<svg' in text
    for row in simulated.rows:
        assert f'{100 * row.probability:.1f} %' in text


@pytest.mark.slow
def test_a_design_tells_what_it_does_not_separate_and_what_would(designed):
    assert designed.designs
    assert designed.best.margin == max(each.margin for each in designed.designs)
    one, other = designed.alike
    assert 1 in (one, other)
    assert any('cut-out' in text or 'camera' in text for text in designed.advice)
    document = json.loads(designed.to_json())
    assert len(document['design']['proposals']) == len(designed.designs)
    assert document['design']['alike'] == list(designed.alike)


@pytest.mark.slow
def test_proposed_traps_find_a_place_after_many_of_ones_own():
    harmless, given = {'kind': 'wiper', 'height': '40mm'}, {'drops': 20, 'model_range': False}
    found = ra.design_track('hex_nut', 2, {**NUT, 'traps': [harmless] * 19}, **given)
    assert len(found.best.passage.track.traps) <= 20
    with pytest.raises(ra.InvalidValueError, match='20'):
        ra.design_track('hex_nut', 2, {**NUT, 'traps': [harmless] * 20}, **given)


@pytest.mark.slow
def test_without_a_design_other_rows_are_named():
    # Four rows of the prism pass each trap that row 4 passes.
    found = ra.design_track('t_prism', 4, drops=100, model_range=False)
    assert not found.designs
    assert found.best is found.bare
    assert found.best.passage.wanted == (4,)
    assert any('No set of traps' in text for text in found.advice)
    assert any('these wanted rows' in text for text in found.advice)


@pytest.mark.slow
def test_rows_in_which_hardly_a_part_arrives_are_summed_up_in_tables_but_not_in_files(tmp_path):
    found = ra.track('washer', {**NUT, 'traps': [WIPER]}, drops=20, model_range=False)
    assert [row.probability for row in found.rows] == pytest.approx([1, 0, 0])
    assert [len(table.rows) for table in found.tables()] == [1, 1]
    assert '2 other rows are not shown, with 0.0 % of the parts' in found.tables()[0].caption
    assert len(json.loads(found.to_json())['orientations']) == 3
    found.save_csv(tmp_path / 'rows.csv')
    assert len((tmp_path / 'rows.csv').read_text().splitlines()) == 4
    assert len(ra.track('washer', NUT, [2], drops=20, model_range=False).tables()[0].rows) == 2


@pytest.mark.slow
def test_an_interrupted_design_is_not_complete():
    stopped = ra.design_track(
        'hex_nut', 1, drops=50, model_range=False, simulate=2, stopped=lambda: True
    )
    assert not stopped.complete
    assert stopped.best.runs is None

"""The public functions of a track: documents, actions before the traps, runs, designs."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import resting_aspects_ros as ra

NUT = {'width': '40mm', 'roll': '5deg', 'speed': '300mm/s'}
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
    good = document['orientations'][0]['probability']
    assert document['efficiency'] == pytest.approx([good, good])
    assert document['passes_per_part'] == pytest.approx([1 / good, 1 / good])
    returned = document['returned_per_minute']
    assert np.add(document['rate'], returned[::-1]) == pytest.approx([document['arrivals']] * 2)


@pytest.mark.slow
def test_model_range_of_a_row_is_that_of_its_aspects(simulated):
    flat = simulated.rows[0]
    assert flat.yaw.low == 1  # with any friction of the wall
    model = simulated.drop.distribution.model.by_aspect[np.array(flat.aspects) - 1]
    assert flat.model == pytest.approx(np.minimum(model.sum(axis=0), 1))
    assert simulated.passage.model_good == pytest.approx(flat.model)
    assert simulated.drop.range_text in simulated.sentences


@pytest.mark.slow
def test_csv_and_page_have_each_row(simulated, tmp_path):
    simulated.save_csv(tmp_path / 'rows.csv')
    with (tmp_path / 'rows.csv').open(encoding='utf-8') as file:
        lines = list(csv.DictReader(file))
    assert [int(line['id']) for line in lines] == [row.id for row in simulated.rows]
    assert [line['trap_1_outcome'] for line in lines] == ['pass', 'reject', 'reject']
    assert [float(line['trap_1_simulated']) for line in lines] == [1, 0, 0]
    page = simulated.report(tmp_path)
    names = {'track.html', 'orientations.png', 'track.png', 'flow.png'}
    assert {file.name for file in tmp_path.iterdir()} >= names
    text = page.read_text(encoding='utf-8')
    for row in simulated.rows:
        assert f'{100 * row.probability:.1f} %' in text


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


@pytest.mark.slow
def test_rare_rows_are_summed_up_in_tables_but_not_in_files():
    found = ra.track('washer', {**NUT, 'traps': [WIPER]}, **FEW)
    assert [row.probability for row in found.rows] == pytest.approx([1, 0, 0])
    assert [len(table.rows) for table in found.tables()] == [1, 1]
    assert '2 other rows are not shown, with 0.0 % of the parts' in found.tables()[0].caption
    assert len(found.document()['orientations']) == 3
    assert len(ra.track('washer', NUT, [2], **FEW).tables()[0].rows) == 2

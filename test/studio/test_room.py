"""A room: the latest change wins, results are shown, and nothing is left behind."""

import functools
import json
import re
import threading
import warnings

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.errors import InvalidValueError, StoppedError
from resting_aspects_ros.studies.calibration.counts_file import make_surface_counts
from resting_aspects_ros.studio import tabs
from resting_aspects_ros.studio.export import drop_recipe
from resting_aspects_ros.studio.opening import Opener
from resting_aspects_ros.studio.room import KEPT, collected_warnings, route_warnings
from resting_aspects_ros.studio.rows import Source, pickable_text
from resting_aspects_ros.studio.settings import TRAP_KINDS, Settings, changed, trap_sliders
from resting_aspects_ros.studio.tabs import BOTH_DIFFER, PENDING, TABS
from resting_aspects_ros.tracks.traps import Wiper


def complete(message):
    return bool(message.get('caption'))


def drops(**values):
    return ra.drop('l_bracket', 400, **values).distribution


def test_bars_are_those_of_the_function(bracket, shown):
    *earlier, rows = [m['rows'] for m in shown.of('bars') if m['rows']]
    expected = drops()
    counts = [int(row['count'].partition(' ')[0]) for row in rows]
    assert counts[:5] == expected.counts.tolist()
    assert counts[5:] == [expected.unclassified, expected.unsettled, expected.failed, 0, 0]
    # On a fixed scale: the length of a bar is the share.
    shares = 100 * expected.counts / 400
    assert [row['bar'][0] for row in rows[:5]] == pytest.approx(shares.tolist(), abs=0.01)
    assert [row['hidden'] for row in rows[5:]] == [False, False, True, True, True]
    # The place of the model range is kept while it is made.
    assert earlier
    assert {row['range'] for each in earlier for row in each[:5]} == {PENDING}
    assert all(row['range'].endswith(' %') and row['model'] for row in rows[:5])


def test_latest_of_many_changes_wins_without_a_queue(bracket, shown):
    before = len(shown.messages)
    for k in range(1, 501):
        bracket.change('condition.friction', f'{k / 1000}')
    done = shown.wait('bars', lambda m: complete(m) and 'friction 0.5' in m['caption'], before)
    expected = [f'{count} of 400' for count in drops(friction=0.5).counts]
    assert [row['count'] for row in done['rows'][:5]] == expected
    # Far fewer runs than changes.
    runs = [m for m in shown.of('bars') if complete(m)]
    assert len(runs) < 250
    assert len(bracket._results) <= KEPT


def test_without_live_changes_wait(bracket, shown):
    bracket.change('live', False)
    before = len(shown.messages)
    bracket.change('condition.friction', '0.7')
    assert shown.wait('progress', lambda m: 'Drop now' in m['text'], before)
    assert not shown.of('bars', before)
    bracket.work_now()
    assert 'friction 0.7' in shown.wait('bars', complete, before)['caption']
    bracket.change('more', True)
    assert shown.wait('bars', lambda m: complete(m) and '1600 drops' in m['caption'], before)


def test_pickable_share_is_that_of_the_classes_together(bracket, shown):
    before = len(shown.messages)
    bracket.change('pickable.1', True)
    bracket.change('pickable.3', True)
    distribution = drops()
    text = pickable_text(distribution, frozenset({1, 3}))
    share = distribution.counts[[0, 2]].sum() / 400
    assert float(text.partition(' ')[0]) == pytest.approx(100 * share, abs=0.1)
    shown.wait('bars', lambda m: m.get('pickable') == text, before)
    with pytest.raises(InvalidValueError, match='1 to 5'):
        bracket.change('pickable.6', True)


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize('tab', TABS)
def test_each_tab_shows_something(bracket, shown, tab):
    bracket.change('pickable.1', True)
    bracket.change('count.1', '30')
    bracket.change('trap.add', 'wiper')
    before = len(shown.messages)
    bracket.change('tab', tab)
    if tab != 'aspects':
        assert len(shown.wait(tab, after=before)['html']) > 100
    assert not any(message['text'] for message in shown.of('problem'))


def test_broken_file_leaves_the_old_part(bracket, shown, tmp_path):
    path = tmp_path / 'part.stl'
    mesh = trimesh.creation.box((10, 20, 30))
    mesh.update_faces(np.arange(len(mesh.faces)) > 1)
    mesh.export(path)
    before = len(shown.messages)
    bracket.open(Source('my crate.stl', path))
    problem = shown.wait('problem', lambda m: m['text'], before)['text']
    assert 'my crate.stl' in problem
    assert str(tmp_path) not in problem
    assert not shown.of('part', before)
    bracket.change('condition.friction', '0.3')
    assert 'friction 0.3' in shown.wait('bars', complete, before)['caption']


def test_trap_of_each_kind_can_be_added_changed_and_removed():
    for kind in TRAP_KINDS:
        added = changed(Settings(), 'trap.add', kind)
        (trap,) = added.rail.traps
        ((_, _, dimensions),) = trap_sliders(added.rail)
        for each in dimensions:
            assert changed(added, each.name, each.value).rail.traps == (trap,)
        two = changed(added, 'trap.add', 'wiper')
        higher = changed(two, 'trap.2.height', '12.5').rail.traps
        assert higher == (trap, Wiper(0.0125))
        assert changed(two, 'trap.remove', '1').rail.traps == (Wiper(0.01),)
        assert changed(added, 'trap.remove', '1').rail.traps is None
        listed = json.dumps([each.document for each in higher])
        assert changed(Settings(), 'trap.all', listed).rail.traps == higher


@pytest.mark.slow
def test_second_part_is_compared_by_shape(bracket, shown):
    bracket.change('surface', 'steel')
    bracket.change('tab', 'compare')
    shown.wait('compare')
    before = len(shown.messages)
    bracket.open(Source('angle_45x30x8'), 'second')
    html = shown.wait('compare', lambda m: 'angle_45x30x8' in m['html'], before)['html']
    assert html.count('drops on steel') == 2
    assert BOTH_DIFFER not in html
    before = len(shown.messages)
    bracket.change('other.surface', 'rubber_mat')
    shown.wait('compare', lambda m: BOTH_DIFFER in m['html'], before)
    assert bracket.work().opened.part.name == 'l_bracket'


def test_counts_by_hand_are_compared_as_the_command_does(bracket, shown, tmp_path):
    counts = {'1': 80, '2': 10, '3': 5, '4': 3, '5': 2, 'unclassified': 1}
    for name, number in counts.items():
        bracket.change(f'count.{name}', str(number))
    bracket.change('tab', 'counts')
    html = shown.wait('counts', lambda m: 'verdict' in m['html'])['html']
    path = tmp_path / 'counts.csv'
    lines = [f'{name},{number}' for name, number in counts.items()]
    path.write_text('\n'.join(['class,count', *lines]) + '\n')
    found = ra.compare(ra.drop('l_bracket', 400), path)
    assert f'{100 * abs(found.comparison.largest_deviation):.1f}' in html


def test_warnings_are_those_of_the_own_thread(monkeypatch):
    monkeypatch.setattr(warnings, 'showwarning', lambda *_, **__: None)
    with warnings.catch_warnings():
        route_warnings()
        with collected_warnings() as notes:
            warn = functools.partial(warnings.warn, category=ra.RestingAspectsWarning)
            other = threading.Thread(target=warn, args=('other',))
            other.start()
            other.join()
            warn('own')
    assert notes == ['own']


@pytest.mark.slow
def test_part_is_opened_in_a_process_that_can_be_cancelled(tmp_path):
    opener, steps, path = Opener(), [], tmp_path / 'part.stl'
    path.write_bytes(b'nothing')
    try:
        opened = opener.open(Source('tetrahedron'), steps.append, lambda: False)
        assert opened.part.part_sha256 == ra.load_part('tetrahedron').part_sha256
        assert len(steps) == 3
        with pytest.raises(ra.PartError, match=re.escape('other name.stl')):
            opener.open(Source('other name.stl', path), steps.append, lambda: False)
        with pytest.raises(StoppedError):
            opener.open(Source('hex_nut'), steps.append, lambda: True)
    finally:
        opener.end()
    assert opener._ready is None


def test_body_of_a_file_is_chosen_from_a_list(bracket, shown, tmp_path, monkeypatch):
    path = tmp_path / 'part.stl'
    small = trimesh.creation.box((5, 6, 7)).apply_translation((50, 0, 0))
    trimesh.util.concatenate([trimesh.creation.box((10, 20, 30)), small]).export(path)
    before = len(shown.messages)
    bracket.open(Source('two.stl', path))
    problem = shown.wait('problem', lambda m: m['text'], before)['text']
    assert problem.endswith('(1: 10 x 20 x 30 mm, 2: 5 x 6 x 7 mm): choose one.')
    assert shown.of('first')[-1]['bodies'][2] == '2: 5 x 6 x 7 mm'
    bracket.open_again('body', 2)
    assert shown.wait('part', after=before)['name'] == 'two'
    bracket.open_again('unit', 'cm')
    assert shown.wait('part', lambda m: '50 x 60 x 70 mm' in m['facts'], before)
    offered = shown.of('first')[-1]
    assert (len(offered['bodies']), offered['body'], offered['unit']) == (3, 2, 'cm')
    work = bracket.work()
    recipe = drop_recipe(work.opened.source, work.settings)
    assert '--unit cm --body 2' in recipe.line
    assert "unit='cm', body=2" in recipe.python
    with pytest.raises(InvalidValueError):
        bracket.open_again('body', '2')
    # The counts are those of this body.
    bracket.change('count.1', '8')
    monkeypatch.setattr(tabs, 'calibrate', lambda counts, **_: counts)
    counted = make_surface_counts(tabs._fitted(bracket.work()), tmp_path).parts[0]
    assert counted.part.part_sha256 == work.opened.part.part_sha256


@pytest.mark.slow
def test_a_second_part_that_is_still_read_is_forgotten(bracket, shown, monkeypatch):
    started, go_on = threading.Event(), threading.Event()
    read = bracket._opener.open

    def slow(source, step, stopped):
        step('Reading ...')
        started.set()
        go_on.wait()
        return read(source, step, stopped)

    monkeypatch.setattr(bracket._opener, 'open', slow)
    before = len(shown.messages)
    bracket.open(Source('angle_45x30x8'), 'second')
    started.wait()
    bracket.forget_second()
    go_on.set()
    shown.wait('opening', lambda m: not m['text'], before)
    bracket.change('tab', 'compare')
    shown.wait('compare', after=before)
    assert bracket._parts['second'] is None
    assert shown.of('opening')[-1] == {'text': ''}

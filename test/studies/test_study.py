"""Studies: resumed, extended, repeated bit for bit, and refused where they do not fit."""

import errno
import html
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.errors import EngineError, InvalidValueError, OutputError
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.studies.design import Factor, Setting
from resting_aspects_ros.studies.effects import FRESH_DROPS
from resting_aspects_ros.studies.points import STORE, Case, PointStore
from resting_aspects_ros.studies.study import (
    SPEC,
    StudyResult,
    StudySpec,
    read_spec,
    run_study,
    study,
)

VERSIONS = {'numpy': '1', 'pybullet': '2'}
VARY = {'restitution': '0.1:0.4:2', 'friction': '0.2:0.5:2'}


def run(out=None, **changes):
    given = {'parts': ['tetrahedron'], 'vary': VARY, 'points': 4, 'drops': 630, 'height': 0.03}
    return study(**{**given, **changes}, out=out)


def table(result):
    return [np.column_stack([case.classes, case.other]).tolist() for case in result.cases]


def simulated(workers, drops=630):
    """The number of points that have this number of drops."""
    ends = {job.seed: end for job, _, end in workers.submitted}
    return sum(end == drops for end in ends.values())


@pytest.fixture(scope='module')
def whole(here):
    return table(run(workers=here()))


@pytest.mark.slow
def test_study_that_is_broken_off_or_stopped_continues(tmp_path, here, whole):
    with pytest.raises(EngineError):
        run(tmp_path, workers=here(failing=(5,), lookahead=1))
    assert len((tmp_path / STORE).read_text().splitlines()) == 3  # versions and two points
    workers, more = here(lookahead=1), iter([True] * 5)
    result = run(tmp_path, workers=workers, stopped=lambda: not next(more, False))
    assert not result.complete
    finished = [row for row, full in zip(table(result)[0], whole[0], strict=True) if row == full]
    workers = here()
    assert table(run(tmp_path, workers=workers)) == whole
    assert simulated(workers) == len(whole[0]) - len(finished)


@pytest.mark.slow
def test_points_are_added_without_repetition(tmp_path, here):
    vary = {'restitution': '0.1:0.4:2', 'friction': '0.2:0.5'}
    few = run(tmp_path, vary=vary, points=1, drops=50, workers=here())
    workers = here()
    more = run(tmp_path, vary=vary, points=3, drops=50, workers=workers)
    before = len(few.design.points)
    assert table(more)[0][:before] == table(few)[0]
    assert simulated(workers, 50) == len(more.design.points) - before


def test_changes_are_confirmed_by_fresh_drops(tmp_path, here):
    workers = here()
    result = run(tmp_path, parts=['l_bracket'], drops=40, workers=workers)
    for effect in result.effects[0].factors:
        assert effect.largest.points is not None
    (case,) = result.cases
    assert {int(each.sum()) for each in case.fresh.values()} == {FRESH_DROPS * 40}
    # They are other drops than those of the design, which are all counted in the table.
    assert case.drops.tolist() == [40] * 4
    assert simulated(workers, 40) == 4
    assert simulated(workers, FRESH_DROPS * 40) == len(case.fresh)
    again = here()
    repeated = run(tmp_path, parts=['l_bracket'], drops=40, workers=again)
    assert repeated.findings == result.findings
    assert again.submitted == []
    # The part is saved with its mass.
    assert read_spec(tmp_path / SPEC).parts[0].part_sha256 == case.part.part_sha256


@pytest.mark.slow
def test_study_yaml_repeats_a_study_and_more_drops_begin_with_the_same(tmp_path, here, whole):
    run(tmp_path / 'first', drops=500, workers=here())
    assert table(run(tmp_path / 'first', workers=here())) == whole
    (tmp_path / 'first').rename(tmp_path / 'moved')
    (tmp_path / 'moved' / STORE).unlink()
    again = run_study(read_spec(tmp_path / 'moved' / SPEC), tmp_path / 'other', workers=here())
    assert table(again) == whole


def test_study_yaml_of_a_hand_stays_as_it_is(tmp_path, here):
    path = tmp_path / SPEC
    text = '# mine\nparts: mesh\nvary: {friction: "0.2:0.4:2"}\ndrops: 1\n'
    path.write_text(text)
    part = ra.load_part('tetrahedron')
    (tmp_path / 'mesh').mkdir()
    (tmp_path / 'mesh' / 'own.stl').write_bytes(part.mesh_bytes)
    assert run_study(read_spec(path), tmp_path, workers=here()).complete
    assert path.read_text() == text
    assert not (tmp_path / 'parts').exists()


def test_only_a_store_of_the_same_versions_is_continued(tmp_path):
    path = tmp_path / STORE
    PointStore(path, VERSIONS).add('a', 2, np.array([[1, 1]]))
    with pytest.raises(InvalidValueError, match='made with numpy 1, expected 3'):
        PointStore(path, {**VERSIONS, 'numpy': '3'})
    whole = path.read_bytes()
    with path.open('ab') as file:
        file.write(b'{"point":"b","drops":2,"cou')  # cut short
    store = PointStore(path, VERSIONS)
    assert path.read_bytes() == whole
    assert store.counts('a', 2).tolist() == [[1, 1]]
    assert store.counts('a', 3) is store.counts('b', 2) is None
    path.write_text('{"x": 1}\n')
    with pytest.raises(InvalidValueError, match='expected points of a study'):
        PointStore(path, VERSIONS)


@pytest.mark.slow
def test_full_disk_loses_no_finished_point(tmp_path, here, whole, monkeypatch):
    written, opened = [], Path.open

    def full(path, *arguments, **given):
        if path.name == STORE:
            if len(written) == 3:
                raise OSError(errno.ENOSPC, 'No space left on device')
            written.append(path)
        return opened(path, *arguments, **given)

    monkeypatch.setattr(Path, 'open', full)
    with pytest.raises(OutputError, match='the same command continues the study'):
        run(tmp_path, workers=here())
    monkeypatch.undo()
    assert len((tmp_path / STORE).read_text().splitlines()) == 3  # versions and two points
    workers = here()
    assert table(run(tmp_path, workers=workers)) == whole
    assert simulated(workers) == 2


def test_impossible_points_are_skipped_and_counted(tmp_path, here):
    vary = {'height': '1mm:100mm:4'}
    given = {'vary': vary, 'design': 'factorial', 'height_of': HeightOf.CENTRE_OF_MASS}
    result = run(tmp_path, drops=5, workers=here(), **given)
    assert result.complete
    case = result.cases[0]
    assert list(case.skipped) == [0]
    assert case.drops.tolist() == [0, 5, 5, 5]
    skipped = [row for row in result.rows if row['skipped']]
    assert {(row['point'], row['count'], row['probability']) for row in skipped} == {(0, 0, None)}
    # A model range is wider than the interval, but nothing is known without drops and elsewhere.
    for row in result.rows:
        if row['drops'] and row['class'] is not None:
            assert row['model_lower'] <= row['lower'] <= row['upper'] <= row['model_upper']
        else:
            assert row['model_lower'] is None


def test_actions_are_counted_by_the_class_from_which_they_start(here):
    vary = {'action.speed': '0.05:0.8:2', 'friction': '0.2:0.5:2'}
    result = run(parts='box_10x20x30', action='tap', vary=vary, drops=10, workers=here())
    assert [case.start for case in result.cases] == [1, 2, 3]
    assert all(row['model_lower'] is None for row in result.rows)
    for case in result.cases:
        assert case.drops.tolist() == [20] * 4  # two aspects of a class, ten actions each
        # Fresh actions start only from the aspects of the class.
        assert {int(each.sum()) for each in case.fresh.values()} == {2 * FRESH_DROPS * 10}


def test_surroundings_vary(tmp_path, here):
    vary = {'surroundings.angle': '0deg:20deg:2'}
    given = {'surroundings': 'slope', 'vary': vary, 'design': 'factorial'}
    result = run(tmp_path, drops=10, workers=here(), **given)
    assert result.cases[0].drops.tolist() == [10, 10]
    assert yaml.safe_load((tmp_path / SPEC).read_text())['surroundings']['kind'] == 'slope'
    assert read_spec(tmp_path / SPEC).base == result.spec.base


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'vary': {}}, 'missing factor'),
        ({'parts': []}, 'missing part'),
        ({'tolerance': 2}, 'invalid tolerance 2'),
        ({'vary': {'height': '0.1:60'}}, 'invalid height 60 m'),
        ({'parts': ['tetrahedron', 'tetrahedron']}, 'expected different names'),
    ],
)
def test_invalid_study_is_refused(changes, message):
    with pytest.raises(InvalidValueError, match=message):
        run(**changes)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'parts': [1]}, r'invalid parts \[1\]: expected the name of a part'),
        ({'design': ['sobol']}, r"invalid design \['sobol'\]: expected one of curves"),
        ({'action': {'kind': ['kick']}}, r"invalid kind of action \['kick'\]"),
        ({'extra': 1}, "invalid key 'extra'"),
        ({'conditions': {'hight': 1}}, "invalid condition 'hight'"),
        ({'drops': 'many'}, 'invalid drops'),
    ],
)
def test_invalid_study_yaml_is_refused_with_its_name(changes, message, tmp_path):
    path = tmp_path / 'odd.yaml'
    path.write_text(yaml.safe_dump({'parts': 'tetrahedron', 'vary': VARY, **changes}))
    with pytest.raises(InvalidValueError, match=rf'odd\.yaml.*{message}'):
        read_spec(path)


HEIGHT, FRICTION = Factor('height', 0.02, 0.2, 3), Factor('friction', 0.1, 0.5, 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('table', 'lost', 'factors'),
    # Counts (3, c) of a class or two at three heights, and lost drops (3,).
    [
        ([[20], [20], [0]], [0, 0, 20], (HEIGHT, FRICTION)),
        ([[12, 8], [0, 0], [0, 0]], [0] * 3, (HEIGHT,)),
        ([[0, 0]] * 3, [0] * 3, (HEIGHT, FRICTION)),
    ],
    ids=['one class, some lost', 'one point', 'no drops'],
)
def test_degenerate_counts_have_tables_findings_and_a_page(table, lost, factors, tmp_path):
    table, lost = np.array(table), np.array(lost)
    part = ra.load_part('tetrahedron' if table.shape[1] == 1 else 'washer')
    spec = StudySpec((part,), Setting(shipped_surfaces().get()), factors, 'factorial')
    design = spec.made_design()
    row = (2 * design.points[:, 0]).astype(int)
    other = np.zeros((len(row), 5), dtype=np.int64)
    other[:, 3] = lost[row]
    fresh = {k: np.append(table[each], lost[each]) for k, each in enumerate(row)}
    case = Case(part, ra.find_aspects(part), table[row], other, fresh=fresh)
    result = StudyResult(spec, design, (case,), True)
    with warnings.catch_warnings():
        warnings.simplefilter('error', ra.RestingAspectsWarning)  # no analysis fails
        page = html.unescape(result.report(tmp_path).read_text())
        findings = result.findings
    assert len(list(result.rows)) == len(row) * (table.shape[1] + 1)
    assert len(findings) == len(factors)
    assert all(finding.sentence in page for finding in findings)

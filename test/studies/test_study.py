"""Studies: resumed, extended, repeated bit for bit, and refused where they do not fit."""

import errno
import json

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.core.errors import EngineError, InvalidValueError, OutputError
from resting_aspects_ros.studies import point_store
from resting_aspects_ros.studies.point_store import STORE, PointStore
from resting_aspects_ros.studies.study_run import run_study
from resting_aspects_ros.studies.study_spec import SPEC, make_spec, read_spec

VERSIONS = {'numpy': '1', 'pybullet': '2'}
VARY = {'restitution': '0.1:0.4', 'friction': '0.2:0.5'}


def spec(**changes):
    document = {'parts': ['tetrahedron'], 'vary': VARY, 'points': 4, 'drops': 630}
    return make_spec({**document, 'conditions': {'height': '30mm'}, **changes})


def table(result):
    return [np.column_stack([case.classes, case.other]).tolist() for case in result.cases]


@pytest.fixture(scope='module')
def whole(here):
    return table(run_study(spec(), None, workers=here()))


def test_study_that_was_broken_off_continues(tmp_path, here, whole):
    with pytest.raises(EngineError):
        run_study(spec(), tmp_path, workers=here(failing=(5,)))
    lines = (tmp_path / STORE).read_text().splitlines()
    assert len(lines) > 1  # the finished points are stored
    workers = here()
    result = run_study(spec(), tmp_path, workers=workers)
    assert result.complete
    assert table(result) == whole
    assert len(workers.submitted) < 8  # the others are not repeated


def test_points_and_drops_are_added_without_repetition(tmp_path, here, whole):
    first = run_study(spec(points=2, drops=500), tmp_path, workers=here())
    assert first.cases[0].drops.tolist() == [500, 500]
    workers = here()
    more = run_study(spec(), tmp_path, workers=workers)
    assert table(more) == whole
    spans = sorted((start, end) for _, start, end in workers.submitted)
    assert spans == [(0, 500)] * 2 + [(500, 630)] * 4
    again = here()
    fewer = run_study(spec(points=2, drops=500), tmp_path, workers=again)
    assert table(fewer) == whole
    assert again.submitted == []


def test_study_yaml_has_all_that_is_needed_to_repeat_it(tmp_path, here, whole):
    run_study(spec(), tmp_path / 'first', workers=here())
    (tmp_path / 'first').rename(tmp_path / 'moved')
    (tmp_path / 'moved' / STORE).unlink()
    again = run_study(read_spec(tmp_path / 'moved' / SPEC), tmp_path / 'other', workers=here())
    assert table(again) == whole


def test_part_of_a_study_is_saved_with_its_mass(tmp_path, here):
    part = ra.load_part('l_bracket')
    result = ra.study(
        part, {'friction': '0.2:0.4'}, points=1, drops=1, out=tmp_path, workers=here()
    )
    saved = read_spec(tmp_path / SPEC)
    assert saved.parts[0].part_sha256 == part.part_sha256
    assert result.cases[0].drops.tolist() == [1]


def test_other_study_in_the_folder_is_refused(tmp_path, here):
    run_study(spec(points=1, drops=1), tmp_path, workers=here())
    for change in ({'seed': 2}, {'vary': {'friction': '0.2:0.5'}}, {'parts': ['hex_nut']}):
        with pytest.raises(InvalidValueError, match='expected the same study, but it differs in'):
            run_study(spec(points=1, drops=1, **change), tmp_path, workers=here())


def test_drops_of_other_versions_are_refused(tmp_path):
    with PointStore(tmp_path / STORE, VERSIONS) as store:
        store.add('a', 0, 2, np.array([[1, 1]]))
    with pytest.raises(InvalidValueError, match='made with numpy 1, expected 3'):
        PointStore(tmp_path / STORE, {**VERSIONS, 'numpy': '3'})


def test_study_that_another_program_runs_is_refused(tmp_path):
    with (
        PointStore(tmp_path / STORE, VERSIONS),
        pytest.raises(InvalidValueError, match='no other program'),
    ):
        PointStore(tmp_path / STORE, VERSIONS)


def test_line_that_was_cut_short_is_removed(tmp_path):
    path = tmp_path / STORE
    with PointStore(path, VERSIONS) as store:
        store.add('a', 0, 2, np.array([[1, 1]]))
    whole = path.read_bytes()
    with path.open('ab') as file:
        file.write(b'{"point":"b","first":0,"end":2,"cou')
    with PointStore(path, VERSIONS) as store:
        assert (store.done('a'), store.done('b')) == (2, 0)
        store.add('a', 2, 4, np.array([[2, 0]]))
        assert store.counts('a').tolist() == [[3, 1]]
    assert path.read_bytes().startswith(whole)


def test_full_disk_loses_no_finished_point(tmp_path, monkeypatch):
    path = tmp_path / STORE
    with PointStore(path, VERSIONS) as store:
        store.add('a', 0, 2, np.array([[1, 1]]))

        def full(_):
            raise OSError(errno.ENOSPC, 'No space left on device')

        monkeypatch.setattr(point_store.os, 'fsync', full)
        with pytest.raises(OutputError, match='the 1 points in it are complete'):
            store.add('b', 0, 2, np.array([[1, 1]]))
        monkeypatch.undo()
    with PointStore(path, VERSIONS) as store:
        assert (store.done('a'), store.done('b')) == (2, 0)


def test_study_continues_after_a_full_disk(tmp_path, here, whole, monkeypatch):
    written, fsync = [], point_store.os.fsync

    def full(file):
        if len(written) == 3:
            raise OSError(errno.ENOSPC, 'No space left on device')
        written.append(file)
        fsync(file)

    monkeypatch.setattr(point_store.os, 'fsync', full)
    with pytest.raises(OutputError, match='the same command continues the study'):
        run_study(spec(), tmp_path, workers=here())
    monkeypatch.undo()
    assert len((tmp_path / STORE).read_text().splitlines()) == 3  # versions and two points
    workers = here()
    assert table(run_study(spec(), tmp_path, workers=workers)) == whole
    assert len(workers.submitted) == 4  # two chunks for each of the two other points


def test_worker_of_another_version_costs_no_finished_point(tmp_path, here, whole):
    """`chunks` refuses the drops of such a worker with an EngineError; see test_dask_workers."""
    workers = here()
    result, answers = workers.result, []

    def refusing(future):
        if len(answers) == 4:
            raise EngineError('a worker has numpy 1.0, expected 2.0')
        answers.append(future)
        return result(future)

    workers.result = refusing
    with pytest.raises(EngineError, match=r'expected 2\.0'):
        run_study(spec(), tmp_path, workers=workers)
    assert len((tmp_path / STORE).read_text().splitlines()) > 1
    rest = here()
    assert table(run_study(spec(), tmp_path, workers=rest)) == whole
    assert len(rest.submitted) < 8


def test_file_that_is_no_store_is_refused(tmp_path):
    (tmp_path / STORE).write_text('{"x": 1}\n')
    with pytest.raises(InvalidValueError, match='expected points of a study'):
        PointStore(tmp_path / STORE, VERSIONS)


def test_impossible_points_are_skipped_and_counted(tmp_path, here):
    conditions = {'height_of': 'CENTRE_OF_MASS'}
    made = spec(vary={'height': '1mm:100mm:4'}, design='factorial', drops=5, conditions=conditions)
    result = run_study(made, tmp_path, workers=here())
    assert result.complete
    case = result.cases[0]
    assert list(case.skipped) == [0]
    assert case.drops.tolist() == [0, 5, 5, 5]
    skipped = [row for row in result.rows if row['skipped']]
    assert {(row['point'], row['count'], row['probability']) for row in skipped} == {(0, 0, None)}


def test_actions_are_counted_by_the_class_from_which_they_start(here):
    made = make_spec(
        {
            'parts': ['box_10x20x30'],
            'action': 'tap',
            'vary': {'action.speed': '0.05:0.8:2'},
            'design': 'factorial',
            'drops': 10,
        }
    )
    result = run_study(made, None, workers=here())
    assert [case.start for case in result.cases] == [1, 2, 3]
    for case in result.cases:
        assert case.drops.tolist() == [20, 20]  # two aspects of a class, ten actions each


def test_surroundings_vary(here):
    made = make_spec(
        {
            'parts': ['tetrahedron'],
            'surroundings': 'slope',
            'vary': {'surroundings.angle': '0deg:20deg:2'},
            'design': 'factorial',
            'drops': 10,
        }
    )
    result = run_study(made, None, workers=here())
    assert result.cases[0].drops.tolist() == [10, 10]
    assert json.loads(json.dumps(made.document(['x'])))['surroundings']['kind'] == 'slope'


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'vary': {}}, 'missing factor'),
        ({'parts': []}, 'missing part'),
        ({'parts': [1]}, r'invalid parts \[1\]: expected the name of a part'),
        ({'parts': {'a': 1}}, "invalid parts {'a': 1}: expected the name of a part"),
        ({'design': ['sobol']}, r"invalid design \['sobol'\]: expected one of factorial"),
        ({'vary': {'height': '10mm:20mm:0'}}, 'invalid number of levels 0'),
        ({'points': 10**400}, 'invalid number of points'),
        ({'action': {'kind': ['kick']}}, r"invalid kind of action \['kick'\]"),
        ({'action': [1]}, r'invalid action \[1\]'),
        ({'surroundings': [1]}, r'invalid surroundings \[1\]'),
        ({'surroundings': {'kind': {}}}, 'invalid kind of surroundings {}'),
        ({'extra': 1}, "invalid key 'extra'"),
        ({'conditions': {'hight': 1}}, "invalid condition 'hight'"),
        ({'tolerance': 2}, 'invalid tolerance 2'),
        ({'drops': 0}, 'drops'),
        ({'parts': ['tetrahedron', 'tetrahedron']}, 'expected different names'),
        ({'vary': {'height': [1, 2]}}, 'invalid range'),
    ],
)
def test_invalid_study_is_refused(changes, message):
    with pytest.raises(InvalidValueError, match=message):
        spec(**changes).points()


@pytest.mark.parametrize('text', ['points: 0', 'points: []', 'points: [-1]'])
def test_invalid_number_of_points_names_the_file(tmp_path, text):
    path = tmp_path / 'odd.yaml'
    path.write_text(f'parts: tetrahedron\nvary: {{friction: "0.1:0.5"}}\n{text}\n')
    with pytest.raises(InvalidValueError, match=r'odd\.yaml.*invalid number of points'):
        read_spec(path)


def test_tables_have_a_row_for_each_point_and_class(tmp_path, here):
    parquet = pytest.importorskip('pyarrow.parquet')
    result = run_study(spec(points=2, drops=10), None, workers=here())
    files = result.save_tables(tmp_path)
    assert [file.name for file in files] == ['results.csv', 'results.parquet']
    rows = list(result.rows)
    assert parquet.read_table(files[1]).to_pylist() == rows
    assert len(rows) == 2 * 2
    assert sum(row['count'] for row in rows) == 20

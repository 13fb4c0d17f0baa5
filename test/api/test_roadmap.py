"""Pose roadmaps: documents, reading them back, and comparison of measured trials."""

import contextlib
import copy
import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from doc_pages import first_cells, section
from hypothesis import given, settings
from hypothesis import strategies as st

from resting_aspects_ros.api import roadmap
from resting_aspects_ros.api.roadmap import (
    compare_measured,
    read_roadmap,
    roadmap_document,
    with_measured,
)
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import CORNER, EDGE, NONE
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.statistics.distribution import (
    Distribution,
    Placement,
    Placements,
    no_drops,
)
from resting_aspects_ros.statistics.intervals import SIMULTANEOUS
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix

EXAMPLE = Path(__file__).resolve().parents[2] / 'docs' / 'reference' / 'roadmap_example.json'
TAP = {'kind': 'kick', 'speed': np.float64(0.3), 'time': 0.5}


@pytest.fixture(scope='module')
def box(part):
    return part('box_10x20x30')


@pytest.fixture(scope='module')
def aspects(box):
    return find_aspects(box)


@pytest.fixture(scope='module')
def matrix(aspects):
    """Make a matrix of a box of counts by (row, column), counted from 1."""

    def make(counts, **given):
        table = np.zeros((len(aspects), len(aspects) + len(OUTCOMES)), dtype=np.int64)
        for (row, column), count in counts.items():
            table[row - 1, column - 1] = count
        return TransitionMatrix(aspects, table, **given)

    return make


@pytest.fixture(scope='module')
def document(box, aspects, matrix):
    """Return a document of a box, as read from JSON, with two actions."""
    counts = np.array([300, 310, 100, 90, 20, 25], dtype=np.int64)
    drops = Distribution(aspects, counts, 5, 0, 0)
    weights = estimate(RestingShape(box, aspects), 'csa').probabilities
    tap = matrix({(1, 1): 80, (1, 2): 15, (1, 7): 5, (3, 1): 40, (3, 3): 60})
    matrices = {'tap': (tap, TAP), 'toss': (matrix({(1, 2): 7}), {'kind': 'kick'})}
    return json.loads(to_json(roadmap_document(box, drops, weights, matrices)))


@pytest.fixture
def read(tmp_path):
    """Read a roadmap with a content; the file is called f.json."""

    def read(content):
        path = tmp_path / 'f.json'
        text = content if isinstance(content, str) else json.dumps(content)
        path.write_text(text, encoding='utf-8')
        return read_roadmap(path)

    return read


@pytest.fixture
def refusal(read, tmp_path):
    """Return the error of reading a content, in which the path is f.json."""

    def said(content):
        with pytest.raises(InvalidValueError) as caught:
            read(content)
        message = str(caught.value)
        assert '\n' not in message
        assert len(message) < 400 + len(str(tmp_path))
        return message.replace(repr(str(tmp_path / 'f.json')), 'f.json')

    return said


def changed(document, path, value):
    document = copy.deepcopy(document)
    *outer, last = path
    inside = document
    for key in outer:
        inside = inside[key]
    inside[last] = value
    return document


def with_trials(document, *trials):
    """Return the document with trials: (from, to, action, trials, successes) each."""
    document = copy.deepcopy(document)
    for row, column, action, n, successes in trials:
        experimental = {'status': 'tested', 'trials': n, 'successes': successes}
        (entry,) = [
            each
            for each in document['transitions']
            if (each['from_pose'], each['to_pose'], each['action']['name'])
            == (row, column, action)
        ] or [{'from_pose': row, 'to_pose': column, 'action': {'name': action}}]
        if entry not in document['transitions']:
            document['transitions'].append(entry)
        entry['experimental'] = experimental
    return document


def test_the_document_has_every_aspect(document, aspects):
    assert document['format'] == 'bibazu_pose_roadmap_handover'
    assert document['schema_version'] == 1
    poses = document['poses']
    assert [pose['id'] for pose in poses] == [1, 2, 3, 4, 5, 6]
    orientations = np.array([pose['orientation_quaternion_xyzw'] for pose in poses])
    assert aspects.classify(orientations).tolist() == [1, 2, 3, 4, 5, 6]
    assert [pose['observed_count'] for pose in poses] == [300, 310, 100, 90, 20, 25]
    assert poses[0]['observed_frequency_percent'] == pytest.approx(100 * 300 / 850)
    # Over an edge of 30 mm the centre of the side 20 x 30 mm, 5 mm high, rises to its diagonal.
    assert poses[0]['rocking_barrier_mm'] == pytest.approx(math.hypot(5, 10) - 5)
    assert sum(pose['csa_stability_index'] for pose in poses) == pytest.approx(1)
    assert poses[0]['csa_stability_index'] > poses[-1]['csa_stability_index'] > 0
    assert poses[0]['contacts'] == {'floor': True, 'wall': False}
    assert poses[0]['contact_counts'] == {'floor': 300, 'wall': 0}


def test_contacts_are_those_of_most_drops_in_an_aspect(box, aspects):
    """A wall is touched in aspect 1 by 200 of 300 drops, in 2 by 100 of 300; 4 is never seen."""
    contacts = Placements(
        ('belt', 'wall'),
        [
            Placement((1, 3), np.array([0, 0, 0, 1.0]), 150),
            Placement((1, EDGE), np.array([0, 0, 0, 1.0]), 50),
            Placement((1, NONE), np.array([0, 0, 0, 1.0]), 100),
            Placement((2, CORNER), np.array([0, 0, 0, 1.0]), 100),
            Placement((2, NONE), np.array([0, 0, 0, 1.0]), 200),
            Placement((EDGE, 3), np.array([0, 0, 0, 1.0]), 7),
            Placement((3, NONE), np.array([0, 0, 0, 1.0]), 5),
        ],
        drops=612,
    )
    counts = np.array([300, 300, 5, 0, 0, 0], dtype=np.int64)
    drops = Distribution(aspects, counts, 7, 0, 0, contacts=contacts)
    found = [
        (pose['contacts']['floor'], pose['contacts']['wall'], *pose['contact_counts'].values())
        for pose in roadmap_document(box, drops, None, {})['poses']
    ]
    assert found == [
        (True, True, 300, 200), (True, False, 300, 100), (True, False, 5, 0),
        (True, None, 0, 0), (True, None, 0, 0), (True, None, 0, 0),
    ]  # fmt: skip


def test_the_document_has_every_pair_that_was_seen(document):
    found = [
        (each['action']['name'], each['from_pose'], each['to_pose'])
        for each in document['transitions']
    ]
    assert found == [
        ('tap', 1, 1), ('tap', 1, 2), ('tap', 3, 1), ('tap', 3, 3), ('toss', 1, 2)
    ]  # fmt: skip
    second = document['transitions'][1]
    capture = second['capture']
    assert (capture['probability'], capture['trials']) == (0.15, 100)
    assert 0 < capture['lower'] < 0.15 < capture['upper'] < 1
    assert second['action'] == {
        'name': 'tap', 'axis': None, 'direction': None, 'commanded_angle_deg': None
    }  # fmt: skip
    assert second['experimental'] == {'status': 'untested', 'trials': None, 'successes': None}
    assert [each['values'] for each in document['actions']] == [
        {'kind': 'kick', 'speed': 0.3, 'time': 0.5}, {'kind': 'kick'}
    ]  # fmt: skip


def test_unknown_values_are_null(solid):
    ball = solid(trimesh.creation.icosphere(3, radius=10))
    (pose,) = roadmap_document(ball, no_drops(find_aspects(ball)), None, {})['poses']
    assert pose['observed_frequency_percent'] is None
    assert pose['rocking_barrier_mm'] is None
    assert pose['csa_stability_index'] is None


def test_ids_of_transitions_are_unique(document):
    ids = [each['id'] for each in document['transitions']]
    assert len(set(ids)) == len(ids)
    for each, name in zip(document['transitions'], ids, strict=True):
        ends = re.fullmatch(r'[^:]+:(\d+)->(\d+)', name).groups()
        assert ends == (str(each['from_pose']), str(each['to_pose']))


def test_an_untested_roadmap_is_read_without_trials(read, document, matrix):
    measured = read(document)
    assert measured.actions == ('tap', 'toss')
    assert list(measured.orientations) == [1, 2, 3, 4, 5, 6]
    assert measured.pairs == ()
    simulated = matrix({(1, 1): 5})
    assert compare_measured(measured, simulated, 'tap') == ()
    kept = with_measured(measured, simulated, 'tap', 1)
    assert kept.counts.tolist() == simulated.counts.tolist()


def test_trials_are_read_also_of_added_pairs(read, document):
    measured = read(with_trials(document, (1, 2, 'tap', 20, 4), (6, 5, 'tap', 9, 0)))
    assert [
        (each.action, each.from_aspect, each.to_aspect, each.trials, each.successes)
        for each in measured.pairs
    ] == [('tap', 1, 2, 20, 4), ('tap', 6, 5, 9, 0)]


# A pair of the action tap, and one of its fields.
TRIAL = ('transitions', 1, 'experimental')


@pytest.mark.parametrize(
    ('place', 'value', 'said'),
    [
        (('format',), 'other', "invalid format 'other' in f.json: expected 'bibazu_pose_roadmap"),
        (('schema_version',), 2, 'invalid schema_version 2 in f.json: expected 1'),
        (('poses',), {}, 'invalid poses {} in f.json: expected a valid list'),
        (('poses', 0), 7, 'invalid poses[0] 7 in f.json: expected'),
        (('poses', 0, 'id'), 2, 'invalid poses[1].id 2 in f.json: expected each id once'),
        (('poses', 0, 'id'), 1.5, 'invalid poses[0].id 1.5 in f.json: expected'),
        (
            ('poses', 0, 'orientation_quaternion_xyzw'),
            [0, 0, 0, 2],
            'invalid poses[0].orientation_quaternion_xyzw (0, 0, 0, 2) in f.json: expected a unit',
        ),
        (
            ('poses', 0, 'orientation_quaternion_xyzw'),
            [0, 0, 1e308, 1e308],
            'in f.json: expected a unit quaternion',
        ),
        (('transitions',), None, 'invalid transitions None in f.json: expected'),
        (
            ('transitions', 0, 'to_pose'),
            77,
            'invalid transitions[0].to_pose 77 in f.json: expected the id of a pose',
        ),
        (('transitions', 0, 'from_pose'), '1', "invalid transitions[0].from_pose '1' in f.json"),
        (
            ('transitions', 0, 'to_pose'),
            2,
            "invalid transitions[1] ('tap', 1, 2) in f.json: expected each pair once",
        ),
        (('transitions', 0, 'action', 'name'), 3, 'invalid transitions[0].action.name 3 in'),
        ((*TRIAL, 'status'), 'done', "experimental.status 'done' in f.json: expected 'untested'"),
        ((*TRIAL, 'trials'), -1, 'invalid transitions[1].experimental.trials -1 in f.json'),
        ((*TRIAL, 'trials'), 2.5, 'invalid transitions[1].experimental.trials 2.5 in f.json'),
        ((*TRIAL, 'trials'), 10**9, 'trials 1000000000 in f.json: expected less than or equal'),
        ((*TRIAL, 'trials'), True, 'trials True in f.json: expected a valid integer'),
        (TRIAL, {'status': 'tested'}, 'trials None in f.json: expected 1 or more, because the'),
        (TRIAL, {'status': 'tested', 'trials': 0, 'successes': 0}, 'trials 0 in f.json: expected'),
        (
            TRIAL,
            {'status': 'tested', 'trials': 3},
            'invalid transitions[1].experimental.successes None in f.json: expected 0 to 3, the',
        ),
        (
            TRIAL,
            {'status': 'tested', 'trials': 3, 'successes': 4},
            'invalid transitions[1].experimental.successes 4 in f.json: expected 0 to 3, the num',
        ),
        (
            TRIAL,
            {'status': 'untested', 'trials': 3, 'successes': 2},
            "experimental.status 'untested' in f.json: expected 'tested', because there are",
        ),
    ],
)
def test_a_damaged_field_is_named(document, refusal, place, value, said):
    assert said in refusal(changed(document, place, value))


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'f.json is not JSON'),
        ('{"a": ', 'f.json is not JSON: Expecting value'),
        pytest.param('{"poses":' * 100_000, 'f.json is not JSON: ', id='nested'),
        ('{"poses": [NaN]}', 'f.json is not JSON: NaN is not a finite number'),
        ('{"poses": [1e999]}', 'f.json is not JSON: 1e999 is not a finite number'),
        pytest.param(f'{{"poses": {"9" * 5000}}}', 'f.json is not JSON: ', id='digits'),
        ('{"trials": 1, "trials": 2}', "f.json is not JSON: the key 'trials' occurs twice in an"),
        ('[]', 'invalid document [] in f.json: expected a JSON object'),
        ('{}', 'f.json has no format'),
    ],
)
def test_a_file_without_a_roadmap_is_refused(refusal, text, said):
    assert said in refusal(text)


def test_a_missing_field_is_named(document, refusal):
    for place in [('poses',), ('poses', 0, 'id'), ('transitions', 0, 'experimental')]:
        fewer = copy.deepcopy(document)
        inside = fewer
        for key in place[:-1]:
            inside = inside[key]
        del inside[place[-1]]
        assert refusal(fewer).startswith('f.json has no ')


def test_other_files_than_text_of_limited_size_are_refused(tmp_path, monkeypatch):
    path = tmp_path / 'f.json'
    with pytest.raises(InvalidValueError, match='does not exist'):
        read_roadmap(path)
    with pytest.raises(InvalidValueError, match='is a folder'):
        read_roadmap(tmp_path)
    path.write_bytes(b'\xff\xfe{')
    with pytest.raises(InvalidValueError, match='is not text in UTF-8'):
        read_roadmap(path)
    monkeypatch.setattr(roadmap, 'MAX_ROADMAP_BYTES', 1 << 10)
    path.write_text(' ' * 1025)
    with pytest.raises(InvalidValueError, match='too large: expected at most 1 KiB'):
        read_roadmap(path)
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(InvalidValueError, match='a pipe'):
        read_roadmap(tmp_path / 'pipe')


def places(value, path=()):
    """Yield all places in a document."""
    if path:
        yield path
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(inner, (*path, key))


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=5,
)


@settings(max_examples=100)
@given(data=st.data())
def test_any_value_in_any_field_is_read_or_refused(document, matrix, tmp_path_factory, data):
    trials = with_trials(document, (1, 2, 'tap', 20, 4))
    wrong = trials
    for _ in range(data.draw(st.integers(1, 2))):
        place = data.draw(st.sampled_from(list(places(wrong))))
        wrong = changed(wrong, place, data.draw(anything))
    path = tmp_path_factory.getbasetemp() / 'any.json'
    path.write_text(json.dumps(wrong), encoding='utf-8')
    with contextlib.suppress(InvalidValueError):
        measured = read_roadmap(path)
        assert all(0 <= each.successes <= each.trials > 0 for each in measured.pairs)
        found = compare_measured(measured, matrix({(1, 2): 5, (1, 1): 5}), 'tap')
        assert {each.pair for each in found} <= set(measured.pairs)


@given(data=st.binary(max_size=60))
def test_any_bytes_are_refused(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / 'bytes.json'
    path.write_bytes(data)
    with pytest.raises(InvalidValueError):
        read_roadmap(path)


@pytest.mark.parametrize(
    ('measured', 'simulated', 'lower', 'upper'),
    # Newcombe 1998, Statistics in Medicine 17:873, table II, method 10.
    [
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((9, 10), (3, 10), 0.1705, 0.8090),
        ((10, 10), (0, 10), 0.6075, 1.0000),
        ((0, 10), (0, 20), -0.1611, 0.2775),
    ],
)
@pytest.mark.parametrize('interval', ['wilson', SIMULTANEOUS])
def test_difference_has_its_published_interval(
    read, document, matrix, measured, simulated, lower, upper, interval
):
    successes, trials = measured
    count, actions = simulated
    table = matrix({(1, 2): count, (1, 1): actions - count}, interval=interval)
    given = read(with_trials(document, (1, 2, 'tap', trials, successes)))
    (found,) = compare_measured(given, table, 'tap')
    assert found.measured.probability == successes / trials
    assert found.simulated.probability == count / actions
    assert found.actions == actions
    assert found.difference == pytest.approx(successes / trials - count / actions)
    assert (found.lower, found.upper) == pytest.approx((lower, upper), abs=5e-5)
    assert found.verdict == ('differs' if lower > 0 else 'agrees within the interval')


def test_a_pair_that_was_not_simulated_has_no_difference(read, document, matrix):
    given = read(with_trials(document, (4, 2, 'tap', 10, 5), (1, 2, 'toss', 9, 9)))
    (found,) = compare_measured(given, matrix({(1, 1): 5}), 'tap')
    assert found.verdict == 'not simulated'
    assert math.isnan(found.difference)
    assert (found.simulated.lower, found.simulated.upper) == (0, 1)


def test_an_action_that_is_not_in_the_file_is_refused(read, document, matrix):
    for use in (compare_measured, lambda *given: with_measured(*given, 1)):
        with pytest.raises(InvalidValueError, match=r"'blow': expected .*f.json': 'tap, toss'"):
            use(read(document), matrix({}), 'blow')


@pytest.mark.parametrize(
    ('pose_id', 'angle', 'said'),
    [
        (9, 0, 'invalid pose 9 in .*: expected an orientation of aspect 9 .* it is of aspect 6'),
        (6, 1, 'invalid pose 6 in .* it is of no aspect'),
        (0, 1, 'invalid pose 0 in .* it is of no aspect'),
    ],
)
def test_poses_that_are_not_the_aspects_are_refused(read, document, matrix, pose_id, angle, said):
    wrong = changed(document, ('poses', 5, 'id'), pose_id)
    if angle:
        turned = [math.sin(angle / 2), 0, 0, math.cos(angle / 2)]
        wrong['poses'][5]['orientation_quaternion_xyzw'] = turned
    with pytest.raises(InvalidValueError, match=said):
        compare_measured(read(wrong), matrix({}), 'tap')


def test_a_row_with_enough_trials_is_replaced(read, document, matrix):
    simulated = matrix({(1, 1): 80, (1, 2): 20, (2, 2): 7, (3, 3): 60}, energy_growth=0.01)
    given = read(
        with_trials(
            document,
            (1, 2, 'tap', 20, 4),
            (1, 1, 'tap', 20, 16),
            (2, 1, 'tap', 30, 29),
            (3, 1, 'tap', 19, 19),
            (1, 2, 'toss', 50, 50),
        )
    )
    found = with_measured(given, simulated, 'tap', 20)
    # Row 2 has enough trials, but the outcome of one is not known; row 3 has too few.
    expected = matrix({(1, 1): 16, (1, 2): 4, (2, 2): 7, (3, 3): 60})
    assert found.counts.tolist() == expected.counts.tolist()
    assert found.energy_growth == 0.01
    assert simulated.counts[0, 0] == 80
    lower = with_measured(given, simulated, 'tap', 19)
    assert lower.counts[2].tolist() == [19, 0, 0, 0, 0, 0, 0, 0, 0, 0]


def test_contradicting_trials_of_a_row_are_refused(read, document, matrix):
    different = read(with_trials(document, (1, 2, 'tap', 20, 4), (1, 1, 'tap', 21, 13)))
    with pytest.raises(InvalidValueError, match=r'trials \[20, 21\] of tap from pose 1 in .*same'):
        with_measured(different, matrix({}), 'tap', 1000)
    many = read(with_trials(document, (1, 2, 'tap', 20, 14), (1, 1, 'tap', 20, 13)))
    with pytest.raises(InvalidValueError, match='sum of successes 27 of tap from pose 1'):
        with_measured(many, matrix({}), 'tap', 1)
    with pytest.raises(InvalidValueError, match='min_trials 0: expected 1 or more'):
        with_measured(many, matrix({}), 'tap', 0)


def leaves(value, name=''):
    """Yield the names of all fields of a document that contain no others."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, f'{name}.{key}'.lstrip('.'))
    elif isinstance(value, list) and isinstance(value[0], dict):
        yield from leaves(value[0], f'{name}[]')
    else:
        yield name


def test_every_field_is_documented(document):
    document = copy.deepcopy(document)
    cells = first_cells(section('docs/reference/files.md', '## Pose roadmap'))
    named = [name for cell in cells for name in re.findall(r'`([^`]+)`', cell)]
    document['actions'][0]['values'] = 'as in the file of actions'
    assert named == list(leaves(document))


def test_the_example_file_can_be_read():
    """It is written by a command and may not exist yet."""
    for path in EXAMPLE.parent.glob(EXAMPLE.name):
        document = json.loads(path.read_text(encoding='utf-8'))
        measured = read_roadmap(path)
        assert list(measured.orientations) == [pose['id'] for pose in document['poses']]
        assert {each['action']['name'] for each in document['transitions']} == set(
            measured.actions
        )

"""Pose roadmaps: documents of the aspects of a part and of its transitions."""

import json
import math

import numpy as np
import pytest

from resting_aspects_ros.api.roadmap import roadmap_document
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import CORNER, EDGE, NONE
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.statistics.distribution import Distribution, Placement, Placements
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix


@pytest.fixture(scope='module')
def aspects(crate):
    return find_aspects(crate)


@pytest.fixture(scope='module')
def document(crate, aspects):
    """Return a document of a box, as read from JSON, with two actions."""
    counts = np.array([300, 310, 100, 90, 20, 25], dtype=np.int64)
    drops = Distribution(aspects, counts, 5, 0, 0)
    weights = estimate(RestingShape(crate, aspects), 'csa').probabilities
    tap, toss = np.zeros((2, 6, 6 + len(OUTCOMES)), dtype=np.int64)
    tap[[0, 0, 0, 2, 2], [0, 1, 6, 0, 2]] = [80, 15, 5, 40, 60]
    toss[0, 1] = 7
    matrices = {
        'tap': (TransitionMatrix(aspects, tap), {'kind': 'kick', 'speed': np.float64(0.3)}),
        'toss': (TransitionMatrix(aspects, toss), {'kind': 'kick'}),
    }
    return json.loads(to_json(roadmap_document(crate, drops, weights, matrices)))


def test_the_document_has_every_aspect(document, aspects):
    assert document['format'] == 'bibazu_pose_roadmap_handover'
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


def test_contacts_are_those_of_most_drops_in_an_aspect(crate, aspects):
    """A wall is touched in aspect 1 by 200 of 300 drops, in 2 by 100 of 300; 4 is never seen."""
    touched = {
        (1, 3): 150, (1, EDGE): 50, (1, NONE): 100, (2, CORNER): 100, (2, NONE): 200,
        (EDGE, 3): 7, (3, NONE): 5,
    }  # fmt: skip
    placed = [Placement(key, np.array([0, 0, 0, 1.0]), n) for key, n in touched.items()]
    contacts = Placements(('belt', 'wall'), placed, drops=612)
    counts = np.array([300, 300, 5, 0, 0, 0], dtype=np.int64)
    drops = Distribution(aspects, counts, 7, 0, 0, contacts=contacts)
    found = [
        (pose['contacts']['floor'], pose['contacts']['wall'], *pose['contact_counts'].values())
        for pose in roadmap_document(crate, drops, None, {})['poses']
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
    assert second['id'] == 'tap:1->2'
    capture = second['capture']
    assert (capture['probability'], capture['trials']) == (0.15, 100)
    assert 0 < capture['lower'] < 0.15 < capture['upper'] < 1
    assert document['actions'][0]['values'] == {'kind': 'kick', 'speed': 0.3}

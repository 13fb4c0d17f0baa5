"""The service classify_pose: its implementation, and requests over DDS."""

import math
import shutil

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ClassifyPose
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, UnknownPartError
from resting_aspects_ros.nodes.aspect_classifier.classify_pose import answer_pose
from resting_aspects_ros.nodes.aspect_classifier.part_registry import requested_part
from resting_aspects_ros.ros.conversions import poses_from
from resting_aspects_ros.ros.status import NotAvailableError, status_from_errors
from resting_aspects_ros.simulation.conditions import parts_folder
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.poses import RestStatus

BOX = 'box_10x20x30'


def quaternion(xyzw):
    return Quaternion(**dict(zip('xyzw', map(float, xyzw), strict=True)))


def tilted(aspect, degrees):
    """Return the pose of an aspect, rotated about the vertical and then tilted."""
    turn = Rotation.from_euler('zx', [77, degrees], degrees=True)
    return (turn * Rotation.from_quat(aspect.orientation)).as_quat()


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite(workers=1)


@pytest.fixture(scope='module')
def box(part):
    return find_aspects(part(BOX))


def counted(aspects, *counts, unclassified=0):
    return Distribution(aspects, np.array(counts), unclassified, 0, 0)


def answer(aspects, orientation, newest=None):
    """Return the response, and the error if there is one."""
    response = ClassifyPose.Response(angle=math.nan, probability=math.nan)
    request = ClassifyPose.Request(part=BOX, orientation=quaternion(orientation))
    try:
        answer_pose(request, response, aspects, newest)
    except (NotAvailableError, InvalidValueError) as error:
        return response, error
    return response, None


# Without DDS


def test_response_contains_all_fields_of_the_aspect(box):
    newest = counted(box, 1, 2, 3, 4, 5, 6, unclassified=9)
    for aspect in box.aspects:
        response, error = answer(box, tilted(aspect, 1.5), newest)
        assert error is None
        assert response.status == Status(code=Status.OK)
        assert (response.aspect, response.symmetry_class) == (aspect.id, aspect.symmetry_class)
        assert response.angle == pytest.approx(np.radians(1.5), abs=1e-12)
        assert response.probability == aspect.id / 30


def test_probability_is_nan_without_a_distribution(box):
    response, _ = answer(box, box.aspects[3].orientation)
    assert response.aspect == 4
    assert math.isnan(response.probability)


def test_nearest_aspect_is_reported_if_none_matches(box):
    response, error = answer(box, tilted(box.aspects[4], -12.5), counted(box, 1, 1, 1, 1, 1, 1))
    assert isinstance(error, NotAvailableError)
    assert str(error) == (
        f'no aspect of {BOX} matches the orientation: the nearest is aspect 5 at 12.5 degrees, '
        'expected at most 3'
    )
    assert (response.aspect, response.symmetry_class) == (0, 0)
    assert response.angle == pytest.approx(np.radians(12.5), abs=1e-12)
    assert math.isnan(response.probability)


def test_part_without_aspects():
    response, error = answer(AspectSet('', ()), [0, 0, 0, 1])
    assert str(error) == f'part {BOX!r} has no aspect'
    assert response.angle == math.inf


def test_unknown_part_error_lists_the_known_parts(part):
    box = part(BOX)
    assert requested_part({BOX: box}, BOX) is box
    with pytest.raises(UnknownPartError, match=r"^part 'gizmo' is not known; known parts: a, b$"):
        requested_part({'b': box, 'a': box}, 'gizmo')
    with pytest.raises(UnknownPartError, match=r"^part 'x+[.x]*' is not known; .* none, because "):
        requested_part({}, 'x' * 300)


def test_exceptions_become_the_status_of_the_response(box):
    response, complaints = ClassifyPose.Response(), []
    with status_from_errors('classify_pose', response, complaints.append):
        raise UnknownPartError('no such part')
    assert response.status == Status(code=Status.UNKNOWN_PART, message='no such part')
    assert complaints == []
    with status_from_errors('classify_pose', response, complaints.append):
        raise ZeroDivisionError('a defect')
    assert response.status.code == Status.FAILED
    assert complaints == ["classify_pose failed: ZeroDivisionError('a defect')"]


# Over DDS


@pytest.fixture(scope='module')
def asker():
    """Return a function that creates a function to send requests to a suite."""

    def asker(suite):
        client = suite.client.node.create_client(ClassifyPose, 'classify_pose')

        def ask(name, orientation):
            request = ClassifyPose.Request(part=name, orientation=quaternion(orientation))
            return suite.client.call(client, request)

        return ask

    return asker


@pytest.fixture(scope='module')
def classify(asker, suite):
    suite.client.wait(lambda: len(suite.client.parts()) == 9, 'descriptions of the parts')
    return asker(suite)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', ['l_bracket', 'cylinder_d20_h20'])
def test_classification_agrees_with_the_distribution(suite, classify, part, counts, name):
    received = suite.client.poses()
    distribution = suite.client.ask(name, 150, seed=[3]).distribution
    suite.client.wait(
        lambda: any(b.last and b.run.run_id == distribution.run.run_id for b in received), 'poses'
    )
    batches = [poses_from(b) for b in received if b.run.run_id == distribution.run.run_id]
    tally = np.zeros(len(distribution.aspects) + 1, dtype=int)
    for poses in batches:
        for orientation in poses.orientation[poses.status == RestStatus.SETTLED]:
            found = classify(name, orientation)
            tally[found.aspect] += 1
            assert (found.status.code == Status.OK) == (found.aspect > 0)
            if found.aspect:
                aspect = distribution.aspects[found.aspect - 1]
                assert found.symmetry_class == aspect.symmetry_class
                assert found.probability == aspect.probability
                assert found.angle <= np.radians(3)
    assert (*tally[1:], tally[0]) == counts(distribution)[: len(tally)]


def test_aspect_is_returned_before_the_first_drop(classify, part):
    aspect = find_aspects(part('hex_nut')).aspects[2]
    found = classify('hex_nut', aspect.orientation)
    assert found.status.code == Status.OK
    assert found.aspect == 3
    assert math.isnan(found.probability)


def test_pose_between_aspects(classify, box):
    found = classify(BOX, tilted(box.aspects[0], 20))
    assert found.status.code == Status.NOT_AVAILABLE
    assert 'the nearest is aspect 1 at 20 degrees, expected at most 3' in found.status.message
    assert found.aspect == 0
    assert found.angle == pytest.approx(np.radians(20), abs=1e-9)


@pytest.mark.parametrize(
    'wrong',
    [
        (0, 0, 0, 0),
        (math.nan, 0, 0, 1),
        (0, -math.inf, 0, 1),
        (0, 0, 0, 1.002),
        (0.5, 0.5, 0.5, 0.49),
        (1e300, 0, 0, 1e300),
    ],
)
def test_invalid_orientation_is_rejected(suite, classify, wrong):
    found = classify(BOX, wrong)
    assert found.status.code == Status.INVALID
    assert 'of norm 1 within 0.001' in found.status.message
    assert f'{wrong[0]:.6g}, {wrong[1]:.6g}, ' in found.status.message
    assert found.aspect == 0
    assert suite.alive


def test_rounded_quaternion_norm_is_accepted(classify, box):
    exact = classify(BOX, box.aspects[1].orientation)
    rounded = classify(BOX, -1.0009 * box.aspects[1].orientation)
    assert exact.status.code == rounded.status.code == Status.OK
    assert exact.aspect == rounded.aspect == 2
    assert rounded.angle == pytest.approx(exact.angle, abs=1e-12)


@pytest.mark.parametrize('name', ['gizmo', '', '../box', 'x' * 300, 'Würfel ⬛'])
def test_service_error_lists_the_known_parts(classify, name):
    found = classify(name, (0, 0, 0, 1))
    assert found.status.code == Status.UNKNOWN_PART
    assert found.status.message.startswith('part ')
    assert ' is not known; known parts: angle_45' in found.status.message
    assert len(found.status.message) < 400
    assert found.status.message.endswith(', u_bracket, washer')
    assert math.isnan(found.probability)
    assert math.isnan(found.angle)


@pytest.mark.slow
def test_current_or_last_offered_part_is_used(fresh_suite, asker, part, tmp_path_factory):
    folder = tmp_path_factory.mktemp('parts')
    shutil.copy(parts_folder() / f'{BOX}.stl', folder / 'thing.stl')
    constants = {'drop_simulator': {'nodes.drop_simulator.part_publisher.SCAN_PERIOD': 0.2}}
    suite = fresh_suite(constants, parts_folder=folder, workers=1)
    classify = asker(suite)
    before = suite.client.ask('thing', 20).distribution

    def agrees(distribution):
        aspect = max(distribution.aspects, key=lambda aspect: aspect.count)
        found = classify('thing', [getattr(aspect.orientation, axis) for axis in 'xyzw'])
        return (found.aspect, found.probability) == (aspect.id, aspect.probability)

    assert agrees(before)
    shutil.copy(parts_folder() / 'tetrahedron.stl', folder / 'thing.stl')
    suite.client.wait(
        lambda: suite.client.parts()['thing'].part_sha256 != before.run.part_sha256, 'new mesh'
    )
    face = find_aspects(part('tetrahedron')).aspects[2]
    found = classify('thing', face.orientation)
    assert found.aspect == 3
    assert math.isnan(found.probability)  # no distribution of the current version is known
    now = suite.client.ask('thing', 20).distribution
    assert agrees(now)

    suite.processes['drop_simulator'].end()
    suite.client.wait(lambda: not suite.client.parts(), 'no part offered')
    assert agrees(now)
    assert 'known parts: thing' in classify('other', face.orientation).status.message

"""The service classify_pose: its implementation, and requests over DDS."""

import math
import shutil

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ClassifyPose
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.ros.conversions import conditions_msg, poses_from
from resting_aspects_ros.simulation.conditions import parts_folder
from resting_aspects_ros.statistics.poses import RestStatus

BOX = 'box_10x20x30'


def quaternion(xyzw):
    return Quaternion(**dict(zip('xyzw', map(float, xyzw), strict=True)))


def tilted(aspect, degrees):
    """Return the pose of an aspect, rotated about the vertical and then tilted."""
    turn = Rotation.from_euler('zx', [77, degrees], degrees=True)
    return (turn * Rotation.from_quat(aspect.orientation)).as_quat()


@pytest.fixture(scope='module')
def box(part):
    return find_aspects(part(BOX))


# Without DDS


# Over DDS


def asker(suite):
    client = suite.client.node.create_client(ClassifyPose, 'classify_pose')

    def ask(name, orientation):
        request = ClassifyPose.Request(part=name, orientation=quaternion(orientation))
        return suite.client.call(client, request)

    return ask


@pytest.fixture(scope='module')
def classify(suite):
    """Return a function that sends a request to the suite."""
    suite.client.wait(lambda: len(suite.client.parts()) == 4, 'descriptions of the parts')
    return asker(suite)


def test_classification_agrees_with_the_distribution(suite, classify, counts, surfaces):
    name = 'l_bracket'
    # No other test drops under these conditions.
    own = conditions_msg(surfaces.get().changed(friction=0.27))
    received = suite.client.poses()
    distribution = suite.client.ask(name, 150, seed=[3], conditions=[own]).distribution
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
        (0, 0, 0, 1.002),
    ],
)
def test_invalid_orientation_is_rejected(classify, wrong):
    found = classify(BOX, wrong)
    assert found.status.code == Status.INVALID
    assert 'of norm 1 within 0.001' in found.status.message
    assert f'{wrong[0]:.6g}, {wrong[1]:.6g}, ' in found.status.message
    assert found.aspect == 0


@pytest.mark.parametrize('name', ['gizmo', '', 'x' * 300])
def test_service_error_lists_the_known_parts(classify, name):
    found = classify(name, (0, 0, 0, 1))
    assert found.status.code == Status.UNKNOWN_PART
    assert found.status.message.startswith('part ')
    assert ' is not known; known parts: box_10x20x30, ' in found.status.message
    assert len(found.status.message) < 400
    assert math.isnan(found.probability)
    assert math.isnan(found.angle)


def test_current_or_last_offered_part_is_used(fresh_suite, part, tmp_path_factory):
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
    found = suite.client.wait(
        lambda: (answer := classify('thing', face.orientation)).aspect == 3 and answer,
        'its aspect',
    )
    assert math.isnan(found.probability)  # no distribution of the current version is known
    now = suite.client.ask('thing', 20).distribution
    assert agrees(now)

    suite.nodes['drop_simulator'].end()
    suite.client.wait(lambda: not suite.client.parts(), 'no part offered')
    assert agrees(now)
    assert 'known parts: thing' in classify('other', face.orientation).status.message

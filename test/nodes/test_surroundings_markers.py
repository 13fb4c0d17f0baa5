"""Markers of surroundings: patches of planes end at the other planes."""

import dataclasses

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from visualization_msgs.msg import Marker, MarkerArray

import resting_aspects_ros as ra
from resting_aspects_ros.nodes.aspect_classifier.publishers import (
    BODIES,
    NAMES,
    PATCH,
    plane_patch,
    serialized_markers,
)
from resting_aspects_ros.simulation.surroundings import surroundings_names

LEVEL = np.array([0.0, 0.0, 1.0, 0.0])


def area(corners):
    a, b, c = corners[:1], corners[1:-1], corners[2:]
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_patch_of_a_plane_is_a_square_that_ends_at_a_wall():
    corners = plane_patch(np.array([0.6, 0.0, 0.8, -0.1]), [], 2.0)
    np.testing.assert_allclose(corners @ [0.6, 0.0, 0.8], 0.1)
    np.testing.assert_allclose(corners.mean(axis=0), [0.06, 0.0, 0.08], atol=1e-12)
    assert area(corners) == pytest.approx(16.0)
    wall = np.array([0.0, 1.0, 0.0, 0.5])  # the half-space y <= -0.5
    corners = plane_patch(LEVEL, [wall], 2.0)
    assert corners[:, 1].min() == pytest.approx(-0.5)
    assert area(corners) == pytest.approx(4 * 2.5)
    # A plane inside another body has none.
    assert len(plane_patch(LEVEL, [np.array([0.0, 0.0, 1.0, -1.0])], 2.0)) == 0


@pytest.fixture
def markers_in(part, surfaces):
    """Return the serialized markers of the l_bracket in surroundings."""

    def markers_in(name):
        conditions = dataclasses.replace(surfaces.get(), surroundings=ra.surroundings(name))
        return serialized_markers(part('l_bracket'), conditions, None, 'cell')

    return markers_in


def test_a_chute_has_two_patches_with_names(part, markers_in):
    first, *markers = deserialize_message(markers_in('l_chute'), MarkerArray).markers
    assert first.action == Marker.DELETEALL
    assert [each.text for each in markers if each.ns == NAMES] == ['belt, 0.1 m/s', 'wall']
    belt, wall = (
        np.array([[p.x, p.y, p.z] for p in each.points]) for each in markers if each.ns == BODIES
    )
    # The chute is rolled by 45 degrees: both patches rise from its axis, to different sides.
    size = PATCH * part('l_bracket').hull_radius
    for points in (belt, wall):
        assert points[:, 2].min() == pytest.approx(0, abs=1e-9)
        assert points[:, 2].max() == pytest.approx(size * np.sqrt(0.5))
    assert belt[:, 1].mean() * wall[:, 1].mean() < 0


@pytest.mark.parametrize('name', [each for each in surroundings_names() if each != 'plane'])
def test_markers_have_what_rviz_and_foxglove_require(markers_in, name):
    """Read by another implementation of CDR, with its own message definitions."""
    data = markers_in(name)
    store = get_typestore(Stores.ROS2_JAZZY)
    first, *markers = store.deserialize_cdr(data, 'visualization_msgs/msg/MarkerArray').markers
    assert (first.action, first.header.frame_id) == (Marker.DELETEALL, 'cell')
    assert markers
    for each in markers:
        assert (each.action, each.header.frame_id) == (Marker.ADD, 'cell')
        assert (each.lifetime.sec, each.lifetime.nanosec) == (0, 0)  # until it is deleted
        assert 0 < each.color.a <= 1
        q, at = each.pose.orientation, each.pose.position
        assert np.linalg.norm([q.x, q.y, q.z, q.w]) == pytest.approx(1)
        assert np.isfinite([at.x, at.y, at.z]).all()
        if each.type == Marker.TEXT_VIEW_FACING:
            assert each.scale.z > 0
            assert each.text
            continue
        assert each.type == Marker.TRIANGLE_LIST
        assert min(each.scale.x, each.scale.y, each.scale.z) > 0
        assert len(each.points) > 0
        assert len(each.points) % 3 == 0
        assert len(each.colors) in (0, len(each.points))  # one of each point, or none
        assert np.isfinite([[p.x, p.y, p.z] for p in each.points]).all()
    assert len({(each.ns, each.id) for each in markers}) == len(markers)

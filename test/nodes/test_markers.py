"""The markers of aspects and of surroundings, and the current poses, as RViz shows them."""

import dataclasses

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import ContactPlane
from resting_aspects_ros.nodes.aspect_classifier.publishers import (
    MAX_SHOWN,
    MESHES,
    PATCH,
    TEXTS,
    CurrentPosesPublisher,
    PartMarkers,
    labels,
    serialized_markers,
)
from resting_aspects_ros.report.picture import plane_patch
from resting_aspects_ros.ros.conversions import description_msg
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.interface import ALL_LATCHED, CURRENT_POSES, LATCHED
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.statistics.distribution import no_drops
from resting_aspects_ros.statistics.poses import RestStatus

STAMP = Time(sec=12, nanosec=34)


def vector(message):
    return np.array([message.x, message.y, message.z])


# -- of aspects -----------------------------------------------------------------------------------


def corners(mesh):
    """Return the triangles, (m, 3, 3), m, in the tray frame."""
    turn = Rotation.from_quat([getattr(mesh.pose.orientation, axis) for axis in 'xyzw'])
    points = turn.apply(np.array([vector(point) for point in mesh.points]))
    return (points + vector(mesh.pose.position)).reshape(-1, 3, 3)


def split(message):
    """Return the meshes and the texts of a message, by aspect."""
    first, *others = message.markers
    assert first.action == Marker.DELETEALL
    assert {marker.action for marker in others} == {Marker.ADD}
    meshes = {m.id: m for m in others if m.ns == MESHES}
    texts = {m.id: m for m in others if m.ns == TEXTS}
    assert list(meshes) == list(texts) == list(range(1, len(meshes) + 1))
    return meshes, texts


def test_meshes_show_the_part_in_each_aspect(part):
    """Which pose is that of an aspect, test/report tests."""
    part = part('hex_nut')
    aspects = find_aspects(part)
    message = PartMarkers(part, aspects).message(no_drops(aspects), STAMP)
    meshes, texts = split(message)
    for aspect in aspects:
        mesh, text = meshes[aspect.id], texts[aspect.id]
        triangles = corners(mesh)
        assert abs(triangles[..., 2].min()) < 1e-9 * part.hull_radius
        a, b, c = np.moveaxis(triangles - triangles.mean(axis=(0, 1)), 1, 0)
        volume = np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6
        assert volume == pytest.approx(part.volume, rel=1e-6)  # closed, with outward normals
        assert mesh.type == Marker.TRIANGLE_LIST
        np.testing.assert_array_equal(vector(mesh.scale), 1)  # otherwise RViz shows nothing
        assert text.type == Marker.TEXT_VIEW_FACING
        assert text.pose.position.z - text.scale.z / 2 > triangles[..., 2].max()
    for marker in message.markers:
        assert (marker.header.frame_id, marker.header.stamp) == ('tray', STAMP)
        assert marker.color.a == (0 if marker.action == Marker.DELETEALL else 1)
    # Classes share a colour.
    colours = {k: (m.color.r, m.color.g, m.color.b) for k, m in meshes.items()}
    of_classes = [{colours[a.id] for a in members} for members in aspects.classes()]
    assert [len(each) for each in of_classes] == [1, 1]
    assert len(set(colours.values())) == 2


def test_markers_are_published_with_distributions(suite):
    markers = suite.client.listen(MarkerArray, 'markers', ALL_LATCHED)
    found = suite.client.ask('u_bracket', 20, seed=[9006]).distribution
    expected = labels(distribution_from(found))

    def shown():
        # Only the part that has changed last is shown.
        _, texts = split(markers[-1]) if markers else ({}, {})
        return [text.text for text in texts.values()] == expected

    suite.client.wait(shown, 'markers')


# -- of surroundings ------------------------------------------------------------------------------


def area(points, faces):
    a, b, c = np.moveaxis(points[faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_patch_of_a_plane_is_a_square_that_ends_at_a_wall():
    origin = np.zeros(3)
    found = plane_patch(ContactPlane('', np.array([0.6, 0.0, 0.8]), 0.1), [], origin, 2.0)
    np.testing.assert_allclose(found[0] @ [0.6, 0.0, 0.8], 0.1)
    np.testing.assert_allclose(found[0].mean(axis=0), [0.06, 0.0, 0.08], atol=1e-12)
    assert area(*found) == pytest.approx(16.0)
    level = ContactPlane('', np.array([0.0, 0.0, 1.0]), 0.0)
    wall = ContactPlane('', np.array([0.0, 1.0, 0.0]), -0.5)  # of the half-space y <= -0.5
    points, faces = plane_patch(level, [wall], origin, 2.0)
    assert points[:, 1].min() == pytest.approx(-0.5)
    assert area(points, faces) == pytest.approx(4 * 2.5)


@pytest.mark.parametrize('name', ['l_chute', 'bowl_track'])
def test_markers_have_what_rviz_and_foxglove_require(part, surfaces, name):
    """Read by another implementation of CDR, with its own message definitions."""
    solid, store = part('l_bracket'), get_typestore(Stores.ROS2_JAZZY)
    conditions = dataclasses.replace(surfaces.get(), surroundings=ra.surroundings(name))
    job, run = plan_run(solid, conditions, seed=1, drops=1, run_id='a', started=1)
    description = serialize_message(description_msg(run, job.scene, 'cell'))
    data = serialized_markers(description, solid.hull_radius)
    first, *markers = store.deserialize_cdr(data, 'visualization_msgs/msg/MarkerArray').markers
    assert (first.action, first.header.frame_id) == (Marker.DELETEALL, 'cell')
    assert len({(each.ns, each.id) for each in markers}) == len(markers)
    texts = [each for each in markers if each.type == Marker.TEXT_VIEW_FACING]
    bodies = [each for each in markers if each.type == Marker.TRIANGLE_LIST]
    assert len(texts) == len(bodies) == len(markers) / 2 > 0
    for each in markers:
        assert (each.action, each.header.frame_id) == (Marker.ADD, 'cell')
        assert 0 < each.color.a <= 1
        assert np.linalg.norm(dataclasses.astuple(each.pose.orientation)[:4]) == pytest.approx(1)
    points = [np.array([vector(p) for p in each.points]) for each in bodies]
    assert all(len(each) % 3 == 0 < len(each) for each in points)
    assert min(vector(each.scale).min() for each in bodies) > 0
    assert min(each.scale.z for each in texts) > 0
    if name == 'l_chute':
        assert [each.text for each in texts] == ['belt, 0.1 m/s', 'wall']
        # It is rolled by 45 degrees: both patches rise from its axis, to different sides.
        for each in points:
            assert each[:, 2].min() == pytest.approx(0, abs=1e-9)
            assert each[:, 2].max() == pytest.approx(PATCH * solid.hull_radius * np.sqrt(0.5))
        assert points[0][:, 1].mean() * points[1][:, 1].mean() < 0


# -- current poses --------------------------------------------------------------------------------


def test_only_settled_drops_up_to_the_maximum_are_shown(connect, namespace, engine):
    client, listener = connect(namespace), connect(namespace)
    current = CurrentPosesPublisher(client.node, lambda: None)
    received = listener.listen(PoseArray, CURRENT_POSES, LATCHED)
    topic = f'{namespace}/{CURRENT_POSES}'
    client.wait(lambda: client.node.count_subscribers(topic), 'subscription')
    poses = engine(MAX_SHOWN + 20, 1)
    status = np.full(len(poses), RestStatus.SETTLED)
    status[[1, 3]] = RestStatus.UNSETTLED, RestStatus.FAILED
    poses = dataclasses.replace(poses, status=status.astype(np.uint8))
    for k, (run, first, end, shown) in enumerate(
        [
            ('a', 0, 5, [0, 2, 4]),
            ('a', 5, 15, [0, 2, *range(4, 15)]),
            ('a', 15, len(poses), list(range(20, MAX_SHOWN + 20))),
            ('b', 1, 3, [2]),
            ('c', 3, 4, []),
        ],
        start=1,
    ):
        current.take(run, poses.between(first, end), Time(sec=k))
        listener.wait(lambda k=k: current.publish() or len(received) == k, f'message {k}')
        found = [pose.position.x for pose in received[-1].poses]
        assert found == poses.position[shown, 0].tolist()
        assert received[-1].header.stamp.sec == k

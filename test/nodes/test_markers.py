"""The RViz markers: their geometry and texts, and their publication over DDS."""

import copy

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.nodes.aspect_classifier.publishers import (
    MESHES,
    TEXTS,
    PartMarkers,
    labels,
)
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.interface import ALL_LATCHED
from resting_aspects_ros.statistics.distribution import Distribution, no_drops

STAMP = Time(sec=12, nanosec=34)


def vector(message):
    return np.array([message.x, message.y, message.z])


def in_tray(marker, points):
    orientation = marker.pose.orientation
    turn = Rotation.from_quat([getattr(orientation, axis) for axis in 'xyzw'])
    return turn.apply(np.array(points)) + vector(marker.pose.position)


def corners(mesh):
    """Return the triangles, (m, 3, 3), m, in the tray frame."""
    return in_tray(mesh, [vector(p) for p in mesh.points]).reshape(-1, 3, 3)


def split(message):
    """Return the meshes and the texts of a message, by aspect."""
    first, *others = message.markers
    assert first.action == Marker.DELETEALL
    assert {marker.action for marker in others} == {Marker.ADD}
    meshes = {m.id: m for m in others if m.ns == MESHES}
    texts = {m.id: m for m in others if m.ns == TEXTS}
    assert len(meshes) + len(texts) == len(others)
    assert list(meshes) == list(texts) == list(range(1, len(meshes) + 1))
    return meshes, texts


def assert_stands(mesh, part, aspect):
    """Check that a mesh stands on z = 0 in an Aspect, of the suite or of a message."""
    triangles = corners(mesh)
    radius = part.hull_radius
    assert abs(triangles[..., 2].min()) < 1e-9 * radius
    slack = 2e-3 if getattr(aspect.sweep, 'curved', aspect.sweep) else 1e-9
    assert in_tray(mesh, part.centre_of_mass)[2] == pytest.approx(
        aspect.com_height, abs=slack * radius
    )
    a, b, c = np.moveaxis(triangles - triangles.mean(axis=(0, 1)), 1, 0)
    volume = np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(part.volume, rel=1e-6)  # closed, with outward normals


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', ['l_bracket', 'washer'])
def test_meshes_show_the_part_in_each_aspect(part, name):
    part = part(name)
    aspects = find_aspects(part)
    message = PartMarkers(part, aspects).message(no_drops(aspects), STAMP)
    meshes, texts = split(message)
    for aspect in aspects:
        mesh, text = meshes[aspect.id], texts[aspect.id]
        assert_stands(mesh, part, aspect)
        assert mesh.type == Marker.TRIANGLE_LIST
        np.testing.assert_array_equal(vector(mesh.scale), 1)  # otherwise RViz shows nothing
        assert text.type == Marker.TEXT_VIEW_FACING
        assert text.scale.z > 0.1 * part.hull_radius
        where = in_tray(mesh, part.centre_of_mass)
        np.testing.assert_allclose(vector(text.pose.position)[:2], where[:2], atol=1e-12)
        top = corners(mesh)[..., 2].max()
        assert text.pose.position.z - text.scale.z / 2 > top
    for marker in message.markers:
        assert (marker.header.frame_id, marker.header.stamp) == ('tray', STAMP)
        assert marker.color.a == (0 if marker.action == Marker.DELETEALL else 1)
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, 0)  # for ever


def test_meshes_do_not_touch_and_classes_share_a_colour(part):
    part = part('hex_nut')
    aspects = find_aspects(part)
    meshes, _ = split(PartMarkers(part, aspects).message(no_drops(aspects), STAMP))
    spans = [corners(mesh).reshape(-1, 3)[:, :2] for mesh in meshes.values()]
    boxes = [(span.min(axis=0), span.max(axis=0)) for span in spans]
    for k, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:k]:
            assert (low > other_high).any() or (high < other_low).any()
    colours = {k: (m.color.r, m.color.g, m.color.b) for k, m in meshes.items()}
    of_classes = [{colours[a.id] for a in members} for members in aspects.classes()]
    assert [len(each) for each in of_classes] == [1, 1]
    assert len(set(colours.values())) == 2


def test_new_distribution_changes_only_texts_and_stamps(part):
    part = part('tetrahedron')
    aspects = find_aspects(part)
    markers = PartMarkers(part, aspects)
    before = copy.deepcopy(markers.message(no_drops(aspects), Time()))
    counted = Distribution(aspects, np.array([1, 2, 3, 4]), 0, 0, 0)
    _, texts = split(markers.message(counted, STAMP))
    assert [text.text for text in texts.values()] == labels(counted)
    assert markers.message(no_drops(aspects), Time()) == before


def test_markers_are_published_with_distributions(suite):
    markers = suite.client.listen(MarkerArray, 'markers', ALL_LATCHED)
    found = suite.client.ask('u_bracket', 20, seed=[9006]).distribution
    expected = labels(distribution_from(found))

    def shown():
        # Only the part that has changed last is shown.
        _, texts = split(markers[-1]) if markers else ({}, {})
        return [text.text for text in texts.values()] == expected

    suite.client.wait(shown, 'markers')

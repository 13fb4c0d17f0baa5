"""outlines/<part> and identify_part: over DDS, and through the Python client."""

import dataclasses
import math

import numpy as np
import pytest
import shapely
from geometry_msgs.msg import Point32, Polygon
from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import PartDescription, PartOutlines, Status
from resting_aspects_interfaces.srv import IdentifyPart
from shapely import affinity

import resting_aspects_ros as ra
from resting_aspects_ros.api.identify import identify_part, known_part
from resting_aspects_ros.client import RestingAspectsClient
from resting_aspects_ros.nodes.aspect_classifier.outlines import MAX_POINTS
from resting_aspects_ros.ros.conversions import outlines_msg, part_msg, polygon_msgs
from resting_aspects_ros.ros.health import announce
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, IDENTIFY_PART, LATCHED, OUTLINES

PART = 'l_bracket'
SQUARE = np.array([[0, 0], [0.02, 0], [0.02, 0.02], [0, 0.02]])


class Vision:
    """Requests to a suite."""

    def __init__(self, client):
        self.client = client
        self._identify = client.node.create_client(IdentifyPart, IDENTIFY_PART)

    def outlines(self, part):
        """Return the messages of outlines/<part>, after the first has arrived."""
        received = self.client.listen(PartOutlines, f'{OUTLINES}/{part}', LATCHED)
        self.client.wait(lambda: received, f'outlines of {part}')
        return received

    def identify(self, seen, *parts, **fields):
        rings = polygon_msgs(seen) if isinstance(seen, shapely.Polygon) else {'outer': seen}
        request = IdentifyPart.Request(parts=parts, **rings, **fields)
        return self.client.call(self._identify, request)


@pytest.fixture(scope='module')
def vision(suite):
    vision = Vision(suite.client)
    vision.outlines(PART)
    return vision


def test_latched_outlines_are_those_of_the_part(vision, part):
    result = ra.outlines(part(PART))
    expected = outlines_msg(result.part, result.outlines, result.look_alikes)
    received = vision.outlines(PART)[-1]
    # In a message, coordinates have 32 bits.
    assert received == deserialize_message(serialize_message(expected), PartOutlines)


def test_prior_is_the_newest_distribution(vision, part):
    name = 'u_bracket'
    loaded = part(name)
    vision.outlines(name)
    outline = known_part(loaded).outlines[0].polygon
    distribution = vision.client.ask(name, 30, seed=[18], surface='steel').distribution
    by_aspect = {k: each.count + 0.5 for k, each in enumerate(distribution.aspects, start=1)}
    expected = identify_part(outline, known_part(loaded, by_aspect)).candidates[0]
    found = vision.identify(outline, name).candidates[0]
    assert found.prior == pytest.approx(expected.prior)
    assert found.prior != identify_part(outline, known_part(loaded)).candidates[0].prior


@pytest.mark.parametrize(
    ('points', 'parts', 'code', 'reason'),
    [
        (SQUARE[[0, 2, 1, 3]], [PART], Status.INVALID, 'expected a boundary that does not cross'),
        (np.tile(SQUARE, (MAX_POINTS, 1)), [PART], Status.INVALID, f'at most {MAX_POINTS}'),
        (SQUARE, [PART, 'gizmo'], Status.UNKNOWN_PART, "'gizmo'"),
    ],
)
def test_invalid_request_is_rejected_with_the_reason(vision, points, parts, code, reason):
    outer = Polygon(points=[Point32(x=float(x), y=float(y)) for x, y in points])
    found = vision.identify(outer, *parts)
    assert found.status.code == code
    assert reason in found.status.message
    assert not found.candidates
    assert math.isnan(found.none_probability)


def test_client_identifies(suite, vision, part):
    outline = known_part(part(PART)).outlines[1].polygon
    turned = affinity.rotate(outline, 1, (0, 0), use_radians=True)
    seen = affinity.translate(turned, 0.1, 0.05)
    points = {'outer': np.asarray(seen.exterior.coords)}
    with RestingAspectsClient(suite.client.node) as spun:
        asked = spun.identify_part_async(points, PART, camera=[0, 0, 1e6], timeout=600)
        suite.client.wait(asked.done, 'identification')
    best = asked.result().candidates[0]
    assert (best.x, best.y, best.yaw) == pytest.approx((0.1, 0.05, 1), abs=1e-3)


@pytest.mark.slow
def test_outlines_of_a_changed_part_replace_the_old_ones(start, connect, namespace, part):
    client = connect(namespace)
    announce(client.node, DROP_SIMULATOR)
    description = client.node.create_publisher(PartDescription, 'parts/thing', LATCHED)
    quick = {'nodes.aspect_classifier.known.QUIET_PERIOD': 0.1}
    classifier = start('aspect_classifier', namespace, {'log_folder': "''"}, quick)
    vision, box = Vision(client), dataclasses.replace(part('box_10x20x30'), name='thing')
    description.publish(part_msg(dataclasses.replace(part('tetrahedron'), name='thing')))
    received = vision.outlines('thing')
    assert len(received[-1].outlines) == 1
    description.publish(part_msg(box))
    client.wait(lambda: len(received[-1].outlines) == 3, 'outlines of the box')
    assert received[-1].part_sha256 == box.part_sha256
    outline = known_part(box).outlines[1].polygon
    assert vision.identify(outline, 'thing').candidates[0].symmetry_class == 2

    broken = part_msg(box)
    broken.mesh = list(b'no mesh')
    description.publish(broken)
    client.wait(lambda: 'cannot be used' in classifier.output, 'warning')
    assert vision.identify(outline, 'thing').status.code == Status.INVALID

"""Outlines, observed polygons and identified parts as ROS messages, through real CDR."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from resting_aspects_interfaces.msg import Outline
from resting_aspects_interfaces.srv import IdentifyPart
from wire import over_the_wire

import resting_aspects_ros as ra
from resting_aspects_ros.api.identify import identify_part, known_part
from resting_aspects_ros.report.outlines import outlines_document
from resting_aspects_ros.ros.conversions import (
    candidate_msg,
    outlines_msg,
    polygon_from,
    polygon_msgs,
)
from resting_aspects_ros.vision.identification import observed_polygon

# Rounding of a coordinate to 32 bits, for parts of some cm, m.
ROUNDING = 1e-8


def corners(polygon):
    return np.array([(p.x, p.y) for p in polygon.points])


@pytest.mark.slow
def test_message_contains_all_fields_of_the_document(part):
    result = ra.outlines(part('hex_nut'))
    first, *others = result.outlines
    # As of a part that rocks.
    outlines = (dataclasses.replace(first, family=(others[0].polygon, first.polygon)), *others)
    message = over_the_wire(outlines_msg(result.part, outlines, result.look_alikes))
    document = outlines_document(result.part, outlines, result.look_alikes)
    assert (message.part, message.part_sha256) == (document['part'], document['part_sha256'])
    assert len(message.outlines) == len(document['outlines'])
    for found, expected in zip(message.outlines, document['outlines'], strict=True):
        orientation = [getattr(found.orientation, axis) for axis in 'xyzw']
        assert orientation == expected.pop('orientation')
        assert [found.centroid.x, found.centroid.y] == expected.pop('centroid')
        assert list(found.aspects) == expected.pop('aspects')
        check_rings(found, expected)
        for k, other in enumerate(expected.pop('family')):
            of = zip(found.family_holes, found.family_hole_of, strict=True)
            holes = [hole for hole, outline in of if outline == k]
            check_rings(SimpleNamespace(outer=found.family[k], holes=holes), other)
        for k, other in enumerate(expected.pop('look_alike')):
            assert found.other_class[k] == other['symmetry_class']
            assert found.other_overlap[k] == other['overlap']
            assert found.other_verdict[k] == getattr(Outline, other['verdict'].upper())
            assert found.other_resolution[k] == other['resolution']
        expected.pop('mirrored')  # those with the verdict
        assert {name: getattr(found, name) for name in expected} == expected


def check_rings(message, fields):
    outer, holes = fields.pop('outer'), fields.pop('holes')
    assert corners(message.outer) == pytest.approx(np.array(outer), abs=ROUNDING)
    assert len(message.holes) == len(holes)
    for found, expected in zip(message.holes, holes, strict=True):
        assert corners(found) == pytest.approx(np.array(expected), abs=ROUNDING)


def test_polygon_with_a_hole_is_sent_unchanged():
    hole = [[0.01, 0.01], [0.01, 0.02], [0.02, 0.02]]
    given = {'outer': [[0, 0], [0.04, 0], [0.04, 0.03], [0, 0.03]], 'holes': [hole]}
    polygon = observed_polygon(given)
    request = over_the_wire(IdentifyPart.Request(**polygon_msgs(polygon)))
    again = observed_polygon(polygon_from(request.outer, request.holes))
    assert len(again.interiors) == 1
    assert again.symmetric_difference(polygon).area < ROUNDING * polygon.length


def test_candidates_contain_all_poses(part):
    known = known_part(part('box_10x20x30'))
    numbers = 'x y yaw overlap distance residual prior posterior symmetry_class'
    for candidate in identify_part(known.outlines[0].polygon, known).candidates:
        found = over_the_wire(candidate_msg(candidate))
        for name in ('part', *numbers.split()):
            assert getattr(found, name) == getattr(candidate, name)
        assert tuple(found.aspects) == candidate.aspects
        assert list(found.pose_aspects) == [each.aspect for each in candidate.poses]
        assert set(found.pose_aspects) == set(candidate.aspects)
        for sent, pose in zip(found.poses, candidate.poses, strict=True):
            assert [getattr(sent.position, axis) for axis in 'xyz'] == pose.position.tolist()
            assert [getattr(sent.orientation, a) for a in 'xyzw'] == pose.orientation.tolist()

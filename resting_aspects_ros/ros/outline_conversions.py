"""Conversions between outlines, observed polygons, identified parts and ROS messages."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Point32, Polygon
from resting_aspects_interfaces.msg import (
    Outline,
    PartCandidate,
    PartOutlines,
)

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.outlines import polygon_fields
from resting_aspects_ros.ros.conversions import pose_msg, quaternion_msg, shared
from resting_aspects_ros.vision import outline as part_outline
from resting_aspects_ros.vision.outline import LookAlike
from resting_aspects_ros.vision.rolling import Candidate

# By the verdict of a LookAlike.
VERDICTS = {
    'distinct': Outline.DISTINCT,
    'same': Outline.SAME,
    'mirrored': Outline.MIRRORED,
}


def outlines_msg(
    part: Part,
    outlines: Sequence[part_outline.Outline],
    look_alikes: Mapping[int, Sequence[LookAlike]],
) -> PartOutlines:
    """Return the message for the outlines of a part.

    look_alikes : by symmetry class, the comparisons with the outlines of the other classes
    """
    return PartOutlines(
        part=part.name,
        part_sha256=part.part_sha256,
        aspect_numbering=ASPECT_NUMBERING,
        outlines=[_outline_msg(each, look_alikes[each.symmetry_class]) for each in outlines],
    )


def _outline_msg(outline: part_outline.Outline, others: Sequence[LookAlike]) -> Outline:
    x, y = outline.centroid.tolist()
    family = [polygon_msgs(each) for each in outline.family]
    values = shared(outline, Outline) | polygon_msgs(outline.polygon)
    values |= {
        'orientation': quaternion_msg(outline.orientation),
        'centroid': Point(x=x, y=y),
        'family': [each['outer'] for each in family],
        'family_holes': [hole for each in family for hole in each['holes']],
        'family_hole_of': [k for k, each in enumerate(family) for _ in each['holes']],
        'other_class': [each.symmetry_class for each in others],
        'other_overlap': [each.overlap for each in others],
        'other_resolution': [each.resolution for each in others],
        'other_verdict': [VERDICTS[each.verdict] for each in others],
    }
    return Outline(**values)


def polygon_msgs(polygon: Any) -> dict[str, Any]:
    """Return the fields ``outer`` and ``holes`` of a shapely.Polygon; coordinates have 32 bits."""
    rings: dict[str, Any] = polygon_fields(polygon)
    return {'outer': _ring_msg(rings['outer']), 'holes': [_ring_msg(r) for r in rings['holes']]}


def polygon_from(outer: Polygon, holes: Iterable[Polygon]) -> dict[str, Any]:
    """Return the boundaries as `observed_polygon` accepts them; they are not checked."""
    return {'outer': _ring(outer), 'holes': [_ring(each) for each in holes]}


def candidate_msg(candidate: Candidate) -> PartCandidate:
    """Return the message for a candidate of an identification."""
    poses = candidate.poses
    values = shared(candidate, PartCandidate) | {
        'poses': [pose_msg(each.position, each.orientation) for each in poses],
        'pose_aspects': [each.aspect for each in poses],
        'yaw_known': all(each.yaw_known for each in poses),
    }
    return PartCandidate(**values)


def _ring_msg(points: Iterable[tuple[float, float]]) -> Polygon:
    return Polygon(points=[Point32(x=x, y=y) for x, y in points])


def _ring(polygon: Polygon) -> Array:
    points = np.array([(p.x, p.y) for p in polygon.points], dtype=np.float64)
    return points.reshape(-1, 2)

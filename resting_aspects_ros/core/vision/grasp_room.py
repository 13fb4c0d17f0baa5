"""Which grasps of the parts in an image have no other part in the footprint of the gripper."""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import shapely
from shapely import affinity

from resting_aspects_ros.core.vision.grasp import Grasp, gripper_area, gripper_poses
from resting_aspects_ros.core.vision.known_part import KnownPart
from resting_aspects_ros.core.vision.location import Pose


class Detection(Protocol):
    """A camera pose of a part, m and rad, and its distance to the next outline, m."""

    @property
    def x(self) -> float: ...  # noqa: D102
    @property
    def y(self) -> float: ...  # noqa: D102
    @property
    def yaw(self) -> float: ...  # noqa: D102
    @property
    def clearance(self) -> float: ...  # noqa: D102


def free_grasps(
    detections: Sequence[Detection],
    classes: Sequence[int],
    part: KnownPart,
    grasps: Sequence[Grasp],
) -> list[tuple[Pose, ...]]:
    """Return the poses of the gripper, tray frame, for each detection; empty if none is free.

    They are in the order of the grasps, and those of a grasp in the order of the poses of the
    part. A grasp is free if the footprint of the gripper touches no other outline. The outline of
    a detection that is not recognised, or is of another part, is not known: it is assumed to be
    within the length of the longest outline of the part. If the clearance of a detection was
    measured and the gripper stays within it, the other outlines do not matter.

    Parameters
    ----------
    detections : sequence of Detection
        All of an image.
    classes : sequence of int
        Symmetry class of each; 0: not recognised, or another part.
    """
    longest = max(outline.length for outline in part.outlines)
    areas = np.array(
        [
            _area(each, number, part, longest)
            for each, number in zip(detections, classes, strict=True)
        ],
        dtype=object,
    )
    shapely.prepare(areas)
    able = {grasp.aspect for grasp in grasps}
    found = []
    for k, (each, number) in enumerate(zip(detections, classes, strict=True)):
        poses: tuple[Pose, ...] = ()
        if number and able.intersection(part.outlines[number - 1].aspects):
            room = areas[k]
            if math.isfinite(each.clearance):
                room = room.buffer(each.clearance)
            others = np.delete(areas, k)
            lying = part.placements[number - 1].poses(each.x, each.y, each.yaw)
            poses = tuple(
                pose
                for grasp in grasps
                for pose in gripper_poses(grasp, lying)
                if _is_free(gripper_area(grasp, pose), room, others)
            )
        found.append(poses)
    return found


def _area(detection: Detection, number: int, part: KnownPart, longest: float) -> shapely.Geometry:
    """Return what a detection covers on the tray; nothing if its place is not valid."""
    if number:
        polygon = part.outlines[number - 1].polygon
        turned = affinity.rotate(polygon, detection.yaw, origin=(0, 0), use_radians=True)
        return affinity.translate(turned, detection.x, detection.y)
    if not (math.isfinite(detection.x) and math.isfinite(detection.y)):
        return shapely.Point()
    return shapely.Point(detection.x, detection.y).buffer(longest)


def _is_free(
    gripper: shapely.Geometry,
    room: shapely.Geometry,
    others: 'np.ndarray[tuple[int], np.dtype[np.object_]]',
) -> bool:
    return bool(room.covers(gripper) or not shapely.intersects(others, gripper).any())

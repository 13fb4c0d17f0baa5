"""Grasps: read from a file, where the gripper takes a part, what it covers, and its room."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, located, shown
from resting_aspects_ros.input_files import FileModel, FromOne, Number, named, read_yaml, validated
from resting_aspects_ros.part.part import DEFAULT_UNIT, UNITS, Unit
from resting_aspects_ros.rotations import product, rotate
from resting_aspects_ros.vision.boundary import placed
from resting_aspects_ros.vision.location import Placement, Pose, checked_pose
from resting_aspects_ros.vision.rolling import KnownPart

# -- Grasps and the room around them --------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Grasp:
    """A pose of a gripper relative to a part that lies in an aspect, with its footprint.

    z of the gripper frame is its approach direction, away from the robot: down on a tray.

    aspect : int
        One aspect of a symmetry class is sufficient: the poses of a class contain all its aspects.
    position : (3,) float
        Origin of the gripper frame in the part frame, m.
    orientation : (4,) float
        Unit quaternion xyzw, part from gripper.
    length, width, radius : float
        Footprint: all points within the radius of a rectangle, m, along x and y of the gripper
        frame; a disc if length and width are 0.
    """

    aspect: int
    position: Array
    orientation: Array
    length: float = 0.0
    width: float = 0.0
    radius: float = 0.0

    def __post_init__(self) -> None:
        position, orientation = checked_pose(self.position, self.orientation, ' of a grasp')
        sides = (self.length, self.width, self.radius)
        if not all(0 <= side < np.inf for side in sides) or not any(sides):
            raise InvalidValueError(
                f'invalid footprint {shown(sides)} of a grasp: expected lengths of 0 m or more, '
                'one of them above 0'
            )
        object.__setattr__(self, 'position', position)
        object.__setattr__(self, 'orientation', orientation)


def gripper_poses(grasp: Grasp, poses: Iterable[Pose]) -> tuple[Pose, ...]:
    """Return the poses of the gripper in the frame of the poses of a part.

    Only poses in the aspect of the grasp give one, in their order; none if there are none.
    """
    return tuple(
        Pose(
            pose.aspect,
            pose.position + rotate(pose.orientation, grasp.position),
            product(pose.orientation[None], grasp.orientation[None])[0],
            pose.yaw_known,
        )
        for pose in poses
        if pose.aspect == grasp.aspect
    )


def gripper_area(grasp: Grasp, pose: Pose) -> shapely.Geometry:
    """Return what a gripper in a pose of `gripper_poses` covers, seen from above, tray frame, m.

    A gripper that is inclined covers less than this.
    """
    along = rotate(pose.orientation, np.array([[1.0, 0.0, 0.0]]))[0]
    a, b = grasp.length / 2, grasp.width / 2
    sides = shapely.MultiPoint([(a, b), (-a, b), (-a, -b), (a, -b)]).convex_hull
    x, y, _ = pose.position.tolist()
    return placed(sides, x, y, math.atan2(along[1], along[0])).buffer(grasp.radius)


# -- Room -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Detection:
    """A part, or a blob of parts, in an image; see the message Detection.

    index : int
        In the detections of the image, from 0.
    """

    index: int
    part: str
    class_id: str
    score: float
    x: float
    y: float
    yaw: float
    clearance: float


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

    ``detections`` are all of an image, and ``classes`` the symmetry class of each; 0: not
    recognised, or another part.
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
    found = []
    for k, (each, number) in enumerate(zip(detections, classes, strict=True)):
        free: list[Pose] = []
        if number:
            room = areas[k]
            if math.isfinite(each.clearance):
                room = room.buffer(each.clearance)
            others = np.delete(areas, k)
            lying = part.placements[number - 1].poses(each.x, each.y, each.yaw)
            for grasp in grasps:
                for pose in gripper_poses(grasp, lying):
                    gripper = gripper_area(grasp, pose)
                    if room.covers(gripper) or not shapely.intersects(others, gripper).any():
                        free.append(pose)
        found.append(tuple(free))
    return found


def _area(detection: Detection, number: int, part: KnownPart, longest: float) -> shapely.Geometry:
    """Return what a detection covers on the tray; nothing if its place is not valid."""
    if number:
        polygon = part.outlines[number - 1].polygon
        return placed(polygon, detection.x, detection.y, detection.yaw)
    if not (math.isfinite(detection.x) and math.isfinite(detection.y)):
        return shapely.Point()
    return shapely.Point(detection.x, detection.y).buffer(longest)


# -- Grasps of a file -----------------------------------------------------------------------------


# Largest angle between the approach direction of a gripper and the vertical, rad.
MAX_INCLINATION = math.radians(60)
# A grasp that is further from the centre of mass, in radii of the part, has the wrong unit.
MAX_DISTANCE = 10.0
EXPECTED = {
    'unit': f'one of {", ".join(UNITS)}',
    'grasps': 'a list of grasps',
    'aspect': 'an integer from 1',
    'position': '3 numbers',
    'orientation': '4 numbers',
    'footprint': 'a diameter, or length and width',
}


class _GraspsFile(FileModel):
    unit: Unit = DEFAULT_UNIT
    grasps: list[Any]


class _Grasp(FileModel):
    aspect: FromOne
    position: tuple[Number, Number, Number]
    orientation: tuple[Number, Number, Number, Number]
    footprint: Number | tuple[Number, Number]


def load_grasps(path: str | Path) -> tuple[Grasp, ...]:
    """Read the grasps of a part from a YAML file, in their order: the preferred ones first.

    config/grasps/l_bracket.yaml is an example that describes all keys. Lengths are in the unit of
    the file, mm by default.

    Raises
    ------
    InvalidValueError
        The file cannot be read, or a key or a value is invalid; the message names the grasp.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> grasps = ra.load_grasps('config/grasps/l_bracket.yaml')
    >>> [grasp.aspect for grasp in grasps]
    [1, 1]
    """
    label = named('grasps file', Path(path))
    given = validated(_GraspsFile, read_yaml(Path(path), 'grasps file'), label, EXPECTED)
    if not given.grasps:
        raise InvalidValueError(f'invalid grasps [] in {label}: expected at least one')
    return tuple(
        _grasp(values, UNITS[given.unit], f'grasp {number} in {label}')
        for number, values in enumerate(given.grasps, 1)
    )


def check_grasps(
    grasps: Sequence[Grasp], placements: Sequence[Placement], pickable: Sequence[int]
) -> None:
    """Raise InvalidValueError if grasps do not fit a part, or a pickable aspect lacks one.

    There is a placement for each symmetry class. One grasp is sufficient for all aspects of a
    class.
    """
    part, aspects = placements[0].part, placements[0].aspects
    for number, grasp in enumerate(grasps, 1):
        where = f'of grasp {number}'
        if not 1 <= grasp.aspect <= len(aspects):
            raise InvalidValueError(
                f'invalid aspect {shown(grasp.aspect)} {where}: expected 1 to {len(aspects)}'
            )
        distance = math.dist(grasp.position, part.centre_of_mass)
        if distance > MAX_DISTANCE * part.hull_radius:
            raise InvalidValueError(
                f'invalid position {shown(grasp.position.tolist())} m {where}: expected one near '
                f'the part; it is {distance:.3g} m from its centre of mass (is the unit right?)'
            )
        (lies,) = (each for each in placements if grasp.aspect in each.outline.aspects)
        pose = gripper_poses(grasp, lies.poses(0.0, 0.0, 0.0))[0]
        approach = rotate(pose.orientation, np.array([[0.0, 0.0, 1.0]]))[0]
        angle = math.acos(np.clip(-approach[2], -1.0, 1.0))
        if angle > MAX_INCLINATION:
            raise InvalidValueError(
                f'invalid orientation {shown(grasp.orientation.round(4).tolist())} {where}: '
                'expected z of the gripper to point down, within '
                f'{math.degrees(MAX_INCLINATION):.0f} degrees, when the part lies in aspect '
                f'{grasp.aspect}; it is {math.degrees(angle):.0f} degrees from that'
            )
    able = {grasp.aspect for grasp in grasps}
    for each in placements:
        wanted = sorted(set(each.outline.aspects) & set(pickable))
        if wanted and able.isdisjoint(each.outline.aspects):
            raise InvalidValueError(
                f'invalid grasps: expected one for pickable aspect {wanted[0]} (symmetry class '
                f'{each.outline.symmetry_class}); they are for {sorted(able)}'
            )


def _grasp(values: object, metres: float, where: str) -> Grasp:
    """Return the grasp that an entry of a file states."""
    given = validated(_Grasp, values, where, EXPECTED)
    sides = {'radius': 0.0, 'length': 0.0, 'width': 0.0}
    if isinstance(given.footprint, tuple):
        sides['length'], sides['width'] = (metres * side for side in given.footprint)
    else:
        sides['radius'] = metres * given.footprint / 2
    position = metres * np.array(given.position, dtype=np.float64)
    orientation = np.array(given.orientation, dtype=np.float64)
    with located(where):
        return Grasp(given.aspect, position, orientation, **sides)

"""Grasps of a part: read from a file, checked, and as footprints of the gripper on the tray."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.footprint import Footprint, Grip
from resting_aspects_ros.input_files import FileModel, FromOne, Number, named, read_yaml, validated
from resting_aspects_ros.part.hull import smallest_rectangle
from resting_aspects_ros.part.part import DEFAULT_UNIT, UNITS, Unit
from resting_aspects_ros.vision.grasp import (
    Grasp,
    approach_angle,
    gripper_place,
    gripper_poses,
)
from resting_aspects_ros.vision.location import Placement

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

    Parameters
    ----------
    placements : sequence of Placement
        One for each symmetry class.
    pickable : sequence of int
        Ids of aspects; one grasp is sufficient for those of a symmetry class.
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
        angle = approach_angle(_pose_of(grasp, placements))
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


def grips_of(grasps: Sequence[Grasp], placement: Placement) -> tuple[Grip, ...]:
    """Return what the gripper covers for each grasp of a symmetry class.

    It is relative to the centre and the longer side of the rectangle around the outline, as the
    model of free parts represents the part.
    """
    outline = placement.outline
    centre = outline.centroid
    if outline.yaw_symmetry != 0:
        centre = smallest_rectangle(shapely.get_coordinates(outline.polygon))[0]
    cos, sin = math.cos(outline.long_axis), math.sin(outline.long_axis)
    found = []
    for grasp in grasps:
        if grasp.aspect not in outline.aspects:
            continue
        x, y, yaw = gripper_place(_pose_of(grasp, (placement,)))
        dx, dy = x - centre[0], y - centre[1]
        found.append(
            Grip(
                Footprint(grasp.length, grasp.width, grasp.radius),
                float(cos * dx + sin * dy),
                float(cos * dy - sin * dx),
                yaw - outline.long_axis,
            )
        )
    return tuple(found)


def _pose_of(grasp: Grasp, placements: Sequence[Placement]) -> Any:
    """Return the pose of the gripper for a part at x = y = yaw = 0."""
    (placement,) = (each for each in placements if grasp.aspect in each.outline.aspects)
    return gripper_poses(grasp, placement.poses(0.0, 0.0, 0.0))[0]


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
    try:
        return Grasp(given.aspect, position, orientation, **sides)
    except InvalidValueError as error:
        raise InvalidValueError(f'{error} ({where})') from None

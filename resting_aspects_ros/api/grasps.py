"""Grasps of a part: read from a file, checked, and as footprints of the gripper on the tray."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.footprint import Footprint, Grip
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.units import DEFAULT_UNIT, UNITS
from resting_aspects_ros.core.vision.grasp import (
    Grasp,
    approach_angle,
    gripper_place,
    gripper_poses,
)
from resting_aspects_ros.core.vision.location import Placement
from resting_aspects_ros.core.yaml_file import read_yaml

FILE_KEYS = ('unit', 'grasps')
KEYS = ('aspect', 'position', 'orientation', 'footprint')
# Largest angle between the approach direction of a gripper and the vertical, rad.
MAX_INCLINATION = math.radians(60)
# A grasp that is further from the centre of mass, in radii of the part, has the wrong unit.
MAX_DISTANCE = 10.0


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
    content = read_yaml(Path(path), 'grasps file')
    if not isinstance(content, Mapping) or not isinstance(content.get('grasps'), list):
        raise InvalidValueError(f'invalid content of {label}: expected a list "grasps"')
    _check_keys(content, FILE_KEYS, label)
    unit = content.get('unit', DEFAULT_UNIT)
    if not isinstance(unit, str) or unit not in UNITS:
        raise InvalidValueError(
            f'invalid unit {shown(unit)} in {label}: expected one of {", ".join(UNITS)}'
        )
    if not content['grasps']:
        raise InvalidValueError(f'invalid grasps [] in {label}: expected at least one')
    found = []
    for number, values in enumerate(content['grasps'], 1):
        where = f'grasp {number} in {label}'
        try:
            found.append(_grasp(values, UNITS[unit]))
        except InvalidValueError as error:
            raise InvalidValueError(f'{error} ({where})') from None
    return tuple(found)


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
                f'invalid aspect {grasp.aspect} {where}: expected 1 to {len(aspects)}'
            )
        distance = float(np.linalg.norm(grasp.position - part.centre_of_mass))
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
    rectangle = shapely.minimum_rotated_rectangle(outline.polygon)
    middle = outline.polygon if outline.yaw_symmetry == 0 else rectangle
    centre = np.array(middle.centroid.coords[0])
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


def _check_keys(values: Mapping[object, object], keys: Sequence[str], where: str) -> None:
    for key in values:
        if key not in keys:
            raise InvalidValueError(
                f'invalid key {shown(key)} in {where}: expected one of {", ".join(keys)}'
            )


def _grasp(values: object, metres: float) -> Grasp:
    """Return the grasp that the keys of a file state."""
    if not isinstance(values, Mapping) or any(key not in values for key in KEYS):
        raise InvalidValueError(
            f'invalid grasp {shown(values)}: expected the keys {", ".join(KEYS)}'
        )
    _check_keys(values, KEYS, 'a grasp')
    aspect, footprint = values['aspect'], values['footprint']
    if type(aspect) is not int or aspect < 1:
        raise InvalidValueError(f'invalid aspect {shown(aspect)}: expected an integer from 1')
    position = _numbers('position', values['position'], 3)
    orientation = _numbers('orientation', values['orientation'], 4)
    sides = {'radius': 0.0, 'length': 0.0, 'width': 0.0}
    if isinstance(footprint, list):
        sides['length'], sides['width'] = metres * _numbers('footprint', footprint, 2)
    else:
        sides['radius'] = float(metres * _numbers('footprint', footprint, 1)[0] / 2)
    return Grasp(aspect, metres * position, orientation, **sides)


def _numbers(name: str, value: object, count: int) -> Any:
    """Return finite numbers (count,); a single one is given without a list."""
    numbers = value if isinstance(value, list) and count > 1 else [value]
    good = [x for x in numbers if isinstance(x, int | float) and not isinstance(x, bool)]
    if len(good) != count or len(numbers) != count or not all(map(math.isfinite, good)):
        expected = 'a diameter, or length and width' if name == 'footprint' else f'{count} numbers'
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected {expected}')
    return np.array(good, dtype=np.float64)

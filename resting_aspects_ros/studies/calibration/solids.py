"""Parts of a counts file: named parts, mesh files, and solids that are given by their sizes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError, PartError, shown
from resting_aspects_ros.core.part import Part, valid_name
from resting_aspects_ros.core.part_loading import part_from_bytes
from resting_aspects_ros.core.units import DEFAULT_UNIT

# How a part is given, with what is expected.
KINDS = {
    'part': 'the name of a part',
    'mesh': 'a mesh file',
    'box': 'three lengths along x, y and z',
    'cylinder': 'diameter and height',
    'hull': 'rows of x, y and z of the corners of a convex solid',
}
SECTIONS = 64  # flats of a cylinder
# A direction is along an axis within this angle.
AXIS_ANGLE = np.radians(3.0)
MAX_POINTS = 10_000


def make_solid(entry: Mapping[str, Any], folder: Path, where: str) -> Part:
    """Return the part of an entry with exactly one of KINDS; raises RestingAspectsError."""
    given = [kind for kind in KINDS if kind in entry]
    if len(given) != 1:
        raise InvalidValueError(f'{where}: expected exactly one of {", ".join(KINDS)}')
    kind, value = given[0], entry[given[0]]
    unit = entry.get('unit')
    if kind in ('part', 'mesh'):
        if not isinstance(value, str):
            raise InvalidValueError(f'{where}: invalid {kind} {shown(value)}: expected text')
        return load_part(value if kind == 'part' else folder / value, unit)
    import trimesh  # takes a second

    numbers = _numbers(value, kind, where)
    if kind == 'box':
        mesh = trimesh.creation.box(numbers)
    elif kind == 'cylinder':
        mesh = trimesh.creation.cylinder(numbers[0] / 2, numbers[1], sections=SECTIONS)
    else:
        if np.linalg.matrix_rank(numbers - numbers.mean(axis=0)) < 3:
            raise PartError(f'{where}: invalid hull: expected points that span a solid')
        mesh = trimesh.convex.convex_hull(numbers)
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    name = valid_name(str(entry.get('name', kind)))
    return part_from_bytes(data, 'stl', name, unit=DEFAULT_UNIT if unit is None else unit)


def side_ids(kind: str, name: str, aspects: AspectSet) -> tuple[int, ...] | None:
    """Return the ids of the aspects on the sides that a name stands for; None for other names.

    Of a box, x, y or z are the two sides across that axis; of a cylinder, ``end`` and ``side``.
    """
    axes = {'x': 0, 'y': 1, 'z': 2} if kind == 'box' else {'end': 2, 'side': 2}
    if kind not in ('box', 'cylinder') or name not in axes:
        return None
    along = np.array([abs(a.down_in_part[axes[name]]) for a in aspects.aspects])
    inside = along > np.cos(AXIS_ANGLE)
    if name == 'side':
        inside = ~inside
    return tuple(a.id for a, chosen in zip(aspects.aspects, inside, strict=True) if chosen)


def _numbers(value: Any, kind: str, where: str) -> npt.NDArray[np.float64]:
    shapes = {'box': (3,), 'cylinder': (2,)}
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.zeros(0)
    fits = (
        numbers.shape == shapes[kind] and bool((numbers > 0).all())
        if kind in shapes
        else numbers.ndim == 2 and numbers.shape[1] == 3 and 4 <= len(numbers) <= MAX_POINTS
    )
    if not fits or not np.isfinite(numbers).all():
        raise InvalidValueError(f'{where}: invalid {kind} {shown(value)}: expected {KINDS[kind]}')
    return numbers

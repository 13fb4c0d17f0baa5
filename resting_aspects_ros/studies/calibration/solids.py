"""Parts of a counts file: named parts, mesh files, and solids that are given by their sizes."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import StrictStr

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError, PartError, shown
from resting_aspects_ros.core.part import Part, valid_name
from resting_aspects_ros.core.part_loading import part_from_bytes
from resting_aspects_ros.core.schema import FileModel, Number, Positive
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


class CountedEntry(FileModel):
    """A part of a counts file, which is given in one of the ways in KINDS."""

    name: StrictStr = ''
    unit: StrictStr | None = None
    counts: Any = None
    drops: Any = None
    conditions: Any = None
    part: StrictStr | None = None
    mesh: StrictStr | None = None
    box: tuple[Positive, Positive, Positive] | None = None
    cylinder: tuple[Positive, Positive] | None = None
    hull: list[tuple[Number, Number, Number]] | None = None

    @property
    def kind(self) -> str:
        """The key in KINDS that is given; raises InvalidValueError unless it is exactly one."""
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise InvalidValueError(
                f'invalid keys {shown(given)}: expected exactly one of {", ".join(KINDS)}'
            )
        return given[0]


def make_solid(entry: CountedEntry, folder: Path) -> Part:
    """Return the part of an entry; raises RestingAspectsError."""
    kind, unit = entry.kind, entry.unit
    if entry.part is not None:
        return load_part(entry.part, unit)
    if entry.mesh is not None:
        return load_part(folder / entry.mesh, unit)
    import trimesh  # takes a second

    if entry.box is not None:
        mesh = trimesh.creation.box(entry.box)
    elif entry.cylinder is not None:
        mesh = trimesh.creation.cylinder(entry.cylinder[0] / 2, entry.cylinder[1], SECTIONS)
    else:
        mesh = trimesh.convex.convex_hull(_spanning(entry.hull or []))
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    name = valid_name(entry.name or kind)
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


def _spanning(points: list[tuple[float, float, float]]) -> npt.NDArray[np.float64]:
    """Return points (n, 3) that span a solid; raises RestingAspectsError."""
    if not 4 <= len(points) <= MAX_POINTS:
        raise InvalidValueError(
            f'invalid hull of {len(points)} points: expected 4 to {MAX_POINTS} {KINDS["hull"]}'
        )
    found = np.array(points, dtype=np.float64)
    if np.linalg.matrix_rank(found - found.mean(axis=0)) < 3:
        raise PartError('invalid hull: expected points that span a solid')
    return found

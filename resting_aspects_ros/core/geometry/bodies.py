"""Unite the bodies of a mesh that touch each other, and choose one of the united bodies.

CAD programs export an assembly, or a screw as a head and a shank, as several closed shells. The
volume integrals would count overlaps twice, and bodies that do not touch cannot be one rigid part.
"""

import dataclasses
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, PartError, shown
from resting_aspects_ros.core.geometry.closed_surface import Surface, closed_surface
from resting_aspects_ros.core.geometry.mass_properties import solid_integrals
from resting_aspects_ros.core.geometry.mesh_file import without_unused
from resting_aspects_ros.core.geometry.triangle_edges import triangle_edges
from resting_aspects_ros.core.units import box_text

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Bodies touch if the gap is at most this share of the size of the mesh. It is the noise of float32
# far from the origin, and less than any intended gap.
TOUCH = 1e-5
# Maximum relative change of the volume by the union of bodies that touch but do not overlap.
SAME_VOLUME = 1e-6
# A shell with less volume, as a share of the cube of its size, is a sheet folded onto itself.
MIN_VOLUME_SHARE = 1e-9
MAX_BODIES = 10_000
MAX_NEAR_PAIRS = 2_000  # bodies whose boxes touch are compared triangle by triangle
MAX_LISTED = 5


class SeparateBodiesError(PartError):
    """A mesh has several bodies that do not touch each other, and none is chosen."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Body:
    """A shell that faces outward, with its cavities; lengths are relative to the mesh size."""

    number: int
    corners: Array  # (m, 3, 3) of its triangles

    @cached_property
    def volume(self) -> float:
        return float(np.linalg.det(self.corners).sum() / 6)

    @cached_property
    def low(self) -> Array:
        return np.asarray(self.corners.min(axis=(0, 1)))

    @cached_property
    def high(self) -> Array:
        return np.asarray(self.corners.max(axis=(0, 1)))

    @cached_property
    def solid(self) -> Any:
        """The body as an object of manifold3d."""
        import manifold3d

        points, faces = np.unique(self.corners.reshape(-1, 3), axis=0, return_inverse=True)
        faces = faces.reshape(-1, 3).astype(np.uint64)
        return manifold3d.Manifold(manifold3d.Mesh64(points, faces))


def unite_bodies(
    surface: Surface, chosen: int | str | None, unit: str, label: str
) -> tuple[Surface, int]:
    """Return the surface of one solid and the number of the chosen body, 0 if none was chosen.

    Bodies that touch count as one body; they are united if they overlap. Bodies are numbered from
    1, the largest first.

    Parameters
    ----------
    surface : Surface
        Returned unchanged if it has a defect.
    chosen : int, optional
        Number of the body; required if there are bodies that do not touch each other.
    unit : str
        Unit of the coordinates, for errors.

    Raises
    ------
    SeparateBodiesError
        If there are several bodies that do not touch each other, and none is chosen.
    PartError
        If bodies cannot be united, or if there are too many.
    InvalidValueError
        If there is no body with the chosen number.
    """
    if surface.defect:
        if chosen is not None:
            raise PartError(f'{label} {surface.defect}: no body of it can be chosen')
        return surface, 0
    middle = (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2
    # A power of two, so that scaling is exact.
    size = 2.0 ** np.ceil(np.log2(np.ptp(surface.vertices, axis=0).max()))
    corners = ((surface.vertices - middle) / size)[surface.faces]
    bodies = _solids(corners, surface.body)
    groups = _groups(bodies, label) if len(bodies) > 1 else [bodies]
    if chosen is not None and (type(chosen) is not int or not 1 <= chosen <= len(groups)):
        raise InvalidValueError(
            f'invalid body {shown(chosen)} of {label}: expected 1 to {len(groups)}'
        )
    if len(groups) > 1 and chosen is None:
        raise SeparateBodiesError(
            f'{label} has {len(groups)} bodies that do not touch each other '
            f'({_list(groups, size, unit)}): choose one with --body N, or with "body: N" in the '
            'YAML file beside the mesh'
        )
    group = groups[(chosen or 1) - 1]
    if group:
        surface = _cut(surface, np.isin(surface.body, [body.number for body in group]))
    if len(group) > 1:
        surface = _united(surface, group, middle, size, label)
    return surface, chosen if chosen is not None and len(groups) > 1 else 0


def _solids(corners: Array, number: Indices) -> list[_Body]:
    """Return the bodies, without sheets, which have no volume."""
    order = np.argsort(number, kind='stable')
    starts = np.r_[0, np.flatnonzero(np.diff(number[order])) + 1]
    found = [_Body(int(number[rows[0]]), corners[rows]) for rows in np.split(order, starts[1:])]
    return [
        body
        for body in found
        if body.volume > MIN_VOLUME_SHARE * (body.high - body.low).max() ** 3
    ]


def _cut(surface: Surface, kept: npt.NDArray[np.bool_]) -> Surface:
    """Return the surface of a subset of the triangles."""
    if kept.all():
        return surface
    vertices, faces = without_unused(surface.vertices, surface.faces[kept])
    return Surface(vertices, faces, None, surface.warnings, surface.body[kept])


def _list(groups: list[list[_Body]], size: float, unit: str) -> str:
    sides = [
        np.max([body.high for body in group], axis=0)
        - np.min([body.low for body in group], axis=0)
        for group in groups[:MAX_LISTED]
    ]
    texts = [f'{k}: {box_text(size * each, unit)}' for k, each in enumerate(sides, 1)]
    return ', '.join(texts) + (', ...' if len(groups) > MAX_LISTED else '')


def _groups(bodies: list[_Body], label: str) -> list[list[_Body]]:
    """Return groups of bodies that are connected by contact, the largest group first."""
    if len(bodies) > MAX_BODIES:
        raise PartError(f'{label} has {len(bodies)} bodies: expected at most {MAX_BODIES}')
    near = list(_near(bodies))
    if len(near) > MAX_NEAR_PAIRS:
        raise PartError(
            f'{label} has {len(bodies)} bodies, of which {len(near)} pairs may touch: expected at '
            f'most {MAX_NEAR_PAIRS}; unite them in the CAD program'
        )
    if near:
        try:
            import manifold3d  # noqa: F401
        except ImportError:
            raise PartError(
                f'{label} has several bodies that may overlap: uniting them needs '
                'manifold3d, which is not installed (pip install manifold3d)'
            ) from None
    piece = np.arange(len(bodies))
    for one, other in near:
        if piece[one] != piece[other]:
            gap = bodies[one].solid.min_gap(bodies[other].solid, 2 * TOUCH)
            if gap <= TOUCH:
                piece[piece == piece[other]] = piece[one]
    groups = [[bodies[k] for k in np.flatnonzero(piece == p)] for p in np.unique(piece)]
    volumes = [sum(body.volume for body in group) for group in groups]
    largest = max(volumes)
    places = [np.min([body.low for body in group], axis=0).round(6).tolist() for group in groups]
    order = [(-round(v / largest, 6), place) for v, place in zip(volumes, places, strict=True)]
    return [groups[k] for k in sorted(range(len(groups)), key=order.__getitem__)]


def _near(bodies: list[_Body]) -> Iterator[tuple[int, int]]:
    """Yield the pairs of bodies whose bounding boxes touch."""
    low = np.array([body.low for body in bodies]) - TOUCH
    high = np.array([body.high for body in bodies]) + TOUCH
    order = np.argsort(low[:, 0], kind='stable')
    low, high = low[order], high[order]
    ends = np.searchsorted(low[:, 0], high[:, 0], side='right')
    for k, end in enumerate(ends.tolist()):
        rest = slice(k + 1, end)
        meets = ((low[rest] <= high[k]) & (high[rest] >= low[k])).all(axis=1)
        yield from ((int(order[k]), int(order[k + 1 + m])) for m in np.flatnonzero(meets))


def _united(
    surface: Surface, group: list[_Body], middle: Array, size: float, label: str
) -> Surface:
    """Return the union of bodies that touch; the unchanged surface if they do not overlap."""
    import manifold3d

    volume = sum(body.volume for body in group)
    union = manifold3d.Manifold.batch_boolean(
        [body.solid for body in group], manifold3d.OpType.Add
    )
    change = union.volume() / volume - 1
    if union.status() == manifold3d.Error.NoError and abs(change) <= SAME_VOLUME:
        if not triangle_edges(surface.faces).components().any():
            return surface
        warning = (
            f'the mesh has {len(group)} bodies that touch each other and are treated as one part'
        )
        return dataclasses.replace(surface, warnings=(*surface.warnings, warning))
    largest = max(body.volume for body in group)
    mesh = union.to_mesh64()
    points = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3] * size + middle
    found = None
    if largest / volume - 1 - SAME_VOLUME <= change <= 0:
        found = closed_surface(points, np.asarray(mesh.tri_verts).astype(np.int64))
        off = solid_integrals(found.vertices, found.faces).volume / (union.volume() * size**3) - 1
    if found is None or found.defect or abs(off) > SAME_VOLUME:
        raise PartError(
            f'{label} has {len(group)} bodies that overlap and cannot be united '
            f'({union.status().name}): unite them in the CAD program'
        )
    warning = (
        f'the mesh has {len(group)} bodies that overlap; they were united, which changed the '
        f'volume by {100 * change:.2g} %. A body inside another one is a cavity only if it faces '
        'inward'
    )
    return dataclasses.replace(found, warnings=(*surface.warnings, warning))

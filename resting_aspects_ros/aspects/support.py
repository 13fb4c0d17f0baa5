"""What a part rests on in an aspect, and which sides touch which planes."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import POSE_ANGLE, Aspect, AspectSet, Sweep
from resting_aspects_ros.part.hull import COPLANAR, smallest_rectangle
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.surface import connected
from resting_aspects_ros.part.tessellation import CURVED_STEP
from resting_aspects_ros.rotations import angle_between, rotate

# -- Contact regions ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ContactRegion:
    """A connected region of the mesh that touches the surface.

    points : (n, 3) float
        Its vertices relative to the centre of mass, m, part axes.
    outline : (n, 2) float
        The vertices projected onto the surface, m, tray axes.
    area : float
        Area of its triangles on the surface, m^2; 0 for an edge or a corner.
    holes : int
        Number of holes between these triangles.
    beside, sizes : (k, 3) and (k,) float
        Unit normals and areas, m^2, of the triangles adjacent to its edges or its corner.
    """

    points: Array
    outline: Array
    area: float
    holes: int
    beside: Array
    sizes: Array


def contact_regions(part: Part, aspect: Aspect) -> list[ContactRegion]:
    """Return the regions of the mesh that touch the surface in the pose of the aspect."""
    down = aspect.down_in_part
    height = part.vertices @ -down
    near = height - height.min() <= _tolerance(part, aspect)
    faces = part.faces[near[part.faces].any(axis=1)]
    vertices, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    near = near[vertices]
    points = part.vertices[vertices] - part.centre_of_mass
    normals = np.cross(
        points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    )
    double = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(double, np.finfo(float).tiny)[:, None]
    touching = near[faces]
    flat = touching.all(axis=1) & (normals @ down > np.cos(CURVED_STEP))
    label = _labels(faces, touching, len(vertices))
    of_face = label[faces[np.arange(len(faces)), touching.argmax(axis=1)]]
    outline = rotate(aspect.orientation, points)[:, :2]
    regions = []
    used = np.flatnonzero(near)
    for group, here in zip(_grouped(label[used]), _grouped(of_face), strict=True):
        own = used[group]
        on_surface = here[flat[here]]
        joined = touching[here].sum(axis=1) >= min(len(own), 2)
        beside = here[~flat[here] & joined & (double[here] > 0)]
        regions.append(
            ContactRegion(
                points[own],
                outline[own],
                float(double[on_surface].sum() / 2),
                _holes(faces[on_surface]),
                normals[beside],
                double[beside] / 2,
            )
        )
    return regions


def _grouped(labels: Indices) -> list[Indices]:
    """Return the indices of equal labels, in the order of the labels."""
    order = np.argsort(labels, kind='stable')
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _tolerance(part: Part, aspect: Aspect) -> float:
    """Return the maximum height above the surface at which the mesh still touches it, m.

    It includes the corners of the support, even if noise or a simplified hull lifts them.
    """
    corners = rotate(aspect.orientation, part.hull_vertices - part.centre_of_mass)
    height = corners[:, 2] - corners[:, 2].min()
    noise = 2 * COPLANAR * part.hull_radius
    below = [
        height[np.abs(corners[:, :2] - corner).max(axis=1) <= noise].min(initial=np.inf)
        for corner in aspect.support
    ]
    lifted = max((rise for rise in below if rise < np.inf), default=0.0)
    return max(noise, part.hull_error) + float(lifted)


def _labels(faces: Indices, touching: npt.NDArray[np.bool_], count: int) -> Indices:
    """Return the region number (count,) of each vertex, connected by edges that touch."""
    pairs = [
        faces[touching[:, a] & touching[:, b]][:, (a, b)] for a, b in ((0, 1), (1, 2), (2, 0))
    ]
    return connected(count, np.concatenate(pairs))


def _holes(faces: Indices) -> int:
    """Return the number of holes of a connected region, by Euler's formula."""
    edges = np.sort(faces[:, ((0, 1), (1, 2), (2, 0))].reshape(-1, 2), axis=1)
    return 1 - len(np.unique(faces)) + len(np.unique(edges, axis=0)) - len(faces)


# -- In words -------------------------------------------------------------------------------------


# A circle of a mesh has at least this many corners, and their distances from its centre agree
# within this share.
_MIN_ROUND_CORNERS = int(np.ceil(2 * np.pi / CURVED_STEP))
_ROUND = 0.02
# A round side with one hole that covers less than this share of its circle is a ring.
_RING_SHARE = 0.8
# Maximum area of a facet of a curved side, as a multiple of that of an adjacent triangle; a flat
# side with rounded edges is larger.
_MAX_AREA_RATIO = 4.0
# Minimum sine of the angle between the contact line of a cone and its axis.
_MIN_CONE_SINE = 0.02
# Number of directions of a curved side to which a circle is fitted.
_FITTED_DIRECTIONS = 5
# If a flat region covers this share of the support polygon, the others are ignored.
_MAIN_SHARE = 0.95
_NUMBERS = ('no', 'one', 'two', 'three', 'four', 'five', 'six')
# Kinds of regions, in the order in which they are listed.
_KINDS = ('flat side', 'curved side', 'ring', 'edge', 'corner')


def resting_on(part: Part | None, aspect: Aspect) -> str:
    """Return what the part rests on, such as 'flat side 12 x 30 mm' or 'an edge and two corners'.

    Parameters
    ----------
    part : Part or None
        Without a part only the size of the support is described.
    aspect : Aspect
        An aspect of the part.
    """
    if part is None:
        return _support_text(aspect)
    if aspect.sweep is Sweep.SPHERE:
        return f'ball, diameter {_mm(2 * aspect.com_height)} mm (rolls)'
    if aspect.sweep is Sweep.DOME:
        return 'dome'
    texts = {Sweep.ARC: _arc_text, Sweep.RING: _ring_text, Sweep.POINT: _flat_text}
    return texts[aspect.sweep](part, aspect)


def _flat_text(part: Part, aspect: Aspect) -> str:
    """Return the description for a part that neither rolls nor rocks."""
    regions = contact_regions(part, aspect)
    largest = max(regions, key=lambda region: region.area)
    if len(regions) == 1 or largest.area >= _MAIN_SHARE * ConvexHull(aspect.support).volume:
        return _one_text(largest)
    kinds = Counter(_kind(region, aspect.down_in_part) for region in regions)
    if len(kinds) > 1 and len(regions) >= len(_NUMBERS):
        return f'{len(regions)} places within {_rectangle_text(aspect.support)}'
    return _count_text(kinds)


def _support_text(aspect: Aspect) -> str:
    if aspect.sweep is Sweep.POINT:
        return f'within {_rectangle_text(aspect.support)}'
    return {
        Sweep.ARC: 'curved side (rocks)',
        Sweep.RING: 'curved side (rolls)',
        Sweep.DOME: 'dome',
        Sweep.SPHERE: 'ball (rolls)',
    }[aspect.sweep]


def _kind(region: ContactRegion, down: Array) -> str:
    """Return the kind of a region, one of _KINDS."""
    on_curve = region.beside @ down > np.cos(CURVED_STEP)
    if region.area:
        like = region.area <= _MAX_AREA_RATIO * region.sizes[on_curve].max(initial=0.0)
        return 'curved side' if like and np.count_nonzero(on_curve) > 1 else 'flat side'
    if _diameter(region):
        return 'ring'
    if len(on_curve) and on_curve.all():
        return 'curved side'
    return 'corner' if len(region.outline) == 1 else 'edge'


def _count_text(kinds: Counter[str]) -> str:
    """Return the kinds with their numbers, such as 'an edge and two corners'."""
    texts = [
        f'{_number(n)} {kind}s' if n > 1 else f'{"an" if kind == "edge" else "a"} {kind}'
        for kind in _KINDS
        if (n := kinds[kind])
    ]
    return ', '.join([*texts[:-2], ' and '.join(texts[-2:])])


def _one_text(region: ContactRegion) -> str:
    """Return the description of the only region on which the part rests."""
    diameter = _diameter(region)
    if not diameter:
        return f'flat side {_rectangle_text(region.outline)}'
    name = 'ring'
    if region.area:
        full = region.holes != 1 or region.area >= _RING_SHARE * np.pi * diameter**2 / 4
        name = 'round flat side' if full else 'flat ring'
    return f'{name}, diameter {_mm(diameter)} mm'


def _ring_text(part: Part, aspect: Aspect) -> str:
    """Return the description for a part that rolls on a full circle."""
    regions = contact_regions(part, aspect)
    axis = aspect.axis
    along = [region.points @ axis for region in regions]
    across = [
        float(np.linalg.norm(region.points - np.outer(z, axis), axis=1).max())
        for region, z in zip(regions, along, strict=True)
    ]
    diameters = list(dict.fromkeys(_mm(2 * r) for r in sorted(across, reverse=True)))
    noise = 2 * COPLANAR * max(across)
    if len(regions) > 1:
        rims = all(np.ptp(z) <= noise for z in along)
        each = f'diameter {diameters[0]} mm'
        if len(diameters) > 1:
            each = f'diameters {" and ".join(diameters[:2])} mm'
        return f'{_number(len(regions))} {"rims" if rims else "round sides"}, {each} (rolls)'
    (region,) = regions
    name = 'cylinder'
    if np.ptp(along[0]) <= noise:
        name = 'rim'
    elif abs(aspect.down_in_part @ axis) > _MIN_CONE_SINE:
        name = 'cone'
    leans = np.abs((region.beside - aspect.down_in_part) @ axis)
    on_curve = (region.beside @ aspect.down_in_part > np.cos(CURVED_STEP)) & (
        leans > _MIN_CONE_SINE
    )
    if region.area <= _MAX_AREA_RATIO * region.sizes[on_curve].max(initial=0.0):
        name = 'curved side'
    return f'{name}, diameter {diameters[0]} mm (rolls)'


def _arc_text(part: Part, aspect: Aspect) -> str:
    """Return the description for a part that rocks, with the radius if the side is a cylinder."""
    corners = part.hull_vertices - part.centre_of_mass
    chosen = np.linspace(0, len(aspect.directions) - 1, _FITTED_DIRECTIONS).astype(int)
    heights = corners @ aspect.directions[np.unique(chosen)].T
    touching = heights.max(axis=0) - heights <= 2 * COPLANAR * part.hull_radius
    on_side = corners[touching.any(axis=1)]
    across = np.linalg.svd(aspect.axis[None])[2][1:]
    flat = np.unique(np.round(on_side @ across.T / part.hull_radius, 5), axis=0)
    text = 'curved side'
    if len(flat) >= 3:
        # |p|^2 = 2 c . p + (r^2 - |c|^2), after Kasa 1976.
        equations = np.column_stack([2 * flat, np.ones(len(flat))])
        x, y, rest = np.linalg.lstsq(equations, (flat**2).sum(axis=1), rcond=None)[0]
        radius = np.sqrt(max(rest + x**2 + y**2, 0.0))
        off = np.abs(np.linalg.norm(flat - (x, y), axis=1) - radius).max()
        if off <= _ROUND * radius:
            text += f', radius {_mm(radius * part.hull_radius)} mm'
    return f'{text} (rocks)'


def _diameter(region: ContactRegion) -> float:
    """Return the diameter of the outline of a region, m; 0 if it is not round."""
    outline = region.outline
    size = np.linalg.svd(outline - outline.mean(axis=0), compute_uv=False)
    if len(outline) < _MIN_ROUND_CORNERS or size[1] <= _ROUND * size[0]:  # straight
        return 0.0
    corners = outline[ConvexHull(outline).vertices]
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = np.linalg.norm(corners - centre, axis=1)
    round_ = len(corners) >= _MIN_ROUND_CORNERS and np.ptp(radius) <= 2 * _ROUND * radius.max()
    return 2 * float(radius.max()) if round_ else 0.0


def _rectangle_text(outline: Array) -> str:
    """Return the sides of the smallest rectangle around points on the surface: '12 x 30 mm'."""
    long, short = np.linalg.norm(smallest_rectangle(outline)[1], axis=1)
    return f'{_mm(short)} x {_mm(long)} mm'


def _number(n: int) -> str:
    return _NUMBERS[n] if n < len(_NUMBERS) else str(n)


def _mm(length: float) -> str:
    """Return a length, m, as text in mm with three digits and no exponent."""
    return np.format_float_positional(1000 * length, precision=3, fractional=False, trim='-')


# -- Contacts with several planes -----------------------------------------------------------------


# A part touches a plane if its hull is closer than this, R. Engines let parts rest at 0.001.
TOUCH = 0.01
# Points of the hull that are at most this much further from a plane, R, touch it too; they span a
# side, an edge, or nothing.
FLAT = 0.01
# Codes of contacts that are in no aspect; positive codes are ids of aspects.
NONE, SIDE, EDGE, CORNER = 0, -1, -2, -3
CODE_TEXT = {NONE: '-', SIDE: 'other side', EDGE: 'edge', CORNER: 'corner'}


@dataclass(frozen=True, eq=False)
class ContactPlane:
    """A plane that parts can touch.

    name : str
        Such as 'wall'.
    normal : (3,) float
        Unit vector that points away from the body, tray frame.
    offset : float
        Points x on the plane have ``normal @ x == offset``, m.
    """

    name: str
    normal: Array
    offset: float = 0.0


class ContactFinder:
    """Finds the contacts of the resting poses of a part.

    Parameters
    ----------
    part : Part
    aspects : AspectSet
        Aspects of the part on a level plane: their ids name its sides.
    planes : sequence of ContactPlane
    """

    def __init__(self, part: Part, aspects: AspectSet, planes: Sequence[ContactPlane]) -> None:
        self.planes = tuple(planes)
        self._aspects = aspects
        self._corners = part.hull_vertices
        self._radius = part.hull_radius

    def find(self, position: Array, orientation: Array) -> Indices:
        """Return the contacts (n, planes): the id of an aspect, or NONE, SIDE, EDGE or CORNER.

        Parameters
        ----------
        position, orientation : (n, 3) and (n, 4) float
            Poses tray from part, m and unit quaternions xyzw.
        """
        found = np.zeros((len(position), len(self.planes)), dtype=np.int64)
        inverse = orientation * [-1, -1, -1, 1]
        for k, plane in enumerate(self.planes):
            normal = rotate(inverse, plane.normal)
            height = normal @ self._corners.T
            lowest = height.min(axis=1)
            gap = position @ plane.normal - plane.offset + lowest
            near = height <= (lowest + FLAT * self._radius)[:, None]
            touches = np.abs(gap) < TOUCH * self._radius
            ids, angle = self._aspects.locate(-normal)
            code = np.where(angle <= POSE_ANGLE, ids, 0)
            for i in np.flatnonzero(touches & (code == 0)):
                code[i] = self._kind(self._corners[near[i]])
            found[:, k] = np.where(touches, code, NONE)
        return found

    def _kind(self, points: Array) -> int:
        """Return SIDE, EDGE or CORNER for the points (k, 3) of a hull that touch a plane."""
        size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        spread = size / np.sqrt(len(points)) > FLAT * self._radius
        return (CORNER, EDGE, SIDE, SIDE)[int(spread.sum())]


def pose_angles(
    orientation: Array,
    other: Array,
    rotations: Array,
    normal: Array | None,
    axis: Array | None = None,
) -> Array:
    """Return the angles (n,), rad, from orientations to another one, minimised over rotations.

    Parameters
    ----------
    orientation, other : (n, 4) and (4,) float
        Unit quaternions xyzw, tray from part.
    rotations : (g, 3, 3) float
        Rotations of the part onto itself, part frame.
    normal : (3,) float or None
        Unit vector, tray frame, about which the parts may be turned; None: about none.
    axis : (3,) float, optional
        Unit vector, part frame, about which every rotation, after one of these, maps the part
        onto itself; None: there is none.
    """
    inverse = orientation * [-1, -1, -1, 1]
    if normal is not None:
        seen = rotate(inverse, normal)
        of_other = rotations @ rotate(other * [-1, -1, -1, 1], normal)
        if axis is None:
            return np.asarray(np.min([angle_between(seen, each) for each in of_other], axis=0))
        across, of_axis = angle_between(seen, axis), angle_between(of_other, axis)
        return np.asarray(np.abs(across[:, None] - of_axis).min(axis=1))
    axes = np.eye(3)
    # The cosine of the angle of a rotation is (trace - 1) / 2.
    frames = np.stack([rotate(orientation, x) for x in axes], 2)
    of_other = np.stack([rotate(other, x) for x in axes], axis=1)
    between = np.einsum('nki,gkj->ngij', frames, of_other @ rotations.transpose(0, 2, 1))
    traces = np.einsum('ngii->ng', between)
    if axis is not None:
        # The trace of the product with a rotation about the axis is a sine of its angle.
        along = between @ axis @ axis
        skew = between - between.transpose(0, 1, 3, 2)
        side = np.stack([skew[..., 1, 2], skew[..., 2, 0], skew[..., 0, 1]], axis=-1) @ axis
        traces = along + np.hypot(traces - along, side)
    return np.asarray(np.arccos(np.clip((traces.max(axis=1) - 1) / 2, -1, 1)))


def class_of_contacts(aspects: AspectSet, contacts: tuple[int, ...]) -> tuple[int, ...]:
    """Return the smallest of the contacts that rotations of the part onto itself make of these."""
    symmetry = aspects.symmetry
    if symmetry is None or not len(aspects):
        return contacts
    down = np.array([aspect.down_in_part for aspect in aspects])
    found = []
    for rotation in symmetry.rotations:
        ids = aspects.locate(down @ rotation.T)[0].tolist()
        found.append(tuple(ids[c - 1] if c > 0 else c for c in contacts))
    return min(found)

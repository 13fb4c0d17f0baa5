"""A short description of what a part rests on in an aspect, from its contact with the surface.

A facet of the convex hull can span gaps of the part: a bracket rests on the edges of its leg and
its toe. So the description is that of the connected regions of the mesh that touch the surface.
"""

from collections import Counter

import numpy as np
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.aspects.aspect_set import Aspect, Sweep
from resting_aspects_ros.core.aspects.contact import ContactRegion, contact_regions
from resting_aspects_ros.core.geometry.hull import smallest_rectangle
from resting_aspects_ros.core.geometry.polyhedron import COPLANAR
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array

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
_KINDS = {
    'flat side': 'a flat side',
    'curved side': 'a curved side',
    'ring': 'a ring',
    'edge': 'an edge',
    'corner': 'a corner',
}


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
    """Return the kind of a region, a key of _KINDS."""
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
        one if n == 1 else f'{_number(n)} {kind}s'
        for kind, one in _KINDS.items()
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


def _is_straight(outline: Array) -> bool:
    size = np.linalg.svd(outline - outline.mean(axis=0), compute_uv=False)
    return bool(size[1] <= _ROUND * size[0])


def _diameter(region: ContactRegion) -> float:
    """Return the diameter of the outline of a region, m; 0 if it is not round."""
    if len(region.outline) < _MIN_ROUND_CORNERS or _is_straight(region.outline):
        return 0.0
    corners = region.outline[ConvexHull(region.outline).vertices]
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

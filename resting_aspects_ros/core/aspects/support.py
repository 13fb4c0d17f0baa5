"""What a part rests on in an aspect, in words: from where its mesh touches the surface.

A facet of the convex hull can bridge what the part does not touch: a bracket rests on the edges
of its leg and its toe. So the words are those of the connected pieces of the mesh that touch.
"""

from collections import Counter

import numpy as np
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.aspects.aspect_set import Aspect, Sweep
from resting_aspects_ros.core.aspects.contact import ContactRegion, contact_pieces
from resting_aspects_ros.core.geometry.polyhedron import COPLANAR
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array

# A circle of a mesh has as many corners, and their distances from its centre agree within this.
_MIN_ROUND_CORNERS = int(np.ceil(2 * np.pi / CURVED_STEP))
_ROUND = 0.02
# A round side with one hole that covers less than this share of its circle is a ring.
_RING_SHARE = 0.8
# A facet of a curved side is at most so many times as large as a triangle beside it; a flat side
# with rounded edges is larger.
_LIKE_NEIGHBOURS = 4.0
# The line on which a cone touches leans to its axis by more than this, as a sine.
_CONE_LEAN = 0.02
# Directions of a curved side to which a circle is fitted.
_FITTED = 5
# A flat piece that covers this share of the support polygon is all that counts.
_ALL_SHARE = 0.95
_NUMBERS = ('no', 'one', 'two', 'three', 'four', 'five', 'six')
# In the order in which they are named.
_KINDS = {
    'flat side': 'a flat side',
    'curved side': 'a curved side',
    'ring': 'a ring',
    'edge': 'an edge',
    'corner': 'a corner',
}


def resting_on(part: Part | None, aspect: Aspect) -> str:
    """Return what the part rests on, as 'flat side 12 x 30 mm' or 'an edge and two corners'.

    Parameters
    ----------
    part : Part or None
        Without it only the size of the support is known.
    aspect : Aspect
        Of the part.
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
    """What a part touches the surface with that neither rolls nor rocks."""
    pieces = contact_pieces(part, aspect)
    largest = max(pieces, key=lambda piece: piece.area)
    if len(pieces) == 1 or largest.area >= _ALL_SHARE * ConvexHull(aspect.support).volume:
        return _one_text(largest)
    kinds = Counter(_kind(piece, aspect.down_in_part) for piece in pieces)
    if len(kinds) > 1 and len(pieces) >= len(_NUMBERS):
        return f'{len(pieces)} places within {_rectangle_text(aspect.support)}'
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


def _kind(piece: ContactRegion, down: Array) -> str:
    """Which of _KINDS it is, among other pieces."""
    on_curve = piece.beside @ down > np.cos(CURVED_STEP)
    if piece.area:
        like = piece.area <= _LIKE_NEIGHBOURS * piece.sizes[on_curve].max(initial=0.0)
        return 'curved side' if like and np.count_nonzero(on_curve) > 1 else 'flat side'
    if _diameter(piece):
        return 'ring'
    if len(on_curve) and on_curve.all():
        return 'curved side'
    return 'corner' if len(piece.outline) == 1 else 'edge'


def _count_text(kinds: Counter[str]) -> str:
    """'an edge and two corners'."""
    words = [
        one if n == 1 else f'{_number(n)} {kind}s'
        for kind, one in _KINDS.items()
        if (n := kinds[kind])
    ]
    return ', '.join([*words[:-2], ' and '.join(words[-2:])])


def _one_text(piece: ContactRegion) -> str:
    """Of a piece that is all on which the part rests."""
    diameter = _diameter(piece)
    if not diameter:
        return f'flat side {_rectangle_text(piece.outline)}'
    name = 'ring'
    if piece.area:
        full = piece.holes != 1 or piece.area >= _RING_SHARE * np.pi * diameter**2 / 4
        name = 'round flat side' if full else 'flat ring'
    return f'{name}, diameter {_mm(diameter)} mm'


def _ring_text(part: Part, aspect: Aspect) -> str:
    """What a part touches the surface with that rolls all round."""
    pieces = contact_pieces(part, aspect)
    axis = aspect.axis
    along = [piece.points @ axis for piece in pieces]
    across = [
        float(np.linalg.norm(piece.points - np.outer(z, axis), axis=1).max())
        for piece, z in zip(pieces, along, strict=True)
    ]
    diameters = list(dict.fromkeys(_mm(2 * r) for r in sorted(across, reverse=True)))
    least = 2 * COPLANAR * max(across)
    if len(pieces) > 1:
        rims = all(np.ptp(z) <= least for z in along)
        each = f'diameter {diameters[0]} mm'
        if len(diameters) > 1:
            each = f'diameters {" and ".join(diameters[:2])} mm'
        return f'{_number(len(pieces))} {"rims" if rims else "round sides"}, {each} (rolls)'
    (piece,) = pieces
    name = 'cylinder'
    if np.ptp(along[0]) <= least:
        name = 'rim'
    elif abs(aspect.down_in_part @ axis) > _CONE_LEAN:
        name = 'cone'
    leans = np.abs((piece.beside - aspect.down_in_part) @ axis)
    on_curve = (piece.beside @ aspect.down_in_part > np.cos(CURVED_STEP)) & (leans > _CONE_LEAN)
    if piece.area <= _LIKE_NEIGHBOURS * piece.sizes[on_curve].max(initial=0.0):
        name = 'curved side'
    return f'{name}, diameter {diameters[0]} mm (rolls)'


def _arc_text(part: Part, aspect: Aspect) -> str:
    """A curved side on which the part rocks; with its radius, if it is a piece of a cylinder."""
    corners = part.hull_vertices - part.centre_of_mass
    chosen = np.linspace(0, len(aspect.directions) - 1, _FITTED).astype(int)
    heights = corners @ aspect.directions[np.unique(chosen)].T
    touching = heights.max(axis=0) - heights <= 2 * COPLANAR * part.hull_radius
    on_side = corners[touching.any(axis=1)]
    across = np.linalg.svd(aspect.axis[None])[2][1:]
    flat = np.unique(np.round(on_side @ across.T / part.hull_radius, 5), axis=0)
    words = 'curved side'
    if len(flat) >= 3:
        # |p|^2 = 2 c . p + (r^2 - |c|^2), after Kasa 1976.
        equations = np.column_stack([2 * flat, np.ones(len(flat))])
        x, y, rest = np.linalg.lstsq(equations, (flat**2).sum(axis=1), rcond=None)[0]
        radius = np.sqrt(max(rest + x**2 + y**2, 0.0))
        off = np.abs(np.linalg.norm(flat - (x, y), axis=1) - radius).max()
        if off <= _ROUND * radius:
            words += f', radius {_mm(radius * part.hull_radius)} mm'
    return f'{words} (rocks)'


def _is_straight(outline: Array) -> bool:
    size = np.linalg.svd(outline - outline.mean(axis=0), compute_uv=False)
    return bool(size[1] <= _ROUND * size[0])


def _diameter(piece: ContactRegion) -> float:
    """Of its outline, m; 0 if that is not round."""
    if len(piece.outline) < _MIN_ROUND_CORNERS or _is_straight(piece.outline):
        return 0.0
    corners = piece.outline[ConvexHull(piece.outline).vertices]
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = np.linalg.norm(corners - centre, axis=1)
    round_ = len(corners) >= _MIN_ROUND_CORNERS and np.ptp(radius) <= 2 * _ROUND * radius.max()
    return 2 * float(radius.max()) if round_ else 0.0


def _rectangle_text(outline: Array) -> str:
    """Sides of the smallest rectangle around points on the surface: '12 x 30 mm'."""
    corners = outline[ConvexHull(outline).vertices]
    edges = np.roll(corners, -1, axis=0) - corners
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    sides = np.stack(
        [
            np.ptp(corners @ edges.T, axis=0),
            np.ptp(corners @ np.stack([-edges[:, 1], edges[:, 0]]), axis=0),
        ]
    )
    short, long = np.sort(sides[:, sides.prod(axis=0).argmin()])
    return f'{_mm(short)} x {_mm(long)} mm'


def _number(n: int) -> str:
    return _NUMBERS[n] if n < len(_NUMBERS) else str(n)


def _mm(length: float) -> str:
    """A length, m, in mm with three digits and no exponent."""
    return np.format_float_positional(1000 * length, precision=3, fractional=False, trim='-')

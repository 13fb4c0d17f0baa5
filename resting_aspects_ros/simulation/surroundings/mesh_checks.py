"""Checks that parts can be released above a mesh: its size, its orientation, and its gaps."""

import itertools

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.surroundings.release import ground_below
from resting_aspects_ros.simulation.surroundings.scene import MeshBody

# Extent of a mesh in hull radii of the part; one that is smaller or larger has a wrong unit.
MIN_EXTENT, MAX_EXTENT = 1.0, 5000.0
# A gap that is wider than this, in hull radii, is open for a part above it.
GAP = 1.0
# Places in each direction at which the region of release is checked.
PLACES = 5


def ground_of(mesh: MeshBody, region: tuple[Array, Array], radius: float) -> float:
    """Return the highest z of a mesh below the place of release of a part of a hull radius, m.

    Raises InvalidValueError if the mesh is too small or too large for the part, if it is open
    below the release, or if it is seen from inside there.
    """
    _check_extent(mesh, radius)
    low, high = np.transpose(region)
    places = itertools.product(*(np.unique(np.linspace(a, b, PLACES)) for a, b in region))
    for place in map(np.array, places):
        half = GAP * radius / 2
        if ground_below(mesh.vertices, mesh.triangles, place - half, place + half) is None:
            raise InvalidValueError(
                f'invalid release at {_text(place)}: expected a place above the mesh, which has '
                'no triangle there'
            )
        _check_outside(mesh, place)
    top = ground_below(mesh.vertices, mesh.triangles, low - radius, high + radius)
    assert top is not None
    return top


def _check_extent(mesh: MeshBody, radius: float) -> None:
    size = np.ptp(mesh.vertices, axis=0)
    least, most = MIN_EXTENT * radius, MAX_EXTENT * radius
    if not least <= size[:2].max() <= most or size[:2].min() < least:
        x, y, z = (1000 * size).tolist()
        raise InvalidValueError(
            f'invalid size {x:.4g} x {y:.4g} x {z:.4g} mm of the mesh of the surroundings: '
            f'expected {1000 * least:.4g} mm to {1000 * most:.4g} mm along x and y for this part; '
            'is its unit right?'
        )


def _check_outside(mesh: MeshBody, place: Array) -> None:
    """Raise InvalidValueError if the highest triangle at a place (2,) points down."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    one, other, way = (b - a)[:, :2], (c - a)[:, :2], place - a[:, :2]
    double = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    upright = double == 0
    double[upright] = 1.0
    u = (way[:, 0] * other[:, 1] - way[:, 1] * other[:, 0]) / double
    v = (one[:, 0] * way[:, 1] - one[:, 1] * way[:, 0]) / double
    hit = np.flatnonzero(~upright & (u >= 0) & (v >= 0) & (u + v <= 1))
    height = (a + u[:, None] * (b - a) + v[:, None] * (c - a))[hit, 2]
    if len(hit) and double[hit[np.argmax(height)]] < 0:
        raise InvalidValueError(
            f'invalid mesh of the surroundings: its highest triangle at {_text(place)} points '
            'down; expected triangles that point outward'
        )


def _text(place: Array) -> str:
    x, y = (1000 * place).tolist()
    return f'x {x:.4g} mm, y {y:.4g} mm'

"""Which minima of a landscape are one aspect.

A mesh makes flats of a curved side, and every flat a minimum; and noise splits one minimum into
some. No barrier tells these from small but real ones (the rim of a washer, a pin on its end), so
they are told apart by shape first: neighbours on a curved side, and then what is lower than noise.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.geometry.polyhedron import Polyhedron
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.rotations import Array, angle_between

# Steps along a curved side are alike up to this factor; a chamfer beside a flat is not.
LIKE_STEPS = 1.5
# The barrier between two minima on a curved side is the sagitta of the arc between them, up to
# this factor for meshes whose flats are not alike.
SAGITTA_SLACK = 1.3
# On a dome a flat is further below the surface than between two edges: by 8 / 3 if all are equal
# triangles, and by this factor in irregular meshes.
DOME_DEPTH = 3.2
# A minimum with nothing but the mesh's own steps around it is made by the mesh if it is this much
# shallower than a flat there is deep: on a side of radius r, with the centre of mass h away, it is
# r / h of that, and of a flat side it is more.
RIM_DEPTH = 0.6
# Minima on a curved side are neighbours within this many steps, and within one of the largest;
# further apart, as the two flat sides beside a fillet, they are different.
NEIGHBOUR_STEPS = 3.0
# Barriers below this, R, are noise: a breath moves the part across.
NOISE_BARRIER = 1e-3


@dataclass(frozen=True, eq=False)
class JoinedMinima:
    """Minima that are one aspect.

    minima : (k,) int
        Their places in the landscape, lowest first.
    curved : bool
        Whether they are flats of a curved side.
    step : float
        Largest step of the mesh of the curved side, rad; 0 without one.
    level : int
        So many of them are as low as the lowest but for the mesh; the others are on a slope.
    height : float
        Of the centre of mass on it, R: the lowest minimum's; of a curved side that of the highest
        saddle within the level, as a mesh has its edges on the true surface and its flats below.
    """

    minima: npt.NDArray[np.int64]
    curved: bool
    step: float
    level: int
    height: float


# For a run of drops both its aspects and its job are made of them.
@lru_cache(maxsize=1)
def join_minima(landscape: Landscape) -> list[JoinedMinima]:
    """The aspects as groups of minima, each minimum in one of them.

    Saddles are taken from the lowest up, and each joins what is on its sides if it is one of a
    curved side's mesh, or if the barrier over it from the higher side is noise (persistence:
    Edelsbrunner, Letscher, Zomorodian 2002).
    """
    group = np.arange(len(landscape.minima))
    low = landscape.heights / landscape.radius
    curved = np.zeros(len(group), dtype=bool)
    saddles = landscape.saddles
    heights = saddles.heights / landscape.radius
    curved_edges = is_curved(landscape.hull)
    steps = _largest(landscape.hull, curved_edges, landscape.hull.angles)
    step = steps[landscape.minima]
    sagitta = _sagittas(landscape.hull, curved_edges)
    depth = _largest(landscape.hull, curved_edges, sagitta)[landscape.minima]
    tessellation = _tessellation(landscape, curved_edges, steps)
    over = zip(heights, saddles.between, tessellation, sagitta[saddles.edges], strict=True)
    drained = np.zeros(len(group), dtype=bool)  # down a side, to where it is no neighbour
    for height, (a, b), meshed, own in over:
        one, other = group[a], group[b]
        if one == other:
            continue
        barrier = height - max(low[one], low[other])
        # Step by step, each as low as the mesh makes it, one could climb from one end of an
        # egg to the other.
        # What has drained off the curved side is no way along it, but for what the mesh makes.
        slack = 1.0 if drained[a] or drained[b] else DOME_DEPTH
        by_mesh = meshed and barrier <= slack * max(depth[one], depth[other])
        # Where the side curves more sharply than a sphere would, only its mesh holds the part.
        on_curve = by_mesh or barrier <= RIM_DEPTH * own
        if not on_curve and barrier > NOISE_BARRIER:
            continue
        into, gone = (one, other) if low[one] <= low[other] else (other, one)
        if not by_mesh:
            drained[group == gone] = True
        group[group == gone] = into
        curved[into] |= curved[gone] | on_curve
        step[into] = max(step[into], step[gone])
        depth[into] = max(depth[into], depth[gone])
    joined = []
    for k in np.unique(group):
        level = low[k] + DOME_DEPTH * depth[k] * curved[k]
        inner = (group[saddles.between] == k).all(axis=1) & (heights <= level)
        joined.append(
            JoinedMinima(
                minima=np.flatnonzero(group == k),
                curved=bool(curved[k]),
                step=float(step[k] * curved[k]),
                level=int((low[group == k] <= level).sum()),
                height=float(heights[inner].max(initial=low[k]) if curved[k] else low[k]),
            )
        )
    return joined


def _tessellation(
    landscape: Landscape, curved_edges: npt.NDArray[np.bool_], steps: Array
) -> npt.NDArray[np.bool_]:
    """(s,) whether each saddle is one that the mesh of a curved side makes."""
    hull, saddles = landscape.hull, landscape.saddles
    local = steps[hull.sides[saddles.edges]].max(axis=1)
    a, b = np.moveaxis(landscape.directions[saddles.between], 1, 0)
    apart = angle_between(a, b)
    near = apart <= np.minimum(NEIGHBOUR_STEPS * local, CURVED_STEP)
    barrier = saddles.heights - landscape.heights[saddles.between].max(axis=1)
    shallow = barrier <= SAGITTA_SLACK * saddles.heights * (1 - np.cos(apart / 2))
    return np.asarray(curved_edges[saddles.edges] & near & shallow)


def is_curved(hull: Polyhedron) -> npt.NDArray[np.bool_]:
    """(e,) whether each edge is a step of the mesh of a curved side.

    It is if one of its facets goes on, across another edge, with a step that is like it and does
    not turn back: three flats in a chain. Or if it is small, and so are all that lead from it once
    round the part.
    """
    small = hull.angles <= CURVED_STEP
    found = small & _goes_round(hull, small)
    for edge in np.flatnonzero(small & ~found).tolist():
        angle = hull.angles[edge]
        for side in (0, 1):
            facet, beyond = hull.sides[edge, side], hull.sides[edge, 1 - side]
            back = hull.normals[beyond] - hull.normals[facet]
            for next_edge in hull.edges_of_facets[facet]:
                ratio = hull.angles[next_edge] / angle
                if next_edge == edge or not small[next_edge]:
                    continue
                if not 1 / LIKE_STEPS <= ratio <= LIKE_STEPS:
                    continue
                sides = hull.sides[next_edge]
                ahead = hull.normals[sides.sum() - facet] - hull.normals[facet]
                found[edge] |= bool(ahead @ back < 0)
    return np.asarray(found)


def _goes_round(hull: Polyhedron, small: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """(e,) whether small steps lead from each edge's first facet once round the part."""
    count = len(hull.normals)
    links = coo_array((small, tuple(hull.sides.T)), shape=(count, count))
    _, side = connected_components(links, directed=False)
    closed: npt.NDArray[np.bool_] = np.zeros(count, dtype=bool)
    for number in np.flatnonzero(np.bincount(side) >= np.pi / CURVED_STEP):
        normals = hull.normals[side == number]
        middle = normals.mean(axis=0)
        axes = np.linalg.svd(normals - middle, full_matrices=False)[2]
        x, y = axes[:2] @ (normals - middle).T
        azimuth = np.sort(np.arctan2(y, x))
        gaps = np.diff(azimuth, append=azimuth[0] + 2 * np.pi)
        # A flat with what is around it is no ring.
        radius = np.hypot(x, y)
        cap = np.linalg.norm(middle) > 0.5 and radius.min() < 0.5 * radius.max()
        closed[number] = gaps.max() <= CURVED_STEP and not cap
    return closed[side[hull.sides[:, 0]]]


def _sagittas(hull: Polyhedron, curved_edges: npt.NDArray[np.bool_]) -> Array:
    """(e,) how far below the curved side the middle of a flat at each edge is, R; 0 at others.

    Two chords of length w that meet at an angle a are below their circle by w / 2 tan(a / 4). The
    narrower of the two facets is the one of the mesh; the other may be a flat side.
    """
    edges = np.flatnonzero(curved_edges)
    first = hull.points[hull.ends[edges, 0]]
    along = hull.points[hull.ends[edges, 1]] - first
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    width = np.full(len(edges), np.inf)
    for facets in hull.sides[edges].T.tolist():
        around = [hull.edges_of_facets[facet] for facet in facets]
        owner = np.repeat(np.arange(len(edges)), [len(each) for each in around])
        arms = hull.points[hull.ends[np.fromiter(chain(*around), int)]] - first[owner, None]
        square = (arms * arms).sum(axis=2) - (arms * along[owner, None]).sum(axis=2) ** 2
        furthest = np.zeros(len(edges))
        np.maximum.at(furthest, owner, square.max(axis=1))
        width = np.minimum(width, np.sqrt(furthest))
    found = np.zeros(len(hull.angles))
    found[edges] = width / 2 * np.tan(hull.angles[edges] / 4)
    return found


def _largest(hull: Polyhedron, edges: npt.NDArray[np.bool_], values: Array) -> Array:
    """(f,) the largest of the values (e,) of those of its edges at each facet; 0 at none."""
    found = np.zeros(len(hull.normals))
    chosen = np.flatnonzero(edges)
    np.maximum.at(found, hull.sides[chosen].ravel(), np.repeat(values[chosen], 2))
    return found

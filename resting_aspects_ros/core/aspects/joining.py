"""Join the minima of a landscape that belong to one aspect.

A mesh approximates a curved side by flats, each of which is a minimum, and noise splits a minimum
into several. The height of the barrier does not distinguish these from small real minima (the rim
of a washer, a pin on its end). So minima are joined by shape first, if they are neighbours on a
curved side, and then if the barrier between them is below the noise.
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

# Adjacent steps of a curved side differ by at most this factor; a chamfer and its flat differ
# more.
MAX_STEP_RATIO = 1.5
# The barrier between two minima on a curved side is at most the sagitta of the arc between them
# times this factor, which allows for unequal flats.
SAGITTA_SLACK = 1.3
# The depth of a flat below a dome, relative to that between two edges, is 8 / 3 for equal
# triangles, and up to this factor in irregular meshes.
DOME_DEPTH = 3.2
# A minimum surrounded by steps of the mesh is an artifact of the mesh if its barrier is below this
# share of the depth of a flat. On a side of radius r at the distance h of the centre of mass the
# share is r / h; for a flat side it is larger.
RIM_DEPTH = 0.6
# Minima on a curved side are neighbours if they are at most this many steps, and at most one
# CURVED_STEP, apart. Minima further apart, such as two flat sides beside a fillet, are different.
NEIGHBOUR_STEPS = 3.0
# Barriers below this, R, are noise: any disturbance moves the part across.
NOISE_BARRIER = 1e-3


@dataclass(frozen=True, eq=False)
class JoinedMinima:
    """Minima that belong to one aspect.

    minima : (k,) int
        Their indices in the landscape, lowest first.
    curved : bool
        Whether they are flats of a curved side.
    step : float
        Maximum step of the mesh of the curved side, rad; 0 without a curved side.
    level : int
        Number of minima that are as low as the lowest, apart from effects of the mesh; the others
        are on a slope.
    height : float
        Height of the centre of mass, R: that of the lowest minimum, or for a curved side that of
        the highest saddle within the level, because the edges of a mesh are on the true surface
        and its flats below.
    """

    minima: npt.NDArray[np.int64]
    curved: bool
    step: float
    level: int
    height: float


# Cached because a run of drops needs them for both its aspects and its job.
@lru_cache(maxsize=1)
def join_minima(landscape: Landscape) -> list[JoinedMinima]:
    """Return the aspects as groups of minima; each minimum is in one group.

    The saddles are processed in ascending order. A saddle joins the groups on its two sides if it
    belongs to the mesh of a curved side, or if the barrier from the higher side is below the noise
    (persistence: Edelsbrunner, Letscher, Zomorodian 2002).
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
    drained = np.zeros(
        len(group), dtype=bool
    )  # joined across a curved side to a minimum that is not a neighbour
    for height, (a, b), meshed, own in over:
        one, other = group[a], group[b]
        if one == other:
            continue
        barrier = height - max(low[one], low[other])
        # Without a limit, a chain of low steps could connect the two ends of an egg. A minimum
        # that was drained off the curved side does not continue it, apart from effects of the
        # mesh.
        slack = 1.0 if drained[a] or drained[b] else DOME_DEPTH
        by_mesh = meshed and barrier <= slack * max(depth[one], depth[other])
        # If the side is more curved than a sphere around the centre of mass, only the mesh makes a
        # minimum.
        on_curve = by_mesh or barrier <= RIM_DEPTH * own
        if not on_curve and barrier > NOISE_BARRIER:
            continue
        into, merged = (one, other) if low[one] <= low[other] else (other, one)
        if not by_mesh:
            drained[group == merged] = True
        group[group == merged] = into
        curved[into] |= curved[merged] | on_curve
        step[into] = max(step[into], step[merged])
        depth[into] = max(depth[into], depth[merged])
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
    """Return whether each saddle (s,) is an artifact of the mesh of a curved side."""
    hull, saddles = landscape.hull, landscape.saddles
    local = steps[hull.sides[saddles.edges]].max(axis=1)
    a, b = np.moveaxis(landscape.directions[saddles.between], 1, 0)
    apart = angle_between(a, b)
    near = apart <= np.minimum(NEIGHBOUR_STEPS * local, CURVED_STEP)
    barrier = saddles.heights - landscape.heights[saddles.between].max(axis=1)
    shallow = barrier <= SAGITTA_SLACK * saddles.heights * (1 - np.cos(apart / 2))
    return np.asarray(curved_edges[saddles.edges] & near & shallow)


def is_curved(hull: Polyhedron) -> npt.NDArray[np.bool_]:
    """Return whether each edge (e,) is a step of the mesh of a curved side.

    It is one if a similar step in the same direction follows at another edge of one of its facets,
    so that three flats form a chain; or if a closed chain of small steps leads around the part.
    """
    small = hull.angles <= CURVED_STEP
    found = small & _in_closed_chain(hull, small)
    for edge in np.flatnonzero(small & ~found).tolist():
        angle = hull.angles[edge]
        for side in (0, 1):
            facet, beyond = hull.sides[edge, side], hull.sides[edge, 1 - side]
            back = hull.normals[beyond] - hull.normals[facet]
            for next_edge in hull.edges_of_facets[facet]:
                ratio = hull.angles[next_edge] / angle
                if next_edge == edge or not small[next_edge]:
                    continue
                if not 1 / MAX_STEP_RATIO <= ratio <= MAX_STEP_RATIO:
                    continue
                sides = hull.sides[next_edge]
                ahead = hull.normals[sides.sum() - facet] - hull.normals[facet]
                found[edge] |= bool(ahead @ back < 0)
    return np.asarray(found)


def _in_closed_chain(hull: Polyhedron, small: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return whether small steps lead from the first facet of each edge (e,) around the part."""
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
        # A flat with its surroundings is not a ring.
        radius = np.hypot(x, y)
        cap = np.linalg.norm(middle) > 0.5 and radius.min() < 0.5 * radius.max()
        closed[number] = gaps.max() <= CURVED_STEP and not cap
    return closed[side[hull.sides[:, 0]]]


def _sagittas(hull: Polyhedron, curved_edges: npt.NDArray[np.bool_]) -> Array:
    """Return the depth (e,) of the flats at each edge below the curved side, R; 0 at other edges.

    Two chords of length w that meet at an angle a are below their circle by w / 2 tan(a / 4). The
    narrower of the two facets belongs to the mesh of the curved side; the other may be flat.
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
    depth = np.zeros(len(hull.angles))
    depth[edges] = width / 2 * np.tan(hull.angles[edges] / 4)
    return depth


def _largest(hull: Polyhedron, edges: npt.NDArray[np.bool_], values: Array) -> Array:
    """Return the maximum of the values (e,) over the given edges of each facet (f,), or 0."""
    largest = np.zeros(len(hull.normals))
    chosen = np.flatnonzero(edges)
    np.maximum.at(largest, hull.sides[chosen].ravel(), np.repeat(values[chosen], 2))
    return largest

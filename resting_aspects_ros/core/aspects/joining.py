"""Join the minima of a landscape that belong to one aspect.

A mesh approximates a curved side by flats, each of which is a minimum, and noise splits a minimum
into several. Minima are one aspect if the barrier between them is not higher than what explains
it: the depth of the flats of the mesh below the curved side on which they are, or noise. Angles
between flats alone do not decide: a flat of a ball may be closer to its neighbours than 25
degrees.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.geometry.curved_edges import CurvedEdges
from resting_aspects_ros.core.geometry.polyhedron import Indices
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.rotations import angle_between

# Barriers below this share of the height of the centre of mass in the higher minimum are noise:
# the part leaves the minimum if it is tilted by 2.6 degrees.
NOISE_BARRIER = 1e-3
# A side whose facets are within this angle is flat, rad: its steps are noise.
ONE_FLAT = np.radians(3.0)
# Depth of a flat below a curved side as a multiple of the barrier to the next flat, at most: 4 for
# an equilateral triangle on a sphere.
MAX_RISE = 4.0
# A part that must roll by more than this angle before it reaches the exit of a minimum can rest
# there, however low the barrier is: a ball with a small flat.
PLATEAU = CURVED_STEP


@dataclass(frozen=True, eq=False)
class JoinedMinima:
    """Minima that belong to one aspect.

    minima : (k,) int
        Their indices in the landscape, lowest first.
    drained : (d,) int
        Minima without an aspect, from which noise moves a part into these.
    curved : bool
        Whether they are flats of a curved side.
    step : float
        Maximum step of the mesh of the curved side, rad; 0 without a curved side.
    level : int
        Number of minima that are as low as the lowest, apart from effects of the mesh and noise;
        the others are on a slope.
    height : float
        Height of the centre of mass, R: that of the lowest minimum, or for a curved side that of
        the highest saddle within the level, because the edges of a mesh are on the true surface
        and its flats below.
    rest : float
        Height, R, of the highest minimum of the level that is below the lowest exit.
    ignored : float
        Highest barrier, R, that was ignored to join the minima.
    """

    minima: Indices
    drained: Indices
    curved: bool
    step: float
    level: int
    height: float
    rest: float
    ignored: float


class _Groups:
    """The groups of minima while they are joined; a group has the number of its lowest one."""

    def __init__(self, landscape: Landscape) -> None:
        self.low = landscape.heights / landscape.radius  # of each minimum
        self.number = np.arange(len(self.low))  # of the group of each minimum
        self.drained = np.zeros(len(self.low), dtype=np.bool_)
        self.curved = self.drained.copy()
        self.noisy = self.drained.copy()  # whether noise is all that separated minima of a group
        self.ignored = np.zeros(len(self.low))

    def pair(self, between: Indices) -> tuple[int, int]:
        """Return the lower and the higher group on the sides of a saddle."""
        one, other = self.number[between].tolist()
        return (one, other) if self.low[one] <= self.low[other] else (other, one)

    def join(self, lower: int, higher: int, barrier: float) -> None:
        """Join the higher group into the lower one across an ignored barrier."""
        self.ignored[lower] = max(self.ignored[lower], self.ignored[higher], barrier)
        self.number[self.number == higher] = lower


# Cached because a run of drops needs them for both its aspects and its job.
@lru_cache(maxsize=1)
def join_minima(landscape: Landscape) -> list[JoinedMinima]:
    """Return the aspects as groups of minima; each minimum is in one group.

    The saddles are processed in ascending order, so that the barrier of a group is that of its
    lowest minimum (persistence: Edelsbrunner, Letscher, Zomorodian 2002). Flats of curved sides
    are joined first: otherwise all flats of a ball would be joined to a flat side beside it, one
    after the other.
    """
    groups = _Groups(landscape)
    edges = CurvedEdges(landscape.hull)
    saddles = landscape.saddles
    heights = saddles.heights / landscape.radius
    explained = edges.depth[saddles.edges]
    explained += landscape.error * (explained > 0)
    meshed = edges.meshed[landscape.minima]
    # The lowest flat of a group can be deeper than those at the saddle.
    deep, share = edges.facet_depth[landscape.minima], edges.share[saddles.edges]
    for curved_only in (True, False):
        for k, (height, between) in enumerate(zip(heights, saddles.between, strict=True)):
            if curved_only and not meshed[between].all():
                continue
            lower, higher = groups.pair(between)
            barrier = height - groups.low[higher]
            by_mesh = barrier <= max(explained[k], share[k] * deep[higher])
            noise = max(NOISE_BARRIER * groups.low[higher], landscape.error)
            if lower == higher or not (by_mesh or (barrier <= noise and not curved_only)):
                continue
            level = groups.low[higher] - groups.low[lower] <= noise
            if not (curved_only or level) and _is_plateau(landscape, groups, higher, height):
                continue
            if by_mesh:
                groups.curved[lower] |= meshed[between].any()
            elif level:
                groups.noisy[lower] = True
            else:
                groups.drained |= groups.number == higher
            groups.curved[lower] |= groups.curved[higher] & (by_mesh | level)
            groups.noisy[lower] |= groups.noisy[higher] & level
            groups.join(lower, higher, barrier)
    return [_joined(landscape, groups, edges, int(k)) for k in np.unique(groups.number)]


def _is_plateau(landscape: Landscape, groups: _Groups, group: int, height: float) -> bool:
    """Return whether a part must roll by more than PLATEAU to leave a group at a height, R."""
    saddles = landscape.saddles
    inside = groups.number[saddles.between] == group
    limit = height + NOISE_BARRIER * groups.low[group]
    exits = (inside.sum(axis=1) == 1) & (saddles.heights <= limit * landscape.radius)
    own = np.flatnonzero((groups.number == group) & (groups.low <= limit))
    feet = saddles.directions(landscape.hull, np.flatnonzero(exits))
    nearest = (landscape.directions[own] @ feet.T).max(axis=1)
    return bool(nearest.min() < np.cos(PLATEAU))


def _joined(landscape: Landscape, groups: _Groups, edges: CurvedEdges, k: int) -> JoinedMinima:
    """Return a group with what follows from its minima."""
    own = groups.number == k
    minima = np.flatnonzero(own & ~groups.drained)
    low, saddles = groups.low, landscape.saddles
    facets = landscape.minima[minima]
    curved = bool(groups.curved[k])
    rise = min(float(edges.typical_depth[facets[0]]), MAX_RISE * float(groups.ignored[k]))
    rise *= curved
    leaves = own[saddles.between].sum(axis=1) == 1
    exit_ = saddles.heights[leaves].min(initial=np.inf) / landscape.radius
    top = low[k] + max(rise, NOISE_BARRIER * low[k] * (curved & groups.noisy[k]))
    level = low[minima] <= top
    inner = np.isin(saddles.between, minima[level]).all(axis=1)
    inner &= saddles.between[:, 0] != saddles.between[:, 1]
    heights = saddles.heights[inner] / landscape.radius
    heights = heights[heights <= max(top, low[k] + 2 * rise)]
    side = landscape.hull.normals[edges.sides == edges.sides[facets[0]]]
    curved &= bool(angle_between(side, landscape.directions[minima[0]]).max() > ONE_FLAT)
    return JoinedMinima(
        minima=minima,
        drained=np.flatnonzero(own & groups.drained),
        curved=curved,
        step=float(edges.step[facets].max() * curved),
        level=int(level.sum()) if curved else 1,
        height=float(heights.max(initial=low[k]) if curved else low[k]),
        rest=float(low[minima[level & (low[minima] < exit_)]].max()),
        ignored=float(groups.ignored[k]),
    )

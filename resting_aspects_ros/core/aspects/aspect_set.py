"""The natural resting aspects of a part, and which of them a resting pose is in."""

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from resting_aspects_ros.core.aspects.symmetry import Symmetry
from resting_aspects_ros.core.rotations import Array, angle_between, down_in_part

# A pose is in the aspect with the nearest down direction, if that is within this. Bullet rests
# within hundredths of a degree of a facet, on the margin of its shape; what is further off lies
# on no facet.
POSE_ANGLE = np.radians(3.0)
# Aspects that were found twice are the same if their down directions differ by no more than this.
SAME_DIRECTION = 1e-3
# Within a dome meshed in steps of an angle no direction is further from a flat than this part of
# the step: the flats around a corner are seen from it under 1 / sqrt(3) of it if they are alike.
_DOME_REACH = 0.75
# Poses that are classified at once, so that memory stays flat.
_AT_ONCE = 100_000


class Sweep(Enum):
    """Which down directions an aspect has besides its own."""

    POINT = 'point'  # none: the part rests on a flat side
    ARC = 'arc'  # a piece of a circle about the axis: it rocks on a curved side
    RING = 'ring'  # all of a circle about the axis: it rolls
    DOME = 'dome'  # a piece of the sphere of directions about the axis
    SPHERE = 'sphere'  # all directions

    @property
    def curved(self) -> bool:
        """Whether the part rests on a curved side."""
        return self is not Sweep.POINT


@dataclass(frozen=True, eq=False)
class Aspect:
    """One way in which a part comes to rest.

    id : int
        From 1, lowest centre of mass first.
    down_in_part : (3,) float
        Unit vector of gravity, part frame; of a curved aspect one of those that it sweeps.
    com_height : float
        Of the centre of mass above the surface, m.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part, of a pose that shows the aspect.
    support : (k, 2) float
        Contact polygon on the surface in that pose, m, tray axes, origin below the centre of mass.
    basin_share : float
        Share of all directions of gravity from which the part rolls into this aspect.
    min_barrier : float
        Rise of the centre of mass that takes the part out of it, m; infinite if there is no other.
    neighbour : int
        Id of the aspect to which it then rolls; 0 if it is the only one.
    symmetry_class, multiplicity : int
        Aspects that a rotation of the part onto itself takes to each other are of one class; from
        1, in the order of their first ids; how many aspects are in it.
    rolls : bool
        Whether the part rolls in this aspect, on a curved side.
    sweep : Sweep
    axis : (3,) float
        Of the sweep, unit vector, part frame; zero without one.
    directions : (m, 3) float
        Down directions of all flats of the mesh that belong to it, the own one first.
    links : (l, 2) int
        Pairs of ``directions`` between which the part rolls on a curved side.
    """

    id: int
    down_in_part: Array
    com_height: float
    orientation: Array
    support: Array
    basin_share: float
    min_barrier: float
    neighbour: int
    symmetry_class: int
    multiplicity: int
    rolls: bool
    sweep: Sweep
    axis: Array
    directions: Array = field(repr=False)
    links: npt.NDArray[np.int64] = field(repr=False)


@dataclass(frozen=True, eq=False)
class AspectSet:
    """All aspects of a part, ordered by id; and its symmetry, if that is known."""

    part_sha256: str
    aspects: tuple[Aspect, ...]
    symmetry: Symmetry | None = None

    def __len__(self) -> int:
        return len(self.aspects)

    def is_like(self, other: 'AspectSet') -> bool:
        """Whether an id means the same aspect in both: there are as many, in the same places."""
        pairs = zip(self.aspects, other.aspects, strict=False)
        return len(self) == len(other) and all(
            bool(np.linalg.norm(one.down_in_part - another.down_in_part) <= SAME_DIRECTION)
            for one, another in pairs
        )

    def classify(self, orientation: Array) -> npt.NDArray[np.int64]:
        """(n,) ids of the aspects that poses are in; 0 where none fits.

        Parameters
        ----------
        orientation : (n, 4) float
            Unit quaternions xyzw, tray from part.
        """
        ids, angle = self.locate(down_in_part(np.asarray(orientation).reshape(-1, 4)))
        return np.where(angle <= POSE_ANGLE, ids, 0)

    def locate(self, down: Array) -> tuple[npt.NDArray[np.int64], Array]:
        """(n,) ids of the nearest aspects, and (n,) angles to them, rad.

        Without any aspect the id is 0 and the angle infinite.

        Parameters
        ----------
        down : (n, 3) float
            Unit vectors of gravity, part frame.
        """
        ids = np.zeros(len(down), dtype=np.int64)
        angle = np.full(len(down), np.inf)
        if self.aspects:
            for first in range(0, len(down), _AT_ONCE):
                chunk = slice(first, first + _AT_ONCE)
                ids[chunk], angle[chunk] = self._map.locate(down[chunk])
        return ids, angle

    def classes(self) -> list[tuple[Aspect, ...]]:
        """The aspects of each symmetry class, in the order of the classes."""
        numbers = sorted({a.symmetry_class for a in self.aspects})
        return [tuple(a for a in self.aspects if a.symmetry_class == k) for k in numbers]

    @cached_property
    def _map(self) -> '_DirectionMap':
        return _DirectionMap(self.aspects)


class _DirectionMap:
    """The down directions of all aspects, and the arcs that they sweep."""

    def __init__(self, aspects: tuple[Aspect, ...]) -> None:
        count = [len(a.directions) for a in aspects]
        first = np.cumsum([0, *count[:-1]])
        self._directions = np.concatenate([a.directions for a in aspects])
        self._tree = KDTree(self._directions)
        self._ids = np.repeat([a.id for a in aspects], count)
        links = np.concatenate([a.links + k for a, k in zip(aspects, first, strict=True)])
        self._linked = _linked(links.astype(np.int64), len(self._directions))
        self._reach = np.zeros(len(self._directions))
        for aspect, k in zip(aspects, first, strict=True):
            if aspect.sweep is Sweep.SPHERE:
                self._reach[k : k + len(aspect.directions)] = np.pi
            elif aspect.sweep is Sweep.DOME and len(aspect.links):
                a, b = np.moveaxis(aspect.directions[aspect.links], 1, 0)
                self._reach[k : k + len(aspect.directions)] = (
                    _DOME_REACH * angle_between(a, b).max()
                )

    def locate(self, down: Array) -> tuple[npt.NDArray[np.int64], Array]:
        nearest = np.asarray(self._tree.query(down)[1])
        angle = angle_between(down, self._directions[nearest])
        for other in self._linked.T:
            swept = other[nearest]
            on = np.flatnonzero(swept >= 0)
            ends = self._directions[nearest[on]], self._directions[swept[on]]
            angle[on] = np.minimum(angle[on], _angle_to_arc(down[on], *ends))
        angle[angle <= self._reach[nearest]] = 0.0
        return self._ids[nearest], angle


def _linked(links: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    """(count, most) what each is linked with, filled up with -1."""
    around: list[list[int]] = [[] for _ in range(count)]
    for a, b in links.tolist():
        around[a].append(b)
        around[b].append(a)
    found = np.full((count, max(map(len, around), default=0)), -1)
    for k, others in enumerate(around):
        found[k, : len(others)] = others
    return found


def _angle_to_arc(down: Array, a: Array, b: Array) -> Array:
    """(n,) angles to the shorter arc between a and b, rad; infinite where it ends before."""
    normal = np.cross(a, b)
    within = ((np.cross(normal, a) * down).sum(axis=1) > 0) & (
        (np.cross(b, normal) * down).sum(axis=1) > 0
    )
    across = np.abs((normal * down).sum(axis=1)) / np.linalg.norm(normal, axis=1)
    return np.where(within, np.arcsin(np.minimum(across, 1.0)), np.inf)

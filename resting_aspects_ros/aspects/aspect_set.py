"""The natural resting aspects of a part, and the classification of resting poses."""

import dataclasses
from collections.abc import Sequence, Sized
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import overload

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.symmetry import Symmetry
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.rotations import LENGTH_TOLERANCE, angle_between, canonical, down_in_part

# A pose is in the aspect with the nearest down direction, if the angle is at most this. In Bullet
# parts rest within hundredths of a degree of a facet, on the collision margin; a pose with a
# larger angle does not rest on a facet.
POSE_ANGLE = np.radians(3.0)
# Aspects from two computations are the same if their down directions differ by at most this.
SAME_DIRECTION = 1e-3
# Aspects of a part with an axis are in one class if the height, R, and the cosine to the axis
# agree within this, which is the effect of the tessellation.
CLASS_TOLERANCE = 0.02
# Maximum angle of a direction in a dome from the nearest flat, as a share of the angular step of
# the mesh. If the flats around a corner are equal, they are at 1 / sqrt(3) of the step from it.
_DOME_REACH = 0.75
# Number of poses that are classified at once, to limit the memory.
_BATCH = 100_000


class Sweep(Enum):
    """The range of down directions of an aspect."""

    POINT = 'point'  # a single direction: the part rests on a flat side
    ARC = 'arc'  # an arc about the axis: the part rocks on a curved side
    RING = 'ring'  # a full circle about the axis: the part rolls
    DOME = 'dome'  # a cap of the sphere of directions around the axis
    SPHERE = 'sphere'  # all directions

    @property
    def curved(self) -> bool:
        """Whether the part rests on a curved side."""
        return self is not Sweep.POINT


@dataclass(frozen=True, eq=False)
class Aspect:
    """A natural resting aspect of a part.

    id : int
        From 1, in ascending order of the height of the centre of mass.
    down_in_part : (3,) float
        Unit vector of gravity, part frame; for a curved aspect one of the directions in its sweep.
    com_height : float
        Height of the centre of mass above the surface, m.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part, of a representative pose.
    support : (k, 2) float
        Contact polygon on the surface in that pose, m, tray axes, origin below the centre of mass.
    basin_share : float
        Share of all directions of gravity from which the part rolls into this aspect.
    merged : float
        Highest barrier, m, that was ignored because the mesh or noise explains it: between
        directions of the aspect, or to poses that do not count as an aspect; 0 without any.
    min_barrier : float
        Minimum rise of the centre of mass to leave the aspect, m; infinite for the only aspect.
        For a curved aspect from the highest direction in which the part rests and that is below
        the way out.
    neighbour : int
        Id of the aspect that the part reaches over this barrier; 0 for the only aspect.
    symmetry_class, multiplicity : int
        Number of the symmetry class, from 1, in the order of the lowest ids, and the number of its
        aspects. Rotations of the part onto itself map the aspects of a class to each other.
    rolls : bool
        Whether the part rolls in this aspect, on a curved side.
    sweep : Sweep
    axis : (3,) float
        Axis of the sweep, unit vector, part frame; zero without an axis.
    directions : (m, 3) float
        Down directions of all flats of the mesh in the aspect, ``down_in_part`` first, then the
        others of the level.
    links : (l, 2) int
        Pairs of ``directions`` between which the part rolls on a curved side.
    level : int
        Number of ``directions`` in which the part rests. In the others only the mesh of a curved
        side stops it: a smooth part would roll on.
    """

    id: int
    symmetry_class: int
    multiplicity: int
    rolls: bool
    sweep: Sweep
    axis: Array
    down_in_part: Array
    orientation: Array
    com_height: float
    min_barrier: float
    neighbour: int
    basin_share: float
    merged: float
    support: Array
    directions: Array = field(repr=False)
    links: npt.NDArray[np.int64] = field(repr=False)
    level: int = field(repr=False, default=1)


# Documents and messages contain these fields. The others only serve the classification of poses.
PUBLISHED_FIELDS = tuple(each.name for each in dataclasses.fields(Aspect) if each.repr)


@dataclass(frozen=True, eq=False)
class AspectSet(Sequence[Aspect]):
    """The sequence of all aspects of a part, ordered by id, and its symmetry, if known.

    ``floor_normal`` (3,) is that of the plane on which they lie, tray frame; None: vertical.
    """

    part_sha256: str
    aspects: tuple[Aspect, ...]
    symmetry: Symmetry | None = None
    floor_normal: Array | None = None

    def __len__(self) -> int:
        return len(self.aspects)

    @overload
    def __getitem__(self, index: int) -> Aspect: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Aspect, ...]: ...
    def __getitem__(self, index: int | slice) -> Aspect | tuple[Aspect, ...]:
        """Return the aspect with the id ``index`` + 1, or several."""
        return self.aspects[index]

    def matches(self, other: 'AspectSet') -> bool:
        """Return whether the ids of both sets stand for the same aspects."""
        pairs = zip(self.aspects, other.aspects, strict=False)
        return len(self) == len(other) and all(
            bool(np.linalg.norm(one.down_in_part - another.down_in_part) <= SAME_DIRECTION)
            for one, another in pairs
        )

    def classify(self, orientation: Array) -> npt.NDArray[np.int64]:
        """Return the ids (n,) of the aspects that poses are in; 0 if a pose is in no aspect.

        Parameters
        ----------
        orientation : (n, 4) float
            Unit quaternions xyzw, tray from part.
        """
        xyzw = np.asarray(orientation).reshape(-1, 4)
        ids, angle = self.locate(down_in_part(xyzw, self.floor_normal))
        return np.where(angle <= POSE_ANGLE, ids, 0)

    def at_rest(self) -> 'AspectSet':
        """Return the aspects with only those directions in which a smooth part rests.

        In the others, such as the flats of the fillet beside a flat side, only the mesh stops it.
        """
        rests = [
            dataclasses.replace(
                a,
                directions=a.directions[: a.level],
                links=a.links[(a.links < a.level).all(axis=1)],
            )
            for a in self.aspects
        ]
        return dataclasses.replace(self, aspects=tuple(rests))

    def locate(self, down: Array) -> tuple[npt.NDArray[np.int64], Array]:
        """Return the ids (n,) of the nearest aspects and the angles (n,) to them, rad.

        If the part has no aspect, the id is 0 and the angle infinite.

        Parameters
        ----------
        down : (n, 3) float
            Unit vectors of gravity, part frame.
        """
        ids = np.zeros(len(down), dtype=np.int64)
        angle = np.full(len(down), np.inf)
        if self.aspects:
            for first in range(0, len(down), _BATCH):
                chunk = slice(first, first + _BATCH)
                ids[chunk], angle[chunk] = self._map.locate(down[chunk])
        return ids, angle

    def classes(self) -> list[tuple[Aspect, ...]]:
        """Return the aspects of each symmetry class, in the order of the classes."""
        numbers = sorted({a.symmetry_class for a in self.aspects})
        return [tuple(a for a in self.aspects if a.symmetry_class == k) for k in numbers]

    def chosen(
        self, ids: Sequence[int] | None, numbers: Sequence[int] | None, what: str
    ) -> tuple[int, ...]:
        """Return ids of aspects, ascending, from ids or else from numbers of symmetry classes.

        Raises InvalidValueError if there is none or one is not known; ``what`` says what they are
        in its message, such as 'pickable'.
        """
        members = self.classes()
        noun, limit, given = 'aspect', len(self), ids
        if given is None:
            noun, limit, given = 'symmetry class', len(members), numbers or ()
        if not isinstance(given, Sized):
            raise InvalidValueError(
                f'invalid {what} {noun} {shown(given)}: expected a sequence of numbers'
            )
        if not len(given):
            raise InvalidValueError(f'invalid {what} {noun}: expected at least one')
        for k in given:
            if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 1 <= k <= limit:
                raise InvalidValueError(f'invalid {what} {noun} {shown(k)}: expected 1 to {limit}')
        if ids is not None:
            return tuple(sorted({int(k) for k in ids}))
        return tuple(sorted(aspect.id for k in set(given) for aspect in members[k - 1]))

    @cached_property
    def _map(self) -> '_DirectionMap':
        return _DirectionMap(self.aspects)


def with_symmetry_classes(aspects: AspectSet, symmetry: Symmetry, radius: float) -> AspectSet:
    """Return the aspects with their symmetry classes; ``radius`` is R, m."""
    group = np.arange(len(aspects))
    down = np.array([aspect.down_in_part for aspect in aspects]).reshape(-1, 3)
    for rotation in symmetry.rotations:
        for k, image in enumerate((aspects.locate(down @ rotation.T)[0] - 1).tolist()):
            if aspects[k].sweep is aspects[image].sweep:
                group[group == max(group[k], group[image])] = min(group[k], group[image])
    if symmetry.axis is not None:
        # Rotations about the axis map aspects to each other that have the same height and the same
        # angle to the axis, such as the sides of a fine prism.
        kinds = list(Sweep)
        keys = [
            (a.com_height / radius, a.down_in_part @ symmetry.axis, kinds.index(a.sweep))
            for a in aspects
        ]
        for k, one in enumerate(keys):
            alike = np.abs(np.array(keys) - one).max(axis=1) < CLASS_TOLERANCE
            first = group[alike].min()
            group[np.isin(group, group[alike])] = min(first, group[k])
    _, classes, sizes = np.unique(group, return_inverse=True, return_counts=True)
    # The mean, because a minimum of the mesh halfway between two aspects is joined with only one.
    share = np.bincount(classes, weights=[a.basin_share for a in aspects]) / sizes
    return AspectSet(
        aspects.part_sha256,
        tuple(
            dataclasses.replace(
                a,
                basin_share=float(share[c]),
                symmetry_class=int(c) + 1,
                multiplicity=int(sizes[c]),
            )
            for a, c in zip(aspects, classes, strict=True)
        ),
        symmetry,
    )


class _DirectionMap:
    """The down directions of all aspects and the arcs between linked directions."""

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
            if len(aspects) == 1 and aspect.sweep is Sweep.SPHERE:
                self._reach[:] = np.pi
            elif aspect.sweep in {Sweep.DOME, Sweep.SPHERE} and len(aspect.links):
                a, b = np.moveaxis(aspect.directions[aspect.links], 1, 0)
                self._reach[k : k + len(aspect.directions)] = (
                    _DOME_REACH * angle_between(a, b).max()
                )

    def locate(self, down: Array) -> tuple[npt.NDArray[np.int64], Array]:
        """Return the ids of the nearest aspects and the angles to them."""
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
    """Return what each element is linked with, (count, max links), padded with -1."""
    around: list[list[int]] = [[] for _ in range(count)]
    for a, b in links.tolist():
        around[a].append(b)
        around[b].append(a)
    table = np.full((count, max(map(len, around), default=0)), -1)
    for k, others in enumerate(around):
        table[k, : len(others)] = others
    return table


def _angle_to_arc(down: Array, a: Array, b: Array) -> Array:
    """Return the angles (n,) to the shorter arc between a and b, rad; infinite beyond its ends."""
    normal = np.cross(a, b)
    within = ((np.cross(normal, a) * down).sum(axis=1) > 0) & (
        (np.cross(b, normal) * down).sum(axis=1) > 0
    )
    across = np.abs((normal * down).sum(axis=1)) / np.linalg.norm(normal, axis=1)
    return np.where(within, np.arcsin(np.minimum(across, 1.0)), np.inf)


# -- Single poses ---------------------------------------------------------------------------------


def unit_orientation(xyzw: npt.ArrayLike) -> Array:
    """Return the quaternion (4,) scaled to length 1 and with w >= 0, to remove rounding errors.

    Raises InvalidValueError for a norm that is not within LENGTH_TOLERANCE of 1.
    """
    numbers = np.asarray(xyzw, dtype=np.float64)
    with np.errstate(over='ignore', invalid='ignore'):  # an overflow is rejected below
        norm = float(np.linalg.norm(numbers))
    if not abs(norm - 1) <= LENGTH_TOLERANCE:  # also rejects NaN
        shown = ', '.join(f'{number:.6g}' for number in numbers)
        raise InvalidValueError(
            f'invalid orientation ({shown}) of norm {norm:.6g}: expected a quaternion x, y, z, w '
            f'of norm 1 within {LENGTH_TOLERANCE:g}'
        )
    return canonical(numbers)

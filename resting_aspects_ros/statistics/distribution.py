"""The distribution of drops over the aspects of a part, and over what the parts touch."""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Optional

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.support import (
    CODE_TEXT,
    NONE,
    ContactFinder,
    class_of_contacts,
    pose_angles,
)
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    Interval,
    checkpoints,
    intervals,
    is_precise,
    stopping_confidence,
)
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

if TYPE_CHECKING:
    from resting_aspects_ros.statistics.model_range import ModelRange

METHOD = 'drops'
# Names of the counts of drops that are at rest in no aspect.
OUTSIDE = ('unclassified', 'unsettled', 'failed', 'lost', 'sliding')
# The counts are first sampled after this number of drops, then this often for each factor of ten.
FIRST_SAMPLE = 10
SAMPLES_PER_DECADE = 10


@dataclass(frozen=True, eq=False)
class Distribution:
    """Counts of the drops of a run by aspect; each drop is counted exactly once.

    counts : (k,) int
        Drops at rest in each aspect, by id from 1.
    unclassified, unsettled, failed : int
        Drops at rest in no aspect, drops not at rest on the surface within the time limit, and
        drops with numerical errors.
    lost, sliding : int
        Parts that left the surroundings, and parts that still slide or roll on them at the end.
    interval : str
        Method of the intervals, one of intervals.METHODS.
    confidence : float
        Confidence of the intervals.
    by_precision : bool
        Whether the run stopped when its intervals were narrow enough.
    energy_growth : float
        Maximum energy_growth of the drops, m g R; see RestingPoses.
    contacts : Placements or None
        The same drops by what they touch, if the surroundings have walls and this was counted.
    model : ModelRange or None
        Where the probabilities are on a real surface, if that is known; see model_range.
    """

    aspects: AspectSet
    counts: npt.NDArray[np.int64]
    unclassified: int
    unsettled: int
    failed: int
    interval: str = INTERVAL
    confidence: float = CONFIDENCE
    by_precision: bool = False
    energy_growth: float = 0.0
    lost: int = 0
    sliding: int = 0
    contacts: Optional['Placements'] = None
    model: Optional['ModelRange'] = None

    @property
    def drops(self) -> int:
        """Number of drops that were counted."""
        return int(self.counts.sum() + sum(getattr(self, name) for name in OUTSIDE))

    def intervals(self) -> list[Interval]:
        """Return count / drops of each aspect with its interval, for n = drops; see intervals.

        The lower bound of a count of zero is zero; the upper bound limits the probability of an
        aspect that was never seen. Without drops the interval is 0 to 1. After a stop by precision
        the intervals are slightly wider, to preserve their coverage; see stopping.
        """
        return self._intervals(self.counts)

    def combined_interval(self, ids: Iterable[int]) -> Interval:
        """Return the probability to rest in any of several aspects, with its interval.

        Raises InvalidValueError if the part has no aspect with one of the ids.
        """
        max_id = len(self.counts)
        for k in set(ids):
            if not 1 <= k <= max_id:
                raise InvalidValueError(f'invalid aspect {k!r}: expected 1 to {max_id}')
        count = self.counts[[k - 1 for k in sorted(set(ids))]].sum()
        return self._intervals(count[None])[0]

    def _intervals(self, counts: npt.NDArray[np.int64]) -> list[Interval]:
        stopped = stopping_confidence(self.confidence) if self.by_precision else self.confidence
        return intervals(counts, self.drops, self.interval, stopped)

    def stops(self, precision: float, drop_limit: int) -> bool:
        """Return whether a run stops with these counts: at the limit, or at a precise checkpoint.

        With a precision of 0 it stops only at the limit.
        """
        if self.drops >= drop_limit:
            return True
        at_checkpoint = precision > 0 and self.drops in checkpoints(drop_limit)
        return at_checkpoint and is_precise(
            self.counts, self.drops, precision, self.interval, self.confidence
        )

    def by_class(self) -> 'Distribution':
        """Return the distribution over the symmetry classes, in their order."""
        classes = [[a.id - 1 for a in members] for members in self.aspects.classes()]
        counts = np.array([self.counts[ids].sum() for ids in classes], dtype=np.int64)
        model = None if self.model is None else self.model.of_classes()
        return dataclasses.replace(self, counts=counts, model=model)

    def model_intervals(self) -> list[Interval | None]:
        """Return count / drops of each aspect with its model range; None where it is not known."""
        if self.model is None or not self.drops:
            return [None] * len(self.counts)
        rows = zip(self.counts.tolist(), self.model.by_aspect.tolist(), strict=True)
        return [Interval(count / self.drops, *bounds) for count, bounds in rows]

    def __add__(self, other: 'Distribution') -> 'Distribution':
        """Return the distribution over the drops of both: different drops of the same part.

        It has no contacts and no model range.
        """
        if self.aspects.part_sha256 != other.aspects.part_sha256:
            raise ValueError('distributions of different parts cannot be added')
        return dataclasses.replace(
            self,
            counts=self.counts + other.counts,
            unclassified=self.unclassified + other.unclassified,
            unsettled=self.unsettled + other.unsettled,
            failed=self.failed + other.failed,
            energy_growth=max(self.energy_growth, other.energy_growth),
            lost=self.lost + other.lost,
            sliding=self.sliding + other.sliding,
            contacts=None,
            model=None,
        )


def no_drops(
    aspects: AspectSet,
    *,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    by_precision: bool = False,
) -> Distribution:
    """Return the distribution before the first drop."""
    none = np.zeros(len(aspects), dtype=np.int64)
    return Distribution(aspects, none, 0, 0, 0, interval, confidence, by_precision)


def aspect_ids(aspects: AspectSet, poses: RestingPoses) -> npt.NDArray[np.int64]:
    """Return the aspect id (n,) of each drop; 0 if it is in no aspect or did not come to rest."""
    settled = poses.status == RestStatus.SETTLED  # other poses can be NaN
    ids = np.zeros(len(poses), dtype=np.int64)
    ids[settled] = aspects.classify(poses.orientation[settled])
    return ids


def count_poses(
    aspects: AspectSet, poses: RestingPoses, ids: npt.NDArray[np.int64] | None = None
) -> Distribution:
    """Return the counts of poses by aspect; ``ids`` are their aspect_ids, if known already."""
    settled = poses.status == RestStatus.SETTLED
    ids = aspect_ids(aspects, poses) if ids is None else ids
    by_id = np.bincount(ids[settled], minlength=len(aspects) + 1)
    return Distribution(
        aspects,
        by_id[1:],
        unclassified=int(by_id[0]),
        unsettled=_number(poses, RestStatus.UNSETTLED),
        failed=_number(poses, RestStatus.FAILED),
        energy_growth=float(poses.energy_growth.max(initial=0.0)),
        lost=_number(poses, RestStatus.LOST),
        sliding=_number(poses, RestStatus.SLIDING),
    )


def _number(poses: RestingPoses, status: RestStatus) -> int:
    return int((poses.status == status).sum())


class History:
    """Counts after fixed numbers of drops, which do not depend on the batches of the run.

    Parameters
    ----------
    aspects : AspectSet
    """

    def __init__(self, aspects: AspectSet) -> None:
        self._aspects = aspects
        self._drops = 0
        self._counts = np.zeros(len(aspects) + 1, dtype=np.int64)  # first: in no aspect
        self._samples: list[tuple[int, Counts]] = []

    def add(self, ids: Counts) -> None:
        """Add the aspect ids of the next drops."""
        while len(ids):
            following = round(FIRST_SAMPLE * 10 ** (len(self._samples) / SAMPLES_PER_DECADE))
            batch, ids = np.split(ids, [following - self._drops])
            self._drops += len(batch)
            self._counts += np.bincount(batch, minlength=len(self._counts))
            if self._drops == following:
                self._samples.append((self._drops, self._counts[1:].copy()))

    def points(self) -> tuple[Counts, Counts]:
        """Return numbers of drops (m,), ascending, and the counts by aspect (m, k) after them."""
        samples = list(self._samples)
        if self._drops and (not samples or samples[-1][0] < self._drops):
            samples.append((self._drops, self._counts[1:].copy()))
        return (
            np.array([drops for drops, _ in samples], dtype=np.int64),
            np.array([counts for _, counts in samples], dtype=np.int64).reshape(
                len(samples), len(self._aspects)
            ),
        )


# -- Contacts -------------------------------------------------------------------------------------


# Poses whose contacts are not all known by their aspects are one placement if they are at most
# this far, rad, from its first pose. Poses of one aspect scatter by hundredths of a degree.
SAME_PLACEMENT = np.radians(10.0)
# Poses that are in none of this number of placements are counted together.
MAX_PLACEMENTS = 200


@dataclass(eq=False)
class Placement:
    """Resting poses with the same contacts and the same orientation, except for what is free.

    contacts : tuple of int
        For each plane the id of the aspect with which the part lies on it, or a code of contacts.
    orientation : (4,) float
        Of the first of the poses, tray from part.
    count : int
    symmetry_class : int
        From 1; placements that a rotation of the part onto itself maps to each other share it.
    """

    contacts: tuple[int, ...]
    orientation: Array
    count: int = 0
    symmetry_class: int = 0


@dataclass(eq=False)
class Placements:
    """Settled drops by what they touch, as a message or a document has them.

    planes : tuple of str
        Names of the planes, in the order of the contacts of the placements.
    placements : list of Placement
    drops : int
        All drops that were counted, also those that did not come to rest.
    uncounted : int
        Drops at rest in none of the placements, of which there were too many.
    """

    planes: tuple[str, ...]
    placements: list[Placement] = field(default_factory=list)
    drops: int = 0
    uncounted: int = 0

    def sorted_rows(self, method: str, confidence: float) -> list[tuple[Placement, Interval]]:
        """Return the placements with the intervals of their shares, the most frequent first."""
        counts = np.array([p.count for p in self.placements], dtype=np.int64)
        found = intervals(counts, self.drops, method, confidence) if len(counts) else []
        rows = list(zip(self.placements, found, strict=True))
        return sorted(rows, key=lambda row: (-row[0].count, row[0].contacts))

    def named(self, placement: Placement) -> dict[str, int | str | None]:
        """Return the contacts of a placement by the names of the planes.

        An aspect is its id, another contact its description, and no contact None. Of several
        planes with the same name, the first one that is touched counts.
        """
        found: dict[str, int | str | None] = {}
        for name, code in zip(self.planes, placement.contacts, strict=True):
            if found.get(name) is None:
                found[name] = _named(code)
        return found


class ContactCounts(Placements):
    """Counts of the settled drops of a run by placement; memory does not grow with the drops.

    The placements are found in the order of the drops, so that those of the first m drops keep
    their place in the list when there are more.
    """

    def __init__(self, finder: ContactFinder, aspects: AspectSet) -> None:
        super().__init__(tuple(plane.name for plane in finder.planes))
        self.finder = finder
        self.aspects = aspects

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count the settled drops of a chunk; the ids of their aspects are not needed."""
        del ids
        self.drops += len(poses)
        settled = poses.status == RestStatus.SETTLED
        orientation = poses.orientation[settled]
        contacts = self.finder.find(poses.position[settled], orientation)
        keys, which = np.unique(contacts, axis=0, return_inverse=True)
        new: list[tuple[int, Placement]] = []
        for k, key in enumerate(keys.tolist()):
            rows = np.flatnonzero(which.ravel() == k)
            new += self._count(tuple(key), rows, orientation[rows])
        for _, found in sorted(new, key=lambda each: each[0]):
            if _all_known(found.contacts) or len(self.placements) < MAX_PLACEMENTS:
                self._append(found)
            else:
                self.uncounted += found.count

    def _count(
        self, key: tuple[int, ...], rows: Counts, orientation: Array
    ) -> list[tuple[int, Placement]]:
        """Count poses (n, 4) with the same contacts in the known placements.

        Returns the placements of the others, each with the first of its ``rows`` (n,).
        """
        known = [p for p in self.placements if p.contacts == key]
        new: list[tuple[int, Placement]] = []
        if _all_known(key):
            if not known:
                new.append((int(rows[0]), Placement(key, orientation[0])))
                known = [new[0][1]]
            known[0].count += len(orientation)
            return new
        touched = [p.normal for p, c in zip(self.finder.planes, key, strict=True) if c != NONE]
        normal = touched[0] if len(touched) == 1 else None
        symmetry = self.aspects.symmetry
        rotations = symmetry.rotations if symmetry else np.eye(3)[None]
        axis = symmetry.axis if symmetry else None
        while len(rows):
            if not known:
                if len(new) == MAX_PLACEMENTS:
                    self.uncounted += len(rows)
                    break
                new.append((int(rows[0]), Placement(key, orientation[0])))
                known = [new[-1][1]]
            place = known.pop(0)
            angles = pose_angles(orientation, place.orientation, rotations, normal, axis)
            far = angles > SAME_PLACEMENT
            place.count += len(rows) - int(far.sum())
            rows, orientation = rows[far], orientation[far]
        return new

    def _append(self, found: Placement) -> None:
        """Append a placement with the number of its symmetry class."""
        of_class = class_of_contacts(self.aspects, found.contacts)
        for other in self.placements:
            if all(c >= NONE for c in found.contacts) and of_class == class_of_contacts(
                self.aspects, other.contacts
            ):
                found.symmetry_class = other.symmetry_class
                break
        else:
            last = max((p.symmetry_class for p in self.placements), default=0)
            found.symmetry_class = last + 1
        self.placements.append(found)

    @property
    def counted(self) -> Placements:
        """The counts without what is needed to count more drops."""
        return Placements(self.planes, list(self.placements), self.drops, self.uncounted)


def _all_known(contacts: tuple[int, ...]) -> bool:
    """Return whether a part touches some planes, and all of them with an aspect."""
    return any(contacts) and all(c >= NONE for c in contacts)


def _named(code: int) -> int | str | None:
    if code == NONE:
        return None
    return code if code > 0 else CODE_TEXT[code]

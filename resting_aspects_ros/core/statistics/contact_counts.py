"""Counts of resting poses by what they touch: an aspect on the floor, and what is at the wall."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.contacts import (
    CODE_TEXT,
    NONE,
    ContactFinder,
    class_of_contacts,
    pose_angles,
)
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.statistics.intervals import Interval, intervals

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
        for k in np.argsort([np.argmax(which.ravel() == k) for k in range(len(keys))]):
            key = tuple(keys[k].tolist())
            self._count(key, orientation[which.ravel() == k])

    def _count(self, key: tuple[int, ...], orientation: Array) -> None:
        """Count poses (n, 4) with the same contacts."""
        same = [p for p in self.placements if p.contacts == key]
        if all(c >= NONE for c in key) and any(key):
            if not same:
                same.append(self._new(key, orientation[0]))
            same[0].count += len(orientation)
            return
        touched = [p.normal for p, c in zip(self.finder.planes, key, strict=True) if c != NONE]
        normal = touched[0] if len(touched) == 1 else None
        rest = orientation
        while len(rest):
            known = same.pop(0) if same else None
            if known is None:
                if len(self.placements) >= MAX_PLACEMENTS:
                    self.uncounted += len(rest)
                    return
                known = self._new(key, rest[0])
            near = pose_angles(rest, known.orientation, self._rotations, normal) <= SAME_PLACEMENT
            known.count += int(near.sum())
            rest = rest[~near]

    def _new(self, key: tuple[int, ...], orientation: Array) -> Placement:
        of_class = class_of_contacts(self.aspects, key)
        for other in self.placements:
            if all(c >= NONE for c in key) and of_class == class_of_contacts(
                self.aspects, other.contacts
            ):
                number = other.symmetry_class
                break
        else:
            number = 1 + max((p.symmetry_class for p in self.placements), default=0)
        self.placements.append(Placement(key, orientation, 0, number))
        return self.placements[-1]

    @property
    def counted(self) -> Placements:
        """The counts without what is needed to count more drops."""
        return Placements(self.planes, list(self.placements), self.drops, self.uncounted)

    @property
    def _rotations(self) -> Array:
        symmetry = self.aspects.symmetry
        return np.eye(3)[None] if symmetry is None else symmetry.rotations


def _named(code: int) -> int | str | None:
    if code == NONE:
        return None
    return code if code > 0 else CODE_TEXT[code]


def contacts_text(contacts: Iterable[tuple[str, int | str | None]]) -> str:
    """Return contacts in words: 'belt: aspect 1, wall: edge'."""
    parts = [
        f'{name.replace("_", " ")}: {"aspect " if isinstance(code, int) else ""}{code}'
        for name, code in contacts
        if code is not None
    ]
    return ', '.join(parts) or 'nothing'

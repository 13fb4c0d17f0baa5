"""Distributions of active and finished runs, as the classifier knows them."""

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from resting_aspects_ros.api.conditions import surroundings_text, without_drops
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import (
    ContactCounts,
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.intervals import is_precise
from resting_aspects_ros.statistics.poses import RestingPoses

# Maximum number of finished distributions that are kept.
MAX_KNOWN = 10_000

Known = tuple[RunDescription, Distribution]


@dataclass
class RunCounts:
    """The current distribution of one run; poses wait until the aspects of the part are known.

    pending : poses that are not counted yet
    finished : whether the run has ended
    problem : why drops of the run are missing; empty if none are
    has_gap : whether drops before the last one are missing, so that the distribution is not that
        of a run
    """

    run: RunDescription
    distribution: Distribution | None = None
    pending: list[RestingPoses] = field(default_factory=list)
    finished: bool = False
    problem: str = ''
    has_gap: bool = False
    contacts: ContactCounts | None = None

    @property
    def counted(self) -> Distribution:
        """The distribution; valid after the first call of ``count``."""
        assert self.distribution is not None
        return self.distribution

    def count(self, part: Part, aspects: AspectSet) -> None:
        """Count the pending poses of a part with these aspects on a level plane."""
        total = self.distribution
        if total is None:
            aspects, self.contacts = without_drops(part, self.run.conditions, aspects)
            total = no_drops(aspects, by_precision=self.run.precision > 0)
        for batch in self.pending:
            ids = aspect_ids(total.aspects, batch)
            total += count_poses(total.aspects, batch, ids)
            if self.contacts is not None:
                self.contacts.add(batch, ids)
        if self.contacts is not None:
            total = dataclasses.replace(total, contacts=self.contacts.counted)
        self.distribution, self.pending = total, []


class DistributionStore:
    """Finished distributions; of runs with the same first drop, the one with the most drops.

    The contents depend only on the runs, not on the order in which they are added: after a
    restart, this is the order in which their logs are read.

    Parameters
    ----------
    aspects_of : returns the aspects of a version of a part by its part_sha256, or None if it has
        not been described
    """

    def __init__(self, aspects_of: Callable[[str], AspectSet | None]) -> None:
        self._aspects_of = aspects_of
        self._known: dict[tuple[object, ...], Known] = {}  # by _key

    def add(self, run: RunDescription, distribution: Distribution) -> None:
        """Add the distribution of a finished run.

        Raises InvalidValueError if its aspects are not those of the part.
        """
        if distribution.drops == 0:
            return  # it was canceled before the first drop
        aspects = self._aspects_of(run.part_sha256)
        if aspects is not None and not aspects.matches(distribution.aspects):
            raise InvalidValueError(
                f'invalid distribution of run {run.run_id}: expected the {len(aspects)} aspects '
                f'of {run.part}'
            )
        key = _key(run)
        candidates = [self._known.pop(key, None), (run, distribution)]
        self._known[key] = max(filter(None, candidates), key=_most_drops)
        while len(self._known) > MAX_KNOWN:
            self._known.pop(next(iter(self._known)))

    def remove_inconsistent(self, part_sha256: str) -> list[RunDescription]:
        """Remove the distributions over other aspects than those of a part; return their runs."""
        of_part = {k: v for k, v in self._known.items() if v[0].part_sha256 == part_sha256}
        aspects = self._aspects_of(part_sha256) if of_part else None
        if aspects is None:
            return []
        wrong = [k for k, (_, each) in of_part.items() if not aspects.matches(each.aspects)]
        return [self._known.pop(key)[0] for key in wrong]

    def find(
        self,
        part_sha256: str,
        conditions: DropConditions,
        drops: int,
        precision: float,
        seed: int | None,
    ) -> Known | None:
        """Return the matching distribution with the most drops; ties go to the newest run.

        A distribution matches if it has at least the requested drops, or the requested precision.
        With a seed, only a run of this seed matches that starts with drop 0.
        """
        requested = part_sha256, conditions.key()
        if seed is None:
            known = [each for key, each in self._known.items() if key[:2] == requested]
        else:
            known = [self._known[key]] if (key := (*requested, seed, 0)) in self._known else []
        matching = [
            (run, each)
            for run, each in known
            if each.drops >= drops
            or (precision and is_precise(each.counts, each.drops, precision))
        ]
        return max(matching, key=_most_drops, default=None)

    def has_all(self, run: RunDescription) -> bool:
        """Return whether all requested drops of a run are known."""
        known = self._known.get(_key(run))
        return known is not None and known[0].run_id == run.run_id and known[1].drops >= run.drops

    def sha_of(self, name: str) -> str | None:
        """Return the part_sha256 of the newest run of a part, or None."""
        of_name = (each for each in self._known.values() if each[0].part == name)
        newest = max(of_name, key=_start_order, default=None)
        return newest[0].part_sha256 if newest else None

    def describe(self, name: str, part_sha256: str, seed: int | None) -> list[str]:
        """Return descriptions of the known distributions of a part name, newest run first.

        Each says how it differs from the requested version and seed.

        part_sha256 : str
            Requested version of the part; empty if no version is known.
        """
        of_name = [each for each in self._known.values() if each[0].part == name]
        of_name.sort(key=_start_order, reverse=True)
        return [
            f'{each.drops} drops on {_conditions_text(run.conditions)}'
            + ('' if seed in (None, run.seed) else f' with seed {run.seed}')
            + ('' if seed is None or not run.first_drop else f' from drop {run.first_drop} on')
            + (
                ' of another version of the part'
                if part_sha256 not in ('', run.part_sha256)
                else ''
            )
            for run, each in of_name
        ]

    def __len__(self) -> int:
        """Return the number of known distributions."""
        return len(self._known)

    def newest(self, part_sha256: str) -> Known | None:
        """Return the distribution of the newest run of a part, under any conditions, or None."""
        of_part = (each for each in self._known.values() if each[0].part_sha256 == part_sha256)
        return max(of_part, key=_start_order, default=None)

    def has(self, part_sha256: str) -> bool:
        """Return whether any distribution of a part is known."""
        return any(run.part_sha256 == part_sha256 for run, _ in self._known.values())


def _key(run: RunDescription) -> tuple[object, ...]:
    return run.part_sha256, run.conditions.key(), run.seed, run.first_drop


def _conditions_text(conditions: DropConditions) -> str:
    surface = conditions.surface or 'own conditions'
    around = conditions.surroundings
    return surface if around is None else f'{surface}, {surroundings_text(around)}'


def _start_order(known: Known) -> tuple[int, str]:
    """Sort key by start time; equal times are ordered by run id, which is unique."""
    return known[0].started, known[0].run_id


def _most_drops(known: Known) -> tuple[int, int, str]:
    return known[1].drops, *_start_order(known)


def newest_distribution(
    known: DistributionStore, active: Iterable[RunCounts], part_sha256: str
) -> Distribution | None:
    """Return the newest finished distribution of a part, else that of its newest active run."""
    counted = [
        counts.distribution
        for counts in active
        if counts.run.part_sha256 == part_sha256
        and counts.distribution is not None
        and counts.distribution.drops
    ]
    finished = known.newest(part_sha256)
    return finished[1] if finished else next(reversed(counted), None)

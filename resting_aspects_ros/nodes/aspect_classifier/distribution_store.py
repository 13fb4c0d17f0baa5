"""What the classifier knows of runs: the distribution of each, under way or finished."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.statistics.distribution import Distribution, count_poses, no_drops
from resting_aspects_ros.core.statistics.stopping import is_precise
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.run_description import RunDescription

# Finished distributions that are kept.
MAX_KNOWN = 10_000

Known = tuple[RunDescription, Distribution]


@dataclass
class RunCounts:
    """The distribution of one run so far; poses wait until the part's aspects are known.

    over : the run has ended
    problem : why it has not all drops of its run; empty if it has
    gap : drops in between are not there, so what was counted is the distribution of no run
    """

    run: RunDescription
    distribution: Distribution | None = None
    waiting: list[RestingPoses] = field(default_factory=list)
    over: bool = False
    problem: str = ''
    gap: bool = False

    @property
    def counted(self) -> Distribution:
        """The distribution; only after something was counted."""
        assert self.distribution is not None
        return self.distribution

    def count(self, aspects: AspectSet) -> None:
        """Count what waits."""
        total = self.distribution or no_drops(aspects, by_precision=self.run.precision > 0)
        for batch in self.waiting:
            total += count_poses(aspects, batch)
        self.distribution, self.waiting = total, []


class DistributionStore:
    """Finished distributions; of those that begin with the same drop the one with most drops.

    What is known, and what is answered of it, depends on the runs alone, not on the order in which
    they come: after a restart they come as their logs are read.

    Parameters
    ----------
    aspects_of : gives the aspects of a version of a part, by its part_sha256; None while it has
        not been described
    """

    def __init__(self, aspects_of: Callable[[str], AspectSet | None]) -> None:
        self._aspects_of = aspects_of
        self._known: dict[tuple[object, ...], Known] = {}  # by _key

    def add(self, run: RunDescription, distribution: Distribution) -> None:
        """Take the distribution of a run that is over.

        Raises InvalidValueError if it is not over the aspects that the part has.
        """
        if distribution.drops == 0:
            return  # it was canceled at once
        aspects = self._aspects_of(run.part_sha256)
        if aspects is not None and not aspects.is_like(distribution.aspects):
            raise InvalidValueError(
                f'run {run.run_id} counts other aspects than {run.part} has, allowed are its '
                f'{len(aspects)}'
            )
        key = _key(run)
        both = [self._known.pop(key, None), (run, distribution)]
        self._known[key] = max(filter(None, both), key=_most_drops)
        while len(self._known) > MAX_KNOWN:
            self._known.pop(next(iter(self._known)))

    def check(self, part_sha256: str) -> list[RunDescription]:
        """Forget what is not over the aspects of a part that is described now; the runs of it."""
        of_part = {k: v for k, v in self._known.items() if v[0].part_sha256 == part_sha256}
        aspects = self._aspects_of(part_sha256) if of_part else None
        if aspects is None:
            return []
        unlike = [k for k, (_, each) in of_part.items() if not aspects.is_like(each.aspects)]
        return [self._known.pop(key)[0] for key in unlike]

    def find(
        self,
        part_sha256: str,
        conditions: DropConditions,
        drops: int,
        precision: float,
        seed: int | None,
    ) -> Known | None:
        """The one with most drops, if it has at least those, or the precision, asked for.

        Of several the newest.

        A seed stands for its drops from the first on.
        """
        asked = part_sha256, conditions.values()
        if seed is None:
            known = [each for key, each in self._known.items() if key[:2] == asked]
        else:
            known = [self._known[key]] if (key := (*asked, seed, 0)) in self._known else []
        fitting = [
            (run, found)
            for run, found in known
            if found.drops >= drops
            or (precision and is_precise(found.counts, found.drops, precision))
        ]
        return max(fitting, key=_most_drops, default=None)

    def has_all(self, run: RunDescription) -> bool:
        """Whether all drops that were asked for in a run are known."""
        found = self._known.get(_key(run))
        return found is not None and found[0].run_id == run.run_id and found[1].drops >= run.drops

    def sha_of(self, name: str) -> str | None:
        """The newest version of a part of which a distribution is known."""
        of_name = (each for each in self._known.values() if each[0].part == name)
        newest = max(of_name, key=_newest, default=None)
        return newest[0].part_sha256 if newest else None

    def others(self, name: str, part_sha256: str, seed: int | None) -> list[str]:
        """What is known of parts of a name, and how it differs from that part; newest first.

        part_sha256 : str
            Empty: no version is known that counts.

        With a seed also how it differs from that one's drops from the first on.
        """
        of_name = [each for each in self._known.values() if each[0].part == name]
        of_name.sort(key=_newest, reverse=True)
        return [
            f'{found.drops} drops on {run.conditions.surface or "own conditions"}'
            + ('' if seed in (None, run.seed) else f' with seed {run.seed}')
            + ('' if seed is None or not run.first_drop else f' from drop {run.first_drop} on')
            + (
                ' of another version of the part'
                if part_sha256 not in ('', run.part_sha256)
                else ''
            )
            for run, found in of_name
        ]

    def __len__(self) -> int:
        """How many are known."""
        return len(self._known)

    def newest(self, part_sha256: str) -> Known | None:
        """That of the newest run of a part, under whatever conditions."""
        of_part = (each for each in self._known.values() if each[0].part_sha256 == part_sha256)
        return max(of_part, key=_newest, default=None)

    def has(self, part_sha256: str) -> bool:
        """Whether any is known of a part."""
        return any(run.part_sha256 == part_sha256 for run, _ in self._known.values())


def _key(run: RunDescription) -> tuple[object, ...]:
    return run.part_sha256, run.conditions.values(), run.seed, run.first_drop


def _newest(known: Known) -> tuple[int, str]:
    """Begun last; where clocks say the same the id decides, by which nothing else is tied."""
    return known[0].started, known[0].run_id


def _most_drops(known: Known) -> tuple[int, int, str]:
    return known[1].drops, *_newest(known)


def newest_distribution(
    known: DistributionStore, under_way: Iterable[RunCounts], part_sha256: str
) -> Distribution | None:
    """The newest of a part that is finished, else of its newest run that has counted a drop."""
    counted = [
        account.distribution
        for account in under_way
        if account.run.part_sha256 == part_sha256
        and account.distribution is not None
        and account.distribution.drops
    ]
    finished = known.newest(part_sha256)
    return finished[1] if finished else next(reversed(counted), None)

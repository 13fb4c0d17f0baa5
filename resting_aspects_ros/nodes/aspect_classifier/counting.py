"""Counts of drops by sequence, from resting_poses and from logs, and their model ranges."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg

from resting_aspects_ros.api.conditions import without_drops
from resting_aspects_ros.api.model_range import missing_in, model_range_of
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import start_task, subscribe
from resting_aspects_ros.ros.conversions import poses_from, run_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.goal_client import DropClient, goal_of_run
from resting_aspects_ros.ros.health import (
    Diagnosis,
    RateCounter,
    active_runs_text,
    count_text,
)
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, POSES, RESTING_POSES
from resting_aspects_ros.simulation.conditions import MAX_DROPS, DropConditions, Surfaces
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import (
    ContactCounts,
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.intervals import is_precise
from resting_aspects_ros.statistics.poses import IndexRanges, RestingPoses

if TYPE_CHECKING:
    from resting_aspects_ros.nodes.aspect_classifier.known import PartRegistry
    from resting_aspects_ros.nodes.aspect_classifier.publishers import DistributionPublisher

# Maximum number of tallies that are kept, and of those whose part has not been described.
MAX_KNOWN = 10_000
MAX_UNCOUNTED = 20


@dataclass(eq=False)
class Tally:
    """Consecutive drops of a part under some conditions and with a seed, of one or more runs.

    Drops are reproducible by their index. Therefore each index is counted once, whichever run it
    is of, and in ascending order. Drops after a gap wait until the missing ones have arrived.

    run : RunDescription
        The newest run that has contributed drops, with the range of the drops of all such runs.
    seen : IndexRanges
        The drops that have arrived.
    waiting : list of RestingPoses
        Those that are not counted yet.
    runs : dict
        Ids of the runs of which messages have arrived, and whether they have contributed drops.
    ended : bool
        Whether the run that was the last to begin has ended.
    heard : float
        Time of the last message, on the monotonic clock, s.
    awaits_range : bool
        Whether its model range is being found, before it is published as complete.
    """

    run: RunDescription
    distribution: Distribution | None = None
    seen: IndexRanges = field(default_factory=IndexRanges)
    waiting: list[RestingPoses] = field(default_factory=list)
    runs: dict[str, bool] = field(default_factory=dict)
    ended: bool = False
    heard: float = 0.0
    awaits_range: bool = False
    _current: str = ''  # the run that was the last to begin
    _counting: tuple[AspectSet, ContactCounts | None] | None = None

    def __post_init__(self) -> None:
        self.sequence = self.run.sequence()  # the same for all runs

    @classmethod
    def logged(cls, run: RunDescription, distribution: Distribution) -> 'Tally':
        """Return the tally of a distribution in a log."""
        tally = cls(run, distribution, runs={run.run_id: True}, ended=True)
        tally.seen.add(tally.first, tally.end)
        return tally

    @property
    def first(self) -> int:
        """Index of the first drop."""
        return self.run.first_drop

    @property
    def drops(self) -> int:
        """Number of drops that are counted."""
        return 0 if self.distribution is None else self.distribution.drops

    @property
    def end(self) -> int:
        """Index after the last drop that is counted."""
        return self.first + self.drops

    @property
    def counted(self) -> Distribution:
        """The distribution; valid after the aspects of the part are known."""
        assert self.distribution is not None
        return self.distribution

    @property
    def complete(self) -> bool:
        """Whether no more drops are expected."""
        return self.ended and not self.waiting

    def missing(self) -> list[tuple[int, int]]:
        """Return the ranges of drops before the last one that have not arrived."""
        return self.seen.missing(self.first, self.seen.end)

    @property
    def can_be_joined(self) -> bool:
        """Whether its counts can be added to those of another one: it has no contacts."""
        counted = self.distribution
        return counted is not None and counted.contacts is None and not self.waiting

    def add(self, run: RunDescription, poses: RestingPoses, *, last: bool) -> int:
        """Add a message with drops of a run; return the number of new ones."""
        self.heard = time.monotonic()
        new = self.seen.add(poses.first_drop, poses.end) if len(poses) else []
        if not self.runs.setdefault(run.run_id, False) and (new or len(self.runs) == 1):
            self._join(run)
        self.waiting += [poses.between(*each) for each in new]
        if last and run.run_id == self._current:
            self.ended = True
        return sum(end - first for first, end in new)

    def replace(self, logged: 'Tally') -> None:
        """Take the counts of a log, which has more drops."""
        self.run, self.distribution, self._counting = logged.run, logged.distribution, None
        self.runs |= logged.runs
        self.seen.add(logged.first, logged.end)
        self.waiting = [each.between(logged.end, each.end) for each in self.waiting]

    def append(self, logged: 'Tally') -> None:
        """Add the counts of a log that continues this one."""
        self._join(logged.run)
        self.runs |= logged.runs
        self.distribution, self.ended = self.counted + logged.counted, True
        self.seen.add(logged.first, logged.end)

    def _join(self, run: RunDescription) -> None:
        """Take drops of a further run."""
        self._current, self.ended = run.run_id, False
        if any(self.runs.values()):
            newest = max(run, self.run, key=lambda each: (each.started, each.run_id))
            self.run = dataclasses.replace(
                newest,
                first_drop=self.first,
                drops=min(max(run.end, self.run.end) - self.first, MAX_DROPS),
                precision=run.precision or self.run.precision,
            )
        self.runs[run.run_id] = True

    def count(self, part: Part, aspects: AspectSet) -> None:
        """Count the drops that continue those counted before, of a part with these aspects."""
        aspects, contacts = self._counting or self._begin(part, aspects)
        total = self.distribution or no_drops(aspects)
        waiting, end = [], self.end
        for block in RestingPoses.blocks(self.waiting):
            new = block.between(end, block.end)
            if block.first_drop > end:
                waiting.append(block)
            elif len(new):
                ids = aspect_ids(aspects, new)
                total += count_poses(aspects, new, ids)
                if contacts is not None:
                    contacts.add(new, ids)
                end = new.end
        if self.run.precision and not total.by_precision:
            total = dataclasses.replace(total, by_precision=True)
        if contacts is not None and total is not self.distribution:
            total = dataclasses.replace(total, contacts=contacts.counted)
        self.distribution = total
        self.waiting = waiting

    def _begin(self, part: Part, aspects: AspectSet) -> tuple[AspectSet, ContactCounts | None]:
        """Return the aspects by which drops are counted and the counter of their contacts.

        Poses cannot be classified with the aspects in a message or log: they are replaced.
        """
        self._counting = aspects, contacts = without_drops(part, self.run.conditions, aspects)
        if self.distribution is not None:
            logged = self.distribution.contacts
            if contacts is not None and logged is not None:
                contacts.placements = list(logged.placements)
                contacts.drops, contacts.uncounted = logged.drops, logged.uncounted
            self.distribution = dataclasses.replace(self.distribution, aspects=aspects)
        return self._counting

    def reaches(self, drops: int, precision: float) -> bool:
        """Return whether it has a number of drops, or a precision above 0."""
        if self.distribution is None or not self.drops:
            return False
        counts = self.distribution.counts
        return self.drops >= drops or bool(precision and is_precise(counts, self.drops, precision))


class Tallies:
    """All tallies; of each sequence of drops and first drop, the one with most drops.

    aspects_of : returns the aspects of a version of a part by its part_sha256, or None if it has
        not been described
    """

    def __init__(self, aspects_of: Callable[[str], AspectSet | None]) -> None:
        self._aspects_of = aspects_of
        self._all: list[Tally] = []

    def __len__(self) -> int:
        """Return the number of tallies with counted drops."""
        return sum(tally.drops > 0 for tally in self._all)

    def __iter__(self) -> Iterator[Tally]:
        return iter(list(self._all))

    def of_run(self, run: RunDescription) -> Tally:
        """Return the tally that the drops of a run belong to; a new one if they continue none."""
        continued = [
            tally
            for tally in self._of(run.sequence())
            if tally.first <= run.first_drop <= max(tally.end, tally.seen.end)
        ]
        known = [tally for tally in continued if run.run_id in tally.runs]
        for tally in known or continued:
            return tally
        return self._keep(Tally(run))

    def by_run(self, run_id: str) -> Tally | None:
        """Return the tally that has the drops of a run, or None."""
        return next((tally for tally in self._all if run_id in tally.runs), None)

    def _of(self, sequence: tuple[object, ...]) -> list[Tally]:
        return [tally for tally in self._all if tally.sequence == sequence]

    def _keep(self, tally: Tally) -> Tally:
        self._all = [*self._all, tally][-MAX_KNOWN:]
        uncounted = [each for each in self._all if each.distribution is None]
        for each in uncounted[:-MAX_UNCOUNTED]:
            self._all.remove(each)
        return tally

    def add(self, run: RunDescription, distribution: Distribution) -> None:
        """Add the distribution of a log, unless more drops of the same sequence are known.

        Raises InvalidValueError if its aspects are not those of the part.
        """
        if distribution.drops == 0:
            return  # it was canceled before the first drop
        logged = Tally.logged(run, distribution)
        if not self._is_consistent(logged):
            raise InvalidValueError(
                f'invalid distribution of run {run.run_id}: expected the aspects of {run.part}'
            )
        known = [each for each in self._of(logged.sequence) if each.first == logged.first]
        if not known:
            self._keep(logged)
        elif logged.drops > known[0].drops:
            known[0].replace(logged)
        self._join(logged.sequence)

    def _join(self, sequence: tuple[object, ...]) -> None:
        """Join the tallies of a sequence that continue each other."""
        joined: Tally | None = None
        for tally in sorted(self._of(sequence), key=lambda each: each.first):
            if not tally.can_be_joined:
                continue
            if joined is not None and tally.first == joined.end:
                joined.append(tally)
                self._all.remove(tally)
            elif joined is None or tally.end > joined.end:
                joined = tally

    def _is_consistent(self, tally: Tally) -> bool:
        """Return whether the aspects of a tally are those of its part, as far as it is known."""
        aspects, counted = self._aspects_of(tally.run.part_sha256), tally.distribution
        return aspects is None or counted is None or aspects.matches(counted.aspects)

    def remove_inconsistent(self, part_sha256: str) -> list[RunDescription]:
        """Remove the distributions over other aspects than those of a part; return their runs."""
        of_part = [each for each in self._all if each.run.part_sha256 == part_sha256]
        wrong = [tally for tally in of_part if not self._is_consistent(tally)]
        for tally in wrong:
            self._all.remove(tally)
        return [tally.run for tally in wrong]

    def find(
        self,
        part_sha256: str,
        conditions: DropConditions,
        drops: int,
        precision: float,
        seed: int | None,
    ) -> Tally | None:
        """Return the matching tally with the most drops; ties go to the newest run.

        A tally matches if it has at least the requested drops, or the requested precision. With a
        seed, only one of this seed matches that starts with drop 0.
        """
        requested = part_sha256, conditions.key()
        matching = [
            tally
            for tally in self._all
            if tally.sequence[:2] == requested
            and (seed is None or (tally.run.seed, tally.first) == (seed, 0))
            and tally.reaches(drops, precision)
        ]
        return max(matching, key=_most_drops, default=None)

    def newest(self, part_sha256: str, *, ended: bool = False) -> Tally | None:
        """Return the tally with most drops under the conditions of the newest run, or None.

        ended : whether only those count whose runs have ended
        """
        of_part = [
            tally
            for tally in self._all
            if tally.run.part_sha256 == part_sha256 and tally.drops and (tally.ended or not ended)
        ]
        if not of_part:
            return None
        key = max(of_part, key=_start_order).run.conditions.key()
        return max((each for each in of_part if each.run.conditions.key() == key), key=_most_drops)

    def sha_of(self, name: str) -> str:
        """Return the part_sha256 of the newest run of a part; empty without any."""
        named = [each for each in self._all if each.run.part == name and each.drops]
        newest = max(named, key=_start_order, default=None)
        return newest.run.part_sha256 if newest else ''


def _start_order(tally: Tally) -> tuple[int, str]:
    """Sort key by start time; equal times are ordered by run id, which is unique."""
    return tally.run.started, tally.run.run_id


def _most_drops(tally: Tally) -> tuple[int, int, str]:
    return tally.drops, *_start_order(tally)


@dataclass(eq=False)
class ModelRanges:
    """Adds the model range to distributions; a failure is logged, and the range is then missing.

    surfaces : with the uncertainty of their conditions, which no message has
    worker : makes the drops over this uncertainty
    """

    node: Node
    parts: 'PartRegistry'
    surfaces: Surfaces
    worker: FileWorker

    def __post_init__(self) -> None:
        self._active: dict[int, Future] = {}  # by the id of the distribution

    async def add(self, tally: Tally) -> None:
        """Add the range of the drops that are counted now, unless it is known."""
        given, run = tally.counted, tally.run
        missing = given.model is None and given.drops and not missing_in(run, self.surfaces)
        if not missing or self.parts.aspects(run.part_sha256) is None:
            return
        if (active := self._active.get(id(given))) is not None:
            await active
            return
        finished = self._active[id(given)] = Future(executor=self.node.executor)
        try:
            part, aspects = self.parts.version(run.part_sha256)
            whole = dataclasses.replace(given, aspects=aspects)  # those of a log lack directions
            found = await self.worker.run(model_range_of, whole, part, run, self.surfaces)
        except RestingAspectsError as error:
            self.node.get_logger().warning(
                f'the model range of run {run.run_id} is missing: {error}'
            )
            return
        finally:
            del self._active[id(given)]
            finished.set_result(None)
        if tally.distribution is given:
            # Only the range: the worker has copies of the aspects.
            tally.distribution = dataclasses.replace(given, model=found.model)


# Time without a message after which a run no longer counts as active, s.
IDLE = 60.0


@dataclass(eq=False)
class DropCounter:
    """Subscribes to resting_poses and counts the drops by aspect.

    When the last message of a run has arrived and drops are missing, they are requested again.

    drops : counter of the received drops
    """

    node: Node
    parts: 'PartRegistry'
    tallies: Tallies
    outputs: 'DistributionPublisher'
    client: DropClient
    ranges: ModelRanges

    def __post_init__(self) -> None:
        self.drops = RateCounter()
        subscribe(self.node, RestingPosesMsg, RESTING_POSES, self._receive, POSES)

    def part_changed(self, part_sha256: str) -> None:
        """Count the waiting drops of a part after its description was read."""
        for tally in self.tallies:
            if tally.run.part_sha256 == part_sha256 and tally.waiting:
                self._update(tally)

    def _receive(self, message: RestingPosesMsg) -> None:
        poses, run = poses_from(message), run_from(message.run)
        self.outputs.poses.take(run.run_id, poses, message.header.stamp)
        tally = self.tallies.of_run(run)
        self.drops.add(tally.add(run, poses, last=message.last))
        self._update(tally)
        if message.last and tally.missing():
            failure = 'missing drops are not requested'
            start_task(self.node, failure, self._request_again, tally, run)

    def _update(self, tally: Tally) -> None:
        """Count the waiting drops of a tally, if the aspects of its part are known."""
        if self.parts.aspects(tally.run.part_sha256) is None:
            return
        tally.count(*self.parts.version(tally.run.part_sha256))
        if not tally.complete:
            self.outputs.change(tally)
            return
        tally.awaits_range = True
        start_task(self.node, 'a distribution is missing', self._add_range, tally)

    async def _add_range(self, tally: Tally) -> None:
        """Publish the distribution of a run that has ended, with its model range."""
        try:
            await self.ranges.add(tally)
        finally:
            tally.awaits_range = False
        self.outputs.change(tally)
        self.outputs.publish()

    async def _request_again(self, tally: Tally, run: RunDescription) -> None:
        if not await self.client.request_again(goal_of_run(run), tally.missing):
            lost = sum(end - first for first, end in tally.missing())
            drops = count_text(lost, 'drop', 'drops')
            self.node.get_logger().warning(f'run {run.run_id} of {run.part} is missing {drops}')

    def diagnose(self) -> Diagnosis:
        """Return the progress of the active runs, and what is missing."""
        begin = time.monotonic() - IDLE
        active = [(t.run, t.drops) for t in self.tallies if not t.ended and t.heard > begin]
        waiting = sum(len(poses) for tally in self.tallies for poses in tally.waiting)
        missing = sum(end - first for tally in self.tallies for first, end in tally.missing())
        values = {
            'drops received': self.drops.total,
            'drops per second': self.drops.rate(),
            'drops not counted yet': waiting,
            'missing drops': missing,
            'active runs': len(active),
        }
        warnings = []
        if self.client.simulators.was_seen and self.client.source_is_gone:
            warnings.append(f'no {DROP_SIMULATOR}')
        if missing:
            warnings.append(count_text(missing, 'drop is missing', 'drops are missing'))
        return Diagnosis(active_runs_text(active), values, warnings)

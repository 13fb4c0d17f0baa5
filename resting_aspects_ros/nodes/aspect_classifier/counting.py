"""Counts of drops by sequence, from resting_poses and from logs, and their model ranges."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg

from resting_aspects_ros.api.conditions import surroundings_text, without_drops
from resting_aspects_ros.api.model_range import missing_in, model_range_of
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import sleep_for, start_task, subscribe
from resting_aspects_ros.ros.conversions import poses_from, run_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.goal_client import DropClient, goal_of_run
from resting_aspects_ros.ros.health import (
    RateCounter,
    active_runs_text,
    count_text,
    run_values,
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
    from resting_aspects_ros.nodes.aspect_classifier.known import LogLoader, PartRegistry
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
    ended : bool
        Whether the newest run has ended.
    heard : float
        Time of the last message, on the monotonic clock, s.
    awaits_range : bool
        Whether its model range is being found, before it is published as complete.
    """

    run: RunDescription
    distribution: Distribution | None = None
    seen: IndexRanges = field(default_factory=IndexRanges)
    waiting: list[RestingPoses] = field(default_factory=list)
    ended: bool = False
    heard: float = 0.0
    awaits_range: bool = False
    _runs: set[str] = field(default_factory=set)
    _current: str = ''  # the run that was joined last
    _contacts: ContactCounts | None = None

    @classmethod
    def logged(cls, run: RunDescription, distribution: Distribution) -> 'Tally':
        """Return the tally of a distribution in a log."""
        tally = cls(run, distribution, ended=True, _runs={run.run_id})
        tally.seen.add(run.first_drop, tally.end)
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

    @property
    def can_grow(self) -> bool:
        """Whether further drops can be counted; not if a log has its contacts with walls."""
        contacts = self.distribution.contacts if self.distribution is not None else None
        return contacts is None or self._contacts is not None

    @property
    def is_logged(self) -> bool:
        """Whether it has the counts of logs only, without contacts with walls."""
        counted = self.distribution
        return (
            counted is not None
            and counted.contacts is None
            and self._contacts is None
            and not self.waiting
        )

    def replace(self, logged: 'Tally') -> None:
        """Take the counts of a log, which has more drops."""
        self.run, self.distribution = logged.run, logged.distribution
        self.seen.add(logged.first, logged.end)
        self.waiting = [each.between(logged.end, each.end) for each in self.waiting]

    def append(self, logged: 'Tally') -> None:
        """Add the counts of a log that continues this one."""
        self._join(logged.run)
        self.distribution, self.ended = self.counted + logged.counted, True
        self.seen.add(logged.first, logged.end)

    def missing(self) -> list[tuple[int, int]]:
        """Return the ranges of drops before the last one that have not arrived."""
        return self.seen.missing(self.first, self.seen.end)

    def add(self, run: RunDescription, poses: RestingPoses, *, last: bool) -> int:
        """Add a message with drops of a run; return the number of new ones."""
        self.heard = time.monotonic()
        new = self.seen.add(poses.first_drop, poses.end) if len(poses) else []
        if run.run_id not in self._runs and (new or not self._runs):
            self._join(run)
        self.waiting += [poses.between(*each) for each in new]
        if last and run.run_id == self._current:
            self.ended = True
        return sum(end - first for first, end in new)

    def _join(self, run: RunDescription) -> None:
        """Take drops of a further run."""
        self._current, self.ended = run.run_id, False
        if self._runs:
            newest = max(run, self.run, key=lambda each: (each.started, each.run_id))
            self.run = dataclasses.replace(
                newest,
                first_drop=self.first,
                drops=min(max(run.end, self.run.end) - self.first, MAX_DROPS),
                precision=run.precision or self.run.precision,
            )
        self._runs.add(run.run_id)

    def count(self, part: Part, aspects: AspectSet) -> None:
        """Count the drops that continue those counted before, of a part with these aspects."""
        total = self.distribution
        if total is None:
            aspects, self._contacts = without_drops(part, self.run.conditions, aspects)
            total = no_drops(aspects)
        waiting, end = [], self.first + total.drops
        for block in RestingPoses.blocks(self.waiting):
            new = block.between(end, block.end)
            if block.first_drop > end:
                waiting.append(block)
            elif len(new):
                ids = aspect_ids(total.aspects, new)
                total += count_poses(total.aspects, new, ids)
                if self._contacts is not None:
                    self._contacts.add(new, ids)
                end = new.end
        if self.run.precision and not total.by_precision:
            total = dataclasses.replace(total, by_precision=True)
        if self._contacts is not None and total is not self.distribution:
            total = dataclasses.replace(total, contacts=self._contacts.counted)
        self.distribution = total
        self.waiting = waiting

    def reaches(self, drops: int, precision: float) -> bool:
        """Return whether it has a number of drops, or a precision above 0."""
        if self.distribution is None or not self.drops:
            return False
        counts = self.distribution.counts
        return self.drops >= drops or bool(precision and is_precise(counts, self.drops, precision))


class Tallies:
    """All tallies: of each sequence of drops, and of each first drop, the one with most drops.

    Parameters
    ----------
    aspects_of : returns the aspects of a version of a part by its part_sha256, or None if it has
        not been described
    """

    def __init__(self, aspects_of: Callable[[str], AspectSet | None]) -> None:
        self._aspects_of = aspects_of
        self._all: dict[tuple[object, ...], Tally] = {}  # by sequence and first drop
        self._by_run: dict[str, Tally] = {}

    def __len__(self) -> int:
        """Return the number of tallies with counted drops."""
        return sum(tally.drops > 0 for tally in self._all.values())

    def __iter__(self) -> Iterator[Tally]:
        return iter(list(self._all.values()))

    def of_run(self, run: RunDescription) -> Tally:
        """Return the tally of a run: one that its drops continue, else a new one.

        Raises InvalidValueError if another run with the same id is known.
        """
        known = self._by_run.get(run.run_id)
        if known is not None and known.run.sequence() != run.sequence():
            raise InvalidValueError(
                f'a message of run {run.run_id} describes another run than its earlier messages'
            )
        if known is None:
            known = self._continued(run)
            self._by_run[run.run_id] = known
            while len(self._by_run) > MAX_KNOWN:
                self._by_run.pop(next(iter(self._by_run)))
        return known

    def by_run(self, run_id: str) -> Tally | None:
        """Return the tally that has the drops of a run, or None."""
        return self._by_run.get(run_id)

    def _continued(self, run: RunDescription) -> Tally:
        for tally in self._all.values():
            if (
                tally.run.sequence() == run.sequence()
                and tally.first <= run.first_drop <= max(tally.end, tally.seen.end)
                and tally.can_grow
            ):
                return tally
        tally = Tally(run)
        self._keep(tally)
        return tally

    def _keep(self, tally: Tally) -> None:
        self._all[tally.run.sequence(), tally.first] = tally
        uncounted = [key for key, each in self._all.items() if each.distribution is None]
        for key in uncounted[:-MAX_UNCOUNTED]:
            del self._all[key]
        while len(self._all) > MAX_KNOWN:
            self._all.pop(next(iter(self._all)))

    def add(self, run: RunDescription, distribution: Distribution) -> None:
        """Add the distribution of a log, unless more drops of the same sequence are known.

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
        logged = Tally.logged(run, distribution)
        known = self._all.get((run.sequence(), run.first_drop))
        if known is None:
            self._keep(logged)
            known = logged
        elif _most_drops(logged) > _most_drops(known):
            known.replace(logged)
        self._by_run.setdefault(run.run_id, known)
        self._merge(known)

    def _merge(self, tally: Tally) -> None:
        """Join a tally of logs with those that it continues, or that continue it."""
        for other in list(self._all.values()):
            for one, next_one in ((other, tally), (tally, other)):
                if (
                    one.run.sequence() == next_one.run.sequence()
                    and one.drops
                    and one.end == next_one.first
                    and one.is_logged
                    and next_one.is_logged
                ):
                    one.append(next_one)
                    del self._all[next_one.run.sequence(), next_one.first]
                    self._by_run = {
                        run_id: one if each is next_one else each
                        for run_id, each in self._by_run.items()
                    }
                    self._merge(one)
                    return

    def remove_inconsistent(self, part_sha256: str) -> list[RunDescription]:
        """Remove the distributions over other aspects than those of a part; return their runs."""
        aspects = self._aspects_of(part_sha256)
        wrong = [
            key
            for key, tally in self._all.items()
            if aspects is not None
            and tally.run.part_sha256 == part_sha256
            and tally.distribution is not None
            and not aspects.matches(tally.distribution.aspects)
        ]
        return [self._all.pop(key).run for key in wrong]

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
        matching = [
            tally
            for tally in self._under(part_sha256, conditions)
            if (seed is None or (tally.run.seed, tally.first) == (seed, 0))
            and tally.reaches(drops, precision)
        ]
        return max(matching, key=_most_drops, default=None)

    def longest(
        self, part_sha256: str, conditions: DropConditions, seed: int, version: str
    ) -> Tally | None:
        """Return the tally of a seed and version of the suite that further drops can continue."""
        matching = [
            tally
            for tally in self._under(part_sha256, conditions)
            if (tally.run.seed, tally.first, tally.run.suite_version) == (seed, 0, version)
            and tally.drops
            and tally.can_grow
        ]
        return max(matching, key=_most_drops, default=None)

    def newest(self, part_sha256: str, *, ended: bool = False) -> Tally | None:
        """Return the tally with most drops under the conditions of the newest run, or None.

        ended : whether only those count whose runs have ended
        """
        of_part = [
            tally
            for tally in self._all.values()
            if tally.run.part_sha256 == part_sha256 and tally.drops and (tally.ended or not ended)
        ]
        newest = max(of_part, key=_start_order, default=None)
        if newest is None:
            return None
        key = newest.run.conditions.key()
        return max((each for each in of_part if each.run.conditions.key() == key), key=_most_drops)

    def _under(self, part_sha256: str, conditions: DropConditions) -> list[Tally]:
        requested = part_sha256, conditions.key()
        return [
            tally
            for tally in self._all.values()
            if (tally.run.part_sha256, tally.run.conditions.key()) == requested
        ]

    def sha_of(self, name: str) -> str | None:
        """Return the part_sha256 of the newest run of a part, or None."""
        newest = max(self._named(name), key=_start_order, default=None)
        return newest.run.part_sha256 if newest else None

    def _named(self, name: str) -> list[Tally]:
        return [each for each in self._all.values() if each.run.part == name and each.drops]

    def describe(self, name: str, part_sha256: str, seed: int | None) -> list[str]:
        """Return descriptions of the known distributions of a part name, newest run first.

        Each says how it differs from the requested version and seed.

        part_sha256 : str
            Requested version of the part; empty if no version is known.
        """
        return [
            f'{tally.drops} drops on {_conditions_text(tally.run.conditions)}'
            + ('' if seed in (None, tally.run.seed) else f' with seed {tally.run.seed}')
            + ('' if seed is None or not tally.first else f' from drop {tally.first} on')
            + (
                ' of another version of the part'
                if part_sha256 not in ('', tally.run.part_sha256)
                else ''
            )
            for tally in sorted(self._named(name), key=_start_order, reverse=True)
        ]

    def has(self, part_sha256: str) -> bool:
        """Return whether any distribution of a part is known."""
        return any(each.run.part_sha256 == part_sha256 and each.drops for each in self)


def _conditions_text(conditions: DropConditions) -> str:
    surface = conditions.surface or 'own conditions'
    around = conditions.surroundings
    return surface if around is None else f'{surface}, {surroundings_text(around)}'


def _start_order(tally: Tally) -> tuple[int, str]:
    """Sort key by start time; equal times are ordered by run id, which is unique."""
    return tally.run.started, tally.run.run_id


def _most_drops(tally: Tally) -> tuple[int, int, str]:
    return tally.drops, *_start_order(tally)


class ModelRanges:
    """Adds the model range to distributions; a failure is logged, and the range is then missing.

    Parameters
    ----------
    surfaces : with the uncertainty of their conditions, which no message has
    worker : makes the drops over this uncertainty
    """

    def __init__(
        self, node: Node, parts: 'PartRegistry', surfaces: Surfaces, worker: FileWorker
    ) -> None:
        self._node = node
        self._parts = parts
        self._surfaces = surfaces
        self._worker = worker
        self._active: dict[int, Future] = {}  # by the id of the distribution

    async def add(self, tally: Tally) -> None:
        """Add the range of the drops that are counted now, unless it is known."""
        given, run = tally.counted, tally.run
        missing = given.model is None and given.drops and not missing_in(run, self._surfaces)
        if not missing or self._parts.aspects(run.part_sha256) is None:
            return
        if (active := self._active.get(id(given))) is not None:
            await active
            return
        finished = self._active[id(given)] = Future(executor=self._node.executor)
        try:
            part, _ = self._parts.version(run.part_sha256)
            found = await self._worker.run(model_range_of, given, part, run, self._surfaces)
        except RestingAspectsError as error:
            self._node.get_logger().warning(
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
# Interval of checks whether the logs have been read, s.
LOGS_PERIOD = 0.5


class DropCounter:
    """Subscribes to resting_poses and counts the drops by aspect.

    When the last message of a run has arrived and drops are missing, they are requested again.

    drops : counter of the received drops

    Parameters
    ----------
    tallies : receives the drops
    outputs : publishes the distributions
    logs : of earlier runs, which may have drops whose messages were too old to arrive
    client : requests drops that are missing
    ranges : adds the model range at the end of a run
    """

    def __init__(
        self,
        node: Node,
        parts: 'PartRegistry',
        tallies: Tallies,
        outputs: 'DistributionPublisher',
        logs: 'LogLoader',
        client: DropClient,
        ranges: ModelRanges,
    ) -> None:
        self._node = node
        self._parts = parts
        self._ranges = ranges
        self._tallies = tallies
        self._outputs = outputs
        self._logs = logs
        self._client = client
        self._gone = False  # whether it was logged that the source of active runs is gone
        self.drops = RateCounter()
        subscribe(node, RestingPosesMsg, RESTING_POSES, self._receive, POSES)

    def part_changed(self, part_sha256: str) -> None:
        """Count the waiting drops of a part after its description was read."""
        for tally in self._tallies:
            if tally.run.part_sha256 == part_sha256 and tally.waiting:
                self._update(tally)

    def _receive(self, message: RestingPosesMsg) -> None:
        poses, run = poses_from(message), run_from(message.run)
        self._outputs.poses.take(run.run_id, poses, message.header.stamp)
        tally = self._tallies.of_run(run)
        self.drops.add(tally.add(run, poses, last=message.last))
        self._update(tally)
        if message.last and tally.missing():
            failure = 'missing drops are not requested'
            start_task(self._node, failure, self._request_again, tally, run)

    def _update(self, tally: Tally) -> None:
        """Count the waiting drops of a tally, if the aspects of its part are known."""
        if self._parts.aspects(tally.run.part_sha256) is None:
            return
        tally.count(*self._parts.version(tally.run.part_sha256))
        if not tally.complete:
            self._outputs.change(tally)
            return
        tally.awaits_range = True
        start_task(self._node, 'a distribution is missing', self._add_range, tally)

    async def _add_range(self, tally: Tally) -> None:
        """Publish the distribution of a run that has ended, with its model range."""
        try:
            await self._ranges.add(tally)
        finally:
            tally.awaits_range = False
        self._outputs.change(tally)
        self._outputs.publish()

    async def _request_again(self, tally: Tally, run: RunDescription) -> None:
        while not self._logs.ready:
            await sleep_for(self._node, LOGS_PERIOD)
        if not await self._client.request_again(goal_of_run(run), tally.missing):
            lost = sum(end - first for first, end in tally.missing())
            drops = count_text(lost, 'drop', 'drops')
            self._node.get_logger().warning(f'run {run.run_id} of {run.part} is missing {drops}')

    # Diagnostics

    @property
    def state(self) -> str:
        """The progress of the active runs as text; empty if there are none."""
        return active_runs_text(self._active())

    def _active(self) -> list[tuple[RunDescription, int]]:
        begin = time.monotonic() - IDLE
        return [(t.run, t.drops) for t in self._tallies if not t.ended and t.heard > begin]

    def _missing(self) -> int:
        return sum(end - first for tally in self._tallies for first, end in tally.missing())

    def values(self) -> dict[str, object]:
        """Return values for the diagnostics."""
        waiting = sum(len(poses) for tally in self._tallies for poses in tally.waiting)
        return {
            'drops received': self.drops.total,
            'drops per second': self.drops.rate(),
            'drops not counted yet': waiting,
            'missing drops': self._missing(),
            'drop_simulators': self._client.simulators.count,
            **run_values(self._active()),
        }

    def warnings(self) -> list[str]:
        """Return the current problems; logs once if the simulator disappears during a run."""
        gone = self._client.simulators.was_seen and self._client.source_is_gone
        if gone and self.state and not self._gone:
            self._node.get_logger().warning(f'{DROP_SIMULATOR} disappeared: {self.state}')
        self._gone = gone
        missing = self._missing()
        text = count_text(missing, 'drop is missing', 'drops are missing')
        return [f'no {DROP_SIMULATOR}'] * gone + [text] * bool(missing)

"""What is known of a part that a machine supplies: its counts, the simulation, and drift."""

from dataclasses import dataclass, field

import numpy as np

from resting_aspects_ros.api.counts import single_groups
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.count_conversions import time_label
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.counted_parts import (
    BatchSeries,
    CountSessions,
    LiveCounts,
    ObservedCounts,
)
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.drift import DriftTest, TooFewDropsError, parts_needed

Known = tuple[RunDescription, Distribution]


@dataclass(eq=False)
class LivePart:
    """A version of a part, and what has been counted of it.

    known : the run of the simulated drops and their distribution; None: no drops are known
    window : minimum number of parts in a window; 0 while it is not known
    tested : the test of the windows; None before the first full window
    problem : why the last message was refused; empty if it was not
    test_problem : why drift is not tested; empty if it is
    changed : whether there is something new to be published
    """

    part: Part
    aspects: AspectSet
    sessions: CountSessions
    batches: BatchSeries = field(default_factory=BatchSeries)
    window: int = 0
    known: Known | None = None
    tested: DriftTest | None = None
    problem: str = ''
    test_problem: str = ''
    changed: bool = False
    _attempted: int = 0  # number of parts in the windows that were tested last, or failed to be

    @classmethod
    def of(cls, part: Part, aspects: AspectSet) -> 'LivePart':
        """Return a part of which nothing has been counted."""
        return cls(part, aspects, CountSessions(len(aspects.classes())))

    @property
    def ids(self) -> tuple[int, ...]:
        """Numbers of the symmetry classes."""
        return tuple(members[0].symmetry_class for members in self.aspects.classes())

    @property
    def simulated(self) -> Counts:
        """(c,) simulated drops; one of each class if none are known, as a prior."""
        if self.known is None:
            return np.ones(len(self.ids), dtype=np.int64)
        return self.known[1].by_class().counts

    @property
    def can_drift(self) -> bool:
        """Whether there are drops to compare with, and more than one class."""
        return self.known is not None and len(self.ids) > 1 and bool(self.simulated.any())

    @property
    def is_tested(self) -> bool:
        """Whether all full windows have been tested; a test that failed is not repeated."""
        return self.batches.parts - self._attempted < max(self.window, 1)

    @property
    def is_drifting(self) -> bool:
        """Whether the newest parts deviate from the simulation."""
        if self.tested is None:
            return False
        drifted = self.tested.drifted
        return len(drifted) > 0 and drifted.stop == len(self.tested.windows)

    def live(self, weight: float) -> LiveCounts:
        """Return the counts with the simulation as the prior of a weight, in parts."""
        simulated = self.simulated
        if not simulated.any():  # no drop came to rest in an aspect
            simulated = np.ones_like(simulated)
        return LiveCounts(self.ids, simulated, self.sessions.supplied, weight)

    def follow(self, known: Known) -> None:
        """Compare the counts with other simulated drops from now on."""
        self.known, self.tested, self.test_problem, self.changed = known, None, '', True
        self._attempted = 0

    def observed(self) -> ObservedCounts:
        """Return the batches to be tested now, which do not change meanwhile."""
        found = self.batches.observed(single_groups(self.ids), time_label)
        self._attempted = int(found.windows(self.window)[1][-1])
        return found

    def add_test(self, test: DriftTest) -> None:
        """Take a test; further windows may have become full since it began."""
        self.tested, self.test_problem, self.changed = test, '', True


def default_window(simulated: Counts, level: float) -> int:
    """Return the number of parts that find a class that deviates by 5 points.

    It is the number of drops if these are too few for it, and grows with them. Runs in a
    FileWorker.
    """
    try:
        return parts_needed(simulated, level=level)
    except TooFewDropsError:
        return int(simulated.sum())

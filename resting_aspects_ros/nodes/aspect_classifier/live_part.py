"""What is known of a part that a machine supplies: its counts, the simulation, and drift."""

from dataclasses import dataclass, field

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.count_sessions import CountSessions, CountWindows
from resting_aspects_ros.core.statistics.drift import DriftTest, find_drift
from resting_aspects_ros.core.statistics.drift_power import (
    POWER,
    SHIFT,
    TooFewDropsError,
    parts_needed,
)
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, Counts
from resting_aspects_ros.core.statistics.live_counts import LiveCounts
from resting_aspects_ros.nodes.aspect_classifier.distribution_store import Known
from resting_aspects_ros.report.drift_table import DriftWindows
from resting_aspects_ros.ros.count_conversions import time_label

# Seed of the random tables of a drift test, as in api.drift: equal counts give equal p values.
SEED = 1


@dataclass(eq=False)
class LivePart:
    """A version of a part, and what has been counted of it.

    known : the run of the simulated drops and their distribution; None: no drops are known
    tested : the windows with their tests; None before the first full window
    problem : why the last message was refused, or why drift was not tested; empty if it was not
    changed : whether there is something new to be published
    """

    part: Part
    aspects: AspectSet
    sessions: CountSessions
    windows: CountWindows = field(default_factory=CountWindows)
    known: Known | None = None
    tested: DriftWindows | None = None
    problem: str = ''
    changed: bool = False

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
    def is_tested(self) -> bool:
        """Whether all full windows have been tested."""
        return self.tested is not None and self.tested.ends[-1] == self.windows.ends[-1]

    @property
    def can_drift(self) -> bool:
        """Whether there are drops to compare with, and more than one class."""
        return self.known is not None and len(self.ids) > 1 and bool(self.simulated.any())

    @property
    def is_drifting(self) -> bool:
        """Whether the newest parts deviate from the simulation."""
        if self.tested is None:
            return False
        drifted = self.tested.test.drifted
        return len(drifted) > 0 and drifted.stop == len(self.tested.test.windows)

    def live(self, weight: float) -> LiveCounts:
        """Return the counts with the simulation as the prior of a weight, in parts."""
        simulated = self.simulated
        if not simulated.any():  # no drop came to rest in an aspect
            simulated = np.ones_like(simulated)
        return LiveCounts(self.ids, simulated, self.sessions.supplied, weight)

    def with_test(self, test: DriftTest, weight: float) -> DriftWindows:
        """Return the first windows, which were tested, with their test."""
        count = len(test.windows)
        labels = [time_label(each.time) for each in self.windows.windows[:count]]
        ends = self.windows.ends[: count + 1]
        return DriftWindows(test, self.live(weight), ends, labels, CONFIDENCE, POWER)


def default_window(simulated: Counts, level: float) -> int:
    """Return the number of parts that find a class that is off by 5 points.

    It is the number of drops if these are too few for it. Runs in a FileWorker.
    """
    try:
        return parts_needed(simulated, SHIFT, level)
    except TooFewDropsError:
        return int(simulated.sum())


def test_windows(windows: Counts, simulated: Counts, level: float) -> DriftTest:
    """Return the tests of windows (w, c) against simulated drops (c,); runs in a FileWorker."""
    return find_drift(windows, simulated, np.random.default_rng(SEED), level)

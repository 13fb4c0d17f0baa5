"""What is known of a part that a machine supplies: its counts, the simulation, and drift."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.batch_scatter import batch_scatter
from resting_aspects_ros.core.statistics.count_sessions import (
    Batch,
    CountSessions,
    CountWindows,
    window_ends,
)
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
    problem : why the last message was refused; empty if it was not
    test_problem : why drift is not tested; empty if it is
    changed : whether there is something new to be published
    """

    part: Part
    aspects: AspectSet
    sessions: CountSessions
    windows: CountWindows = field(default_factory=CountWindows)
    known: Known | None = None
    tested: DriftWindows | None = None
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
    def is_tested(self) -> bool:
        """Whether all full windows have been tested; a test that failed is not repeated."""
        return self._attempted == self.windows.ends[-1]

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

    def follow(self, known: Known) -> None:
        """Compare the counts with other simulated drops from now on."""
        self.known, self.tested, self.test_problem, self.changed = known, None, '', True
        self._attempted = 0

    def windows_to_test(self) -> list[Batch]:
        """Return all full windows, which do not change while they are tested."""
        self._attempted = int(self.windows.ends[-1])
        return list(self.windows.windows)

    def add_test(self, test: DriftTest, windows: Sequence[Batch], weight: float) -> None:
        """Take the test of windows; others may have become full, or been joined, since then."""
        labels = [time_label(each.time) for each in windows]
        ends = window_ends(windows)
        self.tested = DriftWindows(test, self.live(weight), ends, labels, CONFIDENCE, POWER)
        self.test_problem, self.changed = '', True


def default_window(simulated: Counts, level: float) -> int:
    """Return the number of parts that find a class that deviates by 5 points.

    It is the number of drops if these are too few for it, and grows with them. Runs in a
    FileWorker.
    """
    try:
        return parts_needed(simulated, SHIFT, level)
    except TooFewDropsError:
        return int(simulated.sum())


def drift_test(
    windows: Counts, simulated: Counts, level: float, units: Sequence[Counts] = ()
) -> DriftTest:
    """Return the tests of windows (w, c) against simulated drops (c,); runs in a FileWorker.

    units : (c,) int
        Successive batches, from which their scatter is estimated.
    """
    scatter = batch_scatter(np.array(units, dtype=np.int64).reshape(-1, len(simulated)))
    return find_drift(windows, simulated, np.random.default_rng(SEED), level, scatter)

"""Counts of newly supplied parts: totals of counters, batches and windows, and their shares.

A counter reports the totals since the beginning of its session. So a lost or repeated report does
no harm, and a counter that is started again begins another session. The sessions are added up.

The shares of the symmetry classes have a Dirichlet distribution. The simulated drops are its
prior, with the weight of a limited number of drops: the simulation has a systematic error, which
more drops do not reduce.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    Interval,
    check_confidence,
    containing,
)

# Tolerance between the clocks of a counter and of the program that adds its totals, ns.
CLOCK_TOLERANCE = 500_000_000
MAX_TOTAL = 100_000_000
# Maximum number of sessions that can still be continued, and of actions.
MAX_SESSIONS, MAX_ACTIONS = 100, 20
MAX_NAME = 64
# In place of an action: newly supplied parts.
_SUPPLIED = '(supplied)'
# Maximum number of batches of a running machine; of more, neighbours are joined.
MAX_BATCHES = 1000

# The numbers of the symmetry classes of each group that is counted together, ascending.
Groups = tuple[tuple[int, ...], ...]
# The weight of the simulation in drops. In the comparison with measurements of
# docs/explanation/validation.md, the squared deviation of a simulated share p is 0.016 p (1 - p)
# on average, which is the variance of a share that is counted in 60 parts.
PRIOR_WEIGHT = 60.0
MAX_WEIGHT = 1e9


@dataclass(frozen=True, eq=False)
class Totals:
    """Totals of a session at a time.

    session : str
    time : int
        When the last part was counted, ns; 0: now.
    supplied : (c,) int
        Newly supplied parts by symmetry class; empty: as before.
    action : str
        Name of the action of ``moved``.
    moved : (c * c,) int
        Parts that were followed through the action, by the class before it and the class after
        it; empty: as before.
    """

    session: str
    time: int
    supplied: Counts
    action: str
    moved: Counts


class CountSessions:
    """The totals of all sessions.

    classes : int
        Number of symmetry classes of the part, c.
    """

    def __init__(self, classes: int) -> None:
        self._classes = classes
        # Time of the newest report of each session, and its totals by action; see _SUPPLIED.
        self._sessions: dict[str, tuple[int, dict[str, Counts]]] = {}
        self._totals = {_SUPPLIED: np.zeros(classes, dtype=np.int64)}

    @property
    def supplied(self) -> Counts:
        """Newly supplied parts by class, (c,)."""
        return self._totals[_SUPPLIED]

    @property
    def moved(self) -> dict[str, Counts]:
        """For each action, the parts that were followed through it, (c, c)."""
        c = self._classes
        return {k: n.reshape(c, c) for k, n in self._totals.items() if k != _SUPPLIED}

    @property
    def parts(self) -> int:
        """Number of newly supplied parts."""
        return int(self.supplied.sum())

    def add(self, totals: Totals, now: int) -> Counts:
        """Add what a report has counted since the last one; return the new supplied parts (c,).

        Raises InvalidValueError if the report is from the future, has another number of classes,
        or if a total has gone down; nothing is added then.
        """
        if totals.time > now + CLOCK_TOLERANCE:
            raise InvalidValueError(
                'invalid time of counts: expected none in the future; it is '
                f'{(totals.time - now) / 1e9:.1f} s ahead of the clock of this program'
            )
        c, time = self._classes, totals.time or now
        newest, known = self._sessions.get(totals.session, (0, {}))
        given = {_SUPPLIED: _checked('supplied', totals.supplied, c)}
        moved = _checked('moved', totals.moved, c * c)
        if moved.any() or (len(moved) and totals.action in known):
            self._check_action(totals.action)
            given[totals.action] = moved
        given = {action: counts for action, counts in given.items() if len(counts)}
        for action, counts in given.items():
            for place in np.flatnonzero(counts < known.get(action, 0))[:1].tolist():
                if time < newest:  # a later report of the session has arrived before
                    return np.zeros(c, dtype=np.int64)
                raise self._decreased(action, place, int(counts[place]), known[action][place])
        new = {action: counts - known.get(action, 0) for action, counts in given.items()}
        for action, counts in new.items():
            self._totals[action] = self._totals.get(action, 0) + counts
        self._sessions.pop(totals.session, None)
        self._sessions[totals.session] = max(time, newest), known | given
        while len(self._sessions) > MAX_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        return new.get(_SUPPLIED, np.zeros(c, dtype=np.int64))

    def _check_action(self, name: str) -> None:
        if not name.isidentifier() or len(name) > MAX_NAME:
            raise InvalidValueError(
                f'invalid action {shown(name)} of moved parts: expected the name of an action'
            )
        if name not in self._totals and len(self._totals) > MAX_ACTIONS:
            raise InvalidValueError(
                f'invalid action {shown(name)} of moved parts: expected at most {MAX_ACTIONS} '
                'actions'
            )

    def _decreased(self, action: str, place: int, count: int, before: int) -> InvalidValueError:
        where = f'in supplied of class {place + 1}'
        if action != _SUPPLIED:
            row, column = divmod(place, self._classes)
            where = f'in moved from class {row + 1} to class {column + 1}'
        return InvalidValueError(
            f'invalid count {count} {where}: expected {before} or more, because a total cannot go '
            'down; a counter that begins again at 0 must begin another session'
        )


class BatchSeries:
    """Successive batches of a machine that runs; of a long series, the oldest are joined in pairs.

    parts : int
        Number of all parts.
    """

    def __init__(self) -> None:
        self.parts = 0
        self._counts: list[Counts] = []
        self._times: list[int] = []

    def add(self, counts: Counts, time: int) -> None:
        """Add the parts of a batch by class, (c,), unless it is empty; ``time`` is in ns."""
        if not counts.any():
            return
        self.parts += int(counts.sum())
        self._counts.append(counts)
        self._times.append(time)
        if len(self._counts) > MAX_BATCHES:
            old = MAX_BATCHES // 2
            self._counts[:old] = [
                np.sum(self._counts[k : k + 2], axis=0) for k in range(0, old, 2)
            ]
            self._times[:old] = self._times[:old:2]

    def observed(self, groups: Groups, label: Callable[[int], str]) -> 'ObservedCounts':
        """Return the batches, of which ``label`` makes the labels from the times."""
        rows = np.array(self._counts, dtype=np.int64).reshape(-1, len(groups))
        return ObservedCounts.of_rows(rows, 'counts', groups, map(label, self._times))


@dataclass(frozen=True, eq=False)
class ObservedCounts:
    """Counts of parts in batches; a batch is the smallest set of parts whose order is unknown.

    source : str
        The file, or another name of the counts for messages.
    groups : tuple of tuples of int
        The c groups of symmetry classes that were counted together; most have one class.
    batch, place, count : (m,) int
        Index of the batch, not descending, index of the group, both from 0, and the number of
        parts.
    labels : tuple of str
        Batch or time of each batch as text; empty if not known.
    unclassified : int
        Number of further parts that were counted in no class.
    """

    source: str
    groups: Groups
    batch: Counts
    place: Counts
    count: Counts
    labels: tuple[str, ...] = ()
    unclassified: int = 0

    @classmethod
    def of_rows(
        cls, rows: Counts, source: str, groups: Groups, labels: Iterable[str] = ()
    ) -> 'ObservedCounts':
        """Return the counts of an array (b, c): a row for each batch, a column for each group."""
        batch, place = np.indices(rows.shape).reshape(2, -1)
        return cls(source, groups, batch, place, rows.ravel(), tuple(labels))

    @property
    def parts(self) -> int:
        """Number of parts that were counted in a class."""
        return int(self.count.sum())

    @property
    def totals(self) -> Counts:
        """All parts by group, (c,)."""
        totals = np.zeros(len(self.groups), dtype=np.int64)
        np.add.at(totals, self.place, self.count)
        return totals

    def grouped(self, into: Groups) -> 'ObservedCounts':
        """Return the counts with larger groups, each of which contains whole groups."""
        place = np.array(group_places(self.groups, into), dtype=np.int64)[self.place]
        return replace(self, groups=into, place=place)

    def windows(self, size: int) -> tuple[Counts, Counts, list[str]]:
        """Return disjoint windows of at least ``size`` parts, each of whole batches.

        Returns
        -------
        counts : (w, c) int
            Parts of each window by group. Parts at the end that do not fill a window are in none.
        ends : (w + 1,) int
            Number of parts before the first window, 0, and up to the end of each window.
        labels : list of str
            Label of the first batch of each window; empty without labels.
        """
        before = np.concatenate([[0], np.cumsum(np.bincount(self.batch, self.count))])
        before = before.astype(np.int64)
        edges = [0]
        while (end := int(np.searchsorted(before, before[edges[-1]] + size))) < len(before):
            edges.append(end)
        windows = np.zeros((len(edges), len(self.groups)), dtype=np.int64)
        window = np.searchsorted(edges, self.batch, side='right') - 1
        np.add.at(windows, (window, self.place), self.count)
        labels = [self.labels[k] for k in edges[:-1]] if self.labels else []
        return windows[:-1], before[edges], labels


def group_places(groups: Groups, into: Groups) -> list[int]:
    """Return for each group the index of the larger group that contains it."""
    return [next(k for k, each in enumerate(into) if group[0] in each) for group in groups]


def _checked(name: str, totals: Counts, length: int) -> Counts:
    """Return totals (length,), or (0,) as they are; raises InvalidValueError for any others."""
    if len(totals) not in (0, length):
        raise InvalidValueError(
            f'invalid number of counts {len(totals)} in {name}: expected {length}, or none'
        )
    if len(totals) and not 0 <= int(totals.max()) <= MAX_TOTAL:
        raise InvalidValueError(
            f'invalid count {int(totals.max())} in {name}: expected at most {MAX_TOTAL}'
        )
    return totals.astype(np.int64)


@dataclass(frozen=True, eq=False)
class LiveCounts:
    """Counted parts and simulated drops by symmetry class, and the distribution of the shares.

    ids : tuple of int
        Numbers of the c symmetry classes.
    simulated : (c,) int
        Simulated drops in each class, at least one in total.
    observed : (c,) int
        Newly supplied parts that were counted in each class; each part is counted once.
    weight : float
        Weight of the simulated drops together, in parts; above 0. It is never more than their
        number.
    """

    ids: tuple[int, ...]
    simulated: Counts
    observed: Counts
    weight: float = PRIOR_WEIGHT

    def __post_init__(self) -> None:
        number = isinstance(self.weight, int | float) and not isinstance(self.weight, bool)
        if not (number and 0 < self.weight <= MAX_WEIGHT):
            raise InvalidValueError(
                f'invalid prior weight {shown(self.weight)}: expected more than 0, at most '
                f'{MAX_WEIGHT:g}'
            )

    @property
    def parts(self) -> int:
        """Number of counted parts."""
        return int(self.observed.sum())

    @property
    def prior_weight(self) -> float:
        """Weight that the simulated drops have, in parts."""
        return float(min(self.weight, self.simulated.sum()))

    @property
    def concentration(self) -> Array:
        """(c,) parameters of the Dirichlet distribution of the shares.

        The prior has the shares of the simulation by Jeffreys' estimate, so that a class that was
        never simulated can still be counted.
        """
        prior = self.simulated + 0.5
        return np.asarray(prior / prior.sum() * self.prior_weight + self.observed)

    def intervals(self, confidence: float = CONFIDENCE) -> list[Interval]:
        """Return the mean share of each class, with its equal-tailed credible interval.

        That of a class that was never seen is extended to the mean, which is above it.
        """
        check_confidence(confidence)
        a = self.concentration
        b = a.sum() - a
        tail = (1 - confidence) / 2
        mean = a / a.sum()
        # The share of a class without any other one is 1.
        ends = [np.where(b > 0, betaincinv(a, b, q), 1.0) for q in (tail, 1 - tail)]
        lower, upper = containing(mean, *ends)
        rows = zip(mean.tolist(), lower.tolist(), upper.tolist(), strict=True)
        return [Interval(*row) for row in rows]

"""Totals of counted parts from one or several counters, and the windows in which drift is tested.

A counter reports the totals since the beginning of its session. So a lost or repeated report does
no harm, and a counter that is started again begins another session. The sessions are added up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.batch_scatter import Units
from resting_aspects_ros.core.statistics.intervals import Counts

# Tolerance between the clocks of a counter and of the program that adds its totals, ns.
CLOCK_TOLERANCE = 500_000_000
MAX_TOTAL = 100_000_000
# Maximum number of sessions that can still be continued, and of actions.
MAX_SESSIONS, MAX_ACTIONS = 100, 20
MAX_NAME = 64
# Maximum number of batches and of windows; of more, neighbours are joined.
MAX_BATCHES = 1000


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


@dataclass(frozen=True, eq=False)
class _Session:
    time: int
    supplied: Counts
    moved: dict[str, Counts]


class CountSessions:
    """The totals of all sessions.

    classes : int
        Number of symmetry classes of the part, c.

    Attributes
    ----------
    supplied : (c,) int
        Newly supplied parts by class.
    moved : dict of str to (c, c) int
        For each action, the parts that were followed through it.
    late : int
        Number of reports that arrived after a later one of their session; they are not needed.
    """

    def __init__(self, classes: int) -> None:
        self._classes = classes
        self._sessions: dict[str, _Session] = {}
        self.supplied: Counts = np.zeros(classes, dtype=np.int64)
        self.moved: dict[str, Counts] = {}
        self.late = 0

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
        count = self._classes
        supplied = _checked('supplied', totals.supplied, count)
        moved = _checked('moved', totals.moved, count * count)
        old = self._sessions.get(totals.session, _Session(0, np.zeros(count, dtype=np.int64), {}))
        none = np.zeros(count * count, dtype=np.int64)
        if moved.any():
            self._check_action(totals.action)
        before = old.moved.get(totals.action, none)
        time = totals.time or now
        try:
            new_supplied = _increase('supplied', supplied, old.supplied, self._class_text)
            new_moved = _increase('moved', moved, before, self._pair_text)
        except InvalidValueError:
            if time < old.time:
                self.late += 1
                return np.zeros(count, dtype=np.int64)
            raise
        actions = dict(old.moved)
        if moved.any():
            actions[totals.action] = before + new_moved
            known = self.moved.get(totals.action, none.reshape(count, count))
            self.moved[totals.action] = known + new_moved.reshape(count, count)
        self._sessions.pop(totals.session, None)
        self._sessions[totals.session] = _Session(
            max(time, old.time), old.supplied + new_supplied, actions
        )
        while len(self._sessions) > MAX_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        self.supplied = self.supplied + new_supplied
        return new_supplied

    def _check_action(self, name: str) -> None:
        if not name.isidentifier() or len(name) > MAX_NAME:
            raise InvalidValueError(
                f'invalid action {shown(name)} of moved parts: expected the name of an action'
            )
        if name not in self.moved and len(self.moved) >= MAX_ACTIONS:
            raise InvalidValueError(
                f'invalid action {shown(name)} of moved parts: expected at most {MAX_ACTIONS} '
                'actions'
            )

    def _class_text(self, place: int) -> str:
        return f'of class {place + 1}'

    def _pair_text(self, place: int) -> str:
        before, after = divmod(place, self._classes)
        return f'from class {before + 1} to class {after + 1}'


@dataclass(frozen=True, eq=False)
class Batch:
    """Parts whose order is not known.

    counts : (c,) int
    time : int
        When they were counted, ns.
    """

    counts: Counts
    time: int


class CountWindows:
    """Disjoint windows of successive parts, in whole batches.

    size : int
        Minimum number of parts in a window; 0 while it is not known.
    windows : list of Batch
        Full windows, each with the time of its first batch.
    units : Units
        Successive batches, from which their scatter is estimated.
    """

    def __init__(self) -> None:
        self.size = 0
        self.windows: list[Batch] = []
        self.units = Units()
        self._open: list[Batch] = []

    def add(self, counts: Counts, time: int) -> None:
        """Add a batch, unless it is empty."""
        if counts.any():
            self._open.append(Batch(counts, time))
            self.units.add(counts)
            self._fill()
            if len(self._open) > MAX_BATCHES:
                self._open = _joined(self._open)

    def resize(self, size: int) -> None:
        """Set the size; windows that are too small then are joined with those that follow."""
        if size > self.size:
            self._open, self.windows = [*self.windows, *self._open], []
        self.size = size
        self._fill()

    def _fill(self) -> None:
        """Make windows of the batches that are in none yet."""
        first = parts = 0
        for k, batch in enumerate(self._open if self.size else ()):
            parts += int(batch.counts.sum())
            if parts >= self.size:
                self.windows.append(_sum(self._open[first : k + 1]))
                first, parts = k + 1, 0
        del self._open[:first]
        if len(self.windows) > MAX_BATCHES:
            half = MAX_BATCHES // 2
            self.windows = [*_joined(self.windows[:half]), *self.windows[half:]]

    @property
    def ends(self) -> Counts:
        """(w + 1,) number of parts before the first window, 0, and up to the end of each."""
        return window_ends(self.windows)


def window_ends(windows: Sequence[Batch]) -> Counts:
    """Return (w + 1,) the number of parts before the first window, 0, and up to each end."""
    sizes = [int(each.counts.sum()) for each in windows]
    return np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])


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


def _increase(name: str, totals: Counts, before: Counts, text: Callable[[int], str]) -> Counts:
    """Return how much totals have grown; raises InvalidValueError if one has gone down."""
    if not len(totals):
        return np.zeros_like(before)
    for place in np.flatnonzero(totals < before)[:1].tolist():
        raise InvalidValueError(
            f'invalid count {int(totals[place])} in {name} {text(place)}: expected '
            f'{int(before[place])} or more, because a total cannot go down; a counter that begins '
            'again at 0 must begin another session'
        )
    return np.asarray(totals - before)


def _joined(batches: list[Batch]) -> list[Batch]:
    """Return batches of which neighbours are joined in pairs."""
    return [_sum(batches[k : k + 2]) for k in range(0, len(batches), 2)]


def _sum(batches: list[Batch]) -> Batch:
    return replace(batches[0], counts=np.sum([each.counts for each in batches], axis=0))

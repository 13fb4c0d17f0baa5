"""How far long work is, on standard error: a bar on a terminal, else a line a second."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
)

if TYPE_CHECKING:
    from resting_aspects_ros.nodes.replay import Position

LINE_PERIOD = 1.0


class DropProgress:
    """Shows drops done and drops per second; use it with `with`.

    done : how many drops are done
    """

    def __init__(self, what: str, total: int) -> None:
        self.done = 0
        self._what = what
        self._total = total
        self._begun = self._shown = time.monotonic()
        self._waited = False
        self._line = ''  # the last that was printed
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        if sys.stderr.isatty():
            self._bar = Progress(
                TextColumn('{task.description}', markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn('{task.fields[rate]}', markup=False),
                console=Console(stderr=True),
            )
            self._task = self._bar.add_task(what, total=total, rate='')

    def __enter__(self) -> 'DropProgress':  # noqa: PYI034 - Self is newer than Python 3.10
        if self._bar is not None:
            self._bar.start()
        return self

    def update(self, done: int) -> None:
        """So many drops are done. To be called often."""
        self.done = done
        self._waited = True
        now = time.monotonic()
        seconds = max(now - self._begun, 1e-9)
        rate = f'{done / seconds:.0f} drops/s' if done else ''
        if self._bar is not None and self._task is not None:
            if 0 < done < self._total:
                rate += f', {seconds * (self._total - done) / done:.0f} s left'
            self._bar.update(self._task, completed=done, rate=rate)
        elif now - self._shown >= LINE_PERIOD or done == self._total:
            line = f'{self._what}: {done} of {self._total} drops'
            if line != self._line:  # the rate alone is no news
                print(f'{line}  {rate}'.rstrip(), file=sys.stderr)
                self._line, self._shown = line, now

    def end(self, done: int) -> None:
        """No more drops come: those that are done are all. Nothing, if none were waited for."""
        if not self._waited:
            return
        self._total = done
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, total=done)
        self.update(done)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()


class ReplayProgress:
    """Shows how far a replay is, on a terminal only; use it with `with`."""

    def __init__(self) -> None:
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        if sys.stderr.isatty():
            self._bar = Progress(
                TextColumn('{task.description}', markup=False),
                BarColumn(),
                TextColumn('{task.fields[position]}', markup=False),
                console=Console(stderr=True),
            )

    def __enter__(self) -> 'ReplayProgress':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def update(self, position: 'Position') -> None:
        """It is so far. To be called often; the first time when the node has said what it is."""
        if self._bar is None:
            return
        if self._task is None:
            self._task = self._bar.add_task('', total=1.0, position='')
        self._bar.update(
            self._task,
            description='paused' if position.paused else 'replay',
            completed=1.0 if position.over else position.seconds / (position.length or 1.0),
            position=str(position),
        )
        self._bar.start()
        if position.over:
            self._bar.stop()
            self._bar = None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

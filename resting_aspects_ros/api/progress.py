"""Progress on standard error: a bar on a terminal, otherwise one line per second."""

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TypeVar

from rich.console import Console
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, TextColumn
from rich.progress import Progress as ProgressBar

Self = TypeVar('Self', bound='TerminalDisplay')  # typing.Self is newer than Python 3.10
LINE_PERIOD = 1.0  # s
# Whether progress is shown on standard error; or a function that is called often with the numbers
# done and in total.
Progress = bool | Callable[[int, int], None]


class TerminalDisplay:
    """Context manager of a moving display on standard error, which ends with it."""

    _moving: ProgressBar | Live | None = None  # None if standard error is not a terminal

    def __enter__(self: Self) -> Self:  # noqa: PYI019
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._moving is not None:
            self._moving.stop()


class ShownProgress(TerminalDisplay):
    """Progress bar on standard error; no bar if that is not a terminal."""

    def __init__(
        self, what: str, total: float, *columns: ProgressColumn, shown: bool = True
    ) -> None:
        self._bar: ProgressBar | None = None
        if shown and sys.stderr.isatty():
            text = TextColumn('{task.fields[text]}', markup=False)
            title = TextColumn('{task.description}', markup=False)
            console = Console(stderr=True)
            self._moving = self._bar = ProgressBar(
                title, BarColumn(), *columns, text, console=console
            )
            self._task = self._bar.add_task(what, total=total, text='')


class DropProgress(ShownProgress):
    """Progress display of drops and drops per second.

    unit : str
        What is counted: drops, or actions.
    done : int
        Drops made so far.
    shown : bool or callable
        False to count without display; a function is called instead of a display.
    """

    def __init__(
        self, what: str, total: int, unit: str = 'drops', *, shown: Progress = True
    ) -> None:
        self._visible = shown is True
        super().__init__(what, total, MofNCompleteColumn(), shown=self._visible)
        self._report = shown if callable(shown) else None
        self.done = 0
        self._what = what
        self._unit = unit
        self._total = total
        self._started = self._shown = time.monotonic()
        self._updated = False
        self._line = ''  # the last printed line

    def update(self, done: int) -> None:
        """Update the number of drops made."""
        self.done = done
        self._updated = True
        if self._report is not None:
            self._report(done, self._total)
        now = time.monotonic()
        seconds = max(now - self._started, 1e-9)
        rate = f'{_rate_text(done / seconds)} {self._unit}/s' if done else ''
        if self._bar is not None:
            if 0 < done < self._total:
                rate += f', {seconds * (self._total - done) / done:.0f} s left'
            self._bar.update(self._task, completed=done, total=self._total, text=rate)
            self._bar.start()
        elif self._visible and (now - self._shown >= LINE_PERIOD or done == self._total):
            line = f'{self._what}: {done} of {self._total} {self._unit}'
            if line != self._line:  # a new rate alone is not printed
                print(f'{line}  {rate}'.rstrip(), file=sys.stderr)
                self._line, self._shown = line, now

    def expect(self, total: int) -> None:
        """Change the number of drops that are expected."""
        self._total = max(total, self.done)

    def end(self, done: int) -> None:
        """Show ``done`` as the total of the finished run; does nothing if no update was shown."""
        if self._updated:
            self._total = done
            self.update(done)


def _rate_text(rate: float) -> str:
    """Return a rate with two digits, so that a slow one is not 0."""
    return f'{rate:.0f}' if rate >= 10 else f'{rate:.1f}' if rate >= 1 else f'{rate:.2g}'

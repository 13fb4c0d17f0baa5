"""The live table of the feeder demo on standard error; a few lines if that is no terminal."""

import sys
from types import TracebackType

from rich.console import Console
from rich.live import Live

from resting_aspects_ros.report.feeder_table import FeederView, feeder_line, feeder_table

# Number of lines for a run if standard error is no terminal.
LINES = 5


class FeederDisplay:
    """Shows the state of a feeder while it runs."""

    def __init__(self) -> None:
        self._live: Live | None = None
        if sys.stderr.isatty():
            self._live = Live(console=Console(stderr=True), auto_refresh=False)
        self._lines = 1

    def __enter__(self) -> 'FeederDisplay':  # noqa: PYI034 - Self is newer than Python 3.10
        if self._live is not None:
            self._live.start()
        return self

    def show(self, view: FeederView) -> None:
        """Update what is shown; call it often."""
        if self._live is not None:
            self._live.update(feeder_table(view), refresh=True)
        elif view.minutes * LINES >= self._lines * view.total:
            self._lines = int(view.minutes * LINES / view.total) + 1
            print(feeder_line(view), file=sys.stderr, flush=True)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

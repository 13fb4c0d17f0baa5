"""The live table of the feeder demo on standard error, or a few lines if that is not a terminal.

A demo that makes no progress ends with an error.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live

from resting_aspects_ros.api.progress import TerminalDisplay
from resting_aspects_ros.cli.node_processes import log_of
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.report.forecast import FeederView, feeder_line, feeder_table

if TYPE_CHECKING:
    from resting_aspects_ros.client.feeder_watch import FeederWatch

# Number of lines for a run if standard error is not a terminal.
LINES = 5
# Maximum real time without progress in the run, s: the model of a part with very many triangles
# takes a minute.
MAX_SILENCE = 120.0


class FeederDisplay(TerminalDisplay):
    """Shows the state of a feeder while it runs."""

    def __init__(self) -> None:
        self._live: Live | None = None
        if sys.stderr.isatty():
            self._moving = self._live = Live(console=Console(stderr=True), auto_refresh=False)
        self._lines = 1

    def show(self, view: FeederView) -> None:
        """Update what is shown; call it often."""
        if self._live is not None:
            self._live.start()
            self._live.update(feeder_table(view), refresh=True)
        elif view.minutes * LINES >= self._lines * view.total:
            self._lines = int(view.minutes * LINES / view.total) + 1
            print(feeder_line(view), file=sys.stderr, flush=True)


def check_silence(watch: 'FeederWatch', folder: Path) -> None:
    """Raise RestingAspectsError if simulated time has stood still for too long."""
    if watch.silence > MAX_SILENCE:
        node, missing = watch.silent
        raise RestingAspectsError(
            f'{node} is silent: no {missing} for {MAX_SILENCE:g} s; see '
            f'{str(log_of(folder, node))!r}'
        )

"""How the feeder demo is watched: a live table on standard error, and a layout for Foxglove.

A demo that makes no progress ends with an error.
"""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.live import Live

from resting_aspects_ros.api.result import whole_file
from resting_aspects_ros.api.runner import TerminalDisplay
from resting_aspects_ros.cli.node_processes import log_of
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.report.forecast import FeederView, feeder_line, feeder_table
from resting_aspects_ros.simulation.conditions import config_folder

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


# The part and the topics of the shipped layout; topics outside the namespace remain.
SHIPPED_PART, GLOBAL = 'l_bracket', ('/diagnostics',)


def save_layout(path: Path, part: str, namespace: str) -> str:
    """Write the layout, and return how to watch the nodes."""
    with whole_file(path) as file:
        file.write_text(foxglove_layout(part, namespace), encoding='utf-8')
    return (
        f'To watch it: the layout {path} for Foxglove, or '
        f'rviz2 -d rviz/feeder.rviz --ros-args -r __ns:={namespace}'
    )


def foxglove_layout(part: str, namespace: str = '/') -> str:
    """Return the shipped layout as JSON, with its topics for a part and a namespace."""
    text = (config_folder() / 'foxglove' / 'feeder.json').read_text(encoding='utf-8')
    prefix = '/' + namespace.strip('/') if namespace.strip('/') else ''

    def changed(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: changed(each) for key, each in value.items()}
        if isinstance(value, list):
            return [changed(each) for each in value]
        if not isinstance(value, str) or not value.startswith('/') or value in GLOBAL:
            return value
        topic, dot, field = value.partition('.')
        head, slash, name = topic.rpartition('/')
        topic = f'{head}{slash}{part}' if name == SHIPPED_PART else topic
        return f'{prefix}{topic}{dot}{field}'

    return json.dumps(changed(json.loads(text)), indent=2) + '\n'

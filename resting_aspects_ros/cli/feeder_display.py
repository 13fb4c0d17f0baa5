"""How the feeder demo is watched: a live table, its sentences, and a layout for Foxglove.

A demo that makes no progress ends with an error.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from resting_aspects_ros.cli.life_cycle import save_text
from resting_aspects_ros.cli.node_processes import log_of
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.report.format import minutes_text, number_text
from resting_aspects_ros.system import config_folder

if TYPE_CHECKING:
    from resting_aspects_ros.client.feeder_watch import FeederWatch
    from resting_aspects_ros.feeding.tray_simulation import ControlledRuns


# Number of lines for a run if standard error is not a terminal.
LINES = 5
# Maximum real time without progress in the run, s: the model of a part with very many triangles
# takes a minute.
MAX_SILENCE = 120.0


# What a run that agrees with its forecast proves, and what it does not.
SHARED = (
    'The run draws its drops and flips from the probabilities of the forecast, mixes the parts '
    'in each flip, and places them without overlap. Agreement shows that images, identification, '
    'decisions and messages work as the forecast assumes. It does not show that a machine does.'
)


@dataclass(frozen=True)
class FeederView:
    """What was counted of a feeder, beside the forecast of a run of ``total`` minutes."""

    watch: 'FeederWatch'
    forecast: 'ControlledRuns'
    total: float

    @property
    def time(self) -> str:
        """Simulated time as minutes and seconds."""
        return '{}:{:02d}'.format(*divmod(round(60 * self.watch.minutes), 60))

    @property
    def forecast_text(self) -> str:
        """The forecast with its interval."""
        lower, upper = map(number_text, self.forecast.prediction)
        return f'{number_text(self.forecast.rate)} ({lower} to {upper})'


def feeder_table(view: FeederView) -> Table:
    """Return the table of a running feeder."""
    watch = view.watch
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style='dim', no_wrap=True)
    table.add_column()
    rows = {
        'simulated time': f'{view.time} of {view.total:g} min',
        'parts in the image': str(watch.on_tray),
        'advice': watch.advice.reason if watch.advice is not None else '',
        'images, flips': f'{watch.images}, {watch.choices["flip"]}',
        'picks': f'{watch.picks}' + (f' ({watch.missed} missed)' if watch.missed else ''),
        'parts per minute': number_text(watch.rate),
        'forecast': f'{view.forecast_text}, 95 % of runs of {view.total:g} min',
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def feeder_line(view: FeederView) -> str:
    """Return the state of a running feeder in a line, for a log."""
    watch = view.watch
    return (
        f'{view.time} of {view.total:g} min: {watch.picks} picks, {number_text(watch.rate)} per '
        f'minute (forecast {view.forecast_text})'
    )


def feeder_sentence(view: FeederView, seconds: float) -> str:
    """Return what a run has shown, in plain sentences.

    seconds : real duration
    """
    watch, rate, (lower, upper) = view.watch, view.forecast.rate, view.forecast.prediction
    text = (
        f'In {view.time} minutes of simulated time, which took {seconds:.0f} s, the robot picked '
        f'{watch.picks} parts: {number_text(watch.rate)} per minute. The forecast is '
        f'{number_text(rate)}, and {number_text(lower)} to {number_text(upper)} for 95 % '
        f'of the runs of {minutes_text(view.total)}'
    )
    if watch.minutes < view.total:
        return f'{text}; this run was shorter.'
    inside = lower <= watch.rate <= upper
    return f'{text}; this run lies {"within" if inside else "outside"} that interval.\n{SHARED}'


class FeederDisplay:
    """Context manager that shows the state of a feeder while it runs."""

    def __init__(self) -> None:
        self._live: Live | None = None
        if sys.stderr.isatty():
            self._live = Live(console=Console(stderr=True), auto_refresh=False)
        self._lines = 1

    def __enter__(self) -> 'FeederDisplay':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, view: FeederView) -> None:
        """Update what is shown; call it often."""
        if self._live is not None:
            self._live.start()
            self._live.update(feeder_table(view), refresh=True)
        elif view.watch.minutes * LINES >= self._lines * view.total:
            self._lines = int(view.watch.minutes * LINES / view.total) + 1
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
    save_text(path, foxglove_layout(part, namespace))
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

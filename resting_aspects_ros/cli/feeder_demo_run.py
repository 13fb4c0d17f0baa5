"""What `resting_aspects feeder_demo` was asked for, and its run: nodes, forecast and results."""

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.forecast import (
    DEFAULT_ACTION,
    check_tray,
    cycle_times,
    forecast_controlled,
    forecast_from,
)
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.api.result import whole_file
from resting_aspects_ros.api.runner import DropProgress
from resting_aspects_ros.cli.console import make_console
from resting_aspects_ros.cli.feeder_display import (
    FeederDisplay,
    FeederView,
    check_silence,
    feeder_sentence,
    save_layout,
)
from resting_aspects_ros.cli.life_cycle import save_text
from resting_aspects_ros.cli.node_processes import NodeProcesses, own_namespace
from resting_aspects_ros.cli.options import parse_numbers
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.feeding.tray_simulation import ControlledRuns
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.part.library import load_part
from resting_aspects_ros.report.document import SCHEMA_VERSION
from resting_aspects_ros.report.document import to_json as json_text
from resting_aspects_ros.report.forecast import controlled_fields, controlled_text
from resting_aspects_ros.report.outlines import DrawnPart, save_tray_picture
from resting_aspects_ros.vision.rolling import KnownPart
from resting_aspects_ros.vision.tray_image import TrayCamera

if TYPE_CHECKING:
    from resting_aspects_ros.client.feeder_watch import FeederWatch, Moment

# Of the camera.
PX_PER_MM = 5.0
MAX_MINUTES = 10_000
# Of the picks: feeder_controller, drop_recorder and the command. The run begins when all of them
# are connected, so that each of them receives all picks, however busy the machine is.
SUBSCRIBERS = 3
# Nodes that make the drops and the flips. The others begin with them.
SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')


@dataclass(frozen=True, eq=False)
class PlannedDemo:
    """What a demo was asked for.

    classes : tuple of int
        Numbers of the pickable classes.
    default : bool
        Whether they were chosen here.
    """

    arguments: argparse.Namespace
    known: KnownPart
    classes: tuple[int, ...]
    default: bool
    tray: Tray
    times: CycleTimes
    minutes: float
    drops: int
    per_aspect: int

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the pickable aspects."""
        return self.known.aspects.chosen(None, self.classes, 'pickable')

    @property
    def pickable_text(self) -> str:
        """Which aspects can be picked, as a sentence."""
        ids, name = ', '.join(map(str, self.ids)), self.known.part.name
        aspects = f'aspect{"s" if len(self.ids) > 1 else ""} {ids}'
        if not self.default:
            return f'The robot picks {name} in {aspects}.'
        share = self.known.shares[self.classes[0] - 1]
        return (
            f'The robot picks {name} in {aspects}, the most probable class '
            f'({100 * share:.0f} %); choose others with --pickable.'
        )

    def node_arguments(self, clock: str, logs: Path) -> dict[str, list[str]]:
        """Return the ROS arguments of each node of the demo.

        clock : topic of the simulated time
        logs : folder of the logs
        """
        cell = {
            'part': self.known.part.name,
            'tray': [float(side) for side in self.tray.size],
            'action': DEFAULT_ACTION,
            **{
                f'{name}_time': float(getattr(self.times, name))
                for name in ('robot', 'place', 'vibrate', 'settle', 'image', 'supply')
            },
        }
        controller = {
            **cell,
            'pickable_classes': list(self.classes),
            'clearance': float(self.tray.clearance),
            'best_number': self.arguments.parts_on_tray or 0,
            'max_picks': self.arguments.max_picks or 0,
        }
        camera = {
            **cell,
            'px_per_mm': PX_PER_MM,
            'seed': self.arguments.seed,
            'evidence': True,
            'subscribers': SUBSCRIBERS,
            'speed': 1.0 if self.arguments.real_time else 0.0,
        }
        simulated = ['-p', 'use_sim_time:=true', '-r', f'/clock:={clock}']
        parts = self.arguments.parts
        folder = [] if parts is None else ['-p', f'parts_folder:={parts}']
        return {
            'drop_simulator': folder,
            # Without logs, a second demo makes its drops again.
            'aspect_classifier': ['-p', "log_folder:=''"],
            'drop_recorder': ['-p', f'log_folder:={logs}'],
            'feeder_controller': [*simulated, *_values(controller)],
            'vision_example': [*simulated, '-p', f'part:={self.known.part.name}'],
            'camera_simulator': ['-r', f'/clock:={clock}', *_values(camera)],
        }


def planned_demo(
    arguments: argparse.Namespace,
    size: tuple[float, float],
    given_times: Mapping[str, Any],
    drops: int,
    per_aspect: int,
) -> PlannedDemo:
    """Return what the flags request; raises RestingAspectsError for wrong input.

    Parameters
    ----------
    size : (float, float)
        Width and depth of the tray, m.
    given_times : mapping
        Options of `cycle_times`.
    drops, per_aspect : int
        Number of drops, and of flips from each aspect.
    """
    known = known_part(load_part(arguments.part, None, arguments.parts, None))
    classes, default = _pickable(arguments, known)
    times = cycle_times(named_action(DEFAULT_ACTION), **given_times)
    clearance = parse_quantity('--clearance', arguments.clearance, 'm')
    tray = Tray(size, clearance)
    minutes = parse_quantity('--minutes', arguments.minutes, '')
    if not 0 < minutes <= MAX_MINUTES:
        raise InvalidValueError(
            f'invalid --minutes {minutes:g}: expected more than 0, at most {MAX_MINUTES}'
        )
    check_tray(known.part, known.aspects, tray, arguments.parts_on_tray)
    TrayCamera(tray.size, PX_PER_MM)
    return PlannedDemo(arguments, known, classes, default, tray, times, minutes, drops, per_aspect)


def _pickable(arguments: argparse.Namespace, known: KnownPart) -> tuple[tuple[int, ...], bool]:
    """Return the numbers of the pickable classes, and whether they are the default."""
    classes = known.aspects.classes()
    if arguments.pickable_classes is not None:
        numbers = parse_numbers('--pickable-classes', arguments.pickable_classes)
        known.aspects.chosen(None, numbers, 'pickable')
        return tuple(sorted(set(numbers))), False
    if arguments.pickable is None:
        return (int(np.argmax(known.shares)) + 1,), True
    ids = parse_numbers('--pickable', arguments.pickable)
    given = set(known.aspects.chosen(ids, None, 'pickable'))
    members = [{aspect.id for aspect in each} for each in classes]
    return tuple(k for k, each in enumerate(members, start=1) if each & given), False


def _values(parameters: dict[str, Any]) -> list[str]:
    texts = {
        name: str(value).lower() if isinstance(value, bool) else str(value)
        for name, value in parameters.items()
    }
    return [word for name, text in texts.items() for word in ('-p', f'{name}:={text}')]


# -- The run --------------------------------------------------------------------------------------

# Maximum time for the drops and for the flips, s.
TIMEOUT = 3600.0
# Maximum time between two checks for Ctrl-C and ended nodes, s.
SPIN_PERIOD = 0.1
# For messages of the last cycle that are still on their way, s.
REST = 0.3


class FeederDemo:
    """The nodes of a demo, and what they have done.

    Parameters
    ----------
    plan : PlannedDemo
    out : Path
    check : raises KeyboardInterrupt after Ctrl-C
    """

    def __init__(self, plan: PlannedDemo, out: Path, check: Callable[[], None]) -> None:
        self._plan, self._out, self._check = plan, out, check
        self._forecast: ControlledRuns | None = None
        self._watch: FeederWatch | None = None
        self._seconds = 0.0
        self._earlier = set(self._logs())

    @property
    def has_begun(self) -> bool:
        """Whether there is something of a run to be saved."""
        return self._watch is not None

    def run(self, layout: Path) -> None:
        """Run the nodes until the simulated time is over; write the layout of their topics."""
        name = own_namespace('feeder_demo')
        namespace = ['-r', f'__ns:={name}']
        _say(self._plan.pickable_text)
        nodes = self._plan.node_arguments(f'{name}/clock', self._out / 'logs')
        _say(f'Starting {len(nodes)} nodes in the namespace {name} ...')
        watching = save_layout(layout, self._plan.known.part.name, name)
        if self._plan.arguments.real_time:
            _say(watching)
        with NodeProcesses(self._out) as processes:

            def check() -> None:
                self._check()
                processes.check()

            def start(names: Iterable[str]) -> None:
                for node in names:
                    processes.start(node, [*namespace, *nodes[node]])
                processes.wait_until_ready(check)

            start(SUITE)
            self._forecast = self._ask(namespace, check)
            start(node for node in nodes if node not in SUITE)
            _say(f'Forecast {controlled_text(self._forecast)}.')
            self._follow(namespace, check)

    def save(self, document: Path, picture: Path) -> str:
        """Write what was found, print a summary, and return the document."""
        watch, forecast, plan = self._watch, self._forecast, self._plan
        found: dict[str, Any] = {
            'schema_version': SCHEMA_VERSION,
            'part': plan.known.part.name,
            'pickable': list(plan.ids),
            'pickable_classes': list(plan.classes),
            'seed': plan.arguments.seed,
            'complete': watch is not None and watch.done.done(),
        }
        if forecast is not None:
            found['forecast'] = controlled_fields(forecast)
        if watch is not None:
            found['run'] = {**watch.fields(), 'real_seconds': self._seconds}
        text = json_text(found)
        save_text(document, text)
        written = [document]
        if watch is not None and watch.best is not None:
            with whole_file(picture) as file:
                self._draw(watch.best, file)
            written.append(picture)
        if watch is not None and forecast is not None and watch.images:
            _say(feeder_sentence(FeederView(watch, forecast, plan.minutes), self._seconds))
        written += sorted(set(self._logs()) - self._earlier)
        _say('Written: ' + ', '.join(str(path) for path in written))
        return text

    def _logs(self) -> Iterator[Path]:
        return (self._out / 'logs').glob('*/*.mcap')

    def _ask(self, namespace: list[str], check: Callable[[], None]) -> ControlledRuns:
        """Request drops and flips, and forecast runs of the controller from them."""
        from resting_aspects_ros.client.client import RestingAspectsClient
        from resting_aspects_ros.ros.conversions import run_from
        from resting_aspects_ros.ros.distribution_conversions import (
            action_from,
            distribution_from,
            transition_matrix_from,
        )

        plan, name = self._plan, self._plan.known.part.name
        flips = plan.per_aspect * len(plan.known.aspects)
        with RestingAspectsClient(ros_args=namespace, check=check) as client:
            with DropProgress(name, plan.drops) as progress:
                drops = client.get_distribution(
                    name,
                    drops=plan.drops,
                    seed=plan.arguments.seed,
                    timeout=TIMEOUT,
                    progress=progress.update,
                )
            with DropProgress(name, flips, 'flips') as progress:
                found = client.reorient_part(
                    name,
                    DEFAULT_ACTION,
                    plan.per_aspect,
                    drops=plan.drops,
                    seed=plan.arguments.seed,
                    timeout=TIMEOUT,
                    progress=progress.update,
                )
        result = ReorientResult(
            transition_matrix_from(found),
            action_from(found.action),
            run_from(found.run),
            plan.known.part,
            distribution_from(drops),
            complete=True,
        )
        forecast = forecast_from(
            result,
            plan.ids,
            plan.tray,
            plan.times,
            parts_on_tray=plan.arguments.parts_on_tray,
            max_picks=plan.arguments.max_picks,
            minutes=plan.minutes,
        )
        return forecast_controlled(forecast)

    def _follow(self, namespace: list[str], check: Callable[[], None]) -> None:
        """Show the run until its time is over."""
        from resting_aspects_ros.client.feeder_watch import FeederWatch, spun_node

        plan, forecast = self._plan, self._forecast
        assert forecast is not None
        begin = time.monotonic()
        with FeederDisplay() as display:

            def refresh() -> None:
                check()
                self._seconds = time.monotonic() - begin
                if self._watch is None:
                    return
                self._watch.connect()
                check_silence(self._watch, self._out)
                if self._watch.images:
                    display.show(FeederView(self._watch, forecast, plan.minutes))

            with spun_node(namespace) as (node, executor):
                watch = self._watch = FeederWatch(node, plan.known.part.name, plan.minutes)
                while not watch.done.done():
                    refresh()
                    executor.spin_once(SPIN_PERIOD)
                end = time.monotonic() + REST
                while (left := end - time.monotonic()) > 0:
                    executor.spin_once(left)
                refresh()

    def _draw(self, moment: 'Moment', path: Path) -> None:
        """Write the picture of a moment."""
        plan, advice, image = self._plan, moment.advice, moment.image
        ranks = {pick.detection: k for k, pick in enumerate(advice.picks, start=1)}
        parts = [
            DrawnPart(int(each.class_id or 0), each.x, each.y, each.yaw, ranks.get(k, 0))
            for k, each in enumerate(moment.detections.detections)
        ]
        save_tray_picture(
            path,
            np.frombuffer(image.data, np.uint8).reshape(image.height, image.width),
            TrayCamera(plan.tray.size, PX_PER_MM),
            parts,
            plan.known.outlines,
            f'Image {advice.image} of {plan.known.part.name}: '
            + (f'pick {len(ranks)} of {len(parts)}' if ranks else 'no pick'),
            advice.reason,
            plan.classes,
        )


def _say(text: str) -> None:
    """Print to standard error, which leaves standard output to the JSON document."""
    console = make_console()
    console.file = sys.stderr
    console.print(text, markup=False, highlight=False, soft_wrap=True)

"""`resting_aspects feeder_demo`: a vision feeder without hardware, over ROS."""

import argparse
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.live import Live

from resting_aspects_ros.api.forecast import (
    CLEARANCE,
    DEFAULT_ACTION,
    ROBOT,
    check_tray,
    cycle_times,
    forecast_controlled,
    forecast_from,
)
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.api.result import check_files, whole_file
from resting_aspects_ros.api.runner import DropProgress
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.life_cycle import DONE, INTERRUPTED, save_text
from resting_aspects_ros.cli.node_processes import NodeProcesses, own_namespace
from resting_aspects_ros.cli.verbs.forecast import add_tray
from resting_aspects_ros.client.client import RestingAspectsClient
from resting_aspects_ros.client.connection import Connection
from resting_aspects_ros.client.feeder_watch import (
    FeederWatch,
    Moment,
    feeder_sentence,
    feeder_table,
)
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.feeding.forecast import check_minutes
from resting_aspects_ros.feeding.tray_simulation import ControlledRuns
from resting_aspects_ros.nodes.aspect_classifier.services import reorientation_from
from resting_aspects_ros.part.library import load_part
from resting_aspects_ros.report.document import SCHEMA_VERSION, to_json
from resting_aspects_ros.report.forecast import controlled_fields, controlled_text
from resting_aspects_ros.report.outlines import DrawnPart, save_tray_picture
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS
from resting_aspects_ros.system import Interruption
from resting_aspects_ros.vision.rolling import KnownPart
from resting_aspects_ros.vision.tray_image import TrayCamera

PART, MINUTES = 'l_bracket', '10'
DROPS, PER_ASPECT = DEFAULT_DROPS, 40
DOCUMENT, PICTURE = 'feeder_demo.json', 'feeder_demo.png'
# Of the camera.
PX_PER_MM = 5.0
# Of the picks: feeder_controller, drop_recorder and the command. The run begins when all of them
# are connected, so that each of them receives all picks, however busy the machine is.
SUBSCRIBERS = 3
# Nodes that make the drops and the flips. The others begin with them.
SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
# Maximum time for the drops and for the flips, s.
TIMEOUT = 3600.0
# Maximum real time without progress in the run, s: the model of a part with very many triangles
# takes a minute.
MAX_SILENCE = 120.0
# Time between two checks for Ctrl-C and ended nodes, s.
PERIOD = 0.1
# For messages of the last cycle that are still on their way, s.
REST = 0.3

DESCRIPTION = f"""Run a vision feeder without hardware, in simulated time: drop the part {DROPS}
times and flip it {PER_ASPECT} times from each aspect over ROS, forecast the parts per
minute, and then let camera_simulator, vision_example and feeder_controller work
together as processes that communicate over DDS. Show the picks beside the
forecast, and write a picture of the tray, a JSON document and logs."""
EXAMPLES = """examples:
  resting_aspects feeder_demo
  resting_aspects feeder_demo hex_nut --pickable-classes 1 --robot 0.9s
  resting_aspects feeder_demo l_bracket --pickable 1,3 --minutes 30 --seed 2
  resting_aspects feeder_demo t_prism --tray 150x150mm --out result --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'part', metavar='PART', nargs='?', default=PART, help=f'name of a part ({PART})'
    )
    parser.add_argument(
        '--parts', metavar='DIR', type=Path, help='folder of named parts (the examples)'
    )
    pickable = parser.add_mutually_exclusive_group()
    options.add_numbers(
        pickable,
        '--pickable',
        'IDS',
        'aspects in which the robot can pick the part, such as 1,3: all of their symmetry '
        'classes (the most probable class)',
    )
    options.add_numbers(pickable, '--pickable-classes', 'NUMBERS', 'symmetry classes instead')
    options.add_number(parser, '--robot', 's', 'from one pick of the robot to the next (1.2)')
    add_tray(parser)
    text = f'duration of the run in simulated time ({MINUTES})'
    options.add_number(parser, '--minutes', '', text, default=MINUTES)
    options.add_seed(parser, 'drops, flips, places on the tray and noise of the camera')
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        default=Path('out/feeder_demo'),
        help='folder of the picture, the document, the logs and the output of the nodes '
        '(out/feeder_demo)',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')


def run(arguments: argparse.Namespace) -> int:
    """Run the demo; returns the exit code. Raises RestingAspectsError if a node fails."""
    check_files('--out', arguments.out, (DOCUMENT, PICTURE))
    with Interruption() as stop:
        demo = FeederDemo(arguments, stop.check)
        failure: RestingAspectsError | None = None
        try:
            demo.run()
        except KeyboardInterrupt:
            print('interrupted', file=sys.stderr)
        except RestingAspectsError as error:
            if demo.watch is None:
                raise
            failure = error
        found = demo.save()
        if arguments.json:
            print(found, end='')
        if failure is not None:
            raise failure
        return INTERRUPTED if stop.asked else DONE


class FeederDemo:
    """The nodes of a demo, and what they have done; ``watch`` is None until the run begins.

    Raises RestingAspectsError for wrong input. ``check`` is called often, and raises
    KeyboardInterrupt after Ctrl-C.
    """

    def __init__(self, arguments: argparse.Namespace, check: Callable[[], None]) -> None:
        self._arguments, self._out, self._check = arguments, arguments.out, check
        self._known = known_part(load_part(arguments.part, None, arguments.parts, None))
        self._name, aspects = self._known.part.name, self._known.aspects
        self._classes = _pickable(arguments, self._known)
        self._ids = aspects.chosen(None, self._classes, 'pickable')
        robot = ROBOT if arguments.robot is None else arguments.robot
        self._times = cycle_times(named_action(DEFAULT_ACTION), robot=robot)
        self._tray = Tray(arguments.tray, CLEARANCE)
        check_minutes(arguments.minutes)
        check_tray(self._known.part, aspects, self._tray, None)
        self._camera = TrayCamera(self._tray.size, PX_PER_MM)
        self._forecast: ControlledRuns | None = None
        self.watch: FeederWatch | None = None

    def run(self) -> None:
        """Run the nodes until the simulated time is over."""
        name = own_namespace('feeder_demo')
        namespace = ['-r', f'__ns:={name}']
        nodes = self._node_arguments(f'{name}/clock')
        print(
            f'The robot picks {self._name} in aspects {", ".join(map(str, self._ids))}.',
            file=sys.stderr,
        )
        print(f'Starting {len(nodes)} nodes in the namespace {name} ...', file=sys.stderr)
        with NodeProcesses(self._out, self._check) as processes:

            def start(names: Iterable[str]) -> None:
                for node in names:
                    processes.start(node, [*namespace, *nodes[node]])
                processes.wait_until_ready()

            start(SUITE)
            forecast = self._forecast = self._ask(namespace, processes.check)
            start(node for node in nodes if node not in SUITE)
            print(f'Forecast {controlled_text(forecast)}.', file=sys.stderr)
            connection = Connection(None, namespace, processes.check)
            live = Live(console=Console(stderr=True), auto_refresh=False)
            with closing(connection), live:
                minutes = self._arguments.minutes
                watch = self.watch = connection.run(
                    lambda: FeederWatch(connection.node, self._name, minutes)
                )
                while not watch.done.done():
                    connection.check()
                    connection.run(watch.connect)
                    if watch.silence > MAX_SILENCE:
                        raise RestingAspectsError(
                            f'simulated time stands still for {MAX_SILENCE:g} s: see the logs of '
                            f'the nodes in {str(self._out)!r}'
                        )
                    if watch.images:
                        live.update(feeder_table(watch, forecast), refresh=True)
                    time.sleep(PERIOD)
                time.sleep(REST)
                live.update(feeder_table(watch, forecast), refresh=True)
            if not live.console.is_terminal:  # Live ends the line only there
                live.console.line()

    def save(self) -> str:
        """Write what was found, print a summary, and return the document."""
        watch, forecast = self.watch, self._forecast
        found: dict[str, Any] = {
            'schema_version': SCHEMA_VERSION,
            'part': self._name,
            'pickable': list(self._ids),
            'pickable_classes': list(self._classes),
            'seed': self._arguments.seed,
            'complete': watch is not None and watch.done.done(),
        }
        if forecast is not None:
            found['forecast'] = controlled_fields(forecast)
        if watch is not None:
            found['run'] = watch.fields()
        text = to_json(found)
        written = [self._out / DOCUMENT]
        save_text(self._out / DOCUMENT, text)
        if watch is not None and watch.best is not None:
            written.append(self._out / PICTURE)
            with whole_file(self._out / PICTURE) as file:
                self._draw(watch.best, file)
        if watch is not None and forecast is not None and watch.images:
            print(feeder_sentence(watch, forecast), file=sys.stderr)
        files = ', '.join(str(path) for path in written)
        print(f'Written: {files}; logs in {self._out / "logs"}', file=sys.stderr)
        return text

    def _node_arguments(self, clock: str) -> dict[str, list[str]]:
        """Return the ROS arguments of each node; ``clock`` is the topic of the simulated time."""
        arguments = self._arguments
        times = ('robot', 'vibrate', 'settle')
        cell = {
            'part': self._name,
            'tray': [float(side) for side in self._tray.size],
            'action': DEFAULT_ACTION,
            **{f'{name}_time': float(getattr(self._times, name)) for name in times},
        }
        controller = {
            **cell,
            'pickable_classes': list(self._classes),
            'clearance': CLEARANCE,
        }
        camera = {
            **cell,
            'px_per_mm': PX_PER_MM,
            'seed': arguments.seed,
            'evidence': 'true',
            'subscribers': SUBSCRIBERS,
        }
        simulated = ['-p', 'use_sim_time:=true', '-r', f'/clock:={clock}']
        parts = {} if arguments.parts is None else {'parts_folder': arguments.parts}
        return {
            'drop_simulator': _values(parts),
            # Without logs, a second demo makes its drops again.
            'aspect_classifier': _values({'log_folder': "''"}),
            'drop_recorder': _values({'log_folder': self._out / 'logs'}),
            'feeder_controller': [*simulated, *_values(controller)],
            'vision_example': [*simulated, *_values({'part': self._name})],
            'camera_simulator': ['-r', f'/clock:={clock}', *_values(camera)],
        }

    def _ask(self, namespace: list[str], check: Callable[[], None]) -> ControlledRuns:
        """Request drops and flips, and forecast runs of the controller from them."""
        arguments, name = self._arguments, self._name
        flips = PER_ASPECT * len(self._known.aspects)
        same = {'drops': DROPS, 'seed': arguments.seed, 'timeout': TIMEOUT}
        with RestingAspectsClient(ros_args=namespace, check=check) as client:
            with DropProgress(name, DROPS) as progress:
                client.get_distribution(name, progress=progress.update, **same)
            with DropProgress(name, flips, 'flips') as progress:
                found = client.reorient_part(
                    name, DEFAULT_ACTION, PER_ASPECT, progress=progress.update, **same
                )
        result = reorientation_from(found, self._known.part)
        minutes = arguments.minutes
        forecast = forecast_from(result, self._ids, self._tray, self._times, minutes=minutes)
        return forecast_controlled(forecast)

    def _draw(self, moment: Moment, path: Path) -> None:
        """Write the picture of a moment."""
        advice, image = moment.advice, moment.image
        ranks = {pick.detection: k for k, pick in enumerate(advice.picks, start=1)}
        parts = [
            DrawnPart(int(each.class_id or 0), each.x, each.y, each.yaw, ranks.get(k, 0))
            for k, each in enumerate(moment.detections.detections)
        ]
        picks = f'pick {len(ranks)} of {len(parts)}' if ranks else 'no pick'
        save_tray_picture(
            path,
            np.frombuffer(image.data, np.uint8).reshape(image.height, image.width),
            self._camera,
            parts,
            self._known.outlines,
            f'Image {advice.image} of {self._name}: {picks}',
            advice.reason,
            self._classes,
        )


def _pickable(arguments: argparse.Namespace, known: KnownPart) -> tuple[int, ...]:
    """Return the numbers of the pickable classes."""
    ids, numbers = arguments.pickable, arguments.pickable_classes
    if ids is None and numbers is None:
        return (int(np.argmax(known.shares)) + 1,)
    chosen = set(known.aspects.chosen(ids, numbers, 'pickable'))
    return tuple(sorted({a.symmetry_class for a in known.aspects if a.id in chosen}))


def _values(parameters: dict[str, Any]) -> list[str]:
    """Return parameters of a node as ROS arguments."""
    return [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]

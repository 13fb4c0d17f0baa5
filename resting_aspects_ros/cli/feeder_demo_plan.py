"""What `resting_aspects feeder_demo` was asked for."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.forecast import (
    DEFAULT_ACTION,
    check_tray,
    cycle_times,
)
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.plan import named_action
from resting_aspects_ros.cli.forecast_options import parse_tray, requested_times
from resting_aspects_ros.cli.options import parse_numbers
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.vision.rolling import KnownPart
from resting_aspects_ros.vision.tray_image import TrayCamera

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

    known: KnownPart
    folder: Path | None
    classes: tuple[int, ...]
    default: bool
    tray: Tray
    times: CycleTimes
    parts_on_tray: int | None
    max_picks: int | None
    minutes: float
    seed: int
    drops: int
    per_aspect: int
    real_time: bool

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
            'best_number': self.parts_on_tray or 0,
            'max_picks': self.max_picks or 0,
        }
        camera = {
            **cell,
            'px_per_mm': PX_PER_MM,
            'seed': self.seed,
            'evidence': True,
            'subscribers': SUBSCRIBERS,
            'speed': 1.0 if self.real_time else 0.0,
        }
        simulated = ['-p', 'use_sim_time:=true', '-r', f'/clock:={clock}']
        folder = [] if self.folder is None else ['-p', f'parts_folder:={self.folder}']
        return {
            'drop_simulator': folder,
            # Without logs, a second demo makes its drops again.
            'aspect_classifier': ['-p', "log_folder:=''"],
            'drop_recorder': ['-p', f'log_folder:={logs}'],
            'feeder_controller': [*simulated, *_values(controller)],
            'vision_example': [*simulated, '-p', f'part:={self.known.part.name}'],
            'camera_simulator': ['-r', f'/clock:={clock}', *_values(camera)],
        }


def planned_demo(arguments: argparse.Namespace, drops: int, per_aspect: int) -> PlannedDemo:
    """Return what the flags request; raises RestingAspectsError for wrong input."""
    known = known_part(load_part(arguments.part, None, arguments.parts, None))
    classes, default = _pickable(arguments, known)
    times = cycle_times(named_action(DEFAULT_ACTION), **requested_times(arguments))
    clearance = parse_quantity('--clearance', arguments.clearance, 'm')
    tray = Tray(parse_tray(arguments.tray), clearance)
    minutes = parse_quantity('--minutes', arguments.minutes, '')
    if not 0 < minutes <= MAX_MINUTES:
        raise InvalidValueError(
            f'invalid --minutes {minutes:g}: expected more than 0, at most {MAX_MINUTES}'
        )
    check_tray(known.part, known.aspects, tray, arguments.parts_on_tray)
    TrayCamera(tray.size, PX_PER_MM)
    return PlannedDemo(
        known=known,
        folder=arguments.parts,
        classes=classes,
        default=default,
        tray=tray,
        times=times,
        parts_on_tray=arguments.parts_on_tray,
        max_picks=arguments.max_picks,
        minutes=minutes,
        seed=arguments.seed,
        drops=drops,
        per_aspect=per_aspect,
        real_time=arguments.real_time,
    )


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

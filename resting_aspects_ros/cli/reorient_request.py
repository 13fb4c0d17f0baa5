"""What `resting_aspects reorient` is asked for: part, actions, conditions, wanted aspects."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.measured_trials import MeasuredTrials
from resting_aspects_ros.api.output_files import check_output, make_folder
from resting_aspects_ros.api.plan_actions import (
    DEFAULT_PER_ASPECT,
    PlannedActions,
    check_actions,
    plan_actions,
)
from resting_aspects_ros.api.roadmap import read_roadmap
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.cli.action_options import requested_actions
from resting_aspects_ros.cli.options import (
    requested_conditions,
)
from resting_aspects_ros.cli.result_folder import requested_folder
from resting_aspects_ros.cli.values import parse_share
from resting_aspects_ros.errors import InvalidValueError, warn
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import check_precision
from resting_aspects_ros.statistics.markov import wanted_mask
from resting_aspects_ros.statistics.poses import RestingPoses

# Drops a part under conditions, and returns the distribution and the poses.
MakeDrops = Callable[[Part, DropConditions], tuple[Distribution, RestingPoses]]

DOCUMENT, ROADMAP = 'transitions.json', 'roadmap.json'


@dataclass(frozen=True)
class ReorientRequest:
    """Actions that were requested.

    wanted : tuple of int
        Ids of the wanted aspects; empty without any.
    by_class : bool
        Whether tables have a row for each symmetry class.
    out : Path or None
        Folder of the result; None if it is not saved.
    drop : Distribution or None
        Distribution of the drops, if they were made already: in surroundings.
    """

    part: Part
    conditions: DropConditions
    planned: tuple[PlannedActions, ...]
    wanted: tuple[int, ...]
    by_class: bool
    measured: MeasuredTrials | None
    out: Path | None
    drop: Distribution | None = None


def requested_reorientation(
    arguments: argparse.Namespace, confidence: float, make_drops: MakeDrops
) -> ReorientRequest:
    """Return the actions that the flags request; raises RestingAspectsError for wrong input.

    ``make_drops`` is called for actions in surroundings, which start from resting poses there.
    """
    precision = 0.0
    if arguments.precision is not None:
        precision = parse_share('--precision', arguments.precision)
        check_precision(precision)
    actions = requested_actions(arguments)
    conditions = requested_conditions(arguments)
    measured = None if arguments.measured is None else read_roadmap(arguments.measured)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    for warning in part.warnings:
        warn(warning)
    per_aspect = arguments.per_aspect
    if per_aspect is None:
        per_aspect = 0 if precision else DEFAULT_PER_ASPECT
    landscape = Landscape(part)
    values: dict[str, Any] = {
        'per_aspect': per_aspect,
        'precision': precision,
        'confidence': confidence,
        'landscape': landscape,
    }
    drop, rests = None, None
    if conditions.surroundings is not None:
        for action in actions:  # before the drops
            check_actions(part, action, conditions, **values)
        drop, rests = make_drops(part, conditions)
    planned = tuple(
        plan_actions(
            part,
            action,
            conditions,
            seed=arguments.seed,
            rests=rests,
            engine=arguments.engine,
            **values,
        )
        for action in actions
    )
    wanted = _wanted(arguments, planned[0])
    out = _folder(arguments, part.name, [action.name for action in actions])
    by_class = not arguments.each and arguments.wanted is None
    return ReorientRequest(part, conditions, planned, wanted, by_class, measured, out, drop)


def _wanted(arguments: argparse.Namespace, planned: PlannedActions) -> tuple[int, ...]:
    """Return the ids of the wanted aspects."""
    aspects = planned.counter.matrix.aspects
    if arguments.wanted is not None:
        numbers = _numbers('--wanted', arguments.wanted)
        wanted_mask(numbers, len(aspects))
        return tuple(sorted(set(numbers)))
    if arguments.wanted_classes is None:
        return ()
    classes = aspects.classes()
    numbers = _numbers('--wanted-classes', arguments.wanted_classes)
    wanted_mask(numbers, len(classes), 'symmetry class')
    return tuple(sorted({a.id for number in numbers for a in classes[number - 1]}))


def _folder(arguments: argparse.Namespace, part: str, actions: list[str]) -> Path | None:
    """Return the folder of the result, None if it is not saved.

    Raises InvalidValueError if the folder cannot be written, or has the file of measured trials.
    """
    flag, out = requested_folder(arguments, part)
    if out is None:
        return None
    _check_trials_are_kept(arguments.measured, flag, out)
    make_folder(flag, out)
    check_output(flag, out / DOCUMENT)
    if arguments.report:
        # This import is slow, and only needed for a report.
        from resting_aspects_ros.api.reorientation_files import check_reorientation_report

        check_reorientation_report(flag, out, actions)
    return out


def _check_trials_are_kept(measured: Path | None, flag: str, out: Path) -> None:
    """Raise InvalidValueError if the file of measured trials would be replaced."""
    roadmap = out / ROADMAP
    if measured is not None and roadmap.exists() and measured.samefile(roadmap):
        raise InvalidValueError(
            f'invalid {flag} {str(out)!r}: expected another folder than that of --measured, whose '
            'trials would be lost'
        )


def _numbers(flag: str, text: str) -> list[int]:
    """Return the numbers in '1,3'; raises InvalidValueError."""
    try:
        return [int(each) for each in text.split(',')]
    except ValueError:
        raise InvalidValueError(
            f'invalid {flag} {text!r}: expected numbers separated by commas, such as 1,3'
        ) from None

"""Simulate the actions that `resting_aspects reorient` requests, show and save the results."""

import argparse
import dataclasses
import sys

from resting_aspects_ros.api.measured_trials import (
    MeasuredComparison,
    compare_measured,
    with_measured,
)
from resting_aspects_ros.api.reorient import drop_for_start, make_actions
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.cli.reorient_request import ReorientRequest, requested_reorientation
from resting_aspects_ros.cli.reorient_show import Answer, print_answer, save_answer, save_page
from resting_aspects_ros.core.errors import warn
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.interruption import Interruption

INTERRUPTED = 130
# Rows with at least so many measured trials replace the simulated ones.
MIN_TRIALS = 50


def reorient_and_show(
    arguments: argparse.Namespace, workers: Workers, confidence: float, stop: Interruption
) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    request = requested_reorientation(arguments, confidence)
    drop = drop_for_start(
        request.part,
        request.conditions,
        arguments.drops,
        arguments.seed,
        workers,
        shown=True,
        stopped=lambda: stop.asked,
    )
    simulated = [
        make_actions(
            planned,
            request.part,
            drop,
            workers,
            check=arguments.check_convergence,
            shown=True,
            stopped=lambda: stop.asked,
        )
        for planned in request.planned
    ]
    results, checks = _with_trials(request, simulated)
    answer = Answer(tuple(results), request.wanted, tuple(checks))
    print_answer(answer, by_class=request.by_class, as_json=arguments.json)
    if request.out is not None:
        pictures = not arguments.report
        written = save_answer(answer, simulated, request.out, request.part, pictures=pictures)
        _print(f'Written: {", ".join(str(path) for path in written)}', arguments)
        if arguments.report:
            _print(f'Report: {save_page(answer, simulated, request.out)}', arguments)
    if not all(result.complete for result in results):
        done = sum(int(result.matrix.actions.sum()) for result in results)
        print(f'interrupted; the result has {done} actions', file=sys.stderr)
        return INTERRUPTED
    return 0


def _print(line: str, arguments: argparse.Namespace) -> None:
    if not arguments.json:
        print(line, flush=True)


def _with_trials(
    request: ReorientRequest, results: list[ReorientResult]
) -> tuple[list[ReorientResult], list[MeasuredComparison]]:
    """Return the results with measured rows, and the comparisons with measured trials."""
    measured = request.measured
    if measured is None:
        return results, []
    replaced: list[ReorientResult] = []
    checks: list[MeasuredComparison] = []
    for result in results:
        name, matrix = result.action.name, result.matrix
        if name in measured.actions:
            checks += compare_measured(measured, matrix, name)
            matrix = with_measured(measured, matrix, name, MIN_TRIALS)
        replaced.append(dataclasses.replace(result, matrix=matrix))
    if not checks:
        names = ', '.join(result.action.name for result in results)
        warn(f'{measured.source} has no trials of {names}')
    return replaced, checks

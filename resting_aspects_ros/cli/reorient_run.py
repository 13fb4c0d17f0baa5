"""Simulate the actions that `resting_aspects reorient` requests, show and save the results."""

import argparse
import dataclasses
import sys

from resting_aspects_ros.api.measured_trials import (
    MeasuredComparison,
    compare_measured,
    with_measured,
)
from resting_aspects_ros.api.reorient import counted_result, drop_for_start, make_actions
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.cli.reorient_request import ReorientRequest, requested_reorientation
from resting_aspects_ros.cli.reorient_show import Answer, print_answer, save_answer, save_page
from resting_aspects_ros.errors import EngineError, analysis, warn
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.poses import RestingPoses

INTERRUPTED = 130
# Rows with at least this number of measured trials replace the simulated ones.
MIN_TRIALS = 50


def reorient_and_show(
    arguments: argparse.Namespace, workers: Workers, confidence: float, stop: Interruption
) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""

    def make_drops(part: Part, conditions: DropConditions) -> tuple[Distribution, RestingPoses]:
        number, seed = arguments.drops, arguments.seed
        return drop_for_start(
            part,
            conditions,
            number,
            seed,
            workers,
            engine=arguments.engine,
            shown=True,
            stopped=lambda: stop.asked,
        )

    request = requested_reorientation(arguments, confidence, make_drops)
    drop = request.drop
    if drop is None:
        drop, _ = make_drops(request.part, request.conditions)
    simulated, failure = _simulate(arguments, request, drop, workers, stop)
    results, checks = _with_trials(request, simulated)
    replaced = any(
        (one.matrix.counts != other.matrix.counts).any()
        for one, other in zip(results, simulated, strict=True)
    )
    answer = Answer(tuple(results), request.wanted, tuple(checks))
    # Measured rows are those of single aspects, which a class would mix with simulated ones.
    by_class = request.by_class and not replaced
    with analysis('the tables of the result'):
        print_answer(answer, by_class=by_class, as_json=arguments.json)
    if request.out is not None:
        pictures = not arguments.report
        written = save_answer(answer, simulated, request.out, request.part, pictures=pictures)
        _print(f'Written: {", ".join(str(path) for path in written)}', arguments)
        if arguments.report:
            print('writing the report ...', file=sys.stderr)
            with analysis('the report'):
                _print(f'Report: {save_page(answer, simulated, request.out)}', arguments)
    return _ended(arguments, request, simulated, failure)


def _simulate(
    arguments: argparse.Namespace,
    request: ReorientRequest,
    drop: Distribution,
    workers: Workers,
    stop: Interruption,
) -> tuple[list[ReorientResult], EngineError | None]:
    """Return the results, complete or not, and the error that ended the simulation early."""
    results: list[ReorientResult] = []
    for planned in request.planned:
        try:
            result = make_actions(
                planned,
                request.part,
                drop,
                workers,
                check=arguments.check_convergence,
                shown=True,
                stopped=lambda: stop.asked,
            )
        except EngineError as error:
            return [*results, counted_result(planned, request.part, drop)], error
        results.append(result)
    return results, None


def _ended(
    arguments: argparse.Namespace,
    request: ReorientRequest,
    simulated: list[ReorientResult],
    failure: EngineError | None,
) -> int:
    """Return the exit code, and say what is missing; raises the failure."""
    done = sum(int(result.matrix.actions.sum()) for result in simulated)
    if failure is not None:
        raise EngineError(f'{failure}; the result has {done} actions')
    if not all(result.complete for result in simulated):
        print(f'interrupted; the result has {done} actions', file=sys.stderr)
        return INTERRUPTED
    for planned in request.planned:
        if planned.counter.precision > 0 and not planned.counter.precise:
            warn(
                f'precision {planned.counter.precision:g} was not reached in '
                f'{planned.counter.done} actions of {planned.action.name}, the requested maximum'
            )
    if arguments.check_convergence and any(each.convergence is None for each in simulated):
        print('interrupted; convergence was not checked', file=sys.stderr)
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

"""Make the drops that `resting_aspects drop` requests, count them, and save the result."""

import argparse
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from resting_aspects_ros.api.drop import recorded
from resting_aspects_ros.api.drop_counter import Convergence, DropCounter, check_in_finer_steps
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.given_states import CountsByState
from resting_aspects_ros.api.load_part import mesh_file
from resting_aspects_ros.api.output_files import (
    check_output,
    make_folder,
    poses_file,
    write_poses,
)
from resting_aspects_ros.api.plan_drops import plan_drops
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.api.surroundings import warn_of_surroundings
from resting_aspects_ros.cli.console import print_result
from resting_aspects_ros.cli.drop_request import DropRequest
from resting_aspects_ros.cli.result_folder import requested_folder
from resting_aspects_ros.errors import EngineError, LogError, OutputError, analysis, warn
from resting_aspects_ros.simulation.interruption import Interruption, catch
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import METHOD, Distribution

INTERRUPTED = 130
DOCUMENT, PICTURE, POSES = 'distribution.json', 'distribution.png', 'poses.csv'


def drop_and_show(
    arguments: argparse.Namespace,
    request: DropRequest,
    workers: Workers,
    confidence: float,
    stop: Interruption,
) -> int:
    """Drop, count and show; returns the exit code.

    Raises RestingAspectsError before the first drop for wrong input, and after saving the partial
    result if something failed.
    """
    part, stop_at = request.part, request.stop_at
    planned = plan_drops(
        part,
        request.conditions,
        drops=request.drops,
        seed=request.seed,
        first_drop=request.first_drop,
        precision=request.precision,
        stop_at=stop_at,
        interval=arguments.interval,
        confidence=confidence,
        starts=request.starts,
        engine=arguments.engine,
    )
    job, run = planned.job, planned.run
    request.check_engine(run)
    flag, out = _folder(arguments, part.name)
    if arguments.log is not None:
        make_folder('--log', arguments.log)
    failure: EngineError | LogError | OutputError | None = None
    log: Path | None = None
    convergence: Convergence | None = None
    checked = not arguments.check_convergence
    counter = DropCounter(planned.empty, run, stop_at, planned.consumers)
    by_state = _counted_by_state(request, counter)
    try:
        with ExitStack() as stack:
            for option, path in _poses_paths(arguments.poses, flag, out):
                file = stack.enter_context(poses_file(option, path))
                counter.consumers.append(partial(write_poses, file))
            for warning in part.warnings:
                warn(warning)
            warn_of_surroundings(request.conditions, part.hull_radius)
            try:
                with (
                    recorded(arguments.log, part, counter, planned.contacts) as log,
                    DropProgress(part.name, run.drops) as progress,
                ):
                    counter.drop(job, workers, progress.update, lambda: stop.asked)
                    progress.end(counter.distribution.drops)
                if arguments.check_convergence and not stop.asked:
                    label = f'{part.name} with a finer time step'
                    with DropProgress(label, counter.distribution.drops) as progress:
                        checked, convergence = check_in_finer_steps(
                            counter, job, workers, progress.update, lambda: stop.asked
                        )
                        progress.end(progress.done)
            except (EngineError, LogError) as error:
                failure = error  # the poses of the completed drops are still saved
    except OutputError as error:
        failure = error
    result = DropResult(
        counter.distribution,
        run,
        part,
        METHOD,
        counter.complete,
        convergence,
        mesh_file(arguments.part),
        counter.history.points(),
        log=log,
        by_state=by_state,
        contacts=planned.contacts,
    )
    _write(result, out, arguments)
    done = result.distribution.drops
    if failure is not None:
        raise type(failure)(f'{failure}; the result has {done} of {run.drops} drops')
    if not result.complete:
        print(f'interrupted; the result has {done} of {run.drops} drops', file=sys.stderr)
        return INTERRUPTED
    _warn_if_not_precise(result.distribution, stop_at)
    if not checked:
        print('interrupted; convergence was not checked', file=sys.stderr)
    return 0 if checked else INTERRUPTED


def _counted_by_state(request: DropRequest, counter: DropCounter) -> CountsByState | None:
    """Let the counter count by given initial state, too; returns the counts."""
    if request.given is None:
        return None
    by_state = CountsByState.none(len(request.given), len(counter.distribution.aspects))
    counter.consumers.append(by_state.add)
    return by_state


def _write(result: DropResult, out: Path | None, arguments: argparse.Namespace) -> None:
    """Save and print the result, even if a step fails; the slow report is last."""
    files = [DOCUMENT, POSES] if arguments.report else [DOCUMENT, PICTURE, POSES]
    logged = [] if result.log is None else [f'Log: {result.log}']
    lines = ['Add --report for pictures of the aspects.']
    try:
        if out is not None:
            lines = [f'Written: {", ".join(str(out / name) for name in files)}']
            result.save_json(out / DOCUMENT)
            if not arguments.report:
                with analysis('the picture'):
                    result.save_picture(out / PICTURE)
    finally:
        print_result(result, as_json=arguments.json, each=arguments.each)
        _print(logged, arguments)
    if arguments.report and out is not None:
        # Everything else is saved, so Ctrl-C may end the report at once.
        catch(signal.default_int_handler)
        _print(lines, arguments)
        from resting_aspects_ros.api.report_files import write_report

        lines = []
        with analysis('the report'):
            lines.append(f'Report: {write_report(result, out)}')
    _print(lines, arguments)


def _print(lines: list[str], arguments: argparse.Namespace) -> None:
    if lines and not arguments.json:
        print(*lines, sep='\n', flush=True)


def _folder(arguments: argparse.Namespace, part: str) -> tuple[str, Path | None]:
    """Return the folder of the result, None if it is not saved, and the flag that requests it.

    Raises InvalidValueError if the folder cannot be written.
    """
    flag, out = requested_folder(arguments, part)
    if arguments.report and out is not None:
        # This import is slow, and only needed for a report.
        from resting_aspects_ros.api.report_files import check_report

        check_report(flag, out)
    return flag, out


def _warn_if_not_precise(distribution: Distribution, precision: float) -> None:
    """Warn if the precision was not reached in the maximum number of drops."""
    half = max((each.upper - each.lower) / 2 for each in distribution.intervals())
    if 0 < precision < half:
        warn(
            f'precision {precision:g} was not reached in {distribution.drops} drops, the '
            f'requested maximum: the widest interval is +-{half:.2g}'
        )


def _poses_paths(poses: Path | None, flag: str, out: Path | None) -> Iterator[tuple[str, Path]]:
    """Yield the files of poses with their flags, after checking that all outputs are writable."""
    check_output('--poses', poses)
    if out is not None:
        make_folder(flag, out)
        for name in (DOCUMENT, PICTURE, POSES):
            check_output(flag, out / name)
        yield flag, out / POSES
    if poses is not None and not (out is not None and poses.resolve() == (out / POSES).resolve()):
        yield '--poses', poses

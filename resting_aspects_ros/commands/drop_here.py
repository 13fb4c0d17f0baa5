"""What `resting_aspects drop` does: drop a part here and now, without ROS."""

import argparse
import signal
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from resting_aspects_ros.commands.answer import Answer
from resting_aspects_ros.commands.convergence import Convergence
from resting_aspects_ros.commands.drop_question import DropQuestion
from resting_aspects_ros.commands.drop_tally import Tally, check_in_finer_steps, drop_all, warn
from resting_aspects_ros.commands.given_part import mesh_file
from resting_aspects_ros.commands.interruption import Interruption
from resting_aspects_ros.commands.outputs import check_output, make_folder
from resting_aspects_ros.commands.poses_csv import poses_file
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import METHOD, Distribution, no_drops
from resting_aspects_ros.core.errors import EngineError, InvalidValueError
from resting_aspects_ros.core.intervals import check_confidence
from resting_aspects_ros.core.landscape import Landscape
from resting_aspects_ros.drops.campaign import Workers
from resting_aspects_ros.drops.ceiling import most_drops
from resting_aspects_ros.drops.plan import plan_run
from resting_aspects_ros.signals import handled_by

INTERRUPTED = 130
DOCUMENT, PICTURE, POSES = 'distribution.json', 'distribution.png', 'poses.csv'
# A fall from higher than this, hull radii, was probably meant in another unit, and takes minutes.
MAX_HEIGHT = 500


def drop_here(
    arguments: argparse.Namespace,
    question: DropQuestion,
    workers: Workers,
    confidence: float,
    stop: Interruption,
) -> int:
    """Drop, count and show; returns the exit code.

    Raises RestingAspectsError: before the first drop for wrong input, and after what was done is
    saved, if not all could be done.
    """
    check_confidence(confidence)
    if not arguments.force:
        _check_height(question)
    part, precision, stop_at = question.part, question.precision, question.stop_at
    landscape = Landscape(part)
    empty = no_drops(
        find_aspects(part, landscape),
        interval=arguments.interval,
        confidence=confidence,
        by_precision=precision > 0,
    )
    job, run = plan_run(
        part,
        question.conditions,
        seed=question.seed,
        drops=most_drops(question.drops, stop_at, len(empty.aspects), empty.interval, confidence),
        first_drop=question.first_drop,
        precision=precision,
        run_id=uuid.uuid4().hex[:12],
        started=time.time_ns(),
        landscape=landscape,
    )
    question.check_engine(run)
    flag, out = _folder(arguments, part.name)
    failure: EngineError | None = None
    convergence: Convergence | None = None
    checked = not arguments.check_convergence
    tally = Tally(empty, run, stop_at, question.ranges)
    with ExitStack() as stack:
        for option, path in _poses_paths(arguments.poses, flag, out):
            tally.tables.append(stack.enter_context(poses_file(option, path)))
        for warning in part.warnings:
            warn(warning)
        try:
            drop_all(part.name, job, workers, tally, stop)
            if arguments.check_convergence and not stop.asked:
                checked, convergence = check_in_finer_steps(job, workers, tally, stop)
        except EngineError as error:
            failure = error
    answer = Answer(
        tally.distribution,
        run,
        part,
        METHOD,
        tally.over,
        convergence,
        mesh_file(arguments.part),
        tally.history.points(),
    )
    _write(answer, out, arguments)
    if failure is not None:
        done = tally.distribution.drops
        raise EngineError(f'{failure}, after {done} of {run.drops} drops, which are in the answer')
    if answer.complete:
        _say_how_precise(answer.distribution, stop_at)
    missing = _missing(answer, checked=checked)
    if missing:
        print(missing, file=sys.stderr)
    return INTERRUPTED if missing else 0


def _write(answer: Answer, out: Path | None, arguments: argparse.Namespace) -> None:
    """Save and print the answer, whatever of it fails; the page, which takes longest, at last."""
    report, as_json = arguments.report, arguments.json
    try:
        if out is not None:
            answer.save_json(out / DOCUMENT)
            if not report:
                answer.save_picture(out / PICTURE)
    finally:
        answer.print(as_json=as_json, each=arguments.each)
    if out is None:
        _say('Add --report for pictures of the aspects.', as_json=as_json)
        return
    names = (DOCUMENT, POSES) if report else (DOCUMENT, PICTURE, POSES)
    written = f'Written: {", ".join(str(out / name) for name in names)}'
    if not report:
        _say(written, as_json=as_json)
        return
    # All else is saved: who does not want to wait for the page need not.
    with handled_by(signal.default_int_handler):
        _say(written, as_json=as_json)
        from resting_aspects_ros.commands.report_files import write_report

        page = write_report(answer, out)
    _say(f'Report: {page}', as_json=as_json)


def _say(line: str, *, as_json: bool) -> None:
    if not as_json:
        print(line, flush=True)


def _folder(arguments: argparse.Namespace, part: str) -> tuple[str, Path | None]:
    """Where the answer goes, if it is to be saved, and which flag says so.

    Raises InvalidValueError if it cannot be written there.
    """
    flag, out = '--out', arguments.out
    if arguments.report:
        # It takes a while to import, which drops without a report do not need.
        from resting_aspects_ros.commands.report_files import check_report, default_folder

        if out is None:
            flag, out = '--report', default_folder(part)
        check_report(flag, out)
    return flag, out


def _missing(answer: Answer, *, checked: bool) -> str:
    """What an interruption left out, in words."""
    done = answer.distribution.drops
    if not answer.complete:
        return f'interrupted after {done} of {answer.run.drops} drops, which are in the answer'
    if not checked:
        return 'interrupted before the convergence was checked'
    return ''


def _say_how_precise(distribution: Distribution, precision: float) -> None:
    """Warn if all drops that were allowed were made, and that was not enough."""
    half = max((each.upper - each.lower) / 2 for each in distribution.intervals())
    if 0 < precision < half:
        warn(
            f'precision {precision:g} was not reached in {distribution.drops} drops, the most '
            f'that were asked for: the widest interval is +-{half:.2g}'
        )


def _check_height(question: DropQuestion) -> None:
    """Refuse a height that is a mistake of the unit."""
    height, radius = question.conditions.height, question.part.hull_radius
    if question.logged is None and height > MAX_HEIGHT * radius:
        raise InvalidValueError(
            f'invalid --height {height:g} m: expected at most {MAX_HEIGHT} times the radius of '
            f'{question.part.name}, {MAX_HEIGHT * radius:.3g} m, or --force; millimetres are '
            f'written {height:g}mm'
        )


def _poses_paths(poses: Path | None, flag: str, out: Path | None) -> Iterator[tuple[str, Path]]:
    """Where the poses go, checked, like what goes beside them, which ``flag`` asks for."""
    check_output('--poses', poses)
    if out is not None:
        make_folder(flag, out)
        for name in (DOCUMENT, PICTURE, POSES):
            check_output(flag, out / name)
        yield flag, out / POSES
    if poses is not None and not (out is not None and _same(poses, out / POSES)):
        yield '--poses', poses


def _same(one: Path, other: Path) -> bool:
    return one.resolve() == other.resolve()

"""`resting_aspects recover`: close logs that a crash left unfinished."""

import argparse
import sys
from pathlib import Path

from resting_aspects_ros.errors import LogError, NoLogError, RestingAspectsError
from resting_aspects_ros.logs.bag import OUTCOME
from resting_aspects_ros.logs.writer import recover_log
from resting_aspects_ros.run_logs import LoggedRun, rest_of_run

DESCRIPTION = """Rebuild index, summary and metadata.yaml of logs whose recorder was killed.
Every complete message in the file is kept, and a classifier that starts later
uses the drops or the transitions. Logs that are closed or being written are
not changed. A file that is damaged before its end is refused: "mcap recover",
of the MCAP command line tool, copies its readable messages."""
EXAMPLES = """examples:
  resting_aspects recover out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50
  resting_aspects recover out/logs/*
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'logs', metavar='LOG', type=Path, nargs='+', help='folder of a run, or an .mcap file'
    )


def run(arguments: argparse.Namespace) -> None:
    """Recover each log and print its contents.

    Continues after a log that cannot be recovered, and raises RestingAspectsError at the end.
    """
    failed = []
    for log in arguments.logs:
        try:
            print(f'{log}: {_recover(log)}', flush=True)
        except RestingAspectsError as error:
            failed.append(error)
    for earlier in failed[:-1]:
        print(f'error: {earlier}', file=sys.stderr)
    if failed:
        raise failed[-1]


def _recover(log: Path) -> str:
    """Recover a log; returns a description of its contents."""
    records: dict[str, dict[str, str]] = {}
    try:
        logged = LoggedRun(log)
        if logged.being_written:
            return 'is being written, not changed'
        run, outcome = logged.run, logged.outcome
        words = 'no drops'
        if run is not None:
            words = f'{outcome.drops} of {run.drops} drops of {run.part}'
            words += rest_of_run(run, outcome)
        elif (matrix := logged.transitions) is not None:
            of = f'{matrix.run.part}, {matrix.action.name}'
            words = f'{outcome.drops} of {matrix.run.drops} actions of {of}'
        if run is not None or logged.transitions is not None:
            records = {OUTCOME: outcome.record()}
    except NoLogError:
        raise
    except LogError as error:  # such as that of messages of another version
        words = f'its drops were not counted: {error}'
    recovered = recover_log(log, records)
    if recovered.being_written:
        return 'is being written, not changed'
    if recovered.closed:
        return f'is already closed, {recovered.messages} messages, {words}'
    return f'{recovered.messages} messages recovered, {words}'

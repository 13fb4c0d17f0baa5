"""What `resting_aspects report` does: read a result, and write its page."""

import argparse
from pathlib import Path

from resting_aspects_ros.commands.answer import Answer
from resting_aspects_ros.commands.counts_files import read_counts
from resting_aspects_ros.commands.document_answer import document_answer
from resting_aspects_ros.commands.given_counts import check_against
from resting_aspects_ros.commands.report_files import check_report, default_folder, write_report
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.logs.log_reader import is_log


def report_here(arguments: argparse.Namespace) -> int:
    """Read and write; returns the exit code. Raises RestingAspectsError for wrong input."""
    answer = _answer(arguments)
    against = None
    if arguments.against is not None:
        against = read_counts(arguments.against)
        aspects = answer.distribution.aspects
        if not answer.distribution.counts.any():
            raise InvalidValueError(
                f'{str(arguments.result)!r} has no drop in an aspect, allowed with --against are '
                '1 or more'
            )
        check_against(against, answer.run.part, answer.run.part_sha256, aspects)
    folder = arguments.out or default_folder(answer.run.part)
    check_report('--out', folder)
    print(f'Report: {write_report(answer, folder, against)}')
    return 0


def _answer(arguments: argparse.Namespace) -> Answer:
    path: Path = arguments.result
    if not is_log(path):
        return document_answer(
            path, arguments.part, arguments.unit, arguments.parts, arguments.body
        )
    for name in ('part', 'unit', 'body', 'parts'):
        if (given := getattr(arguments, name)) is not None:
            raise InvalidValueError(
                f'--{name} is {str(given)!r}, allowed only with a JSON document: a log holds its '
                'part'
            )
    # It imports ROS, which a document does not need.
    from resting_aspects_ros.commands.logged_run import logged_answer

    return logged_answer(path)

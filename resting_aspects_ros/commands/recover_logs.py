"""What `resting_aspects recover` does."""

import sys
from collections.abc import Sequence
from pathlib import Path

from resting_aspects_ros.commands.logged_run import TYPES, LoggedRun, rest_of_run
from resting_aspects_ros.core.errors import LogError, RestingAspectsError
from resting_aspects_ros.logs.log_reader import is_being_written
from resting_aspects_ros.logs.outcome import OUTCOME
from resting_aspects_ros.logs.recovery import BrokenLog


def recover_logs(logs: Sequence[Path]) -> int:
    """Recover one after the other, and say what was found; returns the exit code.

    One that cannot be recovered does not hold up the others. Raises LogError at the end.
    """
    failed = []
    for log in logs:
        try:
            print(f'{log}: {_recover(log)}', flush=True)
        except RestingAspectsError as error:
            failed.append(error)
    for earlier in failed[:-1]:
        print(f'error: {earlier}', file=sys.stderr)
    if failed:
        raise failed[-1]
    return 0


def _recover(log: Path) -> str:
    """What was done."""
    if is_being_written(log):
        return 'is being written, left as it is'
    broken = BrokenLog(log)
    words, notes = _account(broken)
    if broken.closed:
        return f'is closed already, {broken.extent.messages} messages, {words}'
    kept = broken.recover(notes)
    words = f'{broken.extent.messages} messages recovered, {words}'
    if kept is not None:
        lost = ', '.join(broken.extent.losses()) or 'nothing that can be named'
        words += f'; damaged, lost: {lost}; the old file is {kept.name}'
    return words


def _account(broken: BrokenLog) -> tuple[str, dict[str, dict[str, str]]]:
    """How many of its drops a log has, in words and as a record for it."""
    logged = LoggedRun()
    try:
        for type_name, data in broken.messages(TYPES):
            logged.take(type_name, data)
    except LogError as error:
        # Of another version of the suite, perhaps. What is there is kept as it is.
        return f'its drops were not counted: {error}', {}
    if logged.run is None:
        return 'no drops', {}
    outcome = logged.outcome()
    words = f'{outcome.drops} of {logged.run.drops} drops of {logged.run.part}'
    return words + rest_of_run(logged.run, outcome), {OUTCOME: outcome.record()}

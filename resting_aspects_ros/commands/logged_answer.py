"""A log as the answer that it holds."""

from collections.abc import Iterator
from pathlib import Path

from resting_aspects_ros.commands.answer import Answer
from resting_aspects_ros.commands.log_warning import warn_if_unfinished
from resting_aspects_ros.commands.logged_run import read_contents
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import METHOD, count_poses, no_drops
from resting_aspects_ros.core.errors import InvalidValueError, LogError
from resting_aspects_ros.core.history import History
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.merge import Piece, merge_drops
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.log_reader import messages
from resting_aspects_ros.logs.topics import POSES_TYPE
from resting_aspects_ros.nodes.convert import serialized_poses


def logged_answer(log: Path) -> Answer:
    """Count the drops of a log again, each once.

    Raises InvalidValueError if it is no log of a run with its part, LogError if it cannot be read.
    """
    contents = read_contents(log)
    run, part = contents.run.run, contents.run.part
    if run is None:
        raise InvalidValueError(f'log {str(log)!r} holds no drops')
    if part is None or part.part_sha256 != run.part_sha256:
        raise InvalidValueError(f'log {str(log)!r} does not describe its part')
    warn_if_unfinished(log)
    counted = no_drops(find_aspects(part), by_precision=run.precision > 0)
    history = History(counted.aspects)
    for poses in _poses(log, run):
        history.add(poses)
        counted += count_poses(counted.aspects, poses)
    whole = contents.outcome.whole and contents.finished
    return Answer(counted, run, part, METHOD, whole, history=history.points())


def _poses(log: Path, run: RunDescription) -> Iterator[RestingPoses]:
    """The drops of the run, each once, by index."""
    for merged in merge_drops(_pieces(log), any_engine=True):
        if merged.run.sequence() == run.sequence():
            for poses in merged.poses:
                yield poses.between(run.first_drop, run.end)


def _pieces(log: Path) -> Iterator[Piece]:
    for data in messages(log, POSES_TYPE):
        try:
            yield serialized_poses(data)
        except RuntimeError as error:  # all that rclpy raises
            raise LogError(f'log {str(log)!r} holds poses that cannot be read: {error}') from None

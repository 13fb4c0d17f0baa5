"""The distribution of the drops that a log holds of which the rest of the run is not there."""

from collections.abc import Generator
from pathlib import Path

from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import Distribution
from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.drops.merge import Piece, merge_drops
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.log_reader import messages
from resting_aspects_ros.logs.topics import PART_TYPE, POSES_TYPE
from resting_aspects_ros.nodes.convert import serialized_part, serialized_poses
from resting_aspects_ros.nodes.run_accounts import RunAccount


def count_first_drops(log: Path, run: RunDescription) -> Generator[None, None, Distribution]:
    """Count the drops of a run from its first on, up to one that is not in the log.

    The first m of n drops are the run of m, so this is the distribution of a run that was ended
    there. Each step reads a batch. Raises RestingAspectsError if there are none, or not the part.
    """
    parts: list[Part] = []
    for data in messages(log, PART_TYPE):
        parts.append(serialized_part(data))
        yield
    part = next((part for part in parts if part.part_sha256 == run.part_sha256), None)
    if part is None:
        raise LogError(f'log {str(log)!r} does not describe its part')
    pieces: list[Piece] = []
    for data in messages(log, POSES_TYPE):
        pieces.append(serialized_poses(data)[:2])
        yield
    for poses in merge_drops(pieces)[0].poses:
        if poses.first_drop <= run.first_drop < poses.end:
            account = RunAccount(run, waiting=[poses.between(run.first_drop, run.end)])
            account.count(find_aspects(part))
            return account.counted
    raise LogError(f'log {str(log)!r} does not hold the first drops of its run')

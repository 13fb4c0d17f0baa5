"""The result of a run whose drops are in a log."""

from pathlib import Path

from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.surroundings import without_drops
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import named
from resting_aspects_ros.run_logs.contents import read_logged_run
from resting_aspects_ros.statistics.distribution import (
    METHOD,
    History,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.poses import RestingPoses


def logged_result(log: Path, *, keep_poses: bool = False) -> DropResult:
    """Return a result with a new count of the drops in a log, without duplicates.

    The result has the poses only if ``keep_poses`` is set and no drops are missing. Raises
    InvalidValueError if the log has no drops or not their part, LogError if it cannot be read.
    """
    logged = read_logged_run(log, keep_poses=True)
    run, part = logged.run, logged.part
    if run is None:
        raise InvalidValueError(f'{named("log", log)} contains no drops')
    if part is None or part.part_sha256 != run.part_sha256:
        raise InvalidValueError(f'{named("log", log)} does not describe its part')
    logged.warn_if_unfinished()
    run = logged.known_run
    assert run is not None
    aspects, contacts = without_drops(part, run.conditions, find_aspects(part))
    distribution = no_drops(aspects, by_precision=run.precision > 0)
    history = History(distribution.aspects)
    sequence = run.sequence()
    of_run = (poses for each, poses in logged.batches if each.sequence() == sequence)
    blocks = [each.between(run.first_drop, run.end) for each in RestingPoses.blocks(of_run)]
    for poses in blocks:
        ids = aspect_ids(distribution.aspects, poses)
        history.add(ids)
        distribution += count_poses(distribution.aspects, poses, ids)
        if contacts is not None:
            contacts.add(poses, ids)
    whole = logged.outcome.whole and logged.finished
    return DropResult(
        distribution,
        run,
        part,
        METHOD,
        whole,
        history=history.points(),
        poses=blocks[0] if keep_poses and len(blocks) == 1 else None,
        contacts=contacts,
    )

"""The result of a run whose drops are in a log."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.surroundings import without_drops
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.statistics.distribution import (
    METHOD,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.core.statistics.history import History
from resting_aspects_ros.run_logs.contents import read_logged_run
from resting_aspects_ros.simulation.merge_runs import RunPoses, merge_drops
from resting_aspects_ros.simulation.run_description import RunDescription


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
    chunks = list(_poses(logged.batches, run))
    for poses in chunks:
        ids = aspect_ids(distribution.aspects, poses)
        history.add(ids)
        distribution += count_poses(distribution.aspects, poses, ids)
        if contacts is not None:
            contacts.add(poses, ids)
    whole = logged.outcome.whole and logged.finished
    gaps = any(before.end != after.first_drop for before, after in pairwise(chunks))
    return DropResult(
        distribution,
        run,
        part,
        METHOD,
        whole,
        history=history.points(),
        poses=RestingPoses.join(chunks) if keep_poses and chunks and not gaps else None,
        contacts=contacts,
    )


def _poses(batches: list[RunPoses], run: RunDescription) -> Iterator[RestingPoses]:
    """Yield the drops of a run without duplicates, ascending."""
    for merged in merge_drops(batches, any_engine=True):
        if merged.run.sequence() == run.sequence():
            for poses in merged.poses:
                yield poses.between(run.first_drop, run.end)

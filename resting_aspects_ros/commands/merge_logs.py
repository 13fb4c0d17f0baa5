"""What `resting_aspects merge` does."""

import dataclasses
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from resting_aspects_ros.commands.answer import print_table
from resting_aspects_ros.commands.log_warning import warn_if_unfinished
from resting_aspects_ros.commands.surface_text import surface_text
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import METHOD, Distribution, count_poses, no_drops
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.drops.merge import MergedDrops, Piece, merge_drops
from resting_aspects_ros.logs.log_reader import last_message, messages
from resting_aspects_ros.logs.topics import PART_TYPE, POSES_TYPE
from resting_aspects_ros.nodes.convert import serialized_part, serialized_poses
from resting_aspects_ros.report.document import distribution_document, to_json


def merge_logs(logs: Sequence[Path], *, any_engine: bool, as_json: bool, each: bool) -> int:
    """Read, merge, count and show; returns the exit code.

    Raises RestingAspectsError for logs that cannot be read, or do not belong together.
    """
    merged = merge_drops(_pieces(logs), any_engine=any_engine)
    if not merged:
        raise InvalidValueError(f'no drops are in {_named(logs)}, allowed are logs of runs')
    run = merged[0].run
    part = _part(logs, run.part_sha256)
    for log in logs:
        warn_if_unfinished(log)
    distribution = _counted(part, merged)
    if as_json:
        fields = {
            **dataclasses.asdict(run),
            'mesh_sha256': part.mesh_sha256,
            'method': METHOD,
            'runs': [list(each.run_ids) for each in merged],
            'seeds': [each.run.seed for each in merged],
        }
        sys.stdout.write(to_json(distribution_document(distribution, fields, part)))
        return 0
    surface = surface_text(run.conditions)
    runs = len({run_id for each in merged for run_id in each.run_ids})
    words = f'{runs} run{"s" if runs > 1 else ""}'
    title = f'{part.name}, {distribution.drops} drops of {words} on {surface}'
    print_table(distribution, title, part, each=each)
    return 0


def _pieces(logs: Sequence[Path]) -> Iterator[Piece]:
    for log in logs:
        for data in messages(log, POSES_TYPE):
            try:
                yield serialized_poses(data)
            except RuntimeError as error:  # all that rclpy raises
                raise InvalidValueError(
                    f'log {str(log)!r} holds poses that cannot be read: {error}'
                ) from None


def _part(logs: Sequence[Path], part_sha256: str) -> Part:
    """The part as one of the logs describes it."""
    for log in logs:
        data = last_message(log, PART_TYPE)
        if data is not None:
            part = serialized_part(data)
            if part.part_sha256 == part_sha256:
                return part
    raise InvalidValueError(
        f'{_named(logs)} do not describe their part: allowed are logs that the recorder closed, '
        'at least one'
    )


def _counted(part: Part, merged: Sequence[MergedDrops]) -> Distribution:
    total = no_drops(find_aspects(part))
    for each in merged:
        for poses in each.poses:
            total += count_poses(total.aspects, poses)
    return total


def _named(logs: Sequence[Path]) -> str:
    return ', '.join(repr(str(log)) for log in logs)

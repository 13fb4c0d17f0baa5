"""`resting_aspects merge`: one distribution of the drops of several logs, each drop once."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from resting_aspects_ros.api.surroundings import conditions_text, without_drops
from resting_aspects_ros.cli.console import make_console, print_table, show_table
from resting_aspects_ros.cli.options import (
    add_output,
)
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.contact_counts import ContactCounts
from resting_aspects_ros.core.statistics.distribution import (
    METHOD,
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.report.contact_report import contact_rows, contact_table
from resting_aspects_ros.report.document import distribution_document, to_json
from resting_aspects_ros.run_logs.contents import LoggedRun, read_logged_run
from resting_aspects_ros.simulation.merge_runs import MergedDrops, merge_drops

DESCRIPTION = """Show the distribution of all drops in several logs, which must have the same
part and the same conditions. A drop that is in several logs, identified by its
seed and its index, counts once."""
EXAMPLES = """examples:
  resting_aspects merge out/logs/l_bracket_*
  resting_aspects merge monday.mcap tuesday.mcap --any-engine --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'logs', metavar='LOG', type=Path, nargs='+', help='folder of a run, or an .mcap file'
    )
    parser.add_argument(
        '--any-engine',
        action='store_true',
        help='accept different engines, engine versions or time steps',
    )
    add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read, merge, count and show; returns the exit code.

    Raises RestingAspectsError for logs that cannot be read or merged.
    """
    logs = arguments.logs
    found = [read_logged_run(log, keep_poses=True) for log in logs]
    batches = (batch for each in found for batch in each.batches)
    merged = merge_drops(batches, any_engine=arguments.any_engine)
    if not merged:
        raise InvalidValueError(f'no drops in {_named(logs)}: expected logs with drops')
    run = merged[0].run
    part = _part(found, run.part_sha256)
    if part is None:
        raise InvalidValueError(
            f'no description of the part in {_named(logs)}: expected at least one log that the '
            'recorder closed'
        )
    for each in found:
        each.warn_if_unfinished()
    distribution, contacts = _counted(part, merged)
    if arguments.json:
        fields = {
            **run.document(),
            'mesh_sha256': part.mesh_sha256,
            'method': METHOD,
            'runs': [list(each.run_ids) for each in merged],
            'seeds': [each.run.seed for each in merged],
        }
        if contacts is not None:
            fields['contacts'] = contact_rows(contacts, distribution)
        sys.stdout.write(to_json(distribution_document(distribution, fields, part)))
        return 0
    surface = conditions_text(run.conditions)
    runs = len({run_id for each in merged for run_id in each.run_ids})
    words = f'{runs} run{"s" if runs > 1 else ""}'
    title = f'{part.name}, {distribution.drops} drops of {words} on {surface}'
    print_table(distribution, title, part, each=arguments.each)
    if contacts is not None:
        show_table(make_console(), contact_table(contacts, distribution))
    return 0


def _part(found: Sequence[LoggedRun], part_sha256: str) -> Part | None:
    """Return the part from the first log that describes it."""
    parts = (each.part for each in found)
    return next((part for part in parts if part and part.part_sha256 == part_sha256), None)


def _counted(
    part: Part, merged: Sequence[MergedDrops]
) -> tuple[Distribution, ContactCounts | None]:
    aspects, contacts = without_drops(part, merged[0].run.conditions, find_aspects(part))
    total = no_drops(aspects)
    for each in merged:
        for poses in each.poses:
            ids = aspect_ids(aspects, poses)
            total += count_poses(aspects, poses, ids)
            if contacts is not None:
                contacts.add(poses, ids)
    return total, contacts


def _named(logs: Sequence[Path]) -> str:
    return ', '.join(repr(str(log)) for log in logs)

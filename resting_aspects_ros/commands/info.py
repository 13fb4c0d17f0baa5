"""`resting_aspects info`: what is in a log."""

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.answer import print_table
from resting_aspects_ros.commands.logged_run import LogContents, read_contents, rest_of_run
from resting_aspects_ros.commands.options import add_each
from resting_aspects_ros.commands.run_facts import condition_facts, when_text
from resting_aspects_ros.commands.surface_text import surface_text
from resting_aspects_ros.core.distribution import METHOD
from resting_aspects_ros.core.errors import one_line
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.report.document import (
    SCHEMA_VERSION,
    distribution_document,
    plain,
    to_json,
)

EXAMPLES = """examples:
  resting_aspects info out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50
  resting_aspects info run_0.mcap --json
"""

# A log's own texts are shown without control characters, and no longer than this.
_WIDEST = 1000


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'info',
        description='Part, conditions, seed, versions, number of poses, and the distribution\n'
        'that a log holds, closed or broken off.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('log', metavar='LOG', type=Path, help='folder of a run, or an .mcap file')
    add_each(parser)
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read a log and show what is in it; returns the exit code. Raises LogError."""
    found = read_contents(arguments.log)
    if arguments.json:
        sys.stdout.write(to_json(_document(found)))
        return 0
    for label, text in _lines(found):
        print(f'{label:12}{one_line(text, _WIDEST)}')
    if found.run.distribution is not None:
        print()
        counted = found.run.distribution.drops
        of = '' if found.run.complete else ', counted before the run was over'
        title = f'Distribution of {counted} drops{of}'
        print_table(found.run.distribution, title, _part(found), each=arguments.each)
    return 0


def _lines(found: LogContents) -> Iterator[tuple[str, str]]:
    yield 'log', f'{found.path}, {found.path.stat().st_size / 1e6:.3g} MB'
    yield '', f'{_state(found)}, {found.messages} messages'
    run = found.run.run
    if run is None:
        yield 'drops', 'none'
        return
    part = found.run.part
    yield 'part', f'{run.part}, sha256 {run.part_sha256}'
    if part is not None:
        yield '', f'{part.mesh_format} in {part.unit}, {len(part.faces)} triangles'
    else:
        yield '', 'not described in this log'
    yield 'conditions', surface_text(run.conditions)
    yield from (('', f'{name} {value}') for name, value in condition_facts(run.conditions))
    yield 'seed', str(run.seed)
    yield 'drops', _drops(run, found)
    yield 'made', f'{when_text(run.started)} with {run.engine} {run.engine_version}'
    yield '', f'time step {run.time_step:.3g} s, resting_aspects_ros {run.suite_version}'
    yield 'run id', run.run_id


def _state(found: LogContents) -> str:
    if found.being_written:
        return 'being written'
    if not found.finished:
        return 'broken off ("resting_aspects recover" closes it, so that all can read it)'
    return 'closed'


def _drops(run: RunDescription, found: LogContents) -> str:
    words = f'{found.outcome.drops} of {run.drops}'
    if run.first_drop:
        words += f', from drop {run.first_drop} on'
    if run.precision:
        words += f', to a precision of {run.precision:g}'
    return words + (rest_of_run(run, found.outcome) if found.finished else '')


def _document(found: LogContents) -> dict[str, object]:
    run, part, distribution = found.run.run, found.run.part, found.run.distribution
    log = {
        'path': str(found.path),
        'messages': found.messages,
        'finished': found.finished,
        'being_written': found.being_written,
        'whole': found.outcome.whole,
        'poses': found.outcome.drops,
    }
    fields: dict[str, object] = {}
    if run is not None:
        fields = {name: plain(value) for name, value in dataclasses.asdict(run).items()}
    if part is not None:
        fields['mesh_sha256'] = part.mesh_sha256
    if run is not None:
        fields['drops_asked'] = run.drops
    if distribution is None:
        return {'schema_version': SCHEMA_VERSION, **fields, 'log': log}
    fields |= {'method': METHOD, 'complete': found.run.complete, 'log': log}
    return distribution_document(distribution, fields, _part(found))


def _part(found: LogContents) -> Part | None:
    """Return the part of the distribution, if the log describes it."""
    part, distribution = found.run.part, found.run.distribution
    if part is None or distribution is None:
        return None
    return part if part.part_sha256 == distribution.aspects.part_sha256 else None

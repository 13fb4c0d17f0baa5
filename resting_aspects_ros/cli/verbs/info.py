"""`resting_aspects info`: the contents of a log."""

import argparse
import dataclasses
from collections.abc import Iterator
from pathlib import Path

from resting_aspects_ros.api.model_range import missing_in
from resting_aspects_ros.api.pages import part_facts, run_facts, surface_facts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.cli.console import print_table, show_table
from resting_aspects_ros.cli.life_cycle import show_result
from resting_aspects_ros.cli.options import add_output
from resting_aspects_ros.errors import one_line
from resting_aspects_ros.logs.bag import log_files
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, distribution_document, to_json
from resting_aspects_ros.report.drops import contact_rows, contact_table
from resting_aspects_ros.ros.conversions import run_from
from resting_aspects_ros.ros.distribution_conversions import action_from
from resting_aspects_ros.run_logs import LoggedRun, messages_by_topic, rest_of_run
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import METHOD, Distribution

DESCRIPTION = """Show the part, the conditions, the seed, the versions, the number of poses
and the distribution in a log, or the action of a log of reorient_part. For any
other log, such as that of a feeder, show the number of messages of each topic.
The log may be unfinished."""
EXAMPLES = """examples:
  resting_aspects info out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50
  resting_aspects info out/logs/feeder-20250131T120000Z-2718281824f1c
"""

# Maximum length of a text of the log, which is shown without control characters.
_MAX_LENGTH = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('log', metavar='LOG', type=Path, help='folder of a run, or an .mcap file')
    add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Read a log and show its contents. Raises LogError."""
    found = LoggedRun(arguments.log)
    described, action = found.run, None
    if described is None and (matrix := found.transitions) is not None:
        described, action = run_from(matrix.run), action_from(matrix.action)
    counted = _counted(found)
    aspects = None if counted is None else counted[0].aspects
    of, part = described if aspects is None else aspects, found.part
    if part is None or of is None or part.part_sha256 != of.part_sha256:
        part = None

    def show() -> None:
        for label, text in _lines(found, described, action, part, aspects):
            print(f'{label:26}{one_line(text, _MAX_LENGTH)}')
        if counted is None:
            return
        distribution, complete = counted
        of = '' if complete else ' of an unfinished run'
        title = f'Distribution of {distribution.drops} drops{of}'
        known = found.known_run
        missing = '' if known is None or distribution.model else missing_in(known)
        print()
        print_table(distribution, title, part, each=arguments.each, no_model_range=missing)
        if distribution.contacts is not None:
            show_table(contact_table(distribution.contacts, distribution))

    def document() -> str:
        fields = _fields(found, described, action)
        if counted is None:
            return to_json({'schema_version': SCHEMA_VERSION, **fields})
        distribution, complete = counted
        fields |= {'method': METHOD, 'complete': complete}
        if distribution.contacts is not None:
            fields['contacts'] = contact_rows(distribution.contacts, distribution)
        return to_json(distribution_document(distribution, fields, part))

    show_result(arguments, document, show)


def _counted(found: LoggedRun) -> tuple[Distribution, bool] | None:
    """Return the distribution in a log, or of its drops if it has none, and if it is complete."""
    if found.last_distribution is not None:
        distribution, _, complete = found.last_distribution
        return distribution, complete
    run, part = found.run, found.part
    if run is None or part is None or part.part_sha256 != run.part_sha256:
        return None
    result = found.result()
    return dataclasses.replace(result.distribution, contacts=result.contacts), result.complete


def _lines(
    found: LoggedRun,
    run: RunDescription | None,
    action: NamedAction | None,
    part: Part | None,
    aspects: AspectSet | None,
) -> Iterator[tuple[str, str]]:
    """Yield label and text of each fact."""
    size = sum(file.stat().st_size for file in log_files(found.log))
    yield 'log', f'{found.path}, {size / 1e6:.3g} MB'
    yield '', f'{_state(found)}, {found.messages} messages'
    if run is None:
        yield 'drops', 'none'
        for topic, number in messages_by_topic(found.log).items():
            yield '', f'{topic}: {number} messages'
        return
    yield from part_facts(part, run, aspects)
    yield from surface_facts(run.conditions)
    if action is not None:
        yield 'action', f'{action.name}: {action.text}'
    what = 'drops' if action is None else 'actions'
    (label, done), *others = run_facts(run, found.outcome.drops, what)
    rest = rest_of_run(run, found.outcome) if found.finished else ''
    yield from [(label, done + rest), *others]


def _state(found: LoggedRun) -> str:
    if found.being_written:
        return 'being written'
    if not found.finished:
        return 'not closed ("resting_aspects recover" closes it, so that all programs can read it)'
    return 'closed'


def _fields(
    found: LoggedRun, run: RunDescription | None, action: NamedAction | None
) -> dict[str, object]:
    """Return the run and the state of a log as fields of a document."""
    drops = found.outcome.drops
    log = {
        'path': str(found.path),
        'messages': found.messages,
        'finished': found.finished,
        'being_written': found.being_written,
        'whole': found.outcome.whole,
        'poses': drops if action is None else 0,
    }
    fields: dict[str, object] = {}
    if run is None:
        fields['topics'] = messages_by_topic(found.log)
    else:
        fields = run.document()
    if found.part is not None:
        fields['mesh_sha256'] = found.part.mesh_sha256
    if action is not None:
        fields |= {'action': action.values, 'actions_asked': fields.pop('drops')}
        log['actions'] = drops
    elif run is not None:
        fields['drops_asked'] = run.drops
    return {**fields, 'log': log}

"""`resting_aspects reorient`: how an action brings a part from aspect to aspect."""

import argparse
import dataclasses
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from resting_aspects_ros.api.estimate import estimate
from resting_aspects_ros.api.pages import reorientation_page
from resting_aspects_ros.api.reorient import (
    PlanResult,
    ReorientResult,
    plan_reorientation,
    reorient_each,
)
from resting_aspects_ros.api.result import write_page
from resting_aspects_ros.api.roadmap import roadmap_document
from resting_aspects_ros.aspects.estimate import NotDefinedError
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.cli.console import show_page
from resting_aspects_ros.errors import InvalidValueError, analysis
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report import transitions
from resting_aspects_ros.report.document import SCHEMA_VERSION, to_json
from resting_aspects_ros.simulation.actions import (
    DEFAULT_TIME,
    KINDS,
    TIME,
    Actions,
    NamedAction,
    make_action,
)
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS, quantities_of

DOCUMENT, ROADMAP = 'transitions.json', 'roadmap.json'
DEFAULT_ACTION = 'tap'
_PREFIX = 'action_'

DESCRIPTION = """Simulate what a feeder does to parts at rest, many times from each aspect, and
show in which aspects they come to rest again: the transition matrix, the
shares after many repetitions, how soon a wanted aspect is reached, and the best
action in each aspect. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects reorient l_bracket
  resting_aspects reorient l_bracket --action kick --speed 0.5 --spin 20
  resting_aspects reorient t_prism --action tap,toss --wanted 1,3
  resting_aspects reorient my_part.stl --actions my_actions.yaml --action jolt
  resting_aspects reorient l_bracket --action hard_tap --json > transitions.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_part(parser)
    parser.add_argument(
        '--action',
        metavar='NAME',
        help='an action of config/actions.yaml or of --actions, such as tap, or a kind of action '
        'with the values below; several names separated by commas are compared (tap; with '
        '--actions all actions of the file)',
    )
    options.add_actions_file(parser)
    options.add_integer(
        parser,
        '--per-aspect',
        'number of actions from each aspect (400). With --precision the maximum (as many as '
        'needed)',
    )
    options.add_share(
        parser,
        '--precision',
        'P',
        'stop as soon as every interval of the matrix is at most +-P wide, such as 0.05',
    )
    options.add_integer(
        parser,
        '--drops',
        'number of drops; their distribution is shown beside the long run, and parts that '
        f'leave the aspects are replaced by dropped parts ({DEFAULT_DROPS})',
        default=DEFAULT_DROPS,
    )
    options.add_seed(parser, 'transitions')
    wanted = parser.add_mutually_exclusive_group()
    options.add_numbers(
        wanted,
        '--wanted',
        'IDS',
        'wanted aspects, such as 1,3: show how likely and how soon they are reached, and with '
        'several actions the best one in each other aspect',
    )
    options.add_numbers(wanted, '--wanted-classes', 'NUMBERS', 'the same for symmetry classes')
    options.add_confidence(parser)
    options.add_engine(parser)
    options.add_workers(parser)
    options.add_out(
        parser,
        'write transitions.json, transitions.png and roadmap.json into this folder',
        'reorientation.html, a page with the figures, all numbers and all conditions',
    )
    parser.add_argument(
        '--check-convergence',
        action='store_true',
        help='repeat the actions with half the time step, and show how much the matrix changes',
    )
    options.add_output(parser)
    _add_action_values(parser)
    options.add_contact_conditions(parser)
    options.add_surroundings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with life_cycle.session(arguments) as started:
        actions = _requested_actions(arguments)
        conditions = options.requested_conditions(arguments)
        part = options.requested_part(arguments)
        ids, numbers = arguments.wanted, arguments.wanted_classes
        wanted: tuple[int, ...] = ()
        if ids is not None or numbers is not None:
            wanted = find_aspects(part).chosen(ids, numbers, 'wanted')
        out = life_cycle.result_folder(arguments, part.name, (DOCUMENT,))
        simulate = partial(
            reorient_each,
            part,
            actions,
            arguments.per_aspect,
            surface=conditions,
            precision=arguments.precision or 0.0,
            drops=arguments.drops,
            seed=arguments.seed,
            confidence=arguments.confidence,
            check_convergence=arguments.check_convergence,
            engine=arguments.engine,
            **started,
        )
        results, failure = life_cycle.partial_result(simulate)
        plan = None
        if wanted and all(result.long_run is not None for result in results):
            with analysis('the best plan'):
                plan = plan_reorientation(results, wanted)
        files: dict[str, Callable[[Path], object]] = {
            ROADMAP: partial(_save_roadmap, results, part)
        }
        names = [result.action.name for result in results]
        for result in results if not arguments.report else ():  # the page has the same pictures
            name = f'transitions{transitions.suffix_of(result.action.name, names)}.png'
            files[name] = result.save_picture
        shown_plan = plan if len(results) > 1 else None
        page = partial(
            reorientation_page, results, wanted=wanted, plan=shown_plan, each=arguments.each
        )
        life_cycle.finish(
            arguments,
            out,
            (DOCUMENT, partial(_to_json, results, wanted, plan)),
            files,
            lambda: show_page(page()),
            lambda folder: write_page(page(), folder),
        )
        done = sum(int(result.matrix.actions.sum()) for result in results)
        return life_cycle.exit_code(f'{done} actions', started, failure)


# -- Actions --------------------------------------------------------------------------------------


def _add_action_values(parser: argparse.ArgumentParser) -> None:
    """Add a flag for each value of each kind of action; see requested_actions.

    The flag of a value that several kinds have is in the group of the first of them. The groups of
    the others describe it.
    """
    known: set[str] = set()
    for kind, action in KINDS.items():
        values = quantities_of(action)
        shared = [f'{options.flag_of(k)}: {q.text}' for k, q in values.items() if k in known]
        text = textwrap.fill('; '.join(shared), 76) or None
        group = parser.add_argument_group(f'values of the action {kind}', text)
        options.add_quantities(group, {k: q for k, q in values.items() if k not in known}, _PREFIX)
        known |= values.keys()
    group = parser.add_argument_group('time of the action')
    options.add_quantities(group, {'time': TIME}, _PREFIX)


def _requested_actions(arguments: argparse.Namespace) -> list[NamedAction]:
    """Return the actions that the flags request; raises InvalidValueError."""
    known = options.known_actions(arguments)
    values = {
        name: value
        for name in {name for kind in KINDS.values() for name in quantities_of(kind)}
        if (value := getattr(arguments, _PREFIX + name)) is not None
    }
    time = arguments.action_time
    text = arguments.action
    if text is None:
        text = DEFAULT_ACTION if arguments.actions is None else ','.join(known.names())
    names = [name.strip() for name in text.split(',')]
    if len(names) != len(set(names)):
        raise InvalidValueError(f'invalid --action {text!r}: expected different names')
    if (values or time is not None) and len(names) > 1:
        raise InvalidValueError(
            f'invalid --action {text!r}: expected a single action with values, such as --speed'
        )
    return [_named_action(name, known, values, time) for name in names]


def _named_action(
    name: str, known: Actions, values: dict[str, float], time: float | None
) -> NamedAction:
    if name in KINDS and name not in known.names():
        action = make_action(name, values)
        return NamedAction(name, action, DEFAULT_TIME if time is None else time)
    base = known.get(name)
    if time is not None:
        base = dataclasses.replace(base, time=time)
    if not values:
        return base
    changed = make_action(base.action.kind, {**base.action.numbers, **values})
    return NamedAction(f'{name}_changed', changed, base.time)


# -- Files ----------------------------------------------------------------------------------------


def _to_json(
    results: Sequence[ReorientResult], wanted: Sequence[int], plan: PlanResult | None
) -> str:
    """Return one JSON document; with several actions it has a list of results."""
    documents = [result.document(wanted) for result in results]
    document = documents[0]
    if len(documents) > 1:
        document = {'schema_version': SCHEMA_VERSION, 'results': documents}
    if plan is not None:
        document['plan'] = plan.document()
    return to_json(document)


def _save_roadmap(results: Sequence[ReorientResult], part: Part, path: Path) -> None:
    try:
        weights = estimate(part, ['csa']).estimates['csa'].probabilities
    except NotDefinedError:
        weights = None
    matrices = {each.action.name: (each.matrix, each.action.values) for each in results}
    document = roadmap_document(part, results[0].drop, weights, matrices)
    life_cycle.save_text(path, to_json(document))

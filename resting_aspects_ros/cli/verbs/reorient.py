"""`resting_aspects reorient`: how an action brings a part from aspect to aspect."""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.conditions import pieces_text
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
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.estimate import NotDefinedError
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli.action_options import add_action_values, requested_actions
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import (
    Session,
    exit_code,
    finish,
    partial_result,
    result_folder,
    save_text,
    session,
)
from resting_aspects_ros.cli.options import (
    add_actions_file,
    add_confidence,
    add_contact_conditions,
    add_engine,
    add_integer,
    add_out,
    add_output,
    add_part,
    add_seed,
    add_share,
    add_surroundings,
    add_workers,
    parse_numbers,
    requested_conditions,
    requested_part,
    requested_precision,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, to_json
from resting_aspects_ros.report.transitions import (
    Rows,
    actions_table,
    long_run_table,
    long_run_text,
    plan_table,
    suffix_of,
    table_rows,
    transition_table,
    wanted_table,
)
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS
from resting_aspects_ros.statistics.markov import Plan, wanted_mask
from resting_aspects_ros.statistics.transitions import OUTCOMES

DOCUMENT, ROADMAP = 'transitions.json', 'roadmap.json'

DESCRIPTION = """Simulate what a feeder does to parts at rest, many times from each aspect, and
show in which aspects they come to rest again: the transition matrix, the
shares after many repetitions, how soon a wanted aspect is reached, and the best
action in each aspect. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects reorient l_bracket
  resting_aspects reorient l_bracket --action kick --speed 0.5 --spin 20
  resting_aspects reorient t_prism --action tap,toss --wanted 1,3
  resting_aspects reorient l_bracket --action tap,hard_tap --report
  resting_aspects reorient my_part.stl --actions my_actions.yaml --action jolt
  resting_aspects reorient hex_nut --precision 0.05 --out result
  resting_aspects reorient l_bracket --action hard_tap --json > transitions.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--action',
        metavar='NAME',
        help='an action of config/actions.yaml or of --actions, such as tap, or a kind of action '
        'with the values below; several names separated by commas are compared (tap; with '
        '--actions all actions of the file)',
    )
    add_actions_file(parser)
    add_integer(
        parser,
        '--per-aspect',
        'number of actions from each aspect (400). With --precision the maximum (as many as '
        'needed)',
    )
    add_share(
        parser,
        '--precision',
        'P',
        'stop as soon as every interval of the matrix is at most +-P wide, such as 0.05',
    )
    add_integer(
        parser,
        '--drops',
        'number of drops; their distribution is shown beside the long run, and parts that '
        f'leave the aspects are replaced by dropped parts ({DEFAULT_DROPS})',
        default=DEFAULT_DROPS,
    )
    add_seed(parser, 'transitions')
    wanted = parser.add_mutually_exclusive_group()
    wanted.add_argument(
        '--wanted',
        metavar='IDS',
        help='wanted aspects, such as 1,3: show how likely and how soon they are reached, and '
        'with several actions the best one in each other aspect',
    )
    wanted.add_argument(
        '--wanted-classes', metavar='NUMBERS', help='the same for symmetry classes'
    )
    add_confidence(parser)
    add_engine(parser)
    add_workers(parser)
    add_out(
        parser,
        'write transitions.json, transitions.png and roadmap.json into this folder',
        'reorientation.html, a page with the figures, all numbers and all conditions',
    )
    parser.add_argument(
        '--check-convergence',
        action='store_true',
        help='repeat the actions with half the time step, and show how much the matrix changes',
    )
    add_output(parser)
    add_action_values(parser)
    add_contact_conditions(parser)
    add_surroundings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with session(arguments) as started:
        return _reorient_and_show(arguments, started)


def _reorient_and_show(arguments: argparse.Namespace, started: Session) -> int:
    actions = requested_actions(arguments)
    conditions, precision = requested_conditions(arguments), requested_precision(arguments)
    part = requested_part(arguments)
    wanted = _wanted(arguments, find_aspects(part))
    out = result_folder(arguments, part.name, (DOCUMENT,))
    simulate = partial(
        reorient_each,
        part,
        actions,
        arguments.per_aspect,
        surface=conditions,
        precision=precision,
        drops=arguments.drops,
        seed=arguments.seed,
        confidence=arguments.confidence,
        check_convergence=arguments.check_convergence,
        engine=arguments.engine,
        **started.options,
    )
    results, failure = partial_result(simulate)
    answer = Answer(tuple(results), wanted)
    by_class = not (arguments.each or arguments.wanted is not None)
    finish(
        arguments,
        out,
        (DOCUMENT, answer.to_json),
        _files(answer, part, pictures=not arguments.report),
        partial(_show, answer, by_class=by_class),
        partial(_write_page, answer),
    )
    checked = all(result.convergence is not None for result in results)
    return exit_code(
        f'{sum(int(result.matrix.actions.sum()) for result in results)} actions',
        complete=all(result.complete for result in results),
        failure=failure,
        unchecked=arguments.check_convergence and started.stop.asked and not checked,
    )


def _wanted(arguments: argparse.Namespace, aspects: AspectSet) -> tuple[int, ...]:
    """Return the ids of the wanted aspects."""
    given = [
        None if text is None else parse_numbers(flag, text)
        for flag, text in (
            ('--wanted', arguments.wanted),
            ('--wanted-classes', arguments.wanted_classes),
        )
    ]
    return () if given == [None, None] else aspects.chosen(given[0], given[1], 'wanted')


@dataclass(frozen=True, eq=False)
class Answer:
    """Results of one or several actions, with what was asked of them.

    wanted : tuple of int
        Ids of the wanted aspects; empty without any.
    """

    results: tuple[ReorientResult, ...]
    wanted: tuple[int, ...]

    @property
    def plan(self) -> PlanResult | None:
        """The best plan; None without wanted aspects, or if the results are not complete."""
        if not self.wanted or any(result.long_run is None for result in self.results):
            return None
        return plan_reorientation(self.results, self.wanted)

    def to_json(self) -> str:
        """Return one JSON document; with several actions it has a list of results."""
        documents = [result.document(self.wanted) for result in self.results]
        document = documents[0]
        if len(documents) > 1:
            document = {'schema_version': SCHEMA_VERSION, 'results': documents}
        if (plan := self.plan) is not None:
            document['plan'] = plan.document()
        return to_json(document)


# -- Tables ---------------------------------------------------------------------------------------


def _show(answer: Answer, *, by_class: bool) -> None:
    """Print the results as tables."""
    for number, result in enumerate(answer.results):
        if number:
            print()
        _show_result(result, answer.wanted, by_class=by_class)
    if len(answer.results) > 1:
        _show_comparison(answer, by_class=by_class)


def _show_comparison(answer: Answer, *, by_class: bool) -> None:
    """Print the long-run shares of all actions side by side, and the best plan."""
    views = {each.action.name: each.by_class() if by_class else each for each in answer.results}
    rows = table_rows(answer.results[0].matrix.aspects, by_class=by_class)
    shares = {name: v.long_run.shares for name, v in views.items() if v.long_run is not None}
    if shares:
        drop = next(iter(views.values())).drop_shares
        mask = _wanted_rows(answer.results[0], answer.wanted, rows)
        print()
        title = 'in the long run, by action'
        show_table(actions_table(rows, drop / drop.sum(), shares, mask, title))
    if (plan := answer.plan) is not None:
        first = np.array([row[0].id - 1 for row in rows])
        shown = Plan(plan.plan.action[first], plan.plan.time[first])
        print()
        show_table(plan_table(rows, shown, plan.names, 'best plan'))


def _show_result(result: ReorientResult, wanted: Sequence[int], *, by_class: bool) -> None:
    title = f'{result.title}\n{result.action.text}'
    show_table(transition_table(result.matrix, by_class, title))
    if not result.action.action.has_effect:
        show_texts('The action has no effect: every part stays where it is.')
    if result.matrix.sliding:
        show_texts(f'Of the unsettled parts, {result.matrix.sliding} slide or roll for ever.')
    if result.pieces is not None:
        show_texts(pieces_text(result.pieces, 'The edge meets'))
    view = result.by_class() if by_class else result
    rows = table_rows(result.matrix.aspects, by_class=by_class)
    if view.long_run is not None:
        table = long_run_table(
            rows,
            view.long_run,
            *view.long_run_bounds,
            view.drop_shares,
            f'{result.action.name}, repeated',
            result.matrix.confidence,
        )
        print()
        show_table(table)
        show_texts(long_run_text(rows, view.long_run))
    if wanted and (view.matrix.actions > 0).all():
        mask = _wanted_rows(result, wanted, rows)
        way = view.reach((np.flatnonzero(mask) + 1).tolist())
        print()
        show_table(wanted_table(rows, mask, *way, 'the way to wanted aspects'))
    if result.convergence is not None:
        classes = result.matrix.aspects.classes()
        names = [f'aspect {"+".join(str(a.id) for a in row)}' for row in classes]
        show_texts(result.convergence.text([*names, *OUTCOMES]))


def _wanted_rows(
    result: ReorientResult, wanted: Sequence[int], rows: Rows
) -> npt.NDArray[np.bool_]:
    """Return which rows have wanted aspects only, (rows,) bool."""
    mask = wanted_mask(wanted, len(result.matrix.counts)) if wanted else np.zeros(0, dtype=bool)
    return np.array([bool(wanted) and mask[[a.id - 1 for a in row]].all() for row in rows])


# -- Files ----------------------------------------------------------------------------------------


def _files(answer: Answer, part: Part, *, pictures: bool) -> dict[str, Callable[[Path], object]]:
    """Return what writes the roadmap and each picture, which take longest.

    With a page, which has the same pictures, none are needed here.
    """
    saves: dict[str, Callable[[Path], object]] = {ROADMAP: partial(_save_roadmap, answer, part)}
    for result in answer.results if pictures else ():
        suffix = suffix_of(result.action.name, [each.action.name for each in answer.results])
        saves[f'transitions{suffix}.png'] = result.save_picture
    return saves


def _save_roadmap(answer: Answer, part: Part, path: Path) -> None:
    try:
        weights = estimate(part, ['csa']).estimates['csa'].probabilities
    except NotDefinedError:
        weights = None
    matrices = {each.action.name: (each.matrix, each.action.values) for each in answer.results}
    document = roadmap_document(part, answer.results[0].drop, weights, matrices)
    save_text(path, to_json(document))


def _write_page(answer: Answer, out: Path) -> Path:
    """Write the page with its figures and return its path; raises OutputError."""
    print('writing the report ...', file=sys.stderr)
    plan = answer.plan if len(answer.results) > 1 else None
    return write_page(reorientation_page(answer.results, wanted=answer.wanted, plan=plan), out)

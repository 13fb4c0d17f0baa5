"""What `resting_aspects estimate` does: load a part, estimate, and show."""

import argparse
import sys
from collections.abc import Mapping, Sequence

import numpy as np

from resting_aspects_ros.commands.answer import make_console, show_table
from resting_aspects_ros.commands.counts_files import read_counts
from resting_aspects_ros.commands.estimate import ALL
from resting_aspects_ros.commands.given_counts import GivenCounts, check_against
from resting_aspects_ros.commands.given_part import given_part
from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.comparison import compare_with_exact
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.estimators.estimate import METHODS, Estimate, estimate_each
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.intervals import Array
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.report.estimate_document import against_fields, estimate_document
from resting_aspects_ros.report.estimate_table import estimate_table

# Of the tables that are drawn for p values: the same question has the same answer.
SEED = 1


def estimate_here(arguments: argparse.Namespace) -> int:
    """Load, estimate and show; returns the exit code.

    Raises RestingAspectsError for wrong input, NotDefinedError if no method asked for is defined.
    """
    names = _methods(arguments.method)
    part = given_part(arguments.part, arguments.unit, arguments.parts)
    for warning in part.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    shape = RestingShape(part)
    against = None if arguments.against is None else read_counts(arguments.against)
    if against is not None:
        check_against(against, part.name, part.part_sha256, shape.aspects)
    estimates, reasons = _estimates(shape, names)
    show_estimates(part, shape.aspects, estimates, reasons, against, as_json=arguments.json)
    return 0


def show_estimates(
    part: Part,
    aspects: AspectSet,
    estimates: Mapping[str, Estimate | None],
    reasons: Mapping[str, str],
    against: GivenCounts | None = None,
    *,
    as_json: bool,
) -> None:
    """On standard output, as a document and nothing else, or as a table."""
    by_class = against is not None and against.by_class
    shares = {
        name: None if found is None else _of_classes(found) if by_class else found.probabilities
        for name, found in estimates.items()
    }
    deviations = {
        name: compare_with_exact(against.tally, share, np.random.default_rng(SEED))
        for name, share in shares.items()
        if share is not None and against is not None
    }
    if as_json:
        document = estimate_document(part, estimates, reasons)
        if against is not None:
            document['against'] = against_fields(
                str(against.path), against.tally, deviations, by_class=by_class
            )
        sys.stdout.write(to_json(document))
        return
    console = make_console()
    show_table(
        console,
        estimate_table(
            aspects,
            shares,
            _title(part, against),
            None if against is None else against.tally,
            deviations,
            by_class=by_class,
        ),
    )
    for reason in reasons.values():
        console.print(f'{reason}.', markup=False, highlight=False)


def _methods(text: str) -> list[str]:
    """Those that are named, in the order of METHODS; raises InvalidValueError."""
    asked = list(METHODS) if text == ALL else [name.strip() for name in text.split(',')]
    for name in asked:
        if name not in METHODS:
            raise InvalidValueError(
                f'--method is {text!r}, allowed is {ALL}, or some of {", ".join(METHODS)} with '
                'commas between'
            )
    return [name for name in METHODS if name in asked]


def _estimates(
    shape: RestingShape, names: Sequence[str]
) -> tuple[dict[str, Estimate | None], dict[str, str]]:
    """By method what it says, or why it says nothing."""
    found, reasons = estimate_each(shape, names)
    if len(reasons) == len(names):
        raise NotDefinedError('; '.join(reasons.values()))
    return {name: found.get(name) for name in names}, reasons


def _of_classes(found: Estimate) -> Array:
    """(c,) probability of each symmetry class, by number from 1."""
    numbers = [aspect.symmetry_class for aspect in found.aspects.aspects]
    return np.asarray(np.bincount(numbers, weights=found.probabilities)[1:], dtype=np.float64)


def _title(part: Part, against: GivenCounts | None) -> str:
    title = f'{part.name}: probability by method, %'
    return title if against is None else f'{title}\nagainst {against.title}'

"""`resting_aspects classify`: sort a file of resting poses, with or without the part."""

import argparse
from pathlib import Path

from resting_aspects_ros.api.classify import ClassificationResult, PartClassification, classify
from resting_aspects_ros.aspects.clusters import DEFAULT_TOLERANCE_DEGREES
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import DONE, show_result
from resting_aspects_ros.cli.options import (
    add_output,
    add_part_place,
    refuse,
    requested_part,
)
from resting_aspects_ros.errors import one_line
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.comparison import (
    agreement_line,
    agreement_table,
    cluster_table,
    differences_table,
)

DESCRIPTION = """Sort resting poses into clusters by their orientations alone: two poses are
the same if they differ by a turn about the vertical. With --part, also sort
them by the aspects that follow from its shape, and list the poses for which
cluster and aspect do not correspond."""
EXAMPLES = """examples:
  resting_aspects classify poses.csv
  resting_aspects classify poses.csv --part l_bracket
  resting_aspects classify poses.csv --part my_part.stl --json > o.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'poses',
        metavar='POSES.csv',
        type=Path,
        help='a line of names with qx, qy, qz, qw or x, y, z, w among them, in any order, '
        'then a line for each pose: unit quaternions, world from part, z up. If there is a '
        'column status, only rows with SETTLED are sorted',
    )
    parser.add_argument('--part', metavar='PART_OR_MESH', help='name of a part, or a mesh file')
    add_part_place(parser)
    parser.add_argument(
        '--tolerance',
        metavar='DEG',
        help='poses whose down directions are at most this apart belong to one cluster, and so '
        'do chains of such poses (5): 1 to 30 degrees',
    )
    add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> int:
    """Classify and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    degrees = DEFAULT_TOLERANCE_DEGREES
    if arguments.tolerance is not None:
        degrees = parse_quantity('--tolerance', arguments.tolerance, '')
    part = _part(arguments)
    result = classify(arguments.poses, part, tolerance=degrees)
    title = f'{one_line(arguments.poses.name)}, {result.poses.drops} poses'

    def show() -> None:
        if result.by_part is None:
            _show_clusters(title, result)
        else:
            _show_aspects(title, result, result.by_part)

    show_result(arguments, result.to_json, show)
    return DONE


def _part(arguments: argparse.Namespace) -> Part | None:
    if arguments.part is not None:
        return requested_part(arguments)
    refuse(arguments, ('unit', 'body', 'parts'), 'with --part')
    return None


def _show_clusters(title: str, result: ClassificationResult) -> None:
    count = len(result.clusters)
    title += f', {count} cluster' if count == 1 else f', {count} clusters'
    show_table(cluster_table(result.cluster_distribution, result.clusters, title))


def _show_aspects(title: str, result: ClassificationResult, found: PartClassification) -> None:
    title += f' of {found.part.name}'
    show_table(agreement_table(found.distribution, found.agreement, result.clusters, title))
    show_texts(agreement_line(found.agreement, found.differences))
    if len(found.differences):
        places = result.poses.index, result.poses.line
        show_table(differences_table(found.differences, result.clusters, *places))

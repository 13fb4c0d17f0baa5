"""`resting_aspects classify`: sort a file of resting poses, with or without the part."""

import argparse
from pathlib import Path

from resting_aspects_ros.api.classify import classify
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import show_result
from resting_aspects_ros.errors import one_line
from resting_aspects_ros.report.comparison import (
    agreement_line,
    agreement_table,
    cluster_table,
)

DESCRIPTION = """Sort resting poses into clusters by their orientations alone: two poses are
the same if they differ by a turn about the vertical. With --part, also sort
them by the aspects that follow from its shape; --json lists the poses for
which cluster and aspect do not correspond."""
EXAMPLES = """examples:
  resting_aspects classify poses.csv
  resting_aspects classify poses.csv --part l_bracket
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
    options.add_part_place(parser)
    options.add_number(
        parser,
        '--tolerance',
        '',
        'poses whose down directions are at most this apart belong to one cluster, and so do '
        'chains of such poses (5): 1 to 30 degrees',
        default='5',
    )
    options.add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> None:
    """Classify and show. Raises RestingAspectsError for wrong input."""
    part = None
    if arguments.part is not None:
        part = options.requested_part(arguments)
    else:
        options.refuse(arguments, ('unit', 'body', 'parts'), 'with --part')
    result = classify(arguments.poses, part, tolerance=arguments.tolerance)
    title = f'{one_line(arguments.poses.name)}, {result.poses.drops} poses'

    def show() -> None:
        found = result.by_part
        if found is None:
            count = len(result.clusters)
            clusters = f'{title}, {count} cluster{"" if count == 1 else "s"}'
            show_table(cluster_table(result.cluster_distribution, result.clusters, clusters))
            return
        aspects = f'{title} of {found.part.name}'
        show_table(agreement_table(found.distribution, found.agreement, result.clusters, aspects))
        show_texts(agreement_line(found.agreement, found.differences))

    show_result(arguments, result.to_json, show)

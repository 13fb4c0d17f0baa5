"""`resting_aspects classify`: sort a file of resting poses, with or without the part."""

import argparse
import sys
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.inputs.pose_csv import PosesFile, read_poses_file
from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.options import add_output, add_part_place, parse_quantity
from resting_aspects_ros.cli.part_argument import part_of
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.clusters import (
    DEFAULT_TOLERANCE_DEGREES,
    Clusters,
    check_tolerance,
    find_clusters,
)
from resting_aspects_ros.core.errors import InvalidValueError, one_line, shown, warn
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import down_in_part
from resting_aspects_ros.core.statistics.agreement import compare, find_differences
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.report.cluster_report import (
    agreement_fields,
    agreement_line,
    agreement_table,
    cluster_document,
    cluster_table,
    differences_table,
)
from resting_aspects_ros.report.document import to_json

# Without a part one pose has nothing that it could be compared with.
AT_LEAST, AT_LEAST_WITH_PART = 2, 1
INVERSE = np.array([-1.0, -1.0, -1.0, 1.0])

DESCRIPTION = """Sort resting poses by their orientations alone: two are the same if they
differ by a turn about the vertical. With --part also by the aspects that
follow from its shape; then poses on which the two differ are listed. They
agree on a pose that is in an aspect and in the cluster that goes with it."""
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
        'then a line for each pose: unit quaternions, world from part, z up. Of a column '
        'status only SETTLED is sorted',
    )
    parser.add_argument('--part', metavar='PART_OR_MESH', help='name of a part, or a mesh file')
    add_part_place(parser)
    parser.add_argument(
        '--tolerance',
        metavar='DEG',
        help='poses whose down directions are at most this apart are the same, and so on '
        'from each to the next (5): 1 to 30 degrees',
    )
    add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    degrees = DEFAULT_TOLERANCE_DEGREES
    if arguments.tolerance is not None:
        degrees = parse_quantity('--tolerance', arguments.tolerance, '')
    tolerance = float(np.radians(degrees))
    check_tolerance(tolerance)
    part = _part(arguments)
    poses = read_poses_file(arguments.poses, AT_LEAST if part is None else AT_LEAST_WITH_PART)
    clusters = find_clusters(down_in_part(poses.orientation), tolerance)
    if part is None:
        _show_clusters(arguments, poses, clusters, tolerance)
    else:
        _show_agreement(arguments, poses, clusters, part, tolerance)
    return 0


def _part(arguments: argparse.Namespace) -> Part | None:
    if arguments.part is not None:
        return part_of(arguments)
    for name in ('unit', 'body', 'parts'):
        if (value := getattr(arguments, name)) is not None:
            raise InvalidValueError(
                f'invalid --{name} {shown(str(value))}: expected only with --part'
            )
    return None


def _show_clusters(
    arguments: argparse.Namespace, poses: PosesFile, clusters: Clusters, tolerance: float
) -> None:
    distribution = _cluster_distribution(poses, clusters)
    if arguments.json:
        sys.stdout.write(to_json(cluster_document(distribution, clusters, tolerance)))
        return
    name = one_line(arguments.poses.name)
    title = f'{name}, {poses.drops} poses, {_words(len(clusters), "cluster")}'
    show_table(make_console(), cluster_table(distribution, clusters, title))


def _show_agreement(
    arguments: argparse.Namespace,
    poses: PosesFile,
    clusters: Clusters,
    part: Part,
    tolerance: float,
) -> None:
    aspects = find_aspects(part)
    ids = aspects.classify(poses.orientation)
    agreement = compare(ids, len(aspects), clusters)
    differences = find_differences(agreement, aspects, down_in_part(poses.orientation))
    by_id = np.bincount(ids, minlength=len(aspects) + 1)
    distribution = Distribution(
        aspects, by_id[1:], int(by_id[0]), unsettled=poses.unsettled, failed=poses.failed
    )
    _warn_of_another_part(arguments.poses, poses, part, aspects, distribution.unclassified)
    if arguments.json:
        document = cluster_document(_cluster_distribution(poses, clusters), clusters, tolerance)
        places = poses.index, poses.line
        fields = agreement_fields(distribution, agreement, differences, places)
        named = {'part': part.name, 'part_sha256': part.part_sha256}
        sys.stdout.write(to_json(document | named | fields))
        return
    console = make_console()
    title = f'{one_line(arguments.poses.name)}, {poses.drops} poses of {part.name}'
    show_table(console, agreement_table(distribution, agreement, clusters, title))
    console.print(agreement_line(agreement, differences), markup=False, highlight=False)
    if len(differences):
        show_table(console, differences_table(differences, clusters, poses.index, poses.line))


def _cluster_distribution(poses: PosesFile, clusters: Clusters) -> Distribution:
    """Shares of clusters in all poses, counted like those of aspects."""
    nothing = AspectSet('', ())
    return Distribution(nothing, clusters.counts, 0, poses.unsettled, poses.failed)


def _warn_of_another_part(
    path: Path, poses: PosesFile, part: Part, aspects: AspectSet, unclassified: int
) -> None:
    """Say on standard error if most poses fit no aspect, and what might be the reason."""
    settled = len(poses.index)
    if unclassified <= settled / 2:
        return
    inverse = aspects.classify(poses.orientation * INVERSE)
    hint = (
        'the inverse rotations fit, so they may be part from world'
        if np.count_nonzero(inverse) > settled / 2
        else 'is this the pose file of another part, or in another unit or frame?'
    )
    warn(
        f'{unclassified} of {settled} settled poses in {str(path)!r} are in no aspect of '
        f'{part.name!r}: {hint}'
    )


def _words(number: int, word: str) -> str:
    return f'{number} {word}' if number == 1 else f'{number} {word}s'

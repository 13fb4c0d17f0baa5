"""`resting_aspects report`: a page with pictures and charts of a result."""

import argparse
from pathlib import Path

from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.result import make_folder, write_page
from resting_aspects_ros.api.result_json import document_result
from resting_aspects_ros.cli import options
from resting_aspects_ros.logs.bag import is_log
from resting_aspects_ros.report.page import Text

DESCRIPTION = """Write report.html, one file that needs no network. It shows the part in 3D, a
picture and the probability of each aspect, charts, and all conditions. The
figures are also written as PNG and SVG."""
EXAMPLES = """examples:
  resting_aspects report out/nut/distribution.json
  resting_aspects report result/distribution.json --against counted_by_hand.csv
  resting_aspects report request.json --part my_part.stl --unit in
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'result',
        metavar='LOG_OR_JSON',
        type=Path,
        help='a log (the folder of a run, or its .mcap file), or a JSON document of drop or '
        'request',
    )
    parser.add_argument(
        '--against',
        metavar='COUNTS',
        type=Path,
        help='compare it with manual counts (a CSV with aspect or class, and count), a log or a '
        'JSON document',
    )
    options.add_out(parser, 'folder of the files (out/ and the part)')
    parser.add_argument(
        '--part',
        metavar='PART_OR_MESH',
        help='the part of a JSON document (the mesh file or the part that the document names)',
    )
    options.add_part_place(parser)


def run(arguments: argparse.Namespace) -> None:
    """Read the result and write the report. Raises RestingAspectsError."""
    result = _read_result(arguments)
    against, verdict = None, ''
    if arguments.against is not None:
        against = read_counts(arguments.against)
        verdict = compare(result, against).verdict
    folder = arguments.out or Path('out') / result.run.part
    make_folder('--out', folder)
    page = result.page(against)
    print(f'Report: {write_page(page, folder)}')
    for item in (each for section in page.sections for each in section.items):
        if isinstance(item, Text) and item.style == 'verdict':
            verdict = item.text  # by the rows of the page, as in it
    if verdict:
        print(verdict)


def _read_result(arguments: argparse.Namespace) -> DropResult:
    path: Path = arguments.result
    if not is_log(path):
        return document_result(
            path, arguments.part, arguments.unit, arguments.parts, arguments.body
        )
    names = 'part', 'unit', 'body', 'parts'
    options.refuse(arguments, names, 'with a JSON document; a log contains its part')
    # This imports ROS, which a JSON document does not need.
    from resting_aspects_ros.run_logs import logged_result

    return logged_result(path)

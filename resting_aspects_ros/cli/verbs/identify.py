"""`resting_aspects identify`: tell from an observed outline which part lies where and how."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from resting_aspects_ros.cli.options import (
    add_output,
    add_part_place,
)
from resting_aspects_ros.cli.values import parse_quantity

if TYPE_CHECKING:
    from resting_aspects_ros.core.vision.identification import Identification

DESCRIPTION = """Tell from an observed outline which part lies where and in which aspect. The
prior is the distribution that `estimate` predicts. 'None of these' and
'touching parts' are answers, too."""
EXAMPLES = """examples:
  resting_aspects identify l_bracket --polygon seen.json
  resting_aspects identify l_bracket hex_nut --polygon seen.json --json
  resting_aspects identify my_part.stl --polygon seen.json --noise 0.2mm
"""
MAX_BYTES = 1 << 24


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        'parts_', metavar='PART_OR_MESH', nargs='+', help='names of parts, or mesh files'
    )
    parser.add_argument(
        '--polygon',
        metavar='FILE',
        type=Path,
        required=True,
        help='JSON file {"outer": [[x, y], ...], "holes": [[[x, y], ...], ...]} in m, on the tray '
        'seen from above, x to the right and y up; holes can be left out if '
        'the part has none',
    )
    parser.add_argument(
        '--noise',
        metavar='M',
        default='0.1mm',
        help='standard deviation of the boundary, such as 0.2mm (0.1mm)',
    )
    add_part_place(parser)
    add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> int:
    """Identify and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    # These imports are slow because of NumPy and shapely.
    from resting_aspects_ros.api.identify import identification_json, identify_part
    from resting_aspects_ros.api.inputs.json_document import parse_json
    from resting_aspects_ros.api.load_part import load_part
    from resting_aspects_ros.core.input_file import read_input
    from resting_aspects_ros.core.vision.likelihood import OutlineNoise

    noise = OutlineNoise(parse_quantity('--noise', arguments.noise, 'm'))
    path = arguments.polygon
    text = read_input(path, MAX_BYTES, 'polygon').decode('utf-8', 'replace')
    polygon = parse_json(path, text)
    parts = [
        load_part(part, arguments.unit, arguments.parts, arguments.body)
        for part in arguments.parts_
    ]
    found = identify_part(polygon, parts, noise=noise)
    if arguments.json:
        sys.stdout.write(identification_json(found))
    else:
        _show(found, path.name)
    return 0


def _show(found: 'Identification', name: str) -> None:
    """Print the candidates and the other answers as a table."""
    import numpy as np

    from resting_aspects_ros.cli.console import make_console, show_table
    from resting_aspects_ros.core.errors import one_line
    from resting_aspects_ros.report.table import plain_table

    headings = (
        'part',
        'aspects',
        'probability',
        'x (mm)',
        'y (mm)',
        'yaw (deg)',
        'residual\n(mm)',
    )
    table = plain_table(f'{one_line(name)}: {_answer(found)}', *headings)
    for each in found.candidates:
        table.add_row(
            each.part,
            ', '.join(map(str, each.aspects)),
            f'{100 * each.posterior:.1f} %',
            f'{1000 * each.x:.2f}',
            f'{1000 * each.y:.2f}',
            f'{np.degrees(each.yaw):.1f}',
            f'{1000 * each.residual:.3f}',
        )
    table.add_section()
    for label, share in (('none of these', found.none), ('touching parts', found.touching)):
        table.add_row(label, '', f'{100 * share:.1f} %')
    show_table(make_console(), table)


def _answer(found: 'Identification') -> str:
    """Return the most probable answer in words."""
    best = found.best
    if best is None:
        return 'touching parts' if found.answer == 'touching' else 'none of these'
    aspects = ', '.join(map(str, best.aspects))
    return f'{best.part}, aspect{"s" if len(best.aspects) > 1 else ""} {aspects}'

"""`resting_aspects identify`: tell from an observed outline which part lies where and how."""

import argparse
from pathlib import Path

import numpy as np

from resting_aspects_ros.api import identify
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import show_result
from resting_aspects_ros.errors import InvalidValueError, located, one_line, shown
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.vision.camera import Pinhole, surface_pinhole
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import Identification

DESCRIPTION = """Tell from an observed outline which part lies where and in which aspect. The
prior is the distribution of 1000 drops on rubber_mat. 'None of these' and
'touching parts' are answers, too."""
EXAMPLES = """examples:
  resting_aspects identify l_bracket --polygon seen.json
  resting_aspects identify l_bracket hex_nut --polygon seen.json --json
  resting_aspects identify l_bracket --polygon seen.json --camera 0mm,50mm,600mm
"""
TELECENTRIC = (
    'The outline is taken as seen from straight above (telecentric lens); for a lens with '
    'perspective, give --camera.'
)


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
        'seen from above, x to the right and y up; through-holes are part of the outline',
    )
    text = 'standard deviation of the boundary, such as 0.2mm (0.1mm)'
    options.add_number(parser, '--noise', 'm', text, default='0.1mm')
    parser.add_argument(
        '--camera',
        metavar='X,Y,HEIGHT',
        type=_camera,
        help='position of a camera with perspective in the tray frame, such as 0mm,50mm,600mm; '
        'the polygon is what it sees on the surface (none: a telecentric lens)',
    )
    options.add_part_place(parser)
    options.add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> None:
    """Identify and show. Raises RestingAspectsError for wrong input."""
    noise, camera = OutlineNoise(arguments.noise), arguments.camera
    path = arguments.polygon
    seen = identify.read_polygon(path)
    parts = [options.requested_part(arguments, given) for given in arguments.parts_]
    known = [identify.known_part(part) for part in parts]
    found = identify.identify_part(seen, known, noise=noise, camera=camera)
    hint = identify.identification_hint(found, seen, known)
    shown_hint = hint if camera else f'{hint} {TELECENTRIC}'.strip()
    show_result(
        arguments,
        lambda: to_json({**identify.identification_document(found), 'hint': hint or None}),
        lambda: _show(found, path.name, shown_hint),
    )


def _camera(text: str) -> Pinhole:
    """Return the camera at a position; raises InvalidValueError."""
    values = text.split(',')
    if len(values) != 3:
        raise InvalidValueError(
            f'invalid --camera {shown(text)}: expected x, y and height, such as 0mm,50mm,600mm'
        )
    position = [parse_quantity('--camera', value, 'm') for value in values]
    with located('--camera'):
        return surface_pinhole(position)


def _show(found: Identification, name: str, hint: str) -> None:
    """Print the candidates and the other answers as a table, and remarks below it."""
    headings = (
        'part',
        'aspects',
        'probability',
        'x (mm)',
        'y (mm)',
        'yaw (deg)',
        'residual\n(mm)',
    )
    table = Table(f'{one_line(name)}: {_answer(found)}', headings)
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
    show_table(table)
    show_texts(hint)


def _answer(found: Identification) -> str:
    """Return the most probable answer in words."""
    best = found.best
    if best is None:
        return 'touching parts' if found.answer == 'touching' else 'none of these'
    aspects = ', '.join(map(str, best.aspects))
    return f'{best.part}, aspect{"s" if len(best.aspects) > 1 else ""} {aspects}'

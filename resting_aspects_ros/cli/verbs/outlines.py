"""`resting_aspects outlines`: what a camera straight above sees of a part in each aspect."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from resting_aspects_ros.api.outlines import (
    COCO,
    DOCUMENT,
    OutlinesResult,
    check_sheet_name,
    outlines,
)
from resting_aspects_ros.api.result import check_output
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import result_folder, show_result
from resting_aspects_ros.report.format import size_text
from resting_aspects_ros.report.outlines import (
    PIXELS_PER_MM,
    confused_class_texts,
    family_texts,
    outline_table,
)

DESCRIPTION = """Show and export the outline that a camera straight above sees of a part in each
of its aspects, and which classes of aspects look alike. No drops are needed."""
EXAMPLES = """examples:
  resting_aspects outlines l_bracket
  resting_aspects outlines my_part.stl --out outlines --px-per-mm 20
  resting_aspects outlines hex_nut --counting-sheet sheet.pdf
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    options.add_part(parser)
    options.add_out(
        parser,
        'write into this folder: JSON, for each class drawings (SVG and DXF) at true size, '
        'a template and a mask (PNG), and COCO annotations',
    )
    text = 'pixels of the templates and masks for each mm on the tray (10)'
    options.add_number(parser, '--px-per-mm', '', text)
    parser.add_argument(
        '--counting-sheet',
        metavar='FILE',
        type=Path,
        help='write a sheet for counting by hand, A4: a .pdf or .svg file with picture, outline '
        'and tally boxes of each class',
    )
    options.add_output(parser, each=False)


def run(arguments: argparse.Namespace) -> None:
    """Find, show and export the outlines. Raises RestingAspectsError."""
    sheet = arguments.counting_sheet
    if arguments.out is None:
        options.refuse(arguments, ('px_per_mm',), 'with --out')
    scale = PIXELS_PER_MM if arguments.px_per_mm is None else arguments.px_per_mm
    if sheet is not None:
        check_sheet_name('--counting-sheet', sheet)
    part = options.requested_part(arguments)
    out = result_folder(arguments, part.name, (DOCUMENT, COCO))
    check_output('--counting-sheet', sheet)
    result = outlines(part)
    written = []
    if out is not None:
        number = len(result.save(out, scale))
        written.append(
            f'Written: {number} files in {out}: outlines.json (all outlines), coco.json\n'
            '(annotations), and for each class, such as 1, class_1.svg, class_1.dxf,\n'
            'class_1_template.png and class_1_mask.png'
        )
    if sheet is not None:
        result.save_counting_sheet(sheet)
        written.append(f'Counting sheet: {sheet}')
    show_result(arguments, result.to_json, lambda: _show(result, written))


def _show(result: OutlinesResult, written: Sequence[str]) -> None:
    """Print the table, a sentence for each group of classes that look alike, and the files."""
    number = len(result.outlines)
    title = f'{result.part.name}, {size_text(result.part)}: ' + (
        f'{number} outlines' if number != 1 else '1 outline'
    )
    table = outline_table(result.outlines, result.look_alikes, result.aspects, title)
    show_table(table)
    confused = confused_class_texts(result.outlines, result.look_alikes)
    if not confused and number > 1:
        confused = ['A camera straight above can distinguish all classes by their outlines.']
    show_texts(*confused, *family_texts(result.outlines))
    for line in written:
        print(line)

"""What a camera above sees of the part, and which classes look alike."""

import base64

from resting_aspects_ros.api.outlines import OutlinesResult, outlines
from resting_aspects_ros.report.format import aspect_colour, aspects_text, size_text
from resting_aspects_ros.report.outlines import (
    confused_class_texts,
    family_texts,
    members,
    outline_table,
    pair_table,
    svg_drawing,
)
from resting_aspects_ros.report.page import Gallery, Item, Text, Tile
from resting_aspects_ros.studio.recipe import outlines_recipe
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings
from resting_aspects_ros.studio.work import Work, controls_html

FILES = ('counting_sheet.pdf', 'outlines.zip')


def controls(settings: Settings, opened: Opened) -> str:
    """Return the links to the counting sheet and the drawings."""
    del settings, opened
    return controls_html('downloads', names=FILES)


def show(work: Work) -> None:
    """Find and show the outlines."""
    work.publish('same', {'text': outlines_recipe(work.opened.source).line})
    part = work.opened.part
    result: OutlinesResult = work.keep(('outlines', part.part_sha256), lambda: outlines(part))
    seen, alike = result.outlines, result.look_alikes
    confused = confused_class_texts(seen, alike)
    items: list[Item] = [
        Text(f'{part.name}, {size_text(part)}', 'verdict'),
        Gallery([_tile(result, k) for k in range(len(seen))]),
        *(Text(text, 'note') for text in confused),
        outline_table(seen, alike, result.aspects, ''),
        *(Text(text, 'plain') for text in family_texts(seen)),
    ]
    if len(seen) > 1:
        items.append(pair_table(seen, alike, ''))
    work.show('outlines', items)


def _tile(result: OutlinesResult, k: int) -> Tile:
    outline = result.outlines[k]
    alike = members(outline, result.aspects)
    name = f'class {outline.symmetry_class}'
    drawing = svg_drawing(outline.polygon, name).encode()
    picture = f'data:image/svg+xml;base64,{base64.b64encode(drawing).decode()}'
    return Tile(name, aspect_colour(alike[0]), picture, [aspects_text(alike)])

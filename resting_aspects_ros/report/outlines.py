"""Outlines as a document, a table, drawings at true size, and images, also on that of a tray."""

import io
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter
from shapely import Polygon, affinity

from resting_aspects_ros.arrays import Array, Bytes
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, numbers
from resting_aspects_ros.report.figure import FAINT, PAPER, TEXT, new_figure
from resting_aspects_ros.report.format import (
    COLOURS,
    GREY,
    ids_text,
    list_text,
    millimetre_texts,
    millimetres_text,
    number_text,
    numbers_text,
)
from resting_aspects_ros.report.table import NOTHING, Table
from resting_aspects_ros.vision.outline import (
    LookAlike,
    Outline,
    covered_share,
    rings,
    same_groups,
)
from resting_aspects_ros.vision.tray_image import TrayCamera

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LookAlikes = Mapping[int, Sequence[LookAlike]]


def outlines_document(
    part: Part, outlines: Sequence[Outline], look_alikes: LookAlikes
) -> dict[str, object]:
    """Return the outlines of a part as a document of plain JSON types. Nothing is rounded.

    By symmetry class: lengths in m, areas in m2, angles in rad, coordinates in the axes of the
    tray with the origin below the centre of mass. docs/reference/files.md describes the keys.
    """
    return {
        'schema_version': SCHEMA_VERSION,
        'part': part.name,
        'mesh_sha256': part.mesh_sha256,
        'part_sha256': part.part_sha256,
        'outlines': [_fields(each, look_alikes[each.symmetry_class]) for each in outlines],
    }


def _fields(outline: Outline, others: Sequence[LookAlike]) -> dict[str, object]:
    return {
        'aspects': list(outline.aspects),
        'symmetry_class': outline.symmetry_class,
        **polygon_fields(outline.polygon),
        'area': outline.area,
        'length': outline.length,
        'width': outline.width,
        'height': outline.height,
        'com_height': outline.com_height,
        'centroid': numbers(outline.centroid),
        'long_axis': outline.long_axis,
        'orientation': numbers(outline.orientation),
        'yaw_symmetry': outline.yaw_symmetry,
        'mirrored': [each.symmetry_class for each in others if each.verdict == 'mirrored'],
        'mirror_symmetric': bool(outline.mirror_symmetric),
        'family': [polygon_fields(each) for each in outline.family],
        'look_alike': [
            {
                'symmetry_class': each.symmetry_class,
                'overlap': each.overlap,
                'verdict': each.verdict,
                'resolution': each.resolution,
            }
            for each in others
        ],
    }


def polygon_fields(polygon: Polygon) -> dict[str, object]:
    """Return ``outer`` and ``holes`` of a polygon: corners [x, y], the first one not repeated."""
    return {
        'outer': numbers(np.asarray(polygon.exterior.coords)[:-1]),
        'holes': [numbers(np.asarray(hole.coords)[:-1]) for hole in polygon.interiors],
    }


# Outlines that differ by less than this share of their length are hard to distinguish.
HARD = 0.02
# Heights that differ by more than this share of the larger one distinguish classes.
HEIGHT_DIFFERENCE = 0.05
# Maximum number of classes in the list of those that look like a class.
MAX_LISTED = 3
_VERDICTS = ('same', 'mirrored', 'distinct')


def members(outline: Outline, aspects: AspectSet) -> tuple[Aspect, ...]:
    """Return the aspects of the symmetry class of an outline."""
    return tuple(aspect for aspect in aspects if aspect.id in outline.aspects)


def outline_table(
    outlines: Sequence[Outline], look_alikes: LookAlikes, aspects: AspectSet, title: str
) -> Table:
    """Return a table with a row for each symmetry class; it fits 80 columns and is ASCII."""
    headings = (
        'class',
        'aspects',
        'length x width\nx height (mm)',
        'area\n(mm2)',
        'yaw\nsymmetry',
        'looks like',
    )
    table = Table(title, headings, texts={'looks like'}, wrapped='looks like')
    sizes = [[each.length, each.width, each.height] for each in outlines]
    texts = iter(millimetre_texts(np.ravel(sizes)))
    for each in outlines:
        table.add_row(
            str(each.symmetry_class),
            ids_text(members(each, aspects)),
            ' x '.join(next(texts) for _ in range(3)),
            number_text(1e6 * each.area),
            yaw_symmetry_text(each.yaw_symmetry),
            look_alike_text(each, look_alikes[each.symmetry_class]) or NOTHING,
        )
    return table


def pair_table(outlines: Sequence[Outline], look_alikes: LookAlikes, title: str) -> Table:
    """Return a table of all pairs of classes, those that a camera confuses most easily first.

    A camera that does not resolve the stated distance cannot distinguish the classes.
    """
    pairs = [
        (each.symmetry_class, other)
        for each in outlines
        for other in look_alikes[each.symmetry_class]
        if each.symmetry_class < other.symmetry_class
    ]
    headings = ('classes', 'outlines', 'resolution that separates them')
    table = Table(title, headings, texts={'outlines'})
    for number, other in sorted(pairs, key=lambda pair: _order(pair[1])):
        distance = f'{millimetres_text(other.resolution)} mm'
        separates = distance if other.verdict == 'distinct' else NOTHING
        table.add_row(f'{number} and {other.symmetry_class}', other.verdict, separates)
    return table


def yaw_symmetry_text(order: int) -> str:
    """Return by which turns an outline looks the same: 'none', '120 deg' or 'any turn'."""
    if order == 1:
        return 'none'
    return f'{360 / order:.4g} deg' if order else 'any turn'


def confused_class_texts(outlines: Sequence[Outline], look_alikes: LookAlikes) -> list[str]:
    """Return a sentence for each reason why a camera confuses classes of outline_table."""
    by_number = {each.symmetry_class: each for each in outlines}
    groups = same_groups(look_alikes)
    texts = [_same_text([by_number[k] for k in group]) for group in groups if len(group) > 1]
    near = [
        each
        for outline in outlines
        for each in _near(outline, look_alikes[outline.symmetry_class])
        if each.verdict != 'same'
    ]
    if near:
        needed = millimetres_text(min(each.resolution for each in near))
        texts.append(
            f'To distinguish {"the other" if texts else "all"} classes by their outlines, the '
            f'camera must resolve details of {needed} mm.'
        )
    if any(each.verdict == 'mirrored' for each in near):
        texts.append('A match must not accept mirrored outlines.')
    return texts


def family_texts(outlines: Sequence[Outline]) -> list[str]:
    """Return a sentence for each class whose outline changes as the part rolls or rocks."""
    return [
        f'The outline of class {each.symmetry_class} changes while the part rolls or rocks: '
        f'--json contains {len(each.family)} more.'
        for each in outlines
        if each.family
    ]


def look_alike_text(outline: Outline, others: Sequence[LookAlike]) -> str:
    """Return the classes with which a camera confuses a class, with the reasons; can be empty."""
    near = _near(outline, others)
    texts = [
        f'{each.symmetry_class} ({each.verdict}'
        + (f' by {millimetres_text(each.resolution)} mm)' if each.verdict == 'distinct' else ')')
        for each in near[:MAX_LISTED]
    ]
    if len(near) > MAX_LISTED:
        texts.append(f'{len(near) - MAX_LISTED} more')
    return ', '.join(texts)


def _near(outline: Outline, others: Sequence[LookAlike]) -> list[LookAlike]:
    """Return the entries of classes that a camera can hardly distinguish, the worst first."""
    hard = HARD * outline.length
    near = [each for each in others if each.verdict != 'distinct' or each.resolution < hard]
    return sorted(near, key=_order)


def _order(entry: LookAlike) -> tuple[int, float]:
    return _VERDICTS.index(entry.verdict), entry.resolution


def _same_text(outlines: Sequence[Outline]) -> str:
    classes = numbers_text([each.symmetry_class for each in outlines])
    heights = sorted(each.height for each in outlines)
    clear = [high - low > HEIGHT_DIFFERENCE * high for low, high in pairwise(heights)]
    values = f'{list_text([millimetres_text(each.height) for each in outlines])} mm'
    needed = f'a measured height does: {values}'
    if not all(clear):
        needed = 'grey values of the upper side are needed'
    return f'Classes {classes} have the same outline. No resolution distinguishes them; {needed}.'


MM = 1000.0  # mm/m
# Room around the drawing, and width of its line, mm.
SVG_MARGIN, LINE = 1.0, 0.1


def svg_drawing(polygon: Polygon, title: str, colour: str = 'none') -> str:
    """Return the outline as an SVG file that is printed at its true size, filled with a colour.

    User units are mm, x to the right and y down, as SVG prescribes: the corner (x, y) of the
    outline is at (1000 x, -1000 y), and (0, 0) is below the centre of mass. Outer ring and holes
    are one path, ``outline``, which is filled by the rule 'evenodd'.
    """
    left, low, right, high = (MM * each for each in polygon.bounds)
    box = (
        left - SVG_MARGIN,
        -high - SVG_MARGIN,
        right - left + 2 * SVG_MARGIN,
        high - low + 2 * SVG_MARGIN,
    )
    path = ' '.join(
        f'M {" L ".join(f"{_number(MM * x)} {_number(-MM * y)}" for x, y in ring.tolist())} Z'
        for ring in rings(polygon)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_number(box[2])}mm" '
        f'height="{_number(box[3])}mm" viewBox="{" ".join(map(_number, box))}">\n'
        f'<title>{escape(title)}</title>\n'
        f'<path id="outline" fill="{colour}" fill-rule="evenodd" stroke="black" '
        f'stroke-width="{LINE}" d="{path}"/>\n'
        '</svg>\n'
    )


def dxf_drawing(polygon: Polygon) -> str:
    """Return the outline as a DXF file (R2010) in mm; (0, 0) is below the centre of mass.

    The outer ring is a closed LWPOLYLINE on the layer ``outer``, and each hole one on ``holes``.
    """
    import ezdxf
    from ezdxf import units

    drawing = ezdxf.new('R2010', units=units.MM)
    for layer in ('outer', 'holes'):
        drawing.layers.add(layer)
    space = drawing.modelspace()
    for number, ring in enumerate(rings(polygon)):
        layer = 'holes' if number else 'outer'
        space.add_lwpolyline((MM * ring).tolist(), close=True, dxfattribs={'layer': layer})
    file = io.StringIO()
    drawing.write(file)
    return file.getvalue()


def _number(value: float) -> str:
    """Return a number of mm with 1e-9 mm as its last digit, and without an exponent."""
    # Adding 0.0 turns -0.0 into 0.0.
    return np.format_float_positional(round(value, 9) + 0.0, trim='-')


PIXELS_PER_MM = 10.0
# Empty pixels around the part in each image.
MARGIN = 8
MAX_PIXELS = 1 << 24

# The entry of an image in a COCO document, and its annotation.
Described = tuple[dict[str, object], dict[str, object]]


@dataclass(frozen=True, eq=False)
class OutlineImage:
    """The image of an outline as a telecentric camera straight above sees it.

    Image coordinates are in pixels, x to the right and y down, and (0, 0) is the outer corner of
    the upper left pixel, whose centre is at (0.5, 0.5).

    scale : float
        px/m.
    origin : (2,) float
        Image coordinates of the origin of the outline, below the centre of mass.
    polygon : shapely.Polygon
        The outline in image coordinates.
    covered : (height, width) float
        Share of each pixel that the part covers.
    """

    symmetry_class: int
    scale: float
    origin: Array
    polygon: Polygon
    covered: Array

    @property
    def mask(self) -> Bytes:
        """The (height, width) image with 255 where at least half of the pixel is covered."""
        return np.where(self.covered >= 0.5, 255, 0).astype(np.uint8)

    @property
    def template(self) -> Bytes:
        """The (height, width) image on a backlight: the part 0, the surroundings 255."""
        return np.round(255 * (1 - self.covered)).astype(np.uint8)


def check_px_per_mm(outlines: Sequence[Outline], px_per_mm: float) -> None:
    """Raise InvalidValueError if an image would be too large, or a part smaller than a pixel."""
    sides = [np.ptp(np.reshape(each.polygon.bounds, (2, 2)), axis=0) * MM for each in outlines]
    largest = max((float(side.max()) for side in sides), default=1.0)
    smallest = min((float(side.max()) for side in sides), default=1.0)
    high = (MAX_PIXELS**0.5 - 2 * MARGIN - 2) / largest
    low = 1 / smallest
    if not low <= px_per_mm <= high:  # also refuses nan
        raise InvalidValueError(
            f'invalid px_per_mm {shown(px_per_mm)}: expected {low:.3g} to {high:.3g} for a part '
            f'of this size'
        )


def outline_image(outline: Outline, px_per_mm: float = PIXELS_PER_MM) -> OutlineImage:
    """Return the image of an outline; check_px_per_mm tells whether the scale is possible."""
    scale = MM * px_per_mm
    left, low, right, high = (scale * each for each in outline.polygon.bounds)
    # The origin is a corner of a pixel, so that the images of all classes have the same raster.
    origin = np.array([np.ceil(-left), np.ceil(high)]) + MARGIN
    width, height = np.ceil([right, -low]) + origin + MARGIN
    polygon = affinity.affine_transform(outline.polygon, [scale, 0, 0, -scale, *origin])
    covered = covered_share(polygon, int(width), int(height))
    return OutlineImage(outline.symmetry_class, scale, origin, polygon, covered)


def png_file(image: Bytes) -> bytes:
    """Return an 8-bit grey image as a PNG file."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(image).save(file, format='PNG')
    return file.getvalue()


def coco_document(part: Part, described: Sequence[Described]) -> dict[str, object]:
    """Return images and their annotations, from `described_image`, as a COCO document.

    The id of image, category and annotation is the number of the symmetry class.
    """
    numbers = [image['id'] for image, _ in described]
    return {
        'info': {'description': f'Outlines of {part.name}, one for each symmetry class'},
        'licenses': [],
        'images': [image for image, _ in described],
        'categories': [
            {'id': k, 'name': f'{part.name}_class_{k}', 'supercategory': part.name}
            for k in numbers
        ],
        'annotations': [annotation for _, annotation in described],
    }


def described_image(image: OutlineImage) -> Described:
    """Return the entry of an image in a COCO document, and its annotation.

    COCO polygons cannot have holes: a class without holes has a polygon, and a class with holes an
    uncompressed run-length encoding of its mask.
    """
    number, polygon = image.symmetry_class, image.polygon
    height, width = image.covered.shape
    entry = {
        'id': number,
        'file_name': template_name(number),
        'mask_file_name': mask_name(number),
        'width': width,
        'height': height,
        'px_per_mm': image.scale / MM,
        'origin': image.origin.tolist(),
    }
    left, top, right, bottom = polygon.bounds
    outer, *holes = rings(polygon)
    annotation = {
        'id': number,
        'image_id': number,
        'category_id': number,
        'iscrowd': 0,
        'segmentation': _runs(image.mask) if holes else [outer.ravel().tolist()],
        'area': float(np.count_nonzero(image.mask)) if holes else polygon.area,
        'bbox': [left, top, right - left, bottom - top],
    }
    return entry, annotation


def _runs(mask: Bytes) -> dict[str, object]:
    """Return the run-length encoding of a mask.

    These are the lengths of alternating runs, column by column, beginning with zeros.
    """
    flat = np.concatenate([[0], (mask > 0).T.ravel().astype(np.int8)])
    starts = np.flatnonzero(np.diff(flat))
    counts = np.diff(np.concatenate([[0], starts, [mask.size]]))
    return {'size': list(mask.shape), 'counts': counts.tolist()}


def template_name(symmetry_class: int) -> str:
    """Return the name of the template of a class."""
    return f'class_{symmetry_class}_template.png'


def mask_name(symmetry_class: int) -> str:
    """Return the name of the mask of a class."""
    return f'class_{symmetry_class}_mask.png'


# -- Picture of a tray ----------------------------------------------------------------------------


# Inches.
_WIDTH, _HEAD, _FOOT, _SIDE = 6.2, 0.78, 0.42, 0.12
DOTS_PER_INCH = 130
_CHARACTERS = 84


@dataclass(frozen=True)
class DrawnPart:
    """What a vision system has seen.

    symmetry_class : int
        0: not recognised, or parts that touch.
    x, y, yaw : float
        Camera pose, m and rad.
    rank : int
        Place among the parts to be picked, from 1; 0: it is not picked.
    """

    symmetry_class: int
    x: float
    y: float
    yaw: float
    rank: int = 0


def save_tray_picture(
    path: Path,
    image: Bytes,
    camera: TrayCamera,
    parts: Sequence[DrawnPart],
    outlines: Sequence[Outline],
    title: str,
    reason: str,
    pickable: Sequence[int],
) -> None:
    """Write a PNG file with the image of a tray (height, width), outlines of parts, and advice.

    ``outlines`` are those of all classes, and ``pickable`` the numbers of the pickable ones.
    ``title`` and ``reason`` are the advice in a few words, and its reason.
    """
    width, height = camera.size
    size = _WIDTH - 2 * _SIDE
    drawn = size * height / width
    total = _HEAD + drawn + _FOOT
    figure = new_figure(_WIDTH, total)
    axes = figure.add_axes((_SIDE / _WIDTH, _FOOT / total, size / _WIDTH, drawn / total))
    # Half of the contrast, so that outlines and numbers stand out.
    # Without the noise, the file is a fifth as large.
    smooth = 8 * np.rint(gaussian_filter(image.astype(np.float32), 1.5) / 8)
    axes.imshow(smooth, cmap='gray', vmin=-180, vmax=235, interpolation='nearest')
    axes.set_axis_off()
    for part in parts:
        _draw_part(axes, part, camera, outlines)
    left = _SIDE / _WIDTH
    figure.text(left, 1 - 0.3 / total, title, size=11, weight='bold', color=TEXT)
    text = '\n'.join(textwrap.wrap(reason, _CHARACTERS)[:2])
    figure.text(left, 1 - 0.44 / total, text, size=8, color=FAINT, va='top')
    seen = sorted({part.symmetry_class for part in parts})
    x = left
    for number in seen:
        name = 'not recognised, or touching'
        if number:
            name = f'class {number}' + (', pickable' if number in pickable else '')
        figure.text(x, 0.15 / total, '■', size=10, color=_colour(number))
        figure.text(x + 0.15 / _WIDTH, 0.16 / total, name, size=8, color=TEXT)
        x += (0.33 + 0.066 * len(name)) / _WIDTH
    figure.savefig(path, format='png', dpi=DOTS_PER_INCH, facecolor=PAPER)


def _draw_part(
    axes: 'Axes', part: DrawnPart, camera: TrayCamera, outlines: Sequence[Outline]
) -> None:
    """Draw the outline of a part with its class, or its place among the picks."""
    colour = _colour(part.symmetry_class)
    (point,) = camera.model.to_image([[part.x, part.y]])
    if part.symmetry_class:
        outline = outlines[part.symmetry_class - 1].polygon
        turned = affinity.rotate(outline, part.yaw, origin=(0, 0), use_radians=True)
        polygon = camera.to_image(affinity.translate(turned, part.x, part.y))
        for ring in (polygon.exterior, *polygon.interiors):
            u, v = shapely.get_coordinates(ring).T
            axes.plot(u, v, color=colour, linewidth=2.6 if part.rank else 1.4)
        (point,) = shapely.get_coordinates(polygon.representative_point())
    box = {'boxstyle': 'circle,pad=0.25', 'facecolor': colour, 'edgecolor': PAPER}
    text = f'{part.rank}' if part.rank else '' if part.symmetry_class else '?'
    if text:
        axes.text(
            float(point[0]),
            float(point[1]),
            text,
            bbox=box if part.rank else None,
            ha='center',
            va='center',
            color=PAPER,
            size=9,
            weight='bold',
        )


def _colour(symmetry_class: int) -> str:
    return COLOURS[(symmetry_class - 1) % len(COLOURS)] if symmetry_class else GREY

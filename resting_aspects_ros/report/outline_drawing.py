"""Drawings of an outline at its true size, as SVG and DXF files in mm."""

import io
from xml.sax.saxutils import escape

import numpy as np
from shapely import Polygon

from resting_aspects_ros.vision.outline import rings

MM = 1000.0  # mm/m
# Room around the drawing, and width of its line, mm.
SVG_MARGIN, LINE = 1.0, 0.1


def svg_drawing(polygon: Polygon, title: str) -> str:
    """Return the outline as an SVG file that is printed at its true size.

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
        f'<path id="outline" fill="none" fill-rule="evenodd" stroke="black" '
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

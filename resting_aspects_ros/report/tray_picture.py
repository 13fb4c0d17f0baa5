"""A picture of a tray: the image of the camera with outlines, classes, and what is advised."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter
from shapely import affinity

from resting_aspects_ros.arrays import Bytes
from resting_aspects_ros.report.colours import COLOURS, GREY
from resting_aspects_ros.report.figure_style import FAINT, PAPER, TEXT, new_figure
from resting_aspects_ros.vision.outline import Outline
from resting_aspects_ros.vision.tray_image import TrayCamera

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.axes import Axes

# Inches.
WIDTH, HEAD, FOOT, MARGIN = 6.2, 0.78, 0.42, 0.12
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
    """Write a PNG file with the image of a tray, the outlines of parts, and the advice.

    Parameters
    ----------
    image : (height, width) uint8
    parts : sequence of DrawnPart
    outlines : sequence of Outline
        Of all classes.
    title, reason : str
        The advice in a few words, and its reason.
    pickable : sequence of int
        Numbers of the pickable classes.
    """
    width, height = camera.size
    size = WIDTH - 2 * MARGIN
    drawn = size * height / width
    total = HEAD + drawn + FOOT
    figure = new_figure(WIDTH, total)
    axes = figure.add_axes((MARGIN / WIDTH, FOOT / total, size / WIDTH, drawn / total))
    # Half of the contrast, so that outlines and numbers stand out.
    # Without the noise, the file is a fifth as large.
    smooth = 8 * np.rint(gaussian_filter(image.astype(np.float32), 1.5) / 8)
    axes.imshow(smooth, cmap='gray', vmin=-180, vmax=235, interpolation='nearest')
    axes.set_axis_off()
    for part in parts:
        _draw_part(axes, part, camera, outlines)
    left = MARGIN / WIDTH
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
        figure.text(x + 0.15 / WIDTH, 0.16 / total, name, size=8, color=TEXT)
        x += (0.33 + 0.066 * len(name)) / WIDTH
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

"""Retention curves: the probability to leave an aspect against the lift height, with barriers."""

import dataclasses
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.aspect_groups import Group, group_images, group_of
from resting_aspects_ros.report.figure_style import FAINT, TEXT, percent_axis, plain_axes
from resting_aspects_ros.report.pixel_axes import Header, draw_image, pixel_axes
from resting_aspects_ros.report.posed_part import Image
from resting_aspects_ros.report.retention_table import millimetres_text
from resting_aspects_ros.statistics.transitions import RetentionCurve

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_LINES = 10  # more lines would hide each other
# Sizes in pixels. LABEL is the height of the label of a line, PICTURE the side of its picture.
WIDTH, HEIGHT = 1240, 480
LEFT, BOTTOM, RIGHT = 92, 84, 330
LABEL, PICTURE = 84, 80
# The axis is logarithmic if the highest lift is at least this multiple of the lowest.
LOGARITHMIC = 20.0
# Barriers closer than this share of the axis have dashes in turn.
_CLOSE = 0.008
_DASH = 5.0  # line widths


@dataclass(frozen=True, eq=False)
class Line:
    """The curve of an aspect, or the common curve of several aspects that look the same."""

    curve: RetentionCurve
    group: Group


def retention_lines(curves: Sequence[RetentionCurve], aspects: AspectSet) -> list[Line]:
    """Return a line for each symmetry class with a curve, in the order of the ids.

    The counts of curves of the same class are added up if they have the same lift heights.
    """
    lines: list[Line] = []
    for curve in curves:
        aspect = aspects.aspects[curve.aspect - 1]
        for k, line in enumerate(lines):
            if line.group.aspects[0].symmetry_class == aspect.symmetry_class and _same_lift(
                line.curve.lift, curve.lift
            ):
                summed = dataclasses.replace(
                    line.curve,
                    left=line.curve.left + curve.left,
                    parts=line.curve.parts + curve.parts,
                )
                lines[k] = Line(summed, group_of((*line.group.aspects, aspect)))
                break
        else:
            lines.append(Line(curve, group_of((aspect,))))
    return lines


def _same_lift(one: Array, other: Array) -> bool:
    """Return whether lift heights are the same but for rounding."""
    return one.shape == other.shape and np.allclose(one, other, rtol=1e-6)


def retention_figure(
    curves: Sequence[RetentionCurve], aspects: AspectSet, part: Part | None, title: str
) -> 'Figure':
    """Plot the probability to leave each aspect against the lift height, with intervals as bands.

    Dashed vertical lines are the barriers. The axis is logarithmic if the lift heights span more
    than an order of magnitude. Curves of the same symmetry class and the same lift heights are one
    line. If there are more than 10 lines, those of the classes with the largest basins are shown.

    Parameters
    ----------
    curves : sequence of RetentionCurve
        At least one.
    aspects : AspectSet
        The aspects of the part, to which the ids of the curves refer.
    part : Part or None
        Without the part, the figure has no pictures.
    title : str
        Without a title, the figure has no explanation either; see retention_note.
    """
    lines = retention_lines(curves, aspects)
    basins = [sum(aspect.basin_share for aspect in line.group.aspects) for line in lines]
    order = sorted(range(len(lines)), key=lambda k: -basins[k])
    shown = [lines[k] for k in sorted(order[:MAX_LINES])]
    header = Header(title, retention_note(curves, aspects) if title else '', WIDTH)
    room = max(HEIGHT, LABEL * len(shown))
    height = BOTTOM + room + header.height + 24
    figure, canvas = pixel_axes(WIDTH, height)
    header.draw(canvas)
    axes = figure.add_axes(
        (LEFT / WIDTH, BOTTOM / height, (WIDTH - LEFT - RIGHT) / WIDTH, room / height)
    )
    top = _draw_lines(axes, shown)
    _set_axes(axes, shown, top)
    _draw_barriers(axes, shown)
    ends = [BOTTOM + room * float(line.curve.probability[-1]) / top for line in shown]
    images = group_images(part, [line.group for line in shown], PICTURE)
    for k, y in _apart(ends, BOTTOM + LABEL / 2, BOTTOM + room - LABEL / 2):
        _write_label(canvas, shown[k], images[k], ends[k], y)
    return figure


def retention_note(curves: Sequence[RetentionCurve], aspects: AspectSet) -> str:
    """Return the text that explains the figure."""
    count = len(retention_lines(curves, aspects))
    confidence = f'{100 * curves[0].confidence:g} %'
    note = (
        'Probability that a part leaves its aspect after a disturbance whose energy would lift '
        f'its centre of mass by this height. Bands: {confidence} intervals (Wilson). '
        'Dashed: barrier, the minimum lift height with which the part can leave the aspect.'
    )
    if count > MAX_LINES:
        note += f' The {MAX_LINES} of {count} curves with the largest basins are shown.'
    return note


def _draw_lines(axes: 'Axes', shown: Sequence[Line]) -> float:
    """Draw lines and bands, and return the end of the probability axis."""
    top = 0.0
    for line in shown:
        lift, colour = 1000 * line.curve.lift, line.group.colour
        lower, upper = line.curve.bounds()
        axes.fill_between(lift, lower, upper, color=colour, alpha=0.22, linewidth=0)
        axes.plot(
            lift, line.curve.probability, marker='.', markersize=5, color=colour, linewidth=1.8
        )
        top = max(top, float(upper.max()))
    return min(1.1 * top, 1.0)


def _set_axes(axes: 'Axes', shown: Sequence[Line], top: float) -> None:
    from matplotlib.ticker import Locator, LogLocator, MaxNLocator

    low = 1000 * min(float(line.curve.lift[0]) for line in shown)
    high = 1000 * max(float(line.curve.lift[-1]) for line in shown)
    plain_axes(axes, 'y')
    axes.tick_params(axis='x', pad=9)
    locator: Locator = MaxNLocator(steps=[1, 2, 5, 10])
    if high >= LOGARITHMIC * low:
        axes.set_xscale('log')
        locator = LogLocator(subs=(1.0, 2.0, 5.0))
    else:
        low = 0.0
    axes.set_xlim(low, high)
    axes.set_xticks([lift for lift in locator.tick_values(low, high) if low <= lift <= high])
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda lift, _: f'{lift:g}')
    axes.set_ylim(0, top)
    percent_axis(axes, 'y', top)
    axes.set_xlabel('lift height (mm)', size=8, color=FAINT, labelpad=8)


def _draw_barriers(axes: 'Axes', shown: Sequence[Line]) -> None:
    """Draw dashed lines at the barriers; lines at the same place are dashed in turn."""
    pixels = axes.transData.transform
    found = [(1000 * line.curve.barrier, line) for line in shown]
    found = [(barrier, line) for barrier, line in found if np.isfinite(barrier)]
    places = [float(pixels((barrier, 0))[0]) for barrier, _ in found]
    close = _CLOSE * axes.bbox.width
    for k, (barrier, line) in enumerate(found):
        near = [j for j, place in enumerate(places) if abs(place - places[k]) < close]
        dashes = (_DASH, _DASH * max(len(near) - 1, 1))
        axes.axvline(
            barrier,
            color=line.group.colour,
            linewidth=1.3,
            linestyle=(_DASH * near.index(k), dashes),
            zorder=1.5,
        )


def _apart(ends: Sequence[float], low: float, high: float) -> list[tuple[int, float]]:
    """Return each index with its place, in ascending order, at least LABEL apart."""
    order = sorted(range(len(ends)), key=lambda k: ends[k])
    places: list[float] = []
    for k in order:
        places.append(max([ends[k], low, *(place + LABEL for place in places[-1:])]))
    limit = high
    for position in reversed(range(len(places))):
        places[position] = min(places[position], limit)
        limit = places[position] - LABEL
    return list(zip(order, places, strict=True))


def _write_label(canvas: 'Axes', line: Line, image: Image | None, end: float, y: float) -> None:
    """Write name and barrier at the height ``y``, linked with the end of the line."""
    right = WIDTH - RIGHT
    x = right + 40
    canvas.plot(
        [right + 4, right + 14, x - 6, x],
        [end, end, y, y],
        color=line.group.colour,
        linewidth=1.2,
    )
    if image is not None:
        draw_image(canvas, image, x + 6 + PICTURE / 2, y)
        x += PICTURE + 8
    barrier = line.curve.barrier
    text = f'barrier {millimetres_text(barrier)} mm' if np.isfinite(barrier) else 'no barrier'
    name = textwrap.fill(line.group.title, 16)
    canvas.text(x + 6, y + 2, name, size=8.5, weight='bold', color=TEXT, va='bottom')
    canvas.text(x + 6, y - 4, text, size=7.5, color=FAINT, va='top')

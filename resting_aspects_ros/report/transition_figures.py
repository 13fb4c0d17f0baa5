"""Figures of what actions do: the matrix as a heat map, and retention curves."""

import dataclasses
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.figure import (
    FAINT,
    MARGIN,
    TEXT,
    Header,
    draw_image,
    labels_apart,
    percent_axis,
    pixel_axes,
    plain_axes,
)
from resting_aspects_ros.report.format import (
    GREY,
    aspect_colour,
    decimals_of,
    ids_text,
    millimetres_text,
    percent_text,
    rgb,
)
from resting_aspects_ros.report.picture import Image, draw_parts, picture_part, pose_parts
from resting_aspects_ros.report.transitions import OUTCOME_HEADINGS
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.transitions import OUTCOMES, RetentionCurve, TransitionMatrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MAX_GROUPS = 12


@dataclass(frozen=True, eq=False)
class Group:
    """Aspects that a figure draws as one.

    name : str
        '3', '1 and 2', '18 others'.
    colour : str
        '#RRGGBB'.
    alike : bool
        Whether the aspects are in one symmetry class, so that the group has a picture.
    """

    name: str
    aspects: tuple[Aspect, ...]
    colour: str
    alike: bool = True

    @property
    def title(self) -> str:
        """The name with the word 'aspect', as 'aspects 1 and 2'."""
        return f'aspect{"s" * (len(self.aspects) > 1)} {self.name}' if self.alike else self.name


def group_of(alike: tuple[Aspect, ...]) -> Group:
    """Return the group of some or all aspects of a symmetry class."""
    return Group(ids_text(alike), alike, aspect_colour(alike[0]))


def aspect_groups(aspects: AspectSet, weights: Array) -> list[Group]:
    """Return a group for each aspect, or for each symmetry class if there are many aspects.

    If there are also many classes, those with the largest weights have a group each, in the order
    of their numbers, and a last group contains all other aspects. Many is more than MAX_GROUPS.

    Parameters
    ----------
    weights : (k,) float
        How important each aspect is in the figure, 0 or more.
    """
    by_class = len(aspects) > MAX_GROUPS
    rows = aspects.classes() if by_class else [(aspect,) for aspect in aspects]
    total = np.array([weights[[aspect.id - 1 for aspect in row]].sum() for row in rows])
    shown = set(np.argsort(-total, kind='stable')[:MAX_GROUPS].tolist())
    groups = [group_of(row) for k, row in enumerate(rows) if k in shown]
    if others := [aspect for k, row in enumerate(rows) if k not in shown for aspect in row]:
        groups.append(Group(f'{len(others)} others', tuple(others), GREY, alike=False))
    return groups


def membership(groups: Sequence[Group], count: int) -> Array:
    """Return (groups, count) numbers: 1 if the aspect of the column is in the group, else 0."""
    member = np.zeros((len(groups), count))
    for k, group in enumerate(groups):
        member[k, [aspect.id - 1 for aspect in group.aspects]] = 1.0
    return member


def group_images(part: Part | None, groups: Sequence[Group], pixels: int) -> list[Image | None]:
    """Return a picture of the part in each group, None without a part or for other aspects."""
    shown = [k for k, group in enumerate(groups) if group.alike]
    images: list[Image | None] = [None] * len(groups)
    if part is None or not shown:
        return images
    aspects = [groups[k].aspects[0] for k in shown]
    posed_parts = pose_parts(picture_part(part), aspects)
    drawn = draw_parts(posed_parts, [rgb(groups[k].colour) for k in shown], pixels)
    for k, image in zip(shown, drawn, strict=True):
        images[k] = image
    return images


# Sizes in pixels. GAP separates the outcomes from the aspects, BESIDE a name from what it names.
CELL, CELL_OF_MANY, MANY = 116, 96, 6
GAP, BESIDE = 14, 10
NAMES, ACTIONS, LINE = 110, 130, 24
MIN_WIDTH = 700
# Colours of the probabilities 0 and 1, and of texts in cells. They are not those of figure_style,
# which change on a dark page.
PALE, DEEP = '#F3F6FA', '#0A4A7C'
PALE_OUTCOME, DEEP_OUTCOME = '#F4F4F4', '#4A4A4A'
DARK_TEXT, LIGHT_TEXT = '#1A1A1E', '#FAFAFA'
# Texts in cells of a higher probability are light.
LIGHT_FROM = 0.65
# Decimals of a percentage, so that its interval fits into a cell.
MAX_DECIMALS = 2


def transition_figure(matrix: TransitionMatrix, part: Part | None, title: str) -> 'Figure':
    """Plot the probability and its interval from each aspect (row) to each aspect (column).

    If there are more than 12 aspects, rows and columns are symmetry classes. If there are also
    more than 12 classes, those to which most actions lead are shown, and the others share a row
    and a column. Outcomes in no aspect have columns if they occurred.

    Parameters
    ----------
    matrix : TransitionMatrix
        By aspect.
    part : Part or None
        Without the part, the figure has no pictures.
    title : str
        Without a title, the figure has no explanation either; see transition_note.
    """
    groups = _groups(matrix)
    grouped = _grouped(matrix, groups)
    outcomes = [j for j in range(len(OUTCOMES)) if grouped.counts[:, len(groups) + j].any()]
    columns = len(groups) + len(outcomes)
    side = CELL if columns <= MANY else CELL_OF_MANY
    left = MARGIN + NAMES + (side if part else 0) + BESIDE
    width = left + side * columns + GAP * bool(outcomes) + ACTIONS + MARGIN
    width = max(width, MIN_WIDTH)
    header = Header(title, transition_note(matrix) if title else '', width)
    lines = max((_name(group.name).count('\n') + 1 for group in groups), default=1)
    above = (side if part else 0) + LINE * max(lines, 2) + 2 * BESIDE
    figure, axes = pixel_axes(width, header.height + above + side * len(groups) + MARGIN)
    header.draw(axes)
    x = left + side * np.arange(0.5, columns, dtype=np.float64)
    x[len(groups) :] += GAP
    y = MARGIN + side * np.arange(0.5, len(groups), dtype=np.float64)[::-1]
    _draw_axes(axes, groups, group_images(part, groups, side), (x, y), side)
    top = MARGIN + side * len(groups) + BESIDE
    for j, place in zip(outcomes, x[len(groups) :], strict=True):
        _write(axes, OUTCOME_HEADINGS[OUTCOMES[j]], place, top, ha='center', va='bottom')
    shown = [*range(len(groups)), *(len(groups) + j for j in outcomes)]
    _draw_cells(axes, grouped, shown, (x, y), side)
    for n, place in zip(grouped.actions.tolist(), y, strict=True):
        text = f'{n:,} actions'.replace(',', ' ')
        axes.text(x[-1] + side / 2 + BESIDE, place, text, size=7, color=FAINT, va='center')
    return figure


def _grouped(matrix: TransitionMatrix, groups: Sequence[Group]) -> TransitionMatrix:
    """Return the matrix over the groups: rows and columns are summed, as by_class does."""
    k = len(matrix.aspects)
    member = membership(groups, k).astype(np.int64)
    counts = member @ matrix.counts
    inside = counts[:, :k] @ member.T
    return dataclasses.replace(matrix, counts=np.hstack([inside, counts[:, k:]]))


def transition_note(matrix: TransitionMatrix) -> str:
    """Return the text that explains the figure."""
    note = (
        'Probability in % that one action takes a part from the aspect of the row to the aspect '
        f'of the column, with {100 * matrix.confidence:g} % interval '
        f'({matrix.interval.capitalize()}).'
    )
    if others := [group for group in _groups(matrix) if not group.alike]:
        note += (
            f' The aspects to which most actions lead are shown; {len(others[0].aspects)} others '
            'share a row and a column.'
        )
    return note


def _groups(matrix: TransitionMatrix) -> list[Group]:
    arrivals = matrix.counts[:, : len(matrix.aspects)].sum(axis=0)
    return aspect_groups(matrix.aspects, arrivals.astype(float))


def _draw_axes(
    axes: 'Axes',
    groups: Sequence[Group],
    images: Sequence[Image | None],
    places: tuple[Array, Array],
    side: int,
) -> None:
    """Draw picture and name of each group left of its row and above its column."""
    x, y = places
    left, top = x[0] - side / 2 - BESIDE, y[0] + side / 2 + BESIDE
    pictures = side if any(image is not None for image in images) else 0
    for k, (group, image) in enumerate(zip(groups, images, strict=True)):
        if image is not None:
            draw_image(axes, image, left - side / 2, y[k])
            draw_image(axes, image, x[k], top + side / 2)
        beside = left - pictures - BESIDE / 2
        _write(axes, _name(group.name), beside, y[k], ha='right', va='center')
        _write(
            axes,
            _name(group.name),
            x[k],
            top + (side if image is not None else 0),
            ha='center',
            va='bottom',
        )
    _write(axes, 'from', MARGIN, top, ha='left', va='bottom', color=FAINT)
    _write(axes, 'to', left - BESIDE, top + pictures, ha='right', va='bottom', color=FAINT)


def _name(name: str) -> str:
    return textwrap.fill(name, 8)


def _write(axes: 'Axes', text: str, x: float, y: float, **style: Any) -> None:
    style = {'size': 8.5, 'weight': 'bold', 'color': TEXT, 'linespacing': 1.1, **style}
    axes.text(x, y, text, **style)


def _draw_cells(
    axes: 'Axes',
    matrix: TransitionMatrix,
    shown: Sequence[int],
    places: tuple[Array, Array],
    side: int,
) -> None:
    """Draw a cell for each row and each column in ``shown``; ``places`` are their centres."""
    from matplotlib.patches import Rectangle

    lower, upper = matrix.bounds()
    for row, y in enumerate(places[1]):
        for column, x in zip(shown, places[0], strict=True):
            p = float(matrix.probability[row, column])
            ends = (PALE, DEEP) if column < len(matrix.counts) else (PALE_OUTCOME, DEEP_OUTCOME)
            colour = _mixed(*ends, 0.0 if np.isnan(p) else p)
            corner = x - side / 2 + 1, y - side / 2 + 1
            axes.add_patch(Rectangle(corner, side - 2, side - 2, color=colour, linewidth=0))
            if np.isnan(p):
                axes.text(x, y, '-', size=9, color=DARK_TEXT, ha='center', va='center')
            else:
                interval = Interval(p, float(lower[row, column]), float(upper[row, column]))
                _write_cell(axes, interval, x, y)


def _write_cell(axes: 'Axes', interval: Interval, x: float, y: float) -> None:
    decimals = min(decimals_of(interval), MAX_DECIMALS)
    share, low, high = (
        percent_text(value, decimals)
        for value in (interval.probability, interval.lower, interval.upper)
    )
    # An outcome that was never seen is less conspicuous.
    size, weight = (10, 'bold') if interval.probability > 0 else (8, 'normal')
    colour = LIGHT_TEXT if interval.probability > LIGHT_FROM else DARK_TEXT
    style: dict[str, Any] = {'color': colour, 'ha': 'center'}
    axes.text(x, y + 2, share, size=size, weight=weight, va='bottom', **style)
    axes.text(x, y - 6, f'{low}–{high}', size=6.5, va='top', **style)


def _mixed(first: str, last: str, share: float) -> tuple[float, float, float]:
    """Return the colour at ``share`` of the way from the first to the last."""
    red, green, blue = (a + share * (b - a) for a, b in zip(rgb(first), rgb(last), strict=True))
    return red, green, blue


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
        aspect = aspects[curve.aspect - 1]
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
    largest = sorted(range(len(lines)), key=lambda k: -basins[k])[:MAX_LINES]
    shown = [lines[k] for k in sorted(largest)]
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
    order = sorted(range(len(ends)), key=lambda k: ends[k])
    low, high = BOTTOM + LABEL / 2, BOTTOM + room - LABEL / 2
    places = labels_apart(np.array([ends[k] for k in order]), LABEL, low, high)
    for k, y in zip(order, places.tolist(), strict=True):
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


def _write_label(canvas: 'Axes', line: Line, image: Image | None, end: float, y: float) -> None:
    """Write name and barrier at the height ``y``, linked with the end of the line."""
    right = WIDTH - RIGHT
    x = right + 40
    canvas.plot(
        [right + 4, right + 14, x - 6, x], [end, end, y, y], color=line.group.colour, linewidth=1.2
    )
    if image is not None:
        draw_image(canvas, image, x + 6 + PICTURE / 2, y)
        x += PICTURE + 8
    barrier = line.curve.barrier
    text = f'barrier {millimetres_text(barrier)} mm' if np.isfinite(barrier) else 'no barrier'
    name = textwrap.fill(line.group.title, 16)
    canvas.text(x + 6, y + 2, name, size=8.5, weight='bold', color=TEXT, va='bottom')
    canvas.text(x + 6, y - 4, text, size=7.5, color=FAINT, va='top')

"""The figures of a distribution: bars, pie, convergence, estimates and a comparison."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.comparison import ComparedResults, difference_texts
from resting_aspects_ros.report.figure import (
    FAINT,
    MARGIN,
    NARROW,
    PAPER,
    TEXT,
    WIDE,
    Header,
    draw_image,
    labels_apart,
    new_figure,
    percent_axis,
    pixel_axes,
    plain_axes,
)
from resting_aspects_ros.report.format import (
    GREY,
    Row,
    class_rows,
    interval_of,
    interval_text,
    largest_counts,
    model_range,
    outside_rows,
    probability_text,
    rgb,
    short_name,
    with_counts,
)
from resting_aspects_ros.report.picture import Image, draw_parts, pose_parts
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MAX_LINES = 10  # more lines would hide each other


def bands(distribution: Distribution, drops: Counts, counts: Counts) -> list[list[Interval]]:
    """Return the interval of each class after each number of drops of a history.

    Confidence and kind of the intervals are those of the distribution.
    """
    return [
        with_counts(distribution, row, int(n - row.sum())).by_class().intervals()
        for n, row in zip(drops, counts, strict=True)
    ]


def convergence_figure(
    rows: Sequence[Row], drops: Counts, bands: Sequence[Sequence[Interval]], width: float = WIDE
) -> 'Figure':
    """Plot the share of each row against the number of drops, with its interval as a band.

    Of more than MAX_LINES rows, those with the most drops are shown. ``bands`` are the intervals
    of each row after each of the ``drops``, (m,), ascending.
    """
    figure = new_figure(width, 3.6)
    shown = largest_counts([row.count for row in rows], MAX_LINES)
    names = {k: short_name(rows[k]) if width <= NARROW else rows[k].name for k in shown}
    labels = {k: f'{names[k]}: {probability_text(rows[k].interval)}' for k in shown}
    left, right = 0.5, 0.25 + 0.07 * max(map(len, labels.values()), default=0)  # inches
    axes = figure.add_axes((left / width, 0.14, 1 - (left + right) / width, 0.82))
    plain_axes(axes, 'y')
    top = 0.0
    ends = []
    for k in shown:
        history = [after[k] for after in bands]
        lower, upper = ([getattr(each, side) for each in history] for side in ('lower', 'upper'))
        shares = [each.probability for each in history]
        axes.fill_between(drops, lower, upper, color=rows[k].colour, alpha=0.22, linewidth=0)
        axes.plot(drops, shares, color=rows[k].colour, linewidth=1.8)
        top = max(top, *upper)
        ends.append((shares[-1], rows[k].colour, labels[k]))
    axes.set_xscale('log')
    axes.set_xlim(float(drops[0]), float(drops[-1]))
    axes.set_ylim(0, top * 1.02)
    axes.xaxis.set_major_formatter(lambda n, _: f'{n:,.0f}'.replace(',', ' '))
    # The label of a power of ten just below the last number would overlap it.
    decades = 10.0 ** np.arange(np.ceil(np.log10(drops[0])), np.log10(drops[-1]))
    axes.set_xticks([*decades[decades < drops[-1] / 3], drops[-1]])
    axes.minorticks_off()
    percent_axis(axes, 'y', top)
    axes.set_xlabel('number of drops', size=8, color=FAINT)
    _label_ends(axes, ends, top)
    return figure


def comparison_figure(
    rows: Sequence[Row], sides: ComparedResults, width: float = WIDE
) -> 'Figure':
    """Plot two distributions as bars with whiskers, and write the differences beside them.

    The bars of the second side are paler. Thin bars beside the bars are model ranges.
    """
    legend = '\n'.join(
        textwrap.fill(f'{place} bar: {text} drops in an aspect', int(width / 0.075))
        for place, text in zip(('upper', 'lower'), sides.tally_texts(', '), strict=True)
    )
    figure, axes = _band_axes(rows, width, 0.5 + 0.16 * len(legend.splitlines()))
    at = 0.2 / width, 0.1 / figure.get_figheight()
    figure.text(*at, legend, size=8, color=FAINT, parse_math=False)
    places, tall = np.arange(len(rows), dtype=np.float64), 0.25 / _pitch(width)
    both, ranges, differences = sides.shares, sides.ranges, difference_texts(sides)
    drawn: list[Sequence[Interval | None]] = [*both, *ranges]
    top = max(each.upper for side in drawn for each in side if each is not None)
    for side, models, shift, alpha in zip(
        both, ranges, (-tall / 2, tall / 2), (1.0, 0.45), strict=True
    ):
        shares = np.array([each.probability for each in side])
        lower = shares - [each.lower for each in side]
        upper = [each.upper for each in side] - shares
        colours = [row.colour for row in rows]
        axes.barh(places + shift, shares, 0.9 * tall, color=colours, alpha=alpha)
        axes.errorbar(
            shares,
            places + shift,
            xerr=[np.maximum(lower, 0), np.maximum(upper, 0)],
            fmt='none',
            color=TEXT,
            elinewidth=1.0,
            capsize=3,
        )
        for model, row, y in zip(models, rows, places + 2.12 * shift, strict=True):
            if model is not None:
                draw_range(axes, model, row.colour, y, 0.12 * tall)
    ends = [
        max(each.upper for each in row if each is not None) for row in zip(*drawn, strict=True)
    ]
    text_width = _write_differences(axes, rows, differences, ends, narrow=width <= NARROW)
    # The axis leaves room for the text beside the longest bar.
    axes_width = axes.get_position().width * width
    axes.set_xlim(0, top * axes_width / (axes_width - text_width))
    percent_axis(axes, 'x', top)
    return figure


# Height of a band of the comparison, and of the line of text above it in a narrow figure, inches.
_BAND, _LINE = 0.62, 0.24


def _pitch(width: float) -> float:
    """Return the distance of the bands of the comparison, inches."""
    return _BAND + (_LINE if width <= NARROW else 0.0)


def _band_axes(rows: Sequence[Row], width: float, below: float) -> 'tuple[Figure, Axes]':
    """Return a figure and axes with a band for each row, above a space of ``below`` inches.

    The names are left of the bands, or in a narrow figure in the line above each band.
    """
    narrow, pitch = width <= NARROW, _pitch(width)
    height = pitch * len(rows) + below + 0.1
    names = [row.name for row in rows]
    left = 0.2 + (0.0 if narrow else 0.08 * max(map(len, names), default=0))
    bottom = below / height
    room = 1 - (left + 0.25) / width, 1 - bottom - 0.1 / height
    figure = new_figure(width, height)
    axes = figure.add_axes((left / width, bottom, *room))
    plain_axes(axes, 'x')
    half = _BAND / 2 / pitch
    axes.set_ylim(len(rows) - 1 + half, half - 1)
    axes.set_yticks(range(len(rows)), [''] * len(rows) if narrow else names)
    axes.tick_params(axis='y', labelcolor=TEXT, labelsize=9)
    return figure, axes


def _write_differences(
    axes: 'Axes', rows: Sequence[Row], texts: Sequence[str], ends: Sequence[float], *, narrow: bool
) -> float:
    """Write a text right of the end of each row, and return the width that it needs, inches.

    In a narrow figure it is in the line above the band, behind the name of the row.
    """
    style: dict[str, Any] = {'textcoords': 'offset points', 'color': TEXT}
    bold: dict[str, Any] = {**style, 'weight': 'bold'}
    for y, (row, text, x) in enumerate(zip(rows, texts, ends, strict=True)):
        if narrow:
            above = (0, 36 * _BAND + 2)
            line: dict[str, Any] = {'xytext': above, 'xycoords': ('axes fraction', 'data')}
            axes.annotate(row.name, (0, y), size=9, **line, **style)
            axes.annotate(text, (1, y), size=8, ha='right', **line, **bold)
        else:
            axes.annotate(text, (x, y), (8, 0), size=9, va='center', **bold)
    return 0.1 if narrow else 0.2 + 0.083 * max(map(len, texts), default=0)


def _label_ends(axes: 'Axes', ends: Sequence[tuple[float, str, str]], top: float) -> None:
    """Write labels right of the lines, moved apart where they would overlap.

    A label that is moved is connected with the end of its line.
    """
    ordered = sorted(ends)
    places = labels_apart(np.array([share for share, _, _ in ordered]), 0.062 * top)
    inches = axes.bbox.width / axes.figure.dpi
    across = axes.get_yaxis_transform()
    for (share, colour, label), place in zip(ordered, places, strict=True):
        line = [1.0, 1.0 + 0.16 / inches], [share, place]
        axes.plot(*line, color=colour, linewidth=1.5, transform=across, clip_on=False)
        axes.text(
            1.0 + 0.2 / inches, place, label, size=8, va='center', color=TEXT, transform=across
        )


WIDTH, HEIGHT = 5.0, 4.6  # of the figure, inches: the label of a picture at the bottom is inside
# Half the width of the figure in pie radii, with pictures around the pie and without.
REACH, BARE_REACH = 2.0, 1.32
# Slices with a smaller share have their name beside them.
MIN_INSIDE = 0.06
# Maximum number of pictures, for the largest slices: more would overlap.
MAX_PICTURES = 8
# Side of a picture, and distance of its centre from the centre of the pie, in pie radii.
SIDE, DISTANCE = 0.6, 1.42


def pie_figure(rows: Sequence[Row], images: Sequence[Image | None]) -> 'Figure':
    """Draw the shares of all drops as slices, clockwise from the top, with pictures beside them.

    ``images`` are the pictures of the rows; only the MAX_PICTURES largest slices have theirs.
    """
    figure = new_figure(WIDTH, HEIGHT)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    shown = [(row, image) for row, image in zip(rows, images, strict=True) if row.count]
    if not shown:
        axes.set_axis_off()
        axes.text(0.5, 0.5, 'no drops', ha='center', va='center', color=FAINT)
        return figure
    shares = np.array([row.interval.probability for row, _ in shown])
    axes.pie(
        shares,
        colors=[row.colour for row, _ in shown],
        startangle=90,
        counterclock=False,
        wedgeprops={'edgecolor': PAPER, 'linewidth': 1.2 if len(shown) > 1 else 0},
        radius=1.0,
        frame=True,
    )
    axes.set_axis_off()
    middles = np.pi / 2 - 2 * np.pi * (np.cumsum(shares) - shares / 2)
    pictured = np.zeros(len(shown), dtype=bool)
    pictured[np.argsort(-shares, kind='stable')[:MAX_PICTURES]] = True
    pictured &= [image is not None for _, image in shown]
    reach = REACH if pictured.any() else BARE_REACH
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach * HEIGHT / WIDTH, reach * HEIGHT / WIDTH)
    places, gap = middles.copy(), 2 * np.arcsin(SIDE / 2 / DISTANCE)
    clockwise = np.pi / 2 - middles[pictured]
    places[pictured] = np.pi / 2 - labels_apart(clockwise, gap, gap / 2, 2 * np.pi - gap / 2)
    for k, (row, image) in enumerate(shown):
        x, y = np.cos(middles[k]), np.sin(middles[k])
        inside = shares[k] >= MIN_INSIDE
        if image is not None and pictured[k]:
            at = DISTANCE * np.cos(places[k]), DISTANCE * np.sin(places[k])
            _draw_scaled(axes, image, *at, SIDE)
            if not inside:
                axes.plot([x, 0.8 * at[0]], [y, 0.8 * at[1]], color=FAINT, linewidth=0.7)
                _write(axes, short_name(row), at[0], at[1] - 0.55 * SIDE, FAINT)
        if inside:
            text = f'{short_name(row)}\n{100 * shares[k]:.0f} %'
            _write(axes, text, 0.66 * x, 0.66 * y, _text_colour_on(row.colour))
    return figure


def _write(axes: 'Axes', text: str, x: float, y: float, colour: str) -> None:
    axes.text(
        x, y, text, ha='center', va='center', size=9, weight='bold', color=colour, linespacing=1.25
    )


def _draw_scaled(axes: 'Axes', image: Image, x: float, y: float, side: float) -> None:
    axes.imshow(
        image,
        extent=(x - side / 2, x + side / 2, y - side / 2, y + side / 2),
        interpolation='antialiased',
        aspect='auto',
        zorder=3,
    )


def _text_colour_on(colour: str) -> str:
    """Return the text colour, dark or light, with more contrast on a background colour."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb(colour)]
    return '#111111' if np.dot([0.2126, 0.7152, 0.0722], linear) > 0.18 else '#FEFEFE'


MAX_SHOWN = 12  # symmetry classes with a bar of their own; the others share one bar

# Sizes in pixels. BESIDE_BAR is the room for the text at the end of the longest bar.
BARS_WIDTH = 1240
BELOW_HEADER, BOTTOM = 28, 84
ROW, ROW_OF_MANY, MANY = 164, 116, 6
ROW_WITHOUT_PICTURE, ROW_OF_OTHERS = 92, 64
BAR = 42
LABEL, BESIDE_LABEL, BESIDE_BAR = 200, 18, 225


def distribution_figure(
    distribution: Distribution, part: Part | None, title: str, range_text: str = ''
) -> 'Figure':
    """Plot a bar for each symmetry class, with a picture of the part in it if the part is known.

    If there are more than 12 classes, the 12 most probable are shown, in the order of their
    numbers, and the others share one bar. Outcomes in no aspect have grey bars. Whiskers are the
    intervals, and thin bars below are the model ranges. ``range_text`` says what these cover.
    """
    rows = _rows(distribution)
    side = ROW if sum(bool(row.aspects) for row in rows) <= MANY else ROW_OF_MANY
    of_aspect = side if part else ROW_WITHOUT_PICTURE
    sides = [of_aspect if row.aspects else ROW_OF_OTHERS for row in rows]
    room = max(sum(sides), ROW_OF_OTHERS)
    header = Header(title, range_text, BARS_WIDTH)
    height = header.height + BELOW_HEADER + room + BOTTOM
    figure, canvas = pixel_axes(BARS_WIDTH, height)
    header.draw(canvas)
    middles = [
        BOTTOM + room - end + each / 2 for end, each in zip(np.cumsum(sides), sides, strict=True)
    ]
    left = MARGIN + LABEL
    if part:
        left += side
        for middle, image in zip(middles, _images(part, rows, side), strict=False):
            draw_image(canvas, image, MARGIN + side / 2, middle)
    for row, middle in zip(rows, middles, strict=True):
        style: dict[str, Any] = {'ha': 'right', 'va': 'center', 'weight': 'bold'}
        canvas.text(left - BESIDE_LABEL, middle, row.name, size=10, color=TEXT, **style)
    width = BARS_WIDTH - MARGIN - left
    axes = figure.add_axes((left / BARS_WIDTH, BOTTOM / height, width / BARS_WIDTH, room / height))
    _draw_bars(axes, rows, [m - BOTTOM for m in middles], distribution)
    axes.set_ylim(0, room)
    return figure


def _rows(distribution: Distribution) -> list[Row]:
    """Return the rows from top to bottom: classes, the other classes together, other outcomes."""
    rows = class_rows(distribution)
    kept = [rows[k] for k in largest_counts([row.count for row in rows], MAX_SHOWN)]
    if others := sum(len(row.aspects) for row in rows) - sum(len(row.aspects) for row in kept):
        count = sum(row.count for row in rows) - sum(row.count for row in kept)
        kept.append(Row(f'{others} other aspects', count, interval_of(distribution, count), GREY))
    return [*kept, *outside_rows(distribution)]


def _images(part: Part, rows: Sequence[Row], side: int) -> list[Image]:
    shown = [row for row in rows if row.aspects]
    posed_parts = pose_parts(part, [row.aspects[0] for row in shown])
    return draw_parts(posed_parts, [rgb(row.colour) for row in shown], side)


def _draw_bars(
    axes: 'Axes', rows: Sequence[Row], middles: Sequence[float], distribution: Distribution
) -> None:
    for row, middle in zip(rows, middles, strict=True):
        _draw_bar(axes, row, middle, distribution.drops)
    longest = max((row.upper for row in rows), default=1.0)
    room = axes.get_position().width * BARS_WIDTH
    axes.set_xlim(0, longest * room / (room - BESIDE_BAR))
    plain_axes(axes, 'x')
    percent_axis(axes, 'x', longest)
    axes.set_yticks([])
    axes.spines['left'].set_visible(True)
    axes.spines['left'].set_color(FAINT)
    ranges = ' and, as thin bar, model range' if distribution.model else ''
    axes.set_xlabel(
        f'probability from {distribution.drops} drops, with {100 * distribution.confidence:g} % '
        f'interval ({distribution.interval.capitalize()}){ranges}',
        size=8,
        color=FAINT,
        loc='left',
        labelpad=8,
    )


def _draw_bar(axes: 'Axes', row: Row, middle: float, drops: int) -> None:
    interval = row.interval
    axes.barh(middle, interval.probability, height=BAR, color=row.colour)
    axes.errorbar(
        interval.probability,
        middle,
        capsize=4,
        color=TEXT,
        elinewidth=1.2,
        capthick=1.2,
        xerr=[[interval.probability - interval.lower], [interval.upper - interval.probability]],
    )
    unseen = 'never seen' if drops else 'no drops'
    text = probability_text(interval) if interval.probability else unseen
    _write_beside(
        axes, row.upper, middle, 1, text, size=10.5, weight='bold', color=TEXT, va='bottom'
    )
    bounds = interval_text(interval)
    if row.model is not None:
        draw_range(axes, row.model, row.colour, middle - 0.62 * BAR, 0.14 * BAR)
        bounds += f'\n{model_range(row.model)}'
    _write_beside(axes, row.upper, middle, -1.5, bounds, size=7.5, color=FAINT, va='top')


def draw_range(axes: 'Axes', model: Interval, colour: str, middle: float, height: float) -> None:
    """Draw a model range as a thin bar."""
    axes.barh(middle, model.upper - model.lower, height, model.lower, color=colour, alpha=0.55)


def _write_beside(axes: 'Axes', x: float, y: float, rise: float, text: str, **style: Any) -> None:
    """Write right of a point, ``rise`` points above it, on a background that hides the grid."""
    axes.annotate(
        text,
        (x, y),
        (8, rise),
        textcoords='offset points',
        annotation_clip=False,
        bbox={'facecolor': PAPER, 'edgecolor': 'none', 'pad': 0.8},
        **style,
    )

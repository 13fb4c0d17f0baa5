"""Transitions as tables, documents and figures: matrices, long run, plans and retention."""

import dataclasses
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import numbers, plain
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
    aspect_colour,
    aspects_heading,
    aspects_text,
    bounds_text,
    decimals_of,
    ids_text,
    interval_text,
    largest_counts,
    millimetres_text,
    number_text,
    percent_text,
    probability_text,
    rgb,
    share_percent_text,
    share_text,
)
from resting_aspects_ros.report.picture import Image, draw_parts, picture_part, pose_parts
from resting_aspects_ros.report.table import NOTHING, Number, Table
from resting_aspects_ros.statistics.intervals import CONFIDENCE, Interval
from resting_aspects_ros.statistics.markov import LongRun, Plan
from resting_aspects_ros.statistics.transitions import (
    LEVELS,
    OUTCOMES,
    RetentionCurve,
    TransitionMatrix,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Headings of the outcomes in no aspect.
OUTCOME_HEADINGS = {
    'unclassified': 'unclas-\nsified',
    'unsettled': 'unset-\ntled',
    'failed': 'failed',
    'lost': 'lost',
}
# Width at which the heading of a class with many aspects is wrapped.
_HEADING_WIDTH = 10

Rows = Sequence[tuple[Aspect, ...]]


def table_rows(aspects: AspectSet, *, by_class: bool) -> list[tuple[Aspect, ...]]:
    """Return the aspects of each row of a table: each aspect, or each symmetry class."""
    return aspects.classes() if by_class else [(aspect,) for aspect in aspects]


def suffix_of(action: str, actions: Sequence[str]) -> str:
    """Return the end of the names of the files of one of several actions, such as '_tap'."""
    return f'_{action}' if len(actions) > 1 else ''


def transition_table(matrix: TransitionMatrix, by_class: bool, title: str = '') -> Table:
    """Return a matrix by aspect in percent, with the interval below each probability.

    It has a row and a column for each aspect or class, however wide it is. Outcomes in no aspect
    have columns if they occurred.
    """
    rows = table_rows(matrix.aspects, by_class=by_class)
    matrix = matrix.by_class() if by_class else matrix
    columns = shown_columns(matrix)
    names = [textwrap.fill(f'to {ids_text(row)}', _HEADING_WIDTH) for row in rows]
    names += [OUTCOME_HEADINGS[OUTCOMES[c - len(rows)]] for c in columns[len(rows) :]]
    caption = f'Below each probability is its {100 * matrix.confidence:g} % interval.'
    headings = ('from', *(f'{name}\n(%)' for name in names), 'actions')
    table = Table(title, headings, caption=caption)
    found = matrix_intervals(matrix)
    for row, of_row, actions in zip(rows, found, matrix.actions.tolist(), strict=True):
        texts = [_with_bounds(of_row[c]) if of_row else NOTHING for c in columns]
        table.add_row(ids_text(row), *texts, str(actions))
    return table


def shown_columns(matrix: TransitionMatrix) -> list[int]:
    """Return the columns of all aspects, and of the outcomes in no aspect that occurred."""
    occurred = np.asarray(matrix.counts.any(axis=0))
    rows = len(matrix.counts)
    return [c for c in range(len(occurred)) if c < rows or occurred[c]]


def matrix_intervals(matrix: TransitionMatrix) -> list[list[Interval]]:
    """Return the probabilities of each row with their bounds; none in a row without actions."""
    probability, (lower, upper) = matrix.probability, matrix.bounds()
    rows: list[list[Interval]] = [[] for _ in probability]
    for k in np.flatnonzero(matrix.actions):
        values = zip(probability[k].tolist(), lower[k].tolist(), upper[k].tolist(), strict=True)
        rows[k] = [Interval(*each) for each in values]
    return rows


def _with_bounds(interval: Interval) -> str:
    """Return the probability in percent, and below it its bounds, as '25.1-30.7'."""
    share = percent_text(interval.probability, decimals_of(interval))
    values = (interval.probability, interval.lower, interval.upper)
    text = f'{share}\n{bounds_text(interval, "-")}'
    return Number(text, *(100 * value for value in values))


NEVER, WANTED = 'never', 'wanted'


def long_run_table(
    rows: Rows,
    long_run: LongRun,
    lower: Array,
    upper: Array,
    drop: Array,
    title: str,
    confidence: float = CONFIDENCE,
) -> Table:
    """Return a table of the shares that repeated actions lead to, beside the shares of a drop.

    The long run, the bounds ``lower`` and ``upper`` of its shares, and ``drop``, the probabilities
    after a drop, refer to the rows, (k,).
    """
    interval = f'{100 * confidence:g} % interval'
    table = Table(title, (aspects_heading(rows), 'in the\nlong run', interval, 'in a\ndrop'))
    values = zip(long_run.shares.tolist(), lower.tolist(), upper.tolist(), strict=True)
    for row, value, dropped in zip(rows, values, drop.tolist(), strict=True):
        share = Interval(*value)
        cells = probability_text(share), interval_text(share), share_percent_text(dropped)
        table.add_row(ids_text(row), *cells)
    return table


def actions_table(
    rows: Rows, drop: Array, shares: Mapping[str, Array], wanted: npt.NDArray[np.bool_], title: str
) -> Table:
    """Return a table that compares the shares in a drop with those of several repeated actions.

    The last row is the sum of the ``wanted`` rows (k,), if there are any. ``shares`` are the
    long-run shares (k,) of each action by name.
    """
    table = Table(title, (aspects_heading(rows), 'in a\ndrop', *shares))
    columns = (drop, *shares.values())
    for number, row in enumerate(rows):
        table.add_row(
            ids_text(row), *(share_percent_text(float(column[number])) for column in columns)
        )
    if wanted.any():
        sums = (share_percent_text(float(column[wanted].sum())) for column in columns)
        table.add_row(WANTED, *sums)
    return table


def long_run_text(rows: Rows, long_run: LongRun) -> str:
    """Return lines that describe several closed classes, and aspects outside of them.

    The text is empty if all aspects are in one closed class.
    """
    lines = []
    if len(long_run.closed) > 1:
        lines.append(
            'No simulated action led out of any of these groups of aspects, so the long run\n'
            'depends on the start. Rare ways out show with more actions:'
        )
        lines += [
            f'  {number}: {_names(rows, members)}, in which {share_text(weight)} % of parts end'
            for number, (members, weight) in enumerate(
                zip(long_run.closed, long_run.weights.tolist(), strict=True), start=1
            )
        ]
    unreachable = set(long_run.unreachable)
    if transient := [k for k in long_run.transient if k not in unreachable]:
        names = _names(rows, transient)
        lines.append(f'Estimated as 0, because no simulated action led back there: {names}.')
    if unreachable:
        lines.append(
            f'No simulated drop and no action led to {_names(rows, sorted(unreachable))}.'
        )
    return '\n'.join(lines)


def wanted_table(
    rows: Rows, wanted: npt.NDArray[np.bool_], probability: Array, actions: Array, title: str
) -> Table:
    """Return a table of the way to the wanted aspects from each row.

    Parameters
    ----------
    wanted : (k,) bool
    probability : (k,) float
        Probability to reach a wanted row before the part leaves the aspects.
    actions : (k,) float
        Expected number of actions, given that a wanted row is reached; NaN for never.
    """
    table = Table(title, ('from', 'reaches a\nwanted\naspect', 'expected\nactions,\nif it does'))
    columns = zip(rows, wanted.tolist(), probability.tolist(), actions.tolist(), strict=True)
    for row, is_wanted, reached, number in columns:
        if is_wanted:
            cells = WANTED, '0'
        else:
            cells = share_percent_text(reached), NEVER if np.isnan(number) else number_text(number)
        table.add_row(ids_text(row), *cells)
    return table


def plan_table(rows: Rows, plan: Plan, actions: Sequence[str], title: str) -> Table:
    """Return a table of the best action in each row, and the expected time to a wanted row.

    ``actions`` are the names of the actions of the plan.
    """
    headings = (aspects_heading(rows), 'best action', 'expected\ntime (s)')
    table = Table(title, headings, texts={'best action'})
    for row, action, time in zip(rows, plan.action.tolist(), plan.time.tolist(), strict=True):
        if time == 0:
            cells = WANTED, '0'
        elif np.isinf(time):
            cells = NOTHING, NEVER
        else:
            cells = actions[action], number_text(time)
        table.add_row(ids_text(row), *cells)
    return table


def _names(rows: Rows, indices: Sequence[int]) -> str:
    aspects = sorted((a for k in indices for a in rows[k]), key=lambda aspect: aspect.id)
    return aspects_text(tuple(aspects))


def retention_table(curves: Sequence[RetentionCurve], title: str, gravity: float) -> Table:
    """Return a table of the lift heights in mm at which 1, 10 and 50 % of parts leave an aspect.

    The interval is below each height. The barrier is also shown as the speed with the same energy,
    sqrt(2 g h), for a gravity in m/s2.
    """
    headings = [f'{100 * level:g} % leave\nat (mm)' for level in LEVELS]
    table = Table(title, ('aspect', 'barrier\n(mm)', 'as speed\n(m/s)', *headings))
    for curve in curves:
        barrier = [NOTHING, NOTHING]
        if np.isfinite(curve.barrier):
            speed = number_text(float(np.sqrt(2 * gravity * curve.barrier)))
            barrier = [millimetres_text(curve.barrier), speed]
        levels = (_level_text(curve, level) for level in LEVELS)
        table.add_row(str(curve.aspect), *barrier, *levels)
    return table


def _level_text(curve: RetentionCurve, level: float) -> str:
    """Return the lift height at which a share of the parts leaves, and below it the interval."""
    lift = curve.lift_at(level)
    lower, upper = curve.lift_interval(level)
    limit = f'{1000 * curve.lift[-1]:.4g} mm'
    value = f'not reached\nup to {limit}' if np.isnan(lift) else millimetres_text(lift)
    if np.isnan(lower):
        return value
    if np.isnan(upper):
        return f'{value}\nat least {millimetres_text(lower)}'
    return f'{value}\n{millimetres_text(lower)} to {millimetres_text(upper)}'


def matrix_fields(matrix: TransitionMatrix) -> dict[str, Any]:
    """Return a matrix by aspect, and in ``classes`` by symmetry class, as plain JSON types.

    The keys are described in docs/reference/files.md. The probability is null in a row without
    actions.
    """
    aspects = matrix.aspects
    members = [[aspect.id for aspect in alike] for alike in aspects.classes()]
    by_class = _fields(matrix.by_class(), [a[0].symmetry_class for a in aspects.classes()])
    by_aspect = _fields(matrix, [aspect.id for aspect in aspects])
    return {**by_aspect, 'classes': {'members': members, **by_class}}


def _fields(matrix: TransitionMatrix, numbers_of_rows: Sequence[int]) -> dict[str, object]:
    lower, upper = matrix.bounds()
    return {
        'columns': [*numbers_of_rows, *OUTCOMES],
        'actions': plain(matrix.actions),
        'counts': plain(matrix.counts),
        'probability': plain(matrix.probability),
        'lower': plain(lower),
        'upper': plain(upper),
    }


def long_run_fields(
    long_run: LongRun, lower: Array, upper: Array, aspects: AspectSet
) -> dict[str, object]:
    """Return the shares (k,) that repeated actions lead to, with their bounds, as JSON types.

    The keys are described in docs/reference/files.md.
    """
    ids = [aspect.id for aspect in aspects]
    closed = zip(long_run.closed, long_run.weights.tolist(), long_run.stationary, strict=True)
    return {
        'long_run': numbers(long_run.shares),
        'long_run_lower': numbers(lower),
        'long_run_upper': numbers(upper),
        'closed_classes': [
            {'aspects': [ids[k] for k in members], 'weight': weight, 'shares': numbers(shares)}
            for members, weight, shares in closed
        ],
        'transient': [ids[k] for k in long_run.transient],
        'unreachable': [ids[k] for k in long_run.unreachable],
    }


def retention_fields(curve: RetentionCurve) -> dict[str, object]:
    """Return a retention curve as plain JSON types; see docs/reference/files.md. Lengths in m."""
    lower, upper = curve.bounds()
    levels = []
    for level in LEVELS:
        low, high = curve.lift_interval(level)
        levels.append({'level': level, 'lift': curve.lift_at(level), 'lower': low, 'upper': high})
    return {
        'aspect': curve.aspect,
        'barrier': plain(float(curve.barrier)),
        'lift': numbers(curve.lift),
        'left': plain(curve.left),
        'parts': plain(curve.parts),
        'probability': plain(curve.probability),
        'lower': plain(lower),
        'upper': plain(upper),
        'levels': plain(levels),
    }


# -- Figures --------------------------------------------------------------------------------------


MAX_ROWS = 12


def row_images(part: Part | None, rows: Rows, pixels: int) -> list[Image]:
    """Return a picture of the part in each row; none without a part."""
    if part is None:
        return []
    aspects = [row[0] for row in rows]
    posed_parts = pose_parts(picture_part(part), aspects)
    return draw_parts(posed_parts, [rgb(aspect_colour(each)) for each in aspects], pixels)


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

    If there are more than MAX_ROWS aspects, rows and columns are symmetry classes; of more
    classes, those to which most actions lead are shown. Outcomes in no aspect have columns if
    they occurred. Without a title, the figure has no explanation either; see transition_note.
    ``matrix`` is by aspect.
    """
    matrix, rows, kept = _arranged(matrix)
    shown = [*kept, *(c for c in shown_columns(matrix) if c >= len(matrix.counts))]
    columns = len(shown)
    side = CELL if columns <= MANY else CELL_OF_MANY
    left = MARGIN + NAMES + (side if part else 0) + BESIDE
    width = left + side * columns + GAP * (columns > len(rows)) + ACTIONS + MARGIN
    width = max(width, MIN_WIDTH)
    header = Header(title, transition_note(matrix) if title else '', width)
    names = [textwrap.fill(ids_text(row), 8) for row in rows]
    lines = max((name.count('\n') + 1 for name in names), default=1)
    above = (side if part else 0) + LINE * max(lines, 2) + 2 * BESIDE
    figure, axes = pixel_axes(width, header.height + above + side * len(rows) + MARGIN)
    header.draw(axes)
    x = left + side * np.arange(0.5, columns, dtype=np.float64)
    x[len(rows) :] += GAP
    y = MARGIN + side * np.arange(0.5, len(rows), dtype=np.float64)[::-1]
    _draw_axes(axes, names, row_images(part, rows, side), (x, y), side)
    top = MARGIN + side * len(rows) + BESIDE
    for column, place in zip(shown[len(rows) :], x[len(rows) :], strict=True):
        heading = OUTCOME_HEADINGS[OUTCOMES[column - len(matrix.counts)]]
        _write(axes, heading, place, top, ha='center', va='bottom')
    found = matrix_intervals(matrix)
    for row, place in zip(kept, y.tolist(), strict=True):
        for column, at in zip(shown, x.tolist(), strict=True):
            interval = found[row][column] if found[row] else None
            _draw_cell(axes, interval, (at, place), side, outcome=column >= len(matrix.counts))
        text = f'{matrix.actions[row]:,} actions'.replace(',', ' ')
        axes.text(x[-1] + side / 2 + BESIDE, place, text, size=7, color=FAINT, va='center')
    return figure


def _arranged(
    matrix: TransitionMatrix,
) -> tuple[TransitionMatrix, list[tuple[Aspect, ...]], list[int]]:
    """Return the matrix by aspect or class, and the aspects and numbers of the shown rows."""
    by_class = len(matrix.counts) > MAX_ROWS
    rows = table_rows(matrix.aspects, by_class=by_class)
    matrix = matrix.by_class() if by_class else matrix
    kept = largest_counts(matrix.counts[:, : len(rows)].sum(axis=0).tolist(), MAX_ROWS)
    return matrix, [rows[k] for k in kept], kept


def transition_note(matrix: TransitionMatrix) -> str:
    """Return the text that explains the figure."""
    note = (
        'Probability in % that one action takes a part from the aspect of the row to the aspect '
        f'of the column, with {100 * matrix.confidence:g} % interval '
        f'({matrix.interval.capitalize()}).'
    )
    if len(matrix.aspects.classes()) > MAX_ROWS:
        note += f' The {MAX_ROWS} classes of aspects to which most actions lead are shown.'
    return note


def _draw_axes(
    axes: 'Axes',
    names: Sequence[str],
    images: Sequence[Image],
    places: tuple[Array, Array],
    side: int,
) -> None:
    """Draw the picture and the name of each row left of it and above its column."""
    x, y = places
    left, top = x[0] - side / 2 - BESIDE, y[0] + side / 2 + BESIDE
    pictures = side if images else 0
    for k, image in enumerate(images):
        draw_image(axes, image, left - side / 2, y[k])
        draw_image(axes, image, x[k], top + side / 2)
    for k, name in enumerate(names):
        _write(axes, name, left - pictures - BESIDE / 2, y[k], ha='right', va='center')
        _write(axes, name, x[k], top + pictures, ha='center', va='bottom')
    _write(axes, 'from', MARGIN, top, ha='left', va='bottom', color=FAINT)
    _write(axes, 'to', left - BESIDE, top + pictures, ha='right', va='bottom', color=FAINT)


def _write(axes: 'Axes', text: str, x: float, y: float, **style: Any) -> None:
    style = {'size': 8.5, 'weight': 'bold', 'color': TEXT, 'linespacing': 1.1, **style}
    axes.text(x, y, text, **style)


def _draw_cell(
    axes: 'Axes',
    interval: Interval | None,
    place: tuple[float, float],
    side: int,
    *,
    outcome: bool,
) -> None:
    """Draw a cell around a place; None: there are no actions."""
    from matplotlib.patches import Rectangle

    x, y = place
    ends = (PALE_OUTCOME, DEEP_OUTCOME) if outcome else (PALE, DEEP)
    colour = _mixed(*ends, interval.probability if interval else 0.0)
    corner = x - side / 2 + 1, y - side / 2 + 1
    axes.add_patch(Rectangle(corner, side - 2, side - 2, color=colour, linewidth=0))
    if interval is None:
        axes.text(x, y, '-', size=9, color=DARK_TEXT, ha='center', va='center')
    else:
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
    red, green, blue = (a + share * (b - a) for a, b in zip(rgb(first), rgb(last), strict=True))
    return red, green, blue


MAX_LINES = 10  # more lines would hide each other
# Sizes in pixels. LABEL is the height of the label of a line, PICTURE the side of its picture.
WIDTH, HEIGHT = 1240, 480
LEFT, BOTTOM, RIGHT = 92, 84, 330
LABEL, PICTURE = 84, 80
# The curve of an aspect, or the common curve of several aspects that look the same.
Line = tuple[RetentionCurve, tuple[Aspect, ...]]


def retention_lines(curves: Sequence[RetentionCurve], aspects: AspectSet) -> list[Line]:
    """Return a line for each symmetry class with a curve, in the order of the ids.

    The counts of curves of the same class are added up if they have the same lift heights.
    """
    lines: list[Line] = []
    for curve in curves:
        aspect = aspects[curve.aspect - 1]
        for k, (one, members) in enumerate(lines):
            alike = members[0].symmetry_class == aspect.symmetry_class
            if alike and one.lift.shape == curve.lift.shape and np.allclose(one.lift, curve.lift):
                left, parts = one.left + curve.left, one.parts + curve.parts
                lines[k] = dataclasses.replace(one, left=left, parts=parts), (*members, aspect)
                break
        else:
            lines.append((curve, (aspect,)))
    return lines


def retention_figure(
    curves: Sequence[RetentionCurve], aspects: AspectSet, part: Part | None, title: str
) -> 'Figure':
    """Plot the probability to leave each aspect against the lift height, with intervals as bands.

    Dashed vertical lines are the barriers. Curves of the same symmetry class and the same lift
    heights are one line. Of more than MAX_LINES, those of the classes with the largest basins are
    shown. Without a title, the figure has no explanation either; see retention_note.
    """
    lines = retention_lines(curves, aspects)
    basins = [sum(aspect.basin_share for aspect in members) for _, members in lines]
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
    ends = [BOTTOM + room * float(curve.probability[-1]) / top for curve, _ in shown]
    images = row_images(part, [members for _, members in shown], PICTURE)
    order = sorted(range(len(ends)), key=lambda k: ends[k])
    low, high = BOTTOM + LABEL / 2, BOTTOM + room - LABEL / 2
    places = labels_apart(np.array([ends[k] for k in order]), LABEL, low, high)
    for k, y in zip(order, places.tolist(), strict=True):
        _write_label(canvas, shown[k], images[k] if images else None, ends[k], y)
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
    """Draw lines, bands and barriers, and return the end of the probability axis."""
    top = 0.0
    for curve, members in shown:
        lift, colour = 1000 * curve.lift, aspect_colour(members[0])
        lower, upper = curve.bounds()
        axes.fill_between(lift, lower, upper, color=colour, alpha=0.22, linewidth=0)
        axes.plot(lift, curve.probability, '.-', markersize=5, color=colour, linewidth=1.8)
        if np.isfinite(curve.barrier):
            barrier = 1000 * curve.barrier
            axes.axvline(barrier, color=colour, linewidth=1.3, linestyle='--', zorder=1.5)
        top = max(top, float(upper.max()))
    return min(1.1 * top, 1.0)


def _set_axes(axes: 'Axes', shown: Sequence[Line], top: float) -> None:
    from matplotlib.ticker import LogLocator

    low = 900 * min(float(curve.lift[0]) for curve, _ in shown)
    high = 1000 * max(float(curve.lift[-1]) for curve, _ in shown)
    plain_axes(axes, 'y')
    axes.tick_params(axis='x', pad=9)
    axes.set_xscale('log')
    locator = LogLocator(subs=(1.0, 2.0, 5.0))
    axes.set_xlim(low, high)
    axes.set_xticks([lift for lift in locator.tick_values(low, high) if low <= lift <= high])
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda lift, _: f'{lift:g}')
    axes.set_ylim(0, top)
    percent_axis(axes, 'y', top)
    axes.set_xlabel('lift height (mm)', size=8, color=FAINT, labelpad=8)


def _write_label(canvas: 'Axes', line: Line, image: Image | None, end: float, y: float) -> None:
    """Write name and barrier at the height ``y``, linked with the end of the line."""
    curve, members = line
    right = WIDTH - RIGHT
    x = right + 40
    link = [right + 4, right + 14, x - 6, x], [end, end, y, y]
    canvas.plot(*link, color=aspect_colour(members[0]), linewidth=1.2)
    if image is not None:
        draw_image(canvas, image, x + 6 + PICTURE / 2, y)
        x += PICTURE + 8
    barrier = curve.barrier
    text = f'barrier {millimetres_text(barrier)} mm' if np.isfinite(barrier) else 'no barrier'
    name = textwrap.fill(aspects_text(members), 16)
    canvas.text(x + 6, y + 2, name, size=8.5, weight='bold', color=TEXT, va='bottom')
    canvas.text(x + 6, y - 4, text, size=7.5, color=FAINT, va='top')

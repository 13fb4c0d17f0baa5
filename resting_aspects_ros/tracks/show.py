"""A track with traps: tables, a document, and figures to scale."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from resting_aspects_ros.report.document import plain
from resting_aspects_ros.report.figure import FAINT, GRID, TEXT, new_figure
from resting_aspects_ros.report.format import (
    interval_text,
    numbers_text,
    probability_text,
    share_text,
)
from resting_aspects_ros.report.table import NOTHING, Table
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.tracks.orientations import Orientation
from resting_aspects_ros.tracks.rate import Passage
from resting_aspects_ros.tracks.traps import Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from resting_aspects_ros.tracks.design import Band
    from resting_aspects_ros.tracks.simulate import TrackRuns

# Colours of the outcomes, which colour-blind people distinguish.
COLOURS = {
    'pass': '#009E73',
    'reject': '#D55E00',
    'jam': '#CC79A7',
    'turn': '#56B4E9',
    'unknown': '#999999',
}
PART, CONTACT, SUPPORT = '#C9D6E2', '#4477AA', '#EE7733'
# A row with a smaller share of the parts is shown only if it is wanted.
LEAST = 5e-4
# Orientations of a figure in a line, and its width, inches.
_COLUMNS, _WIDTH = 4, 8.0


def row_fields(row: Orientation) -> dict[str, Any]:
    """Return an orientation on the track as plain JSON types, SI units."""
    return {
        'id': row.id,
        'aspects': list(row.aspects),
        'orientation': plain(row.orientation),
        'yaw': row.yaw.angle,
        'probability': row.probability,
        'wall_low': row.low,
        'wall_high': row.high,
        'model_lower': None if row.model is None else row.model[0],
        'model_upper': None if row.model is None else row.model[1],
        'com_to_wall': row.yaw.distance,
        'com_height': row.com_height,
        'height': row.height,
        'length': row.length,
        'lever': row.yaw.lever,
        'rolls': row.rolls,
    }


def shown_rows(found: Passage) -> list[int]:
    """Return the indices of the rows that people see: no others that hardly a part arrives in."""
    return [
        k for k, row in enumerate(found.rows) if row.probability >= LEAST or row.id in found.wanted
    ]


def row_table(
    found: Passage, shares: Sequence[Interval], runs: 'TrackRuns | None', title: str
) -> Table:
    """Return the table of the orientations, and which of them pass the traps.

    shares : sequence of Interval
        Share of each row with its sampling interval.
    """
    ranged = found.model_good is not None
    bounds = ['95 % interval', 'model range' if ranged else 'wall friction']
    if runs is not None:  # a terminal has no room for both beside the simulated shares
        bounds = [',\n'.join(bounds)]
    headings = ['row', 'aspects', 'share', *bounds, 'height\n(mm)', 'centre to\nwall (mm)']
    headings += ['passes'] if runs is None else ['passes', 'simulated']
    table = Table(title, headings, texts={'passes'})
    shown = shown_rows(found)
    for k in shown:
        row, (low, high) = found.rows[k], (float(each[k]) for each in found.passing)
        wider = (row.low, row.high) if row.model is None else row.model
        texts = [interval_text(each) for each in (shares[k], Interval(row.probability, *wider))]
        cells = [
            f'{row.id} *' if row.id in found.wanted else str(row.id),
            numbers_text(row.aspects),
            f'{share_text(row.probability)} %',
            *(texts if runs is None else ['\n'.join(texts)]),
            f'{1e3 * row.height:.1f}',
            f'{1e3 * row.yaw.distance:.2f}',
            _passes(low, high),
        ]
        if runs is not None:
            share = runs.shares[k]
            cells.append(f'{probability_text(share)}\n{interval_text(share)}')
        table.add_row(*cells)
    table.caption = '* wanted.'
    others = np.delete(found.probability, shown)
    if len(others):
        names = f'{len(others)} other rows are' if len(others) > 1 else 'One other row is'
        table.caption += f' {names} not shown, with {share_text(others.sum())} % of the parts.'
    if runs is not None:
        table.caption += (
            f' Simulated: share of {runs.parts} parts of the row that passes all traps, with its '
            '95 % interval (Wilson).'
        )
    return table


def _passes(low: float, high: float) -> str:
    if low == high:
        return 'yes' if low == 1 else 'no' if low == 0 else f'{share_text(low)} %'
    return 'not known' if (low, high) == (0, 1) else f'{share_text(low)} to {share_text(high)} %'


def trap_table(names: Sequence[str], found: Passage, runs: 'TrackRuns | None') -> Table:
    """Return the table of what each trap does to each row: outcome, and margin in mm."""
    headings = [f'{k}: {name}' for k, name in enumerate(names, 1)]
    # A terminal needs short lines; a page shows a heading in one line.
    table = Table('', ('row', *(each.replace(', ', ',\n') for each in headings)))
    for k in shown_rows(found):
        cells = []
        for t, of_trap in enumerate(found.outcomes):
            text = _outcome_text(of_trap[k])
            cells.append(text if runs is None else f'{text}\n{_run_text(runs, t, k)}')
        table.add_row(str(found.rows[k].id), *cells)
    table.caption = (
        'Below each outcome is the margin in mm, and the dimension that limits it: how far the '
        'trap is from the value at which the outcome changes.'
    )
    if runs is not None:
        table.caption += ' Below it are the simulated parts that arrived, and what became of them.'
    return table


def _outcome_text(found: Outcome) -> str:
    if found.share is not None:
        return f'{found.outcome}\n{share_text(found.share)} % accepted'
    if not math.isfinite(found.margin):
        return found.outcome
    return f'{found.outcome}\n{1e3 * found.margin:+.2f} {found.limited_by}'


def _run_text(runs: 'TrackRuns', trap: int, row: int) -> str:
    """Return what became of the simulated parts of a row at a trap, such as '19 pass, 1 jam'."""
    counts = runs.counts[trap, row].tolist()
    if not runs.simulated[trap] or not any(counts):
        return NOTHING
    names = ('pass', 'turn', 'reject', 'jam')
    return ', '.join(f'{n} {name}' for n, name in zip(counts, names, strict=True) if n)


def band_table(bands: Sequence[tuple[str, str, int, 'Band']]) -> Table:
    """Return the table of the grey bands: trap in words, dimension, row and band."""
    table = Table(
        '',
        ('trap', 'row', 'dimension', 'all pass\nfrom (mm)', 'none passes\nfrom (mm)'),
        texts={'dimension'},
    )
    for name, dimension, row, band in bands:
        table.add_row(
            name.partition(',')[0],
            str(row),
            dimension,
            *(
                f'{1e3 * value:.2f}' if math.isfinite(value) else NOTHING
                for value in (band.passes, band.rejects)
            ),
        )
    table.caption = (
        'The simulated values from which all parts of a wanted row pass at this speed, and none '
        f'of another row does. {NOTHING}: not needed, or not within 16 mm of the critical value.'
    )
    return table


def interval_words(share: Interval) -> str:
    """Return a share with its interval: '99.5 % (97.2 to 99.9 %)'."""
    return f'{probability_text(share)} ({interval_text(share)})'


def range_text(low: float, high: float, unit: str, decimals: int = 1) -> str:
    """Return a value, or its range, with a unit: '12.3 %' or '10.0 to 12.3 %'."""
    one, other = (f'{value:.{decimals}f}' for value in (low, high))
    return f'{one} {unit}' if one == other else f'{one} to {other} {unit}'


def rows_figure(
    found: Passage,
    outlines: Sequence[shapely.Geometry],
    supported: Sequence[shapely.Geometry],
) -> 'Figure':
    """Return each orientation from above, to scale: outline, contact, centre of mass, margin.

    Parameters
    ----------
    outlines : sequence of shapely geometry
        Outline of each shown row from above, m, wall at y = 0.
    supported : sequence of shapely geometry
        Convex hull of what the track carries of each shown row, m.
    """
    shown = shown_rows(found)
    rows = [found.rows[k] for k in shown]
    lines = -(-len(rows) // _COLUMNS)
    figure = new_figure(_WIDTH, 2.3 * lines)
    reach = max(max(row.length, row.width) for row in rows)
    for k, row in enumerate(rows):
        outcome = found.ends[shown[k]]
        axes = figure.add_subplot(lines, _COLUMNS, k + 1)
        _draw_wall(axes, reach)
        _fill(axes, outlines[k], PART, 1.0)
        _draw_contact(axes, row.contact)
        _draw_support(axes, supported[k])
        middle = float(np.mean([row.corners[:, 0].min(), row.corners[:, 0].max()]))
        axes.plot([0], [row.yaw.distance], marker='+', color=TEXT, markersize=8, mew=1.5)
        axes.set_xlim(middle - 0.62 * reach, middle + 0.62 * reach)
        axes.set_ylim(-0.12 * reach, 1.1 * reach)
        axes.set_aspect('equal')
        axes.axis('off')
        star = ' *' if row.id in found.wanted else ''
        margin = _deciding_margin(found, shown[k])
        below = '' if margin is None else f'\nmargin {1e3 * margin:+.2f} mm'
        axes.set_title(
            f'{row.id}{star}: {share_text(row.probability)} %, {outcome}{below}',
            fontsize=8,
            color=COLOURS.get(outcome, TEXT),
        )
    figure.tight_layout()
    return figure


def _deciding_margin(found: Passage, k: int) -> float | None:
    """Return the margin of the trap that stops row k, or the least one of those that pass it."""
    margins = [(each.outcome, each.margin) for each in (of_trap[k] for of_trap in found.outcomes)]
    stopping = [margin for outcome, margin in margins if outcome != 'pass']
    value = stopping[0] if stopping else min((margin for _, margin in margins), default=math.inf)
    return value if math.isfinite(value) else None


def track_figure(
    width: float,
    names: Sequence[str],
    cuts: Sequence[shapely.Geometry | None],
    wanted: shapely.Geometry,
) -> 'Figure':
    """Return the track from above, to scale, with its traps, and the wanted row before them.

    cuts : sequence of shapely geometry or None
        What each trap cuts out of the track, m, from its start; None: nothing.
    """
    figure = new_figure(_WIDTH, 2.8)
    axes = figure.add_subplot()
    left, low, right, high = wanted.bounds
    size = right - left
    place, cut = 0.6 * size, []
    for number, piece in enumerate(cuts, 1):
        length = 1.5 * size
        if piece is not None:
            x0, _, x1, _ = piece.bounds
            if x1 - x0 < 1.0:
                length = x1 - x0
                moved = shapely.affinity.translate(piece, place - x0)
            else:
                moved = piece.intersection(shapely.box(-1, -1, 1, 1))
                moved = shapely.box(place, moved.bounds[1], place + length, moved.bounds[3])
            cut.append(moved)
        else:
            axes.plot([place, place], [0, width], color=TEXT, linewidth=2)
            length = 0.0
        axes.text(
            place + length / 2, 1.04 * max(width, high), str(number), ha='center', va='bottom',
            fontsize=9, color=TEXT,
        )  # fmt: skip
        place += length + 1.2 * size
    track = shapely.box(-1.8 * size, 0, place, width).difference(shapely.union_all(cut))
    _fill(axes, track, GRID, 1.0)
    middle = (left + right) / 2
    _fill(axes, shapely.affinity.translate(wanted, -1.1 * size - middle), PART, 1.0)
    axes.plot([-1.8 * size, place], [0, 0], color=TEXT, linewidth=3, solid_capstyle='butt')
    axes.annotate(
        '',
        (0.25 * size, width / 2),
        (-0.35 * size, width / 2),
        arrowprops={'arrowstyle': '->', 'color': TEXT},
    )
    axes.set_title(
        ';  '.join(f'{k}: {name}' for k, name in enumerate(names, 1)),
        fontsize=8,
        loc='left',
        color=TEXT,
    )
    axes.set_xlim(-1.8 * size, place)
    axes.set_ylim(min(-0.1 * width, low), 1.25 * max(width, high))
    axes.set_aspect('equal')
    axes.set_xlabel('mm', fontsize=8, color=FAINT)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f'{1e3 * value:.0f}')
    axes.tick_params(labelsize=7, labelcolor=FAINT)
    axes.spines[['top', 'right', 'left']].set_visible(False)
    figure.tight_layout()
    return figure


def flow_figure(found: Passage, names: Sequence[str]) -> 'Figure':
    """Return where the parts go, a Sankey diagram: from trap to trap, and out of the track.

    The height of a band is a share of the parts, its number a row, and its colour what becomes of
    it. A row of which a sensor accepts only a share is divided. What is not known goes on.
    """
    figure = new_figure(_WIDTH, 4.0)
    axes = figure.add_subplot()
    stages = list(zip(names, found.outcomes, strict=True))
    if any(each.outcome != 'pass' for each in found.entry):
        stages = [('track', found.entry), *stages]
    # What stays longest is at the top, so that few bands cross.
    order = sorted(range(len(found.rows)), key=lambda k: -_stages_passed(stages, k))
    alive = {k: p for k in order if (p := found.rows[k].probability) > 0}
    left, lowest = _stack(alive), 0.0
    for k, ends in left.items():
        _label(axes, -0.03, ends, str(found.rows[k].id), align='right')
    for stage, (name, outcomes) in enumerate(stages):
        kept = {k: share * _kept(outcomes[k]) for k, share in alive.items()}
        lost = {k: share - kept[k] for k, share in alive.items()}
        right, gone = _stack(kept), _stack(lost, -0.1)
        for k, (low, high) in left.items():
            middle = low + lost[k]
            stop, pass_on = COLOURS[outcomes[k].outcome], COLOURS[found.ends[k]]
            _draw_band(axes, (stage, stage + 0.75), (low, middle), gone.get(k), stop)
            _draw_band(axes, (stage, stage + 1.0), (middle, high), right.get(k), pass_on)
        total = sum(lost.values())
        if total:
            out = f'{share_text(total)} % out at\n{name.partition(",")[0]}'
            axes.text(stage + 0.77, -0.1 - total / 2, out, va='center', fontsize=8, color=TEXT)
        lowest = min(lowest, -0.1 - total)
        alive = {k: share for k, share in kept.items() if share > 0}
        left = right
    for k, ends in left.items():
        star = ' *' if found.rows[k].id in found.wanted else ''
        text = f'{found.rows[k].id}{star}, {share_text(alive[k])} %'
        _label(axes, len(stages) + 0.03, ends, text, align='left')
    axes.set_xlim(-0.15, len(stages) + 0.35)
    axes.set_ylim(lowest - 0.08, 1.02)
    axes.axis('off')
    figure.tight_layout()
    return figure


def _stages_passed(stages: Sequence[tuple[str, Sequence[Outcome]]], k: int) -> int:
    """Return how many stages row k passes."""
    passed = [_kept(outcomes[k]) > 0 for _, outcomes in stages]
    return passed.index(False) if False in passed else len(passed)


def _kept(found: Outcome) -> float:
    """Return the share of a row that goes on."""
    if found.share is not None:
        return found.share
    return 0.0 if found.outcome in ('reject', 'jam') else 1.0


def _stack(shares: Mapping[int, float], top: float = 1.0) -> dict[int, tuple[float, float]]:
    """Return bottom and top of the band of each row that has a share, the first at the top."""
    found = {}
    for k, share in shares.items():
        if share > 0:
            found[k] = (top - share, top)
            top -= share
    return found


def _label(axes: 'Axes', x: float, ends: tuple[float, float], text: str, align: str) -> None:
    """Write the number of a row beside its band, if the band is high enough for it."""
    if ends[1] - ends[0] > 0.045:
        axes.text(x, sum(ends) / 2, text, ha=align, va='center', fontsize=8, color=TEXT)


def _draw_band(
    axes: 'Axes',
    x: tuple[float, float],
    start: tuple[float, float],
    end: tuple[float, float] | None,
    colour: str,
) -> None:
    """Fill a band that bends from one height to another; none if it has no end."""
    if end is None:
        return
    at = np.linspace(0.0, 1.0, 40)
    bend = at * at * (3 - 2 * at)
    low, high = (a + (b - a) * bend for a, b in zip(start, end, strict=True))
    places = x[0] + (x[1] - x[0]) * at
    axes.fill_between(places, low, high, color=colour, alpha=0.75, linewidth=0.4, ec='white')


def _draw_wall(axes: 'Axes', reach: float) -> None:
    axes.plot([-2 * reach, 2 * reach], [0, 0], color=TEXT, linewidth=2.5, solid_capstyle='butt')


def _draw_contact(axes: 'Axes', contact: shapely.Geometry) -> None:
    for piece in shapely.get_parts(contact):
        if piece.geom_type == 'Polygon':
            _fill(axes, piece, CONTACT, 0.55)
        else:
            at = shapely.get_coordinates(piece)
            axes.plot(at[:, 0], at[:, 1], color=CONTACT, linewidth=2.5, marker='.', markersize=4)


def _draw_support(axes: 'Axes', region: shapely.Geometry) -> None:
    """Draw the border of the region that has to contain the centre of mass."""
    at = shapely.get_coordinates(region)
    if len(at) > 1:
        axes.plot(at[:, 0], at[:, 1], color=SUPPORT, linewidth=1.2, linestyle='--')


def _fill(axes: 'Axes', geometry: shapely.Geometry, colour: str, alpha: float) -> None:
    """Fill polygons with their holes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    for piece in shapely.get_parts(geometry):
        if piece.geom_type != 'Polygon' or piece.is_empty:
            continue
        rings = [piece.exterior, *piece.interiors]
        path = Path.make_compound_path(*(Path(np.asarray(r.coords), closed=True) for r in rings))
        axes.add_patch(PathPatch(path, facecolor=colour, edgecolor=FAINT, lw=0.6, alpha=alpha))


def rows_text(ids: Sequence[int]) -> str:
    """Return rows as 'row 3' or 'rows 3 and 4'."""
    return f'{"row" if len(ids) == 1 else "rows"} {numbers_text(ids)}'


def margin_text(margin: float) -> str:
    """Return a margin in mm, or what its absence means."""
    return f'{1e3 * margin:.2f} mm' if math.isfinite(margin) else NOTHING

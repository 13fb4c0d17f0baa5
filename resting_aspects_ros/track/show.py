"""A track with traps: tables, a document, and figures to scale."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.report.document import plain
from resting_aspects_ros.report.figure import FAINT, GRID, TEXT, new_figure
from resting_aspects_ros.report.format import numbers_text, share_text
from resting_aspects_ros.report.table import NOTHING, Table
from resting_aspects_ros.track.orientations import Orientation
from resting_aspects_ros.track.traps import Outcome

if TYPE_CHECKING:
    import shapely
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of the outcomes, which colour-blind people distinguish.
COLOURS = {
    'pass': '#009E73',
    'reject': '#D55E00',
    'jam': '#CC79A7',
    'turn': '#56B4E9',
    'unknown': '#999999',
}
PART, CONTACT = '#C9D6E2', '#4477AA'
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
        'com_to_wall': row.yaw.distance,
        'com_height': row.com_height,
        'height': row.height,
        'length': row.length,
        'lever': row.yaw.lever,
        'rolls': row.rolls,
    }


def outcome_fields(row: int, found: Outcome) -> dict[str, Any]:
    """Return what a trap does to a row; values that do not exist are null."""
    return {
        'id': row,
        'outcome': found.outcome,
        'critical': plain(found.critical),
        'margin': plain(found.margin),
        'limited_by': found.limited_by,
    }


def row_table(
    rows: Sequence[Orientation], wanted: Sequence[int], passing: tuple[Any, Any], title: str
) -> Table:
    """Return the table of the orientations, and which of them pass the traps."""
    headings = (
        'row',
        'aspects',
        'share',
        'with wall\nfriction',
        'height\n(mm)',
        'length\n(mm)',
        'centre to\nwall (mm)',
        'passes',
    )
    table = Table(title, headings, texts={'passes': None})
    for row, low, high in zip(rows, *(each.tolist() for each in passing), strict=True):
        name = f'{row.id} *' if row.id in wanted else str(row.id)
        table.add_row(
            name,
            numbers_text(row.aspects),
            f'{share_text(row.probability)} %',
            f'{share_text(row.low)} to {share_text(row.high)} %',
            f'{1e3 * row.height:.1f}',
            f'{1e3 * row.length:.1f}',
            f'{1e3 * row.yaw.distance:.2f}',
            _passes(low, high),
        )
    table.caption = '* wanted'
    return table


def _passes(low: float, high: float) -> str:
    if low == high:
        return 'yes' if low == 1 else 'no' if low == 0 else f'{share_text(low)} %'
    return 'not known' if (low, high) == (0, 1) else f'{share_text(low)} to {share_text(high)} %'


def trap_table(
    rows: Sequence[Orientation], names: Sequence[str], found: Sequence[Sequence[Outcome]]
) -> Table:
    """Return the table of what each trap does to each row: outcome, and margin in mm."""
    table = Table('', ('row', *(f'{k}: {name}' for k, name in enumerate(names, 1))))
    for k, row in enumerate(rows):
        table.add_row(str(row.id), *(_outcome_text(of_trap[k]) for of_trap in found))
    table.caption = (
        'Below each outcome is the margin in mm, and the dimension that limits it: how far the '
        'trap is from the value at which the outcome changes.'
    )
    return table


def _outcome_text(found: Outcome) -> str:
    if not math.isfinite(found.margin):
        return found.outcome
    return f'{found.outcome}\n{1e3 * found.margin:+.2f} {found.limited_by}'


def range_text(low: float, high: float, unit: str, decimals: int = 1) -> str:
    """Return a value, or its range, with a unit: '12.3 %' or '10.0 to 12.3 %'."""
    one, other = (f'{value:.{decimals}f}' for value in (low, high))
    return f'{one} {unit}' if one == other else f'{one} to {other} {unit}'


def rows_figure(
    rows: Sequence[Orientation],
    outlines: Sequence['shapely.Geometry'],
    outcome: Sequence[str],
    wanted: Sequence[int],
) -> 'Figure':
    """Return each orientation from above, to scale: outline, contact and centre of mass.

    Parameters
    ----------
    outlines : sequence of shapely geometry
        Outline of each row from above, m, wall at y = 0.
    outcome : sequence of str
        What becomes of each row.
    """
    lines = -(-len(rows) // _COLUMNS)
    figure = new_figure(_WIDTH, 2.2 * lines)
    reach = max(max(row.length, row.width) for row in rows)
    for k, row in enumerate(rows):
        axes = figure.add_subplot(lines, _COLUMNS, k + 1)
        _draw_wall(axes, reach)
        _fill(axes, outlines[k], PART, 1.0)
        _draw_contact(axes, row.contact)
        middle = float(np.mean([row.corners[:, 0].min(), row.corners[:, 0].max()]))
        axes.plot([0], [row.yaw.distance], marker='+', color=TEXT, markersize=8, mew=1.5)
        axes.set_xlim(middle - 0.62 * reach, middle + 0.62 * reach)
        axes.set_ylim(-0.12 * reach, 1.1 * reach)
        axes.set_aspect('equal')
        axes.axis('off')
        star = ' *' if row.id in wanted else ''
        axes.set_title(
            f'{row.id}{star}: {share_text(row.probability)} %, {outcome[k]}',
            fontsize=8,
            color=COLOURS.get(outcome[k], TEXT),
        )
    figure.tight_layout()
    return figure


def track_figure(
    width: float,
    names: Sequence[str],
    cuts: Sequence['shapely.Geometry | None'],
    wanted: 'shapely.Geometry',
) -> 'Figure':
    """Return the track from above, to scale, with its traps, and the wanted row before them.

    cuts : sequence of shapely geometry or None
        What each trap cuts out of the track, m, from its start; None: nothing.
    """
    import shapely

    figure = new_figure(_WIDTH, 2.8)
    axes = figure.add_subplot()
    left, low, right, _ = wanted.bounds
    size = right - left
    place, cut = 0.6 * size, []
    for name, piece in zip(names, cuts, strict=True):
        length = 1.5 * size
        if piece is not None:
            x0, _, x1, _ = piece.bounds
            if x1 - x0 < 1.0:
                length = x1 - x0
                moved = shapely.affinity.translate(piece, place - x0)
            else:
                moved = piece.intersection(shapely.box(place, -1, place + length, 1))
                moved = shapely.box(place, moved.bounds[1], place + length, moved.bounds[3])
            cut.append(moved)
        else:
            axes.plot([place, place], [0, width], color=TEXT, linewidth=2)
        axes.text(place + length / 2, 1.03 * width, name, ha='center', va='bottom', fontsize=7)
        place += length + 1.2 * size
    track = shapely.box(-1.5 * size, 0, place, width).difference(shapely.union_all(cut))
    _fill(axes, track, GRID, 1.0)
    _fill(axes, shapely.affinity.translate(wanted, -size), PART, 1.0)
    axes.axhline(0, color=TEXT, linewidth=3)
    axes.annotate(
        '',
        (-0.2 * size, width / 2),
        (-0.5 * size + 0.1 * size, width / 2),
        arrowprops={'arrowstyle': '->', 'color': FAINT},
    )
    axes.set_xlim(-1.8 * size, place)
    axes.set_ylim(min(-0.1 * width, low), 1.25 * width)
    axes.set_aspect('equal')
    axes.set_xlabel('mm', fontsize=8, color=FAINT)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f'{1e3 * value:.0f}')
    axes.tick_params(labelsize=7, labelcolor=FAINT)
    axes.spines[['top', 'right', 'left']].set_visible(False)
    figure.tight_layout()
    return figure


def flow_figure(
    rows: Sequence[Orientation], names: Sequence[str], found: Sequence[Sequence[Outcome]]
) -> 'Figure':
    """Return where the parts go: a bar before the traps and after each of them, by row."""
    figure = new_figure(_WIDTH, 0.45 * (len(names) + 1) + 0.9)
    axes = figure.add_subplot()
    left = np.array([row.probability for row in rows])
    alive = np.ones(len(rows))
    labels = ['before the traps', *(f'after {k}: {name}' for k, name in enumerate(names, 1))]
    for line in range(len(labels)):
        if line:
            for k, of_row in enumerate(found[line - 1]):
                if of_row.outcome in ('reject', 'jam'):
                    alive[k] = 0
                elif of_row.outcome in ('unknown', 'turn') and alive[k] == 1:
                    alive[k] = 0.5
        start = 0.0
        for k, row in enumerate(rows):
            if alive[k]:
                axes.barh(
                    -line,
                    left[k],
                    left=start,
                    color=COLOURS['pass' if alive[k] == 1 else 'unknown'],
                    edgecolor='white',
                    height=0.7,
                )
                if left[k] > 0.03:
                    axes.text(
                        start + left[k] / 2,
                        -line,
                        str(row.id),
                        ha='center',
                        va='center',
                        fontsize=7,
                        color='white',
                    )
                start += left[k]
    axes.set_yticks([-k for k in range(len(labels))], labels, fontsize=8)
    axes.set_xlim(0, 1)
    axes.set_xlabel('share of the parts', fontsize=8, color=FAINT)
    axes.tick_params(length=0, labelcolor=TEXT)
    axes.xaxis.set_major_formatter(lambda share, _: f'{100 * share:.0f} %')
    axes.spines[['top', 'right', 'left', 'bottom']].set_visible(False)
    figure.tight_layout()
    return figure


def _draw_wall(axes: 'Axes', reach: float) -> None:
    axes.plot([-2 * reach, 2 * reach], [0, 0], color=TEXT, linewidth=2.5, solid_capstyle='butt')


def _draw_contact(axes: 'Axes', contact: 'shapely.Geometry') -> None:
    import shapely

    for piece in shapely.get_parts(contact):
        if piece.geom_type == 'Polygon':
            _fill(axes, piece, CONTACT, 0.55)
        else:
            at = shapely.get_coordinates(piece)
            axes.plot(at[:, 0], at[:, 1], color=CONTACT, linewidth=2.5, marker='.', markersize=4)


def _fill(axes: 'Axes', geometry: 'shapely.Geometry', colour: str, alpha: float) -> None:
    """Fill polygons with their holes."""
    import shapely
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    for piece in shapely.get_parts(geometry):
        if piece.geom_type != 'Polygon' or piece.is_empty:
            continue
        rings = [piece.exterior, *piece.interiors]
        path = Path.make_compound_path(*(Path(np.asarray(r.coords), closed=True) for r in rings))
        axes.add_patch(PathPatch(path, facecolor=colour, edgecolor=FAINT, lw=0.6, alpha=alpha))


def margin_text(margin: float) -> str:
    """Return a margin in mm, or what its absence means."""
    return f'{1e3 * margin:.2f} mm' if math.isfinite(margin) else NOTHING

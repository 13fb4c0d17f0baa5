"""The page of a distribution: a 3D view, the rows of all outcomes, and what they follow from."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.aspects.estimate import METHODS
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.comparison import (
    ComparedResults,
    comparison_table,
    difference_texts,
    measures,
    verdict,
)
from resting_aspects_ros.report.drop_figures import (
    MAX_SHOWN,
    bands,
    comparison_figure,
    convergence_figure,
    distribution_figure,
    estimates_figure,
    pie_figure,
)
from resting_aspects_ros.report.drops import down_text, estimate_table, never_seen_text
from resting_aspects_ros.report.figure import NARROW, WIDE
from resting_aspects_ros.report.format import (
    Row,
    aspects_text,
    class_of,
    class_rows,
    interval_text,
    millimetre_texts,
    model_range,
    outside_rows,
    probability_text,
    rgb,
    share_text,
    short_name,
)
from resting_aspects_ros.report.page import (
    MANY_ROWS,
    Bars,
    Chart,
    Facts,
    Item,
    OutcomeRow,
    OutcomeRows,
    Page,
    Section,
    Text,
    View,
    file_names,
    picture_uri,
    reading,
)
from resting_aspects_ros.report.picture import (
    FROM_ABOVE,
    OBLIQUE,
    Image,
    PosedPart,
    downsample,
    draw_parts,
    picture_part,
    pose_parts,
    triangle_counts,
)
from resting_aspects_ros.report.table import DOWN, Table
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.statistics.comparison import Comparison
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

PAGE = 'report.html'
_LABELS = {
    'distribution': 'Bar chart of the probabilities with intervals',
    'pie': 'Pie chart of the shares of all drops',
    'convergence': 'Line chart of the probabilities against the number of drops',
    'estimates': 'Chart of the predictions of the analytic methods',
    'comparison': 'Bar chart of the simulated and the measured shares',
}
FIGURES = tuple(_LABELS)
FILES = file_names(PAGE, FIGURES)
# Side of a picture in a row, twice its size on the page for high-resolution screens, smaller on
# pages with many rows (see page.css); and side of a picture beside a bar.
PIXELS, PIXELS_OF_MANY_ROWS, SMALL_PIXELS = 320, 192, 64
MAX_PICTURED_ROWS = 60  # of more rows, those with the most drops have pictures

CONVERGENCE = 'Convergence of the probabilities'
ASPECTS = (
    'Aspects are numbered from the lowest centre of mass to the highest. Each row shows the '
    'probability that was estimated from {drops} drops, with {spread}. Aspects that a rotation of '
    'the part maps onto each other look the same and are counted together in one row.'
)
NOT_LEVEL = (
    'An aspect is the side on which the part lies in these surroundings. The pictures, the height '
    'of the centre of mass, the minimum barrier and the basin show it on a level plane: they do '
    'not tell how firmly the part rests here.'
)
CONTACTS = (
    'What touches each body, with the share of all {drops} drops. A number is that of the aspect '
    'on whose side the part lies there; edge, corner and other side are parts of its convex hull '
    'on which it cannot lie on a level plane. Pictures show the first part that came to rest like '
    'this, and the bodies that it touches; the contacts on them are coloured, with a rim.'
)
CONVERGENCE_CAPTION = (
    'Each line shows how the estimated probability of an aspect changed as the number of drops '
    'grew. The horizontal axis is logarithmic. The bands are {spread}; four times as many drops '
    'make them about half as wide.'
)
NO_HISTORY = (
    'The input of this report contains no history of the counts. To see the convergence, make the '
    'report from the log of the run.'
)

OUTSIDE = {
    'unclassified': 'came to rest, but in none of the stable aspects of the shape',
    'unsettled': 'still moving at the end of the simulated time',
    'failed': 'the simulation failed numerically',
    'lost': 'left the surroundings',
    'sliding': 'still slid or rolled at the end of the simulated time',
}


def drop_page(
    distribution: Distribution,
    part: Part | None,
    title: str,
    subtitle: str,
    *,
    notes: Sequence[str] = (),
    facts: Mapping[str, Sequence[tuple[str, str]]] | None = None,
    history: tuple[Counts, Counts] | None = None,
    estimates: Mapping[str, Array] | None = None,
    not_defined: Mapping[str, str] | None = None,
    measured: tuple[Comparison, ComparedResults] | None = None,
    range_text: str = '',
    contacts: Table | None = None,
    level_floor: bool = True,
) -> Page:
    """Return the page of a distribution.

    Parameters
    ----------
    distribution : Distribution
    part : Part or None
        Without the part, the page has no pictures and no 3D view.
    title, subtitle : str
        Name of the part, and what was dropped.
    notes, facts
        See Page.
    history : ((m,) int, (m, k) int), optional
        Numbers of drops, ascending, and the counts of the k aspects after each of them.
    estimates : mapping, optional
        (k,) probabilities of the aspects by method.
    not_defined : mapping, optional
        By method, why it is not defined for the part.
    measured : (Comparison, ComparedResults), optional
        The counts by class with which the drops are compared.
    range_text : str
        What the model range covers, or why there is none.
    contacts : Table, optional
        What the parts touch in surroundings with walls, with pictures.
    level_floor : bool
        Whether the parts lie on a level plane, as the pictures and the properties of the aspects
        assume.
    """
    drawn = DrawnRows(distribution, part)
    rows = [*drawn.rows, *drawn.outside]
    longest = max((row.upper for row in rows), default=1.0)
    shown = outcome_rows(distribution, drawn, part, level=level_floor, longest=longest)
    drops, confidence = distribution.drops, f'{100 * distribution.confidence:g}'
    spread = f'{confidence} % intervals ({distribution.interval.capitalize()})'
    sections = [
        _aspect_section(
            shown, drops, spread, view=drawn.has_view, level=level_floor, range_text=range_text
        )
    ]
    if contacts is not None and contacts.rows:
        texts: list[Item] = [CONTACTS.format(drops=drops), contacts]
        sections.append(Section('Contacts in the surroundings', 'contacts', texts))
    if measured is not None:
        items = list(comparison_items(drawn.rows, *measured))
        sections.append(Section('Measured and simulated', 'comparison', items))
    if history is None and drops > 1:
        sections.append(Section(CONVERGENCE, 'convergence', [NO_HISTORY]))
    elif history is not None and len(history[0]) > 1 and drawn.rows:
        found = bands(distribution, *history)
        draw = partial(convergence_figure, drawn.rows, history[0], found)
        caption = CONVERGENCE_CAPTION.format(spread=spread)
        chart = _chart('convergence', draw, caption)
        sections.append(Section(CONVERGENCE, 'convergence', [chart]))
    if estimates and drawn.rows and part is not None:
        sections.append(_estimate_section(drawn.rows, part, estimates, not_defined or {}, spread))
    saved = partial(
        distribution_figure, distribution, drawn.part, f'{title}, {subtitle}', range_text
    )
    return Page(
        file=PAGE,
        title=title,
        topic='resting aspects',
        lead='Resting aspects and their probabilities',
        subtitle=subtitle,
        sections=sections,
        reading=reading('drops', confidence=confidence),
        facts=facts or {},
        notes=notes,
        top=list(_top(shown, drawn, part, distribution, spread)),
        saved=[Chart('distribution', _LABELS['distribution'], saved, saved=saved)],
        names=FILES,
    )


class DrawnRows:
    """The rows of a distribution, and the pictures of the part in them.

    pixels : int
        Side of a picture; by default that of the page of the distribution.
    """

    def __init__(self, distribution: Distribution, part: Part | None, pixels: int = 0) -> None:
        self.rows = class_rows(distribution)
        self.outside = outside_rows(distribution)
        self.part = part and picture_part(part, distribution.aspects)
        aspects = [row.aspects[0] for row in self.rows]
        self.posed_parts = pose_parts(self.part, aspects) if self.part else []
        order = sorted(range(len(self.posed_parts)), key=lambda k: -self.rows[k].count)
        self.pictured = sorted(order[:MAX_PICTURED_ROWS])
        pixels = pixels or (PIXELS if len(self.rows) <= MANY_ROWS else PIXELS_OF_MANY_ROWS)
        self.oblique = self._images(OBLIQUE, pixels)
        self.above = self._images(FROM_ABOVE, pixels)

    @property
    def has_view(self) -> bool:
        """Whether there is a 3D view."""
        return self.part is not None and bool(self.rows)

    def pictures(self, k: int) -> list[str]:
        """Return the oblique, top and small picture of a row as data URIs; empty without one."""
        if k not in self.oblique:
            return ['', '', '']
        oblique = self.oblique[k]
        small = downsample(oblique, len(oblique) // SMALL_PIXELS)
        return [picture_uri(image) for image in (oblique, self.above[k], small)]

    def _images(self, view: Array, pixels: int) -> dict[int, Image]:
        """Return the pictures by row index."""
        posed_parts = [self.posed_parts[k] for k in self.pictured]
        colours = [rgb(self.rows[k].colour) for k in self.pictured]
        images = draw_parts(posed_parts, colours, pixels, view)
        return dict(zip(self.pictured, images, strict=True))


def _top(
    shown: Sequence[OutcomeRow],
    drawn: DrawnRows,
    part: Part | None,
    distribution: Distribution,
    spread: str,
) -> Iterator[Item]:
    """Yield the 3D view, if there is one, and the shares of all outcomes."""
    if drawn.part is not None and drawn.rows:
        triangles = triangle_counts(part, drawn.part)
        hint = (
            ''
            if triangles is None
            else (
                f'The pictures show a simplified mesh with {triangles[1]:,} of {triangles[0]:,} '
                'triangles. All numbers are computed from the full mesh.'
            )
        )
        data = scene(drawn.part, drawn.rows, drawn.posed_parts)
        yield View(data, shown[0].oblique, shown[0].name, shown[0].probability, hint)
    rows = [*drawn.rows, *drawn.outside]
    images = [drawn.oblique.get(k) for k in range(len(rows))]
    bars = largest_rows(shown)
    caption = f'Share of each outcome in all {distribution.drops} drops, with {spread}.'
    if distribution.model is not None:
        caption += ' The thin bars below are the model ranges.'
    if len(bars) < len(shown):
        caption += f' Bars are shown for the {len(bars)} largest of {len(shown)} outcomes.'
    if unseen := never_seen_text(distribution):
        caption += f' {unseen}'
    draw = partial(pie_figure, rows, images)
    yield Bars(Chart('pie', _LABELS['pie'], draw, saved=draw), bars, caption)


def _chart(name: str, draw: Any, caption: str) -> Chart:
    """Return a chart with a drawing of its own for a narrow screen."""
    wide = partial(draw, width=WIDE)
    return Chart(name, _LABELS[name], wide, caption, wide, partial(draw, width=NARROW))


def _aspect_section(
    shown: Sequence[OutcomeRow],
    drops: int,
    spread: str,
    *,
    view: bool,
    level: bool,
    range_text: str,
) -> Section:
    items: list[Item] = [ASPECTS.format(drops=drops, spread=spread)]
    if range_text:
        items.append(range_text)
    if not level:
        items.append(NOT_LEVEL)
    items.append(OutcomeRows(shown, drops, view))
    if not shown:
        items.append('The part has no aspects, and no drops were made.')
    return Section('Aspects', 'aspects', items)


def comparison_items(
    rows: Sequence[Row], comparison: Comparison, sides: ComparedResults
) -> Iterator[Item]:
    """Yield what shows the comparison of two sets of drops, with a row for each compared class."""
    confidence = f'{100 * comparison.confidence:g}'
    first, second = sides.labels
    if sides.what == 'class':
        rows = [replace(row, name=f'class {sides.name(k)}') for k, row in enumerate(rows)]
    labelled = [
        (f'{label}, {tally.counts.sum()} of {tally.drops} drops in an aspect', shares)
        for label, tally, shares in zip(
            sides.labels, sides.tallies, sides.shares(comparison.confidence), strict=True
        )
    ]
    texts = difference_texts(comparison, sides)
    draw = partial(comparison_figure, rows, labelled, texts, sides.ranges())
    thin = ' Thin bars are model ranges.' if any(sides.models) else ''
    yield _chart(
        'comparison',
        draw,
        f'Bars show the share of each {sides.what} in the drops that came to rest in an aspect, '
        f'with {confidence} % intervals (Wilson).{thin} The text beside the bars is the '
        f'difference, {first} minus {second}, in percentage points, with simultaneous '
        f'{confidence} % bounds.',
    )
    yield Text(verdict(comparison, [row.name for row in rows]), 'verdict')
    yield comparison_table(comparison, sides, '')
    yield Facts(list(measures(comparison, sides).items()))


def _estimate_section(
    rows: Sequence[Row],
    part: Part,
    estimates: Mapping[str, Array],
    not_defined: Mapping[str, str],
    spread: str,
) -> Section:
    shares = {
        name: np.array([sum(p[a.id - 1] for a in row.aspects) for row in rows])
        for name, p in estimates.items()
    }
    chart = _chart(
        'estimates',
        partial(estimates_figure, rows, shares),
        'Each symbol is the prediction of one analytic method. These methods use only the shape '
        'of the part and ignore friction and bounce. For comparison, the coloured bars are the '
        f'{spread} from the drops, and the line in each is their share.',
    )
    table = estimate_table(part, [row.aspects for row in rows], shares, '')
    # A page has room for the whole names of the methods.
    table.headings = [*table.headings[:2], *(METHODS[name].label for name in shares)]
    table.caption = 'Predictions in %.'
    return Section(
        'Analytic estimates',
        'estimates',
        [chart, table, *(f'{reason}.' for reason in not_defined.values())],
    )


def outcome_rows(
    distribution: Distribution, drawn: DrawnRows, part: Part | None, *, level: bool, longest: float
) -> list[OutcomeRow]:
    """Return the texts and pictures of each row.

    Parameters
    ----------
    level : bool
        Whether the parts lie on a level plane. If not, the facts that are true there say so.
    longest : float
        The share at which a bar has the full width.
    """
    rows = [*drawn.rows, *drawn.outside]
    heights = millimetre_texts(
        np.array([row.aspects[0].com_height if row.aspects else 0.0 for row in rows])
    )
    classes = distribution.aspects.classes()
    found = []
    for k, (row, height) in enumerate(zip(rows, heights, strict=True)):
        oblique, above, small = drawn.pictures(k)
        found.append(
            OutcomeRow(
                name=row.name,
                short=short_name(row),
                note=_note(row),
                colour=row.colour,
                count=row.count,
                **share_fields(row, distribution.drops, longest),
                facts=_facts(row, height, part, classes, level=level) if row.aspects else (),
                members=_members(distribution, row) if len(row.aspects) > 1 else None,
                oblique=oblique,
                above=above,
                small=small,
            )
        )
    return found


def share_fields(row: Row, drops: int, longest: float) -> dict[str, Any]:
    """Return the fields of an OutcomeRow that change with the counts.

    A bar has the full width at the longest share.
    """
    return {
        'probability': _probability(row, drops),
        'interval': interval_text(row.interval),
        'bar': _bar(row.interval, longest),
        'model': row.model and _bar(row.model, longest)[1:],
        'model_text': '' if row.model is None else model_range(row.model),
    }


def _members(distribution: Distribution, row: Row) -> Table:
    """Return the table of the individual aspects of a row."""
    ranged = distribution.model is not None
    headings = ['aspect', DOWN, 'count', 'probability', 'interval']
    if ranged:
        headings.append('model range')
    table = Table('', headings, texts={DOWN: None})
    intervals, ranges = distribution.intervals(), distribution.model_intervals()
    for aspect in row.aspects:
        k = aspect.id - 1
        table.add_row(
            str(aspect.id),
            down_text(aspect),
            str(distribution.counts[k]),
            probability_text(intervals[k]),
            interval_text(intervals[k]),
            *([] if (model := ranges[k]) is None else [interval_text(model)]),
        )
    return table


def largest_rows(rows: Sequence[OutcomeRow]) -> list[OutcomeRow]:
    """Return the ``MAX_SHOWN`` rows with the most drops, in their original order."""
    order = sorted(range(len(rows)), key=lambda k: -rows[k].count)
    return [rows[k] for k in sorted(order[:MAX_SHOWN])]


def _note(row: Row) -> str:
    if not row.aspects:
        return OUTSIDE[row.name]
    return f'{len(row.aspects)} aspects that look the same' if len(row.aspects) > 1 else ''


def _probability(row: Row, drops: int) -> str:
    if not drops:
        return 'no drops'
    return probability_text(row.interval) if row.count else 'never seen'


def _bar(interval: Interval, longest: float) -> tuple[float, float, float]:
    whisker = interval.upper - interval.lower
    fill, left, width = (
        round(x * 100 / longest, 2) for x in (interval.probability, interval.lower, whisker)
    )
    return fill, left, width


def _facts(
    row: Row, height: str, part: Part | None, classes: Sequence[tuple[Aspect, ...]], *, level: bool
) -> tuple[tuple[str, str, str], ...]:
    basin = sum(aspect.basin_share for aspect in row.aspects)
    where = '' if level else ', level plane'
    return (
        ('rests on', resting_on(part, row.aspects[0]), 'where the part touches the surface'),
        (f'centre of mass{where}', f'{height} mm high', 'height above the surface'),
        (
            f'minimum barrier{where}',
            _barrier(row, classes),
            'smallest rise of the centre of mass that tips the part over, and into which aspect',
        ),
        (
            f'basin{where}',
            f'{share_text(basin)} %',
            'share of all orientations from which the part rolls here if released without speed',
        ),
    )


def _barrier(row: Row, classes: Sequence[tuple[Aspect, ...]]) -> str:
    aspect = row.aspects[0]
    if not aspect.neighbour:
        return 'none'
    members = class_of(aspect.neighbour, classes)
    same = members == row.aspects
    target = 'an aspect that looks the same' if same else aspects_text(members)
    target = target.replace('aspect ', 'aspect\N{NO-BREAK SPACE}')  # no number alone in a line
    return f'{1000 * aspect.min_barrier:.3g} mm, to {target}'


def scene(part: Part, rows: Sequence[Row], posed_parts: Sequence[PosedPart]) -> dict[str, object]:
    """Return the data of the 3D view as plain types for JSON; lengths are in hull radii.

    Parameters
    ----------
    part : Part
        The part, simplified if it has too many triangles.
    rows : sequence of Row
        The rows with aspects.
    posed_parts : sequence of PosedPart
        The part in the first aspect of each row.

    Returns
    -------
    dict
        ``points``, relative to the centre of mass, and ``faces``: little-endian float32 and uint32
        in base64. ``rows``:
        ``quaternion`` xyzw, tray from part; ``height`` of the centre of mass; ``colour``;
        ``name``.
    """
    points = (part.vertices - part.centre_of_mass) / part.hull_radius
    return {
        'points': _base64(points.astype('<f4')),
        'faces': _base64(part.faces.astype('<u4')),
        'rows': [
            {
                'name': row.name,
                'colour': row.colour,
                'quaternion': each.orientation.tolist(),
                # Computed from the mesh, which must touch the tray: the height of the aspect is
                # that of a smooth curved side.
                'height': -_lowest(part, each) / part.hull_radius,
            }
            for row, each in zip(rows, posed_parts, strict=True)
        ],
    }


def _lowest(part: Part, posed: PosedPart) -> float:
    """Return the height of the lowest point relative to the centre of mass, m."""
    return float(rotate(posed.orientation, part.vertices - part.centre_of_mass)[:, 2].min())


def _base64(array: npt.NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode('ascii')

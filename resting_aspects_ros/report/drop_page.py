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
    measures,
    verdict,
)
from resting_aspects_ros.report.drop_figures import (
    MAX_SHOWN,
    bands,
    comparison_figure,
    convergence_figure,
    distribution_figure,
    pie_figure,
)
from resting_aspects_ros.report.drops import estimate_table
from resting_aspects_ros.report.figure import NARROW, WIDE
from resting_aspects_ros.report.format import (
    Row,
    aspects_text,
    class_of,
    class_rows,
    interval_text,
    largest_counts,
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
    PosedPart,
    downsample,
    draw_parts,
    picture_part,
    pose_parts,
)
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.statistics.comparison import DropCounts
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval

PAGE = 'report.html'
_LABELS = {
    'distribution': 'Bar chart of the probabilities with intervals',
    'pie': 'Pie chart of the shares of all drops',
    'convergence': 'Line chart of the probabilities against the number of drops',
    'comparison': 'Bar chart of the simulated and the measured shares',
}
FIGURES = tuple(_LABELS)
FILES = file_names(PAGE, FIGURES)
# Side of a picture in a row, twice its size on the page for high-resolution screens, smaller on
# pages with many rows (see page.css); and side of a picture beside a bar.
PIXELS, PIXELS_OF_MANY_ROWS, SMALL_PIXELS = 320, 192, 64

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
    measured: ComparedResults | None = None,
    range_text: str = '',
    contacts: Table | None = None,
    level_floor: bool = True,
) -> Page:
    """Return the page of a distribution.

    Parameters
    ----------
    part : Part or None
        Without the part, the page has no pictures and no 3D view.
    title, subtitle : str
        Name of the part, and what was dropped.
    history : ((m,) int, (m, k) int), optional
        Numbers of drops, ascending, and the counts of the k aspects after each of them.
    estimates, not_defined : mapping, optional
        (k,) probabilities of the aspects by method, or why it is not defined for the part.
    measured : ComparedResults, optional
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
    aspects: list[Item] = [
        ASPECTS.format(drops=drops, spread=spread),
        *([range_text] if range_text else []),
        *([] if level_floor else [NOT_LEVEL]),
        OutcomeRows(shown, drops, drawn.has_view),
        *([] if shown else ['The part has no aspects, and no drops were made.']),
    ]
    sections = [Section('Aspects', 'aspects', aspects)]
    if contacts is not None and contacts.rows:
        texts: list[Item] = [CONTACTS.format(drops=drops), contacts]
        sections.append(Section('Contacts in the surroundings', 'contacts', texts))
    if measured is not None:
        compared = list(comparison_items(drawn.rows, measured))
        sections.append(Section('Measured and simulated', 'comparison', compared))
    if history is not None and len(history[0]) > 1 and drawn.rows:
        draw = partial(convergence_figure, drawn.rows, history[0], bands(distribution, *history))
        caption = CONVERGENCE_CAPTION.format(spread=spread)
        chart = _chart('convergence', draw, caption)
        sections.append(Section('Convergence of the probabilities', 'convergence', [chart]))
    if estimates and drawn.rows and part is not None:
        outside = sum(row.count for row in drawn.outside)
        found = _estimate_section(drawn.rows, part, estimates, not_defined or {}, outside)
        sections.append(found)
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
    """The rows of a distribution, and the pictures of the part in them; none without a part.

    pixels : int
        Side of a picture; by default that of the page of the distribution.
    """

    def __init__(self, distribution: Distribution, part: Part | None, pixels: int = 0) -> None:
        self.rows = class_rows(distribution)
        self.outside = outside_rows(distribution)
        self.part = part and picture_part(part)
        aspects = [row.aspects[0] for row in self.rows]
        self.posed_parts = pose_parts(self.part, aspects) if self.part else []
        pixels = pixels or (PIXELS if len(self.rows) <= MANY_ROWS else PIXELS_OF_MANY_ROWS)
        colours = [rgb(row.colour) for row in self.rows][: len(self.posed_parts)]
        self.oblique = draw_parts(self.posed_parts, colours, pixels, OBLIQUE)
        self.above = draw_parts(self.posed_parts, colours, pixels, FROM_ABOVE)

    @property
    def has_view(self) -> bool:
        """Whether there is a 3D view."""
        return bool(self.posed_parts)

    def pictures(self, k: int) -> list[str]:
        """Return the oblique, top and small picture of a row as data URIs; empty without one."""
        if k >= len(self.oblique):
            return ['', '', '']
        oblique = self.oblique[k]
        small = downsample(oblique, len(oblique) // SMALL_PIXELS)
        return [picture_uri(image) for image in (oblique, self.above[k], small)]


def _top(
    shown: Sequence[OutcomeRow],
    drawn: DrawnRows,
    part: Part | None,
    distribution: Distribution,
    spread: str,
) -> Iterator[Item]:
    """Yield the 3D view, if there is one, and the shares of all outcomes."""
    if drawn.part is not None and drawn.has_view:
        hint = ''
        if part is not None and len(drawn.part.faces) < len(part.faces):
            hint = (
                f'The pictures show a simplified mesh with {len(drawn.part.faces):,} of '
                f'{len(part.faces):,} triangles. All numbers are computed from the full mesh.'
            )
        data = scene(drawn.part, drawn.rows, drawn.posed_parts)
        yield View(data, shown[0].oblique, shown[0].name, shown[0].probability, hint)
    rows = [*drawn.rows, *drawn.outside]
    images = [*drawn.oblique, *[None] * (len(rows) - len(drawn.oblique))]
    bars = [shown[k] for k in largest_counts([row.count for row in shown], MAX_SHOWN)]
    caption = f'Share of each outcome in all {distribution.drops} drops, with {spread}.'
    if distribution.model is not None:
        caption += ' The thin bars below are the model ranges.'
    if len(bars) < len(shown):
        caption += f' Bars are shown for the {len(bars)} largest of {len(shown)} outcomes.'
    draw = partial(pie_figure, rows, images)
    yield Bars(Chart('pie', _LABELS['pie'], draw, saved=draw), bars, caption)


def _chart(name: str, draw: Any, caption: str) -> Chart:
    """Return a chart with a drawing of its own for a narrow screen."""
    wide = partial(draw, width=WIDE)
    return Chart(name, _LABELS[name], wide, caption, wide, partial(draw, width=NARROW))


def comparison_items(rows: Sequence[Row], sides: ComparedResults) -> Iterator[Item]:
    """Yield what shows the comparison of two sets of drops, with a row for each compared class."""
    confidence = f'{100 * sides.comparison.confidence:g}'
    first, second = sides.labels
    if sides.what == 'class':
        rows = [replace(row, name=f'class {sides.names[k]}') for k, row in enumerate(rows)]
    draw = partial(comparison_figure, rows, sides)
    thin = ' Thin bars are model ranges.' if any(sides.models) else ''
    yield _chart(
        'comparison',
        draw,
        f'Bars show the share of each {sides.what} in the drops that came to rest in an aspect, '
        f'with {confidence} % intervals (Wilson).{thin} The text beside the bars is the '
        f'difference, {first} minus {second}, in percentage points, with simultaneous '
        f'{confidence} % bounds.',
    )
    yield Text(verdict(sides), 'verdict')
    yield comparison_table(sides, '')
    yield Facts(list(measures(sides).items()))


def _estimate_section(
    rows: Sequence[Row],
    part: Part,
    estimates: Mapping[str, Array],
    not_defined: Mapping[str, str],
    outside: int,
) -> Section:
    shares = {
        name: np.array([sum(p[a.id - 1] for a in row.aspects) for row in rows])
        for name, p in estimates.items()
    }
    drops = DropCounts(np.array([row.count for row in rows]), outside)
    members = [row.aspects for row in rows]
    table = estimate_table(part, members, shares, '', drops if drops.counts.any() else None)
    # A page has room for the whole names of the methods.
    known = len(table.headings) - len(shares)
    table.headings = [*table.headings[:known], *(METHODS[name].label for name in shares)]
    text = (
        'Predictions of analytic methods, in %. These methods use only the shape of the part and '
        'ignore friction and bounce. For comparison, the first columns are the shares of the '
        'drops that came to rest in an aspect, with their intervals.'
    )
    reasons = [f'{reason}.' for reason in not_defined.values()]
    return Section('Analytic estimates', 'estimates', [text, table, *reasons])


def outcome_rows(
    distribution: Distribution, drawn: DrawnRows, part: Part | None, *, level: bool, longest: float
) -> list[OutcomeRow]:
    """Return the texts and pictures of each row; a bar has the full width at ``longest``.

    If the parts do not lie on a level plane, the facts that are true there say so.
    """
    rows = [*drawn.rows, *drawn.outside]
    heights = millimetre_texts(
        np.array([row.aspects[0].com_height if row.aspects else 0.0 for row in rows])
    )
    classes = distribution.aspects.classes()
    found = []
    for k, (row, height) in enumerate(zip(rows, heights, strict=True)):
        oblique, above, small = drawn.pictures(k)
        note = OUTSIDE.get(row.name, '')
        if len(row.aspects) > 1:
            note = f'{len(row.aspects)} aspects that look the same'
        found.append(
            OutcomeRow(
                name=row.name,
                short=short_name(row),
                note=note,
                colour=row.colour,
                count=row.count,
                **share_fields(row, distribution.drops, longest),
                facts=_facts(row, height, part, classes, level=level) if row.aspects else (),
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
    seen = probability_text(row.interval) if row.count else 'never seen'
    return {
        'probability': seen if drops else 'no drops',
        'interval': interval_text(row.interval),
        'bar': _bar(row.interval, longest),
        'model': row.model and _bar(row.model, longest)[1:],
        'model_text': '' if row.model is None else model_range(row.model),
    }


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

    ``posed_parts`` are the part, simplified if it has too many triangles, in the first aspect of
    each row. The points are relative to the centre of mass; points and faces are little-endian
    float32 and uint32 in base64. Of each row: the quaternion xyzw, tray from part, and the height
    of the centre of mass.
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
                'height': -float(rotate(each.orientation, points)[:, 2].min()),
            }
            for row, each in zip(rows, posed_parts, strict=True)
        ],
    }


def _base64(array: npt.NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode('ascii')

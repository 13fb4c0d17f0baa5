"""Tables of a distribution, of the aspects of a part, of contacts and of analytic estimates."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.aspects.estimate import METHODS, Estimate
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.aspects.symmetry import Symmetry
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, numbers, share_fields
from resting_aspects_ros.report.format import (
    Row,
    aspect_rows,
    aspects_heading,
    bounds_text,
    class_of,
    class_rows,
    decimals_of,
    direction_text,
    ids_text,
    interval_text,
    millimetre_texts,
    outside_rows,
    probability_text,
    share_text,
    short_name,
)
from resting_aspects_ros.report.table import DOWN, NOTHING, RESTS_ON, Number, Table
from resting_aspects_ros.statistics.comparison import Comparison, DropCounts
from resting_aspects_ros.statistics.distribution import Distribution, Placements
from resting_aspects_ros.statistics.intervals import Interval, intervals

# Heading of the model range.
MODEL_RANGE = 'model\nrange'


def distribution_table(
    distribution: Distribution, title: str, part: Part | None = None, *, each: bool = False
) -> Table:
    """Return a table with a row for each symmetry class, each other outcome, and the total.

    Classes in which no drop ended have a row, too. The table fits 80 columns, needs no colour,
    and its cells are ASCII. Probabilities are in percent, with as many digits as their interval
    justifies. The model range is a column of its own, and in a table with a row for each aspect
    below the interval. Without the part, the column 'rests on' shows only the size of the support.
    """
    rows = aspect_rows(distribution) if each else class_rows(distribution)
    several = any(len(row.aspects) > 1 for row in rows)
    ranged, drops = distribution.model is not None, distribution.drops

    texts: dict[str, Callable[[Row], str]] = {
        'aspects' if several else 'aspect': short_name,
        RESTS_ON: lambda row: resting_on(part, row.aspects[0]),
    }
    if each:
        texts[DOWN] = lambda row: down_text(row.aspects[0])
    interval = f'{100 * distribution.confidence:g} % interval'
    values: dict[str, Callable[[Row], str]] = {
        'proba-\nbility': lambda row: shares(row.interval, row.count, drops)[0]
    }
    if ranged and each:
        values[f'{interval},\nmodel range'] = _interval_and_range
    else:
        values[interval] = lambda row: interval_text(row.interval)
    if ranged and not each:
        values[MODEL_RANGE] = model_text
    values['count'] = lambda row: str(row.count)
    if several:
        values['per\naspect'] = partial(_each_text, drops=drops)

    headings = [*texts, *values]
    table = Table(title, headings, texts={RESTS_ON, DOWN}, wrapped=RESTS_ON)
    for row in rows:
        table.add_row(*(cell(row) for cell in (*texts.values(), *values.values())))
    table.add_section()
    empty = [''] * (len(texts) - 2)
    for row in outside_rows(distribution):
        table.add_row('', row.name, *empty, *(cell(row) for cell in values.values()))
    total = {RESTS_ON: 'drops in total', 'count': str(drops)}
    table.add_row(*(total.get(heading, '') for heading in headings), bold=True)
    return table


def _interval_and_range(row: Row) -> str:
    below = '' if row.model is None else f'\n{model_text(row)}'
    return f'{interval_text(row.interval)}{below}'


def model_text(row: Row) -> str:
    """Return the model range of a row, as '41 to 66 %'."""
    return NOTHING if row.model is None else interval_text(row.model)


def _each_text(row: Row, drops: int) -> str:
    if len(row.aspects) < 2 or not drops:
        return ''
    share = 100 * row.interval.probability / len(row.aspects)
    return Number(f'{share:.{decimals_of(row.interval)}f} %', share)


def down_text(aspect: Aspect) -> str:
    """Return the down direction of an aspect, or the axis about which the part rolls in it."""
    if aspect.rolls and aspect.axis.any():
        return f'axis {direction_text(aspect.axis)}'
    return direction_text(aspect.down_in_part)


def shares(interval: Interval, count: int, drops: int) -> tuple[str, str, str]:
    """Return the probability, the interval and the count as three cells of a row."""
    if drops == 0:
        return NOTHING, interval_text(interval), str(count)
    return probability_text(interval), interval_text(interval), str(count)


def aspect_table(aspects: AspectSet, part: Part, title: str, *, each: bool = False) -> Table:
    """Return a table of a part's symmetry classes, or of each aspect, without counts of drops."""
    classes = aspects.classes()
    rows = [(aspect,) for aspect in aspects] if each else classes
    headings = (
        aspects_heading(rows),
        'class',
        RESTS_ON,
        *([DOWN] if each else []),
        'height of\ncentre of\nmass (mm)',
        'basin',
        'barrier\n(mm)',
        'to',
    )
    table = Table(title, headings, texts={RESTS_ON, DOWN}, wrapped=RESTS_ON)
    heights = millimetre_texts(np.array([row[0].com_height for row in rows]))
    for row, height in zip(rows, heights, strict=True):
        aspect = row[0]
        basin = 100 * sum(aspect.basin_share for aspect in row)
        table.add_row(
            ids_text(row),
            str(aspect.symmetry_class),
            resting_on(part, aspect),
            *([down_text(aspect)] if each else []),
            height,
            Number(f'{basin:.1f} %', basin),
            _barrier_text(aspect),
            _to_text(aspect, None if each else classes),
        )
    return table


def _barrier_text(aspect: Aspect) -> str:
    if not aspect.neighbour:
        return NOTHING
    return Number(f'{1000 * aspect.min_barrier:.3g}', 1000 * aspect.min_barrier)


def _to_text(aspect: Aspect, classes: list[tuple[Aspect, ...]] | None) -> str:
    if not aspect.neighbour:
        return '-'
    if classes is None:
        return str(aspect.neighbour)
    return ids_text(class_of(aspect.neighbour, classes))


def symmetry_text(symmetry: Symmetry) -> str:
    """Describe the rotations that map the part onto itself."""
    if symmetry.kind == 'spherical':
        return 'every rotation maps it onto itself'
    if symmetry.kind == 'axial':
        ends = ', and so does turning it end for end' if symmetry.order > 1 else ''
        return f'any rotation about one axis maps it onto itself{ends}'
    if symmetry.order == 1:
        return 'no rotation maps it onto itself'
    return f'{symmetry.order} rotations map it onto itself'


# Rows of the table in a terminal.
MAX_ROWS = 20


def contact_rows(contacts: Placements, distribution: Distribution) -> list[dict[str, object]]:
    """Return a row for each placement, the most frequent first, as plain JSON types.

    Each has ``contacts`` (by the names of the planes: the id of an aspect, 'other side', 'edge',
    'corner', or null), ``symmetry_class``, ``orientation`` (xyzw, tray from part, of its first
    drop), and the fields of a share.
    """
    return [
        {
            'contacts': contacts.named(placement),
            'symmetry_class': placement.symmetry_class,
            'orientation': numbers(placement.orientation),
            **share_fields(placement.count, interval),
        }
        for placement, interval in contacts.sorted_rows(
            distribution.interval, distribution.confidence
        )
    ]


def contact_table(contacts: Placements, distribution: Distribution) -> Table:
    """Return a table of what the parts touch, by aspect ids, the most frequent first."""
    names = list(dict.fromkeys(contacts.planes))
    headings = (
        *(name.replace('_', ' ') for name in names),
        'proba-\nbility',
        f'{100 * distribution.confidence:g} % interval',
        'count',
    )
    title = 'Contacts: which side of the part is on which plane, by the number of its aspect'
    table = Table(title, headings)
    rows = contacts.sorted_rows(distribution.interval, distribution.confidence)
    for placement, interval in rows[:MAX_ROWS]:
        named = contacts.named(placement)
        cells = ['-' if named[name] is None else str(named[name]) for name in names]
        table.add_row(*cells, *shares(interval, placement.count, distribution.drops))
    if len(rows) > MAX_ROWS:
        rest = sum(placement.count for placement, _ in rows[MAX_ROWS:])
        table.add_row(f'{len(rows) - MAX_ROWS} more', *[''] * (len(names) + 1), str(rest))
    return table


def estimate_table(
    part: Part,
    rows: Sequence[tuple[Aspect, ...]],
    shares: Mapping[str, Array | None],
    title: str,
    against: DropCounts | None = None,
    deviations: Mapping[str, Comparison] | None = None,
) -> Table:
    """Return a table with a row for each aspect or class, and a column for each method.

    Shares are in percent, and cells are ASCII. With counts of drops, the first columns are their
    shares in the drops that are in an aspect, and the intervals; the last rows are the deviations
    of each method that is defined.

    Parameters
    ----------
    shares : mapping
        (k,) shares of the rows, by the method's name; None if it is not defined.
    against : DropCounts, optional
        Counts of the rows.
    """
    if against is None:
        headings = [RESTS_ON]
        first = [[resting_on(part, row[0])] for row in rows]
    else:
        headings = ['drops', '95 %\ninterval']
        first = [
            [share_text(each.probability), bounds_text(each)]
            for each in intervals(against.counts, int(against.counts.sum()))
        ]
    for method in shares:
        headings.append(method if len(shares) == 1 else METHODS[method].heading)
    headings = [aspects_heading(rows), *headings]
    table = Table(title, headings, texts={RESTS_ON}, wrapped=RESTS_ON)
    for k, cells in enumerate(first):
        predicted = [NOTHING if p is None else share_text(float(p[k])) for p in shares.values()]
        table.add_row(ids_text(rows[k]), *cells, *predicted)
    if deviations:
        table.add_section()
        for name, text_of in (
            ('mean dev.', lambda c: share_text(c.mean_deviation)),
            ('largest', lambda c: share_text(abs(c.largest_deviation))),
            ('p value', lambda c: '< 0.001' if c.p_value < 0.001 else f'{c.p_value:.2g}'),
        ):
            texts = [text_of(deviations[m]) if m in deviations else NOTHING for m in shares]
            table.add_row('', '', name, *texts)
    return table


def estimate_document(
    part: Part, estimates: Mapping[str, Estimate], reasons: Mapping[str, str]
) -> dict[str, object]:
    """Return each method with its source and the probabilities of aspects and classes, by id.

    If a method is not defined for the part, its ``aspects`` are empty and ``not_defined`` is the
    reason, otherwise null.
    """
    methods = {}
    for name in METHODS:
        found = estimates.get(name)
        if found is not None or name in reasons:
            methods[name] = {
                'source': METHODS[name].source,
                'not_defined': reasons.get(name),
                'aspects': _rows(found.probabilities) if found else [],
                'classes': _rows(found.class_probabilities()) if found else [],
            }
    return {
        'schema_version': SCHEMA_VERSION,
        'part': part.name,
        'mesh_sha256': part.mesh_sha256,
        'part_sha256': part.part_sha256,
        'methods': methods,
    }


def _rows(probabilities: Array) -> list[dict[str, object]]:
    return [{'id': k, 'probability': p} for k, p in enumerate(probabilities.tolist(), start=1)]

"""Tables of a distribution, of the aspects of a part, of contacts and of analytic estimates."""

from collections import Counter
from collections.abc import Mapping, Sequence

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
    aspects_text,
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
from resting_aspects_ros.statistics.intervals import CONFIDENCE, Interval, intervals

# Maximum width of the column RESTS_ON, beyond which its text is wrapped: in a table of classes,
# also with the model range, and with the mean of each aspect as well; and in a table of single
# aspects, which also has the column DOWN, unless that is wider than usual.
_REST_WIDTH, _REST_WIDTH_WITH_RANGE, _REST_WIDTH_OF_SEVERAL, _REST_WIDTH_OF_EACH = 26, 24, 14, 20
# Width of the column DOWN of a part that does not roll.
_DOWN_WIDTH = 19
# Heading of the model range.
MODEL_RANGE = 'model\nrange'


def distribution_table(
    distribution: Distribution, title: str, part: Part | None = None, *, each: bool = False
) -> Table:
    """Return a table with a row for each symmetry class, each other outcome, and the total.

    Classes in which no drop ended have a row, too. The table fits 80 columns, needs no colour,
    and its cells are ASCII. Probabilities are in percent, with as many digits as their interval
    justifies. The model range is a column of its own, and in a table with a row for each aspect
    below the interval.

    Parameters
    ----------
    distribution : Distribution
    title : str
        Plain text, shown above the table.
    part : Part, optional
        Without the part, the column 'rests on' shows only the size of the support.
    each : bool
        Whether the table has a row for each aspect, with its direction, instead of for each class.
    """
    rows = aspect_rows(distribution) if each else class_rows(distribution)
    several = any(len(row.aspects) > 1 for row in rows)
    ranged = distribution.model is not None
    own_column = ranged and not each
    interval = f'{100 * distribution.confidence:g} % interval'
    headings = (
        'aspects' if several else 'aspect',
        RESTS_ON,
        *([DOWN] if each else []),
        'proba-\nbility',
        f'{interval},\nmodel range' if ranged and each else interval,
        *([MODEL_RANGE] if own_column else []),
        'count',
        *(['per\naspect'] if several else []),
    )
    downs = [down_text(row.aspects[0]) if each else '' for row in rows]
    wider = max(map(len, downs), default=0) - _DOWN_WIDTH
    width = _REST_WIDTH_OF_EACH - max(wider, 0) if each else _REST_WIDTH
    if own_column:
        width = _REST_WIDTH_OF_SEVERAL if several else _REST_WIDTH_WITH_RANGE
    table = Table(title, headings, texts={RESTS_ON: width, DOWN: None})
    for row, down in zip(rows, downs, strict=True):
        cells = [short_name(row), resting_on(part, row.aspects[0])]
        if each:
            cells.append(down)
        probability, sampling, count = shares(row.interval, row.count, distribution.drops)
        if own_column:
            cells += [probability, sampling, model_text(row), count]
        else:
            both = f'{sampling}\n{model_text(row)}' if ranged else sampling
            cells += [probability, both, count]
        if several:
            cells.append(_each_text(row, distribution.drops))
        table.add_row(*cells)
    table.add_section()
    for row in outside_rows(distribution):
        cells = ['', row.name, *([''] if each else [])]
        probability, sampling, count = shares(row.interval, row.count, distribution.drops)
        table.add_row(*cells, probability, sampling, *([NOTHING] if own_column else []), count)
    empty = [''] * (2 + each + own_column)
    table.add_row('', 'drops in total', *empty, str(distribution.drops), bold=True)
    return table


def model_text(row: Row) -> str:
    """Return the model range of a row, as '41 to 66 %'."""
    return NOTHING if row.model is None else interval_text(row.model)


def never_seen_text(distribution: Distribution, *, each: bool = False) -> str:
    """Describe the aspects in which no drop ended; empty if there are none."""
    # The basins are those of a level floor.
    normal = distribution.aspects.floor_normal
    level = normal is None or float(normal[2]) > 1 - 1e-9
    texts = [
        f'{row.name} (at most {100 * row.interval.upper:.2g} %{_basin_text(row) if level else ""})'
        for row in (aspect_rows(distribution) if each else class_rows(distribution))
        if not row.count
    ]
    return f'Never seen: {", ".join(texts)}.' if texts and distribution.drops else ''


def merged_text(aspects: AspectSet) -> str:
    """Describe the barriers that were ignored to find the aspects; empty if there are none."""
    having = tuple(aspect for aspect in aspects if aspect.merged > 0)
    if not having:
        return ''
    highest = max(1e-3, 1000 * max(aspect.merged for aspect in having))
    return (
        f'Ignored in {aspects_text(having)}: barriers of up to {highest:.2g} mm, which the mesh '
        'or noise explains.'
    )


def _basin_text(row: Row) -> str:
    share = 100 * sum(aspect.basin_share for aspect in row.aspects)
    them = 'them' if len(row.aspects) > 1 else 'it'
    return f'; the part rolls into {them} from {share:.2g} % of all directions'


def _each_text(row: Row, drops: int) -> str:
    """Return the mean probability of the aspects of a row."""
    if len(row.aspects) == 1 or not drops:
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
    table = Table(title, headings, texts={RESTS_ON: 14 if each else 24, DOWN: None})
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
    """Return the aspect behind the minimum barrier, or all aspects of its class."""
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
    named = [contacts.named(placement) for placement, _ in rows]
    texts = [['-' if one[name] is None else str(one[name]) for name in names] for one in named]
    _letter_repeated(texts)
    for (placement, interval), cells in zip(rows[:MAX_ROWS], texts, strict=False):
        table.add_row(*cells, *shares(interval, placement.count, distribution.drops))
    if len(rows) > MAX_ROWS:
        rest = sum(placement.count for placement, _ in rows[MAX_ROWS:])
        table.add_row(f'{len(rows) - MAX_ROWS} more', *[''] * (len(names) + 1), str(rest))
    return table


def _letter_repeated(rows: list[list[str]]) -> None:
    """Add letters to rows with the same cells, which differ in the orientation of the part.

    The letter follows the last cell that is not an aspect: 'edge a', 'edge b'.
    """
    total = Counter(map(tuple, rows))
    seen: Counter[tuple[str, ...]] = Counter()
    for row in rows:
        key = tuple(row)
        if total[key] > 1:
            column = max((k for k, cell in enumerate(row) if cell[0].isalpha()), default=-1)
            row[column] += f' {_letters(seen[key])}'
            seen[key] += 1


def _letters(number: int) -> str:
    """Return a, b, ... z, aa, ab, ... for 0, 1, ..."""
    first, last = divmod(number, 26)
    return (_letters(first - 1) if first else '') + chr(ord('a') + last)


# Maximum width of the column RESTS_ON, beyond which its text is wrapped.
_REST_WIDTH_OF_ESTIMATES = 20


def estimate_table(
    part: Part,
    rows: Sequence[tuple[Aspect, ...]],
    shares: Mapping[str, Array | None],
    title: str,
    against: DropCounts | None = None,
    deviations: Mapping[str, Comparison] | None = None,
) -> Table:
    """Return a table with a row for each aspect or class, and a column for each method.

    Shares are in percent, and cells are ASCII. For most parts the table fits 80 columns. With
    counts of drops, the first columns are their shares in the drops that are in an aspect, and the
    intervals; the last rows are the deviations of each method from them.

    Parameters
    ----------
    rows : sequence of tuples of Aspect
        The aspects that each row combines.
    shares : mapping
        (k,) shares of the rows, by the method's name; None if it is not defined.
    title : str
        Plain text, shown above the table.
    against : DropCounts, optional
        Counts of the rows.
    deviations : mapping
        Comparison of the counts with each method that is defined.
    """
    if against is None:
        headings = [RESTS_ON]
        first = [[resting_on(part, row[0])] for row in rows]
    else:
        headings = ['drops', '95 %\ninterval']
        first = [
            [
                share_text(each.probability),
                Number(interval_text(each).removesuffix(' %'), 100 * each.lower, 100 * each.upper),
            ]
            for each in intervals(against.counts, int(against.counts.sum()))
        ]
    for method in shares:
        headings.append(method if len(shares) == 1 else METHODS[method].heading)
    headings = [aspects_heading(rows), *headings]
    table = Table(title, headings, texts={RESTS_ON: _REST_WIDTH_OF_ESTIMATES})
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


def legend(methods: Sequence[str]) -> list[str]:
    """Return a line for each method: its name on the command line, its label and its meaning."""
    return [f'{name:<16}{METHODS[name].label}: {METHODS[name].meaning}' for name in methods]


def estimate_document(
    part: Part, estimates: Mapping[str, Estimate], reasons: Mapping[str, str]
) -> dict[str, object]:
    """Return each method with its source and the probabilities of aspects and classes, by id.

    If a method is not defined for the part, its ``aspects`` are empty and ``not_defined`` is the
    reason, otherwise null.
    """
    return {
        'schema_version': SCHEMA_VERSION,
        'part': part.name,
        'mesh_sha256': part.mesh_sha256,
        'part_sha256': part.part_sha256,
        'methods': {
            name: {
                'source': METHODS[name].source,
                'not_defined': reasons.get(name),
                'aspects': _rows(estimates[name].probabilities) if name in estimates else [],
                'classes': _rows(estimates[name].class_probabilities())
                if name in estimates
                else [],
            }
            for name in METHODS
            if name in estimates or name in reasons
        },
    }


def against_fields(
    path: str, tally: DropCounts, deviations: Mapping[str, Comparison], *, by_class: bool
) -> dict[str, object]:
    """Return the reference counts, and the deviation of each method from them.

    Shares refer to the drops that are in an aspect.
    """
    many, one = ('classes', 'class') if by_class else ('aspects', 'aspect')
    shares = intervals(tally.counts, int(tally.counts.sum()))
    return {
        'file': path,
        'drops': tally.drops,
        'confidence': CONFIDENCE,
        many: [
            {'id': k, **share_fields(int(count), each)}
            for k, (count, each) in enumerate(zip(tally.counts, shares, strict=True), start=1)
        ],
        'methods': {
            name: {
                'mean_deviation': each.mean_deviation,
                'largest_deviation': abs(each.largest_deviation),
                f'largest_{one}': each.largest_aspect,
                'p_value': each.p_value,
            }
            for name, each in deviations.items()
        },
    }


def _rows(probabilities: Array) -> list[dict[str, object]]:
    return [{'id': k, 'probability': p} for k, p in enumerate(probabilities.tolist(), start=1)]

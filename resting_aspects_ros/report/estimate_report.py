"""A terminal table and a JSON document with the predictions of the analytic methods."""

from collections.abc import Mapping, Sequence

from rich.table import Table

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.aspects.estimate import METHODS, Estimate
from resting_aspects_ros.aspects.support import resting_on
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, share_fields
from resting_aspects_ros.report.rounding import interval_text, share_text
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.table import NOTHING, RESTS_ON, plain_table
from resting_aspects_ros.statistics.comparison import Comparison, DropCounts
from resting_aspects_ros.statistics.intervals import CONFIDENCE, intervals

# Maximum width of the column RESTS_ON, beyond which its text is wrapped.
_REST_WIDTH = 20


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
            [share_text(each.probability), interval_text(each).removesuffix(' %')]
            for each in intervals(against.counts, int(against.counts.sum()))
        ]
    for method in shares:
        headings.append(method if len(shares) == 1 else METHODS[method].heading)
    aspect = 'aspects' if any(len(row) > 1 for row in rows) else 'aspect'
    table = plain_table(title, aspect, *headings, rest_width=_REST_WIDTH)
    # A table of only one method is widened, so that its title is not wrapped.
    table.min_width = min(80, max(map(len, title.splitlines())))
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
    part: Part,
    estimates: Mapping[str, Estimate],
    reasons: Mapping[str, str],
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

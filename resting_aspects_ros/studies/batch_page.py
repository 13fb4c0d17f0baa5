"""The index page of a batch of parts."""

from typing import Any

import numpy as np

from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.report.page import PAGE
from resting_aspects_ros.report.page_template import render_page
from resting_aspects_ros.report.rows import class_rows
from resting_aspects_ros.studies.batch_result import BatchEntry, BatchResult
from resting_aspects_ros.studies.effects import entropy
from resting_aspects_ros.studies.page_parts import comparison_texts

# Number of classes of a part that the index shows.
TOP = 3


def batch_page(batch: BatchResult, *, compare: bool) -> str:
    """Return the index page as HTML; without comparisons while the batch is running."""
    done = [entry for entry in batch.entries if entry.result is not None]
    pictures = {id(entry.case): entry.pictures for entry in done}
    failed = [entry for entry in batch.entries if entry.error]
    notes = [f'{len(failed)} of {len(batch.entries)} parts failed; see below.'] if failed else []
    facts: dict[str, list[tuple[str, str]]] = {}
    if done and done[0].result is not None:
        run = done[0].result.run
        facts['Conditions'] = [('all parts', conditions_text(run.conditions))]
        facts['Run'] = [
            ('seed of the batch', str(batch.seed)),
            ('engine', f'{run.engine} {run.engine_version}'),
        ]
    drops = sum(e.result.distribution.drops for e in done if e.result is not None)
    return render_page(
        'batch.html',
        report={
            'title': f'{len(done)} parts',
            'subtitle': f'{drops} drops',
            'notes': notes,
            'facts': facts,
        },
        rows=[_row(entry, entry.pictures) for entry in done],
        failed=[(entry.source, entry.error) for entry in failed],
        comparisons=[
            comparison_texts(each, pictures) for each in (batch.comparisons if compare else [])
        ],
        confidence=f'{100 * batch.confidence:g}',
    )


def _row(entry: BatchEntry, pictures: list[str]) -> dict[str, Any]:
    assert entry.result is not None
    found = entry.result.distribution
    rows = class_rows(found)
    order = np.argsort([-row.count for row in rows], kind='stable')[:TOP].tolist()
    shares = np.array([row.count for row in rows]) / max(found.drops, 1)
    return {
        'name': entry.case.part.name,
        'source': entry.source,
        'link': f'{entry.folder}/{PAGE}',
        'drops': found.drops,
        'aspects': len(found.aspects),
        'entropy': f'{float(entropy(shares)):.2f}',
        'top': [
            {
                'name': rows[k].name,
                'picture': pictures[k],
                'colour': rows[k].colour,
                'share': f'{100 * rows[k].interval.probability:.1f} %',
                'interval': _interval(rows[k].interval),
            }
            for k in order
        ],
    }


def _interval(found: Interval) -> str:
    return f'{100 * found.lower:.1f} to {100 * found.upper:.1f}'

"""What methods predict for a part, as a JSON document."""

from collections.abc import Mapping

import numpy as np

from resting_aspects_ros.core.comparison import Comparison, Tally
from resting_aspects_ros.core.estimators.estimate import METHODS, Estimate
from resting_aspects_ros.core.estimators.recommendation import Recommendation
from resting_aspects_ros.core.intervals import CONFIDENCE, Array, intervals
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION


def estimate_document(
    part: Part,
    estimates: Mapping[str, Estimate | None],
    reasons: Mapping[str, str],
    recommended: Recommendation | None = None,
) -> dict[str, object]:
    """Each method with its source, ``aspects`` and ``classes``: id and probability.

    Of a method that is not defined for the part ``aspects`` is empty, and ``not_defined`` says
    why; else that is null. ``recommended`` is the method to trust, null if there is none or the
    conditions are not known, with the reason.
    """
    return {
        'schema_version': SCHEMA_VERSION,
        'part': part.name,
        'mesh_sha256': part.mesh_sha256,
        'part_sha256': part.part_sha256,
        'recommended': None if recommended is None else recommended.method or None,
        'reason': None if recommended is None else recommended.reason,
        'methods': {
            name: {
                'source': METHODS[name].source,
                'not_defined': reasons.get(name),
                'aspects': [] if found is None else _rows(found.probabilities),
                'classes': [] if found is None else _rows(found.of_classes()),
            }
            for name, found in estimates.items()
        },
    }


def against_fields(
    path: str, tally: Tally, deviations: Mapping[str, Comparison], *, by_class: bool
) -> dict[str, object]:
    """What the methods were held against, and how far off each is, by aspect or symmetry class.

    Shares are of the drops that are in an aspect.
    """
    many, one = ('classes', 'class') if by_class else ('aspects', 'aspect')
    found = intervals(tally.counts, int(tally.counts.sum()))
    return {
        'file': path,
        'drops': tally.drops,
        'confidence': CONFIDENCE,
        many: [
            {
                'id': k,
                'count': int(count),
                'probability': each.probability,
                'lower': each.lower,
                'upper': each.upper,
            }
            for k, (count, each) in enumerate(zip(tally.counts, found, strict=True), start=1)
        ],
        'methods': {
            name: {
                'mean_deviation': each.mean_deviation,
                'largest_deviation': float(np.abs(each.deviation).max()),
                f'largest_{one}': each.largest_aspect,
                'p_value': each.p_value,
            }
            for name, each in deviations.items()
        },
    }


def _rows(probabilities: Array) -> list[dict[str, object]]:
    return [{'id': k, 'probability': p} for k, p in enumerate(probabilities.tolist(), start=1)]

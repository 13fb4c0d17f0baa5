"""Two distributions side by side as a JSON document; shares from 0 to 1, nothing rounded."""

from collections.abc import Mapping

import numpy as np

from resting_aspects_ros.core.comparison import REST, Comparison
from resting_aspects_ros.core.intervals import INTERVAL
from resting_aspects_ros.report.comparison_table import Sides
from resting_aspects_ros.report.document import SCHEMA_VERSION


def comparison_document(
    comparison: Comparison, sides: Sides, said: Mapping[str, Mapping[str, object]]
) -> dict[str, object]:
    """All that is known.

    Parameters
    ----------
    comparison : Comparison
        Of the two sides.
    sides : Sides
    said : mapping
        Under ``a`` and ``b`` what each is: file, part, drops, ...
    """
    shares = sides.shares(comparison.confidence)
    lower, upper = comparison.largest_bounds
    rows = zip(
        comparison.deviation.tolist(),
        comparison.lower.tolist(),
        comparison.upper.tolist(),
        strict=True,
    )
    return {
        'schema_version': SCHEMA_VERSION,
        **{
            name: {**said[name], **{outcome: getattr(tally, outcome) for outcome in REST}}
            for name, tally in zip('ab', sides.tallies, strict=True)
        },
        'confidence': comparison.confidence,
        'interval': INTERVAL,
        'by': sides.what,
        'aspects': [
            {
                'id': sides.ids[k],
                'down_in_part': _down(sides, k),
                **{
                    name: {
                        'count': int(tally.counts[k]),
                        'share': side[k].probability,
                        'lower': side[k].lower,
                        'upper': side[k].upper,
                    }
                    for name, tally, side in zip('ab', sides.tallies, shares, strict=True)
                },
                'deviation': deviation,
                'deviation_lower': below,
                'deviation_upper': above,
            }
            for k, (deviation, below, above) in enumerate(rows)
        ],
        'total_variation': comparison.total_variation,
        'largest_deviation': {
            'aspect': sides.ids[comparison.largest_aspect - 1],
            'deviation': comparison.largest_deviation,
            'lower': lower,
            'upper': upper,
        },
        'mean_deviation': comparison.mean_deviation,
        'p_value': comparison.p_value,
        'p_by': comparison.p_by,
    }


def _down(sides: Sides, k: int) -> list[float] | None:
    if sides.down is None or np.isnan(sides.down[k]).any():
        return None
    return [float(x) + 0.0 for x in sides.down[k]]  # and no -0.0

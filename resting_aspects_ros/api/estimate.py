"""Predict the distribution of a part without drops, by the analytic methods of the literature."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.api.result import Result
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.estimate import (
    METHODS,
    Estimate,
    NotDefinedError,
    RestingShape,
    check_method,
    estimate_each,
)
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drops import estimate_document
from resting_aspects_ros.statistics.comparison import (
    Comparison,
    DropCounts,
    compare_with_exact,
)

if TYPE_CHECKING:  # imported when there is something to compare with
    from resting_aspects_ros.api.counts import CountedDrops
    from resting_aspects_ros.api.drop import DropResult

# Seed of the Monte Carlo p values, so that equal inputs give equal results.
SEED = 1


@dataclass(frozen=True, eq=False)
class EstimateResult(Result):
    """Predictions of the methods for a part.

    estimates
        Prediction of each method that is defined for the part, by method, in the order of the
        aspects.
    not_defined
        Reason why a method is not defined for the part, by method.
    against
        Drops with which the methods are compared.
    """

    part: Part
    aspects: AspectSet
    estimates: Mapping[str, Estimate]
    not_defined: Mapping[str, str]
    against: 'CountedDrops | None' = None

    def comparisons(self, *, by_class: bool) -> tuple[DropCounts, dict[str, Comparison]]:
        """Return the drops of ``against``, and their comparison with each method.

        They are by symmetry class, or by aspect if ``against`` counts aspects.
        """
        assert self.against is not None
        from resting_aspects_ros.api.counts import counted_by_class

        by_class = by_class or self.against.by_class
        counted = counted_by_class(self.against, self.aspects) if by_class else self.against
        return counted.tally, {
            name: compare_with_exact(
                counted.tally,
                each.class_probabilities() if by_class else each.probabilities,
                np.random.default_rng(SEED),
            )
            for name, each in self.estimates.items()
        }

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects estimate --json` prints."""
        return estimate_document(self.part, self.estimates, self.not_defined)


def estimate(
    part: Part | str | Path,
    methods: str | Iterable[str] | None = None,
    *,
    against: 'DropResult | str | Path | None' = None,
) -> EstimateResult:
    """Predict the distribution of a part from its shape, without drops.

    The analytic methods of the literature know no conditions, and assume an infinite level plane.
    `drop` takes little longer, and simulates the conditions.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    methods : str or iterable of str, optional
        Names of methods, such as 'csa' or 'rolling'; by default all.
    against : DropResult, str or Path, optional
        Drops of the part to compare with: a result, or a file as for `compare`.

    Raises
    ------
    InvalidValueError
        A method is not known, or ``against`` is of another part.
    NotDefinedError
        No method that was requested is defined for the part.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.estimate('tetrahedron')
    >>> result.estimates['csa'].probabilities.round(3).tolist()
    [0.25, 0.25, 0.25, 0.25]
    """
    given = METHODS if methods is None else methods
    names = [given] if isinstance(given, str) else list(given)
    for name in names:
        check_method(name)
    loaded = given_part(part)
    shape = RestingShape(loaded)
    counted = None
    if against is not None:
        from resting_aspects_ros.api.count_files import counted_drops
        from resting_aspects_ros.api.counts import check_against

        counted = counted_drops(against)
        check_against(counted, loaded.name, loaded.part_sha256, shape.aspects)
    found, reasons = estimate_each(shape, names)
    if not found:
        raise NotDefinedError('; '.join(reasons.values()))
    return EstimateResult(loaded, shape.aspects, found, reasons, counted)

"""Test whether counted parts still have the shares of the simulation."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.drift_options import check_options, window_level, window_size
from resting_aspects_ros.api.drift_result import DriftResult
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.inputs.class_groups import common_groups
from resting_aspects_ros.api.inputs.count_files import read_counts
from resting_aspects_ros.api.inputs.counts import (
    CountedDrops,
    check_counts,
    counted_by_class,
    counts_of_run,
    grouped,
)
from resting_aspects_ros.api.inputs.counts_csv import read_observed
from resting_aspects_ros.api.inputs.observed_counts import ObservedCounts, counts_from_array
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.batch_scatter import UNIT, batch_scatter
from resting_aspects_ros.core.statistics.drift import find_drift
from resting_aspects_ros.core.statistics.drift_power import POWER, SHIFT
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE
from resting_aspects_ros.core.statistics.live_counts import PRIOR_WEIGHT, LiveCounts
from resting_aspects_ros.report.drift_text import DriftWindows

# Seed of the random tables, so that equal inputs give equal results.
SEED = 1


def watch_drift(
    expected: DropResult | str | Path,
    counts: ObservedCounts | str | Path | npt.ArrayLike,
    *,
    window: int | None = None,
    level: float | None = None,
    run_length: int | None = None,
    shift: float = SHIFT,
    cumulative: bool = False,
    prior_weight: float = PRIOR_WEIGHT,
    confidence: float = CONFIDENCE,
) -> DriftResult:
    """Test whether counted parts still have the shares of the simulation.

    The parts are divided into disjoint windows in the order in which they were counted. Each
    window is compared with the simulated drops by symmetry class. Classes that the counts do not
    distinguish ('3+4') are compared with the sum of their simulated drops. That batches differ
    more than by chance is estimated from successive batches, and taken into account.

    Parameters
    ----------
    expected : DropResult, str or Path
        Simulated drops: a result, or a file as in `compare`.
    counts : str, Path, (b, c) int or ObservedCounts
        Newly supplied parts, each counted once: a CSV, an array with a row for each batch and a
        column for each symmetry class, or what `read_observed` returned. Unclassified parts are
        not tested.
    window : int, optional
        Minimum number of parts in a window; batches are not divided. By default the number with
        which a class that deviates by ``shift`` is found with a probability of 80 %. If fewer
        parts were counted, they are one window.
    level : float, optional
        Probability of an alarm in a window without drift, 0.0001 to 0.25; 0.01 by default.
    run_length : int, optional
        Mean number of parts between false alarms, instead of ``level``, which is then the
        window divided by it.
    shift : float
        The deviation of a class that should be found, above 0, at most 0.4.
    cumulative : bool
        Whether each count in the file is the total since the start.
    prior_weight : float
        Weight of the simulated drops in the shares of `DriftResult.live`, in parts.
    confidence : float
        Confidence of the intervals: more than 0.5 and less than 1.

    Returns
    -------
    DriftResult

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a file cannot be read, or the part has only one class.

    Warns
    -----
    RestingAspectsWarning
        The simulated drops are too few to find ``shift`` with any window.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> expected = ra.drop('l_bracket', drops=500, seed=1)
    >>> ra.watch_drift(expected, [[56, 53, 50, 26, 15]], window=200).verdict
    'No drift in 1 window of 200 parts.'
    """
    simulated = _simulated(expected)
    if cumulative and not isinstance(counts, str | Path):
        raise InvalidValueError('invalid cumulative True: expected only for counts in a file')
    if isinstance(counts, ObservedCounts):
        observed = counts
    elif isinstance(counts, str | Path):
        observed = read_observed(
            Path(counts), simulated.members, cumulative=cumulative, part=simulated.part
        )
    else:
        observed = counts_from_array(counts, simulated.all_groups)
    groups = common_groups(simulated.all_groups, observed.groups)
    simulated, observed = grouped(simulated, groups), observed.grouped(groups)
    drops = simulated.tally.counts
    check_options(observed, window, level, run_length, shift, prior_weight, confidence)
    scatter = batch_scatter(observed.windows(UNIT)[0])
    size = window_size(drops, observed.parts, window, level, run_length, shift, scatter)
    windows, ends, labels = observed.windows(size)
    tested_level = window_level(int(ends[-1]) / len(windows), level, run_length)
    live = LiveCounts(simulated.ids, drops, observed.totals, prior_weight)
    test = find_drift(windows, drops, np.random.default_rng(SEED), tested_level, scatter)
    tested = DriftWindows(
        test, live, ends, labels, confidence, POWER, simulated.all_groups, observed.unclassified
    )
    return DriftResult(simulated, observed.source, tested)


def _simulated(expected: DropResult | str | Path) -> CountedDrops:
    if isinstance(expected, DropResult):
        given = counts_of_run(
            f'run {expected.run.run_id}',
            expected.distribution,
            expected.run,
            complete=expected.complete,
        )
        check_counts(given)
        return counted_by_class(given)
    if not isinstance(expected, str | Path):
        raise InvalidValueError(
            f'invalid expected {shown(expected)}: expected a result of drop, or a file'
        )
    return counted_by_class(read_counts(Path(expected)))

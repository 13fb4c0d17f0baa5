"""Compare two distributions, and counted parts and their transitions with the simulation."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.count_files import counted_drops, counts_from_array, read_observed
from resting_aspects_ros.api.counts import (
    CountedDrops,
    check_same_part,
    common_groups,
    counted_by_class,
    single_groups,
)
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.model_range import model_range_text
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, shown, warn
from resting_aspects_ros.report.comparison import ComparedResults, comparison_document, verdict
from resting_aspects_ros.report.document import SCHEMA_VERSION
from resting_aspects_ros.report.drift import drift_fields, drift_sentence
from resting_aspects_ros.statistics import comparison as statistics
from resting_aspects_ros.statistics.comparison import UNIT, batch_scatter, square_and_add
from resting_aspects_ros.statistics.counted_parts import (
    LiveCounts,
    ObservedCounts,
)
from resting_aspects_ros.statistics.drift import (
    LEVEL,
    POWER,
    SHIFT,
    DriftTest,
    TooFewDropsError,
    find_drift,
    parts_needed,
)
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    check_confidence,
)
from resting_aspects_ros.statistics.transitions import TransitionMatrix, no_actions

# Seed of the random tables of a p value, so that equal inputs give equal results.
SEED = 1
MAX_LISTED = 40


@dataclass(frozen=True, eq=False)
class ComparisonResult(Result):
    """Two distributions side by side.

    ``comparison`` has shares, deviations, bounds and p value, with arrays in the order of
    ``a.ids``, which are ids of aspects or of symmetry classes.
    """

    a: CountedDrops
    b: CountedDrops
    comparison: statistics.Comparison

    @property
    def sides(self) -> ComparedResults:
        """Return both sides, as reports show them."""
        a, b = self.a, self.b
        what: Literal['aspect', 'class'] = 'class' if a.by_class else 'aspect'
        models = a.model, b.model
        tallies = a.tally, b.tally
        return ComparedResults(a.ids, a.names, *tallies, self.comparison, what, models=models)

    @property
    def range_texts(self) -> list[str]:
        """Return what the model ranges of A and B cover; one text if it is true of both."""
        texts = [model_range_text(each.model) for each in (self.a, self.b)]
        if texts[0] == texts[1] or not all(texts):
            return [text for text in texts if text][:1]
        return [f'{label}: {text}' for label, text in zip('AB', texts, strict=True)]

    @property
    def verdict(self) -> str:
        """Return a sentence that states whether chance explains the difference."""
        return verdict(self.sides)

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects compare --json` prints."""
        said = {'a': _fields(self.a), 'b': _fields(self.b)}
        return comparison_document(self.sides, said)


def compare(
    a: DropResult | CountedDrops | str | Path,
    b: DropResult | CountedDrops | str | Path,
    *,
    confidence: float = CONFIDENCE,
) -> ComparisonResult:
    """Compare two sets of drops, neither of which is the truth.

    If one of them is counted by symmetry class, both are compared by class. Classes that one of
    them counts together are compared together.

    Parameters
    ----------
    a, b : DropResult, CountedDrops, str or Path
        A result, counts, or a file: a log (the folder of a run, or its .mcap file), a JSON
        document of `resting_aspects drop` or `request`, or a CSV with columns aspect (or class)
        and count.
        Reading a log imports ROS.
    confidence : float
        Confidence of the bounds, which hold for all aspects together: more than 0.5 and less
        than 1.

    Raises
    ------
    InvalidValueError
        A file cannot be read, the two are of different parts, or their aspects differ.

    Warns
    -----
    RestingAspectsWarning
        One of them is incomplete, or the two are not independent.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> a = ra.drop('tetrahedron', drops=200, seed=1)
    >>> b = ra.drop('tetrahedron', drops=200, seed=2)
    >>> result = ra.compare(a, b)
    >>> result.comparison.p_value > 0.001
    True
    """
    check_confidence(confidence)
    one, other = counted_drops(a), counted_drops(b)
    if one.by_class or other.by_class:
        one, other = counted_by_class(one), counted_by_class(other)
    _check_same_aspects(one, other)
    if one.by_class:
        into = common_groups(one.groups, other.groups)
        one, other = one.grouped(into), other.grouped(into)
    for given in (one, other):
        if not given.complete:
            warn(f'{given.source!r} is not complete: it has {given.drops} drops')
    _warn_if_dependent(one, other)
    generator = np.random.default_rng(SEED)
    found = statistics.compare(one.tally, other.tally, generator, confidence)
    return ComparisonResult(one, other, found)


def _check_same_aspects(a: CountedDrops, b: CountedDrops) -> None:
    """Raise InvalidValueError if an aspect of one is not an aspect of the other."""
    check_same_part(
        (f'A, {a.source!r},', a.part, a.part_sha256), (f'B, {b.source!r},', b.part, b.part_sha256)
    )
    if a.members != b.members:
        # Counts that the suite wrote have all aspects of the part.
        wrong, right = (b, a) if b.run is None else (a, b)
        many = 'classes' if a.by_class else 'aspects'
        given, expected = (
            ', '.join(map(str, each.members[:MAX_LISTED])) for each in (wrong, right)
        )
        raise InvalidValueError(
            f'invalid {many} {given} in {wrong.source!r}: expected those in {right.source!r}, '
            f'{expected} (what was never seen has count 0; what looks the same is counted in a '
            'column class instead of aspect)'
        )


def _warn_if_dependent(a: CountedDrops, b: CountedDrops) -> None:
    """Warn if drops of both started from the same orientations."""
    if a.run is None or b.run is None or a.run.seed != b.run.seed:
        return
    end = min(a.run.first_drop + a.drops, b.run.first_drop + b.drops)
    common = end - max(a.run.first_drop, b.run.first_drop)
    if common > 0:
        warn(
            f'{common} drops of A and B start from the same orientations (seed {a.run.seed}): '
            'they are not independent, and bounds and p value do not hold; use another seed'
        )


def _fields(given: CountedDrops) -> dict[str, object]:
    return {
        'file': given.source,
        'part': given.part or None,
        'part_sha256': given.part_sha256 or None,
        'run_id': given.run.run_id if given.run else None,
        'complete': given.complete,
        'drops': given.drops,
    }


# -- Drift ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DriftResult(Result):
    """Counted parts beside the simulation, with the test of each window.

    expected
        The simulated drops by symmetry class.
    source
        The file of the counted parts.
    test
        The windows, their p values, and the deviation of the drifted windows.
    live
        All counted parts with the simulation as the prior.
    shift, needed
        A deviation of the share of a class, and the number of parts in a window that finds it
        with a probability of 80 %; None if the simulated drops are too few.
    """

    expected: CountedDrops
    source: str
    test: DriftTest
    live: LiveCounts
    shift: float
    needed: int | None

    @property
    def drift(self) -> bool:
        """Whether any window raises an alarm."""
        return len(self.test.drifted) > 0

    @property
    def verdict(self) -> str:
        """A sentence: no drift, or which class deviates, by how much and since which part."""
        return drift_sentence(self.test)

    @property
    def title(self) -> str:
        """The counted parts and the simulated drops, in one line."""
        return f'{self.live.parts} parts against {self.expected.title}'

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects drift --json` prints."""
        return {
            'schema_version': SCHEMA_VERSION,
            'file': self.source,
            'part': self.expected.part or None,
            'part_sha256': self.expected.part_sha256 or None,
            'expected': {
                'file': self.expected.source,
                'run_id': self.expected.run.run_id if self.expected.run else None,
                'drops': self.expected.drops,
            },
            **drift_fields(self.test, self.live),
            'shift': self.shift,
            'parts_needed': self.needed,
        }


def watch_drift(
    expected: DropResult | CountedDrops | str | Path,
    counts: ObservedCounts | str | Path | npt.ArrayLike,
    *,
    window: int | None = None,
    level: float = LEVEL,
    shift: float = SHIFT,
    confidence: float = CONFIDENCE,
) -> DriftResult:
    """Test whether counted parts still have the shares of the simulation.

    The parts are divided into disjoint windows in the order in which they were counted. Each
    window is compared with the simulated drops by symmetry class. Classes that the counts do not
    distinguish ('3+4') are compared with the sum of their simulated drops. That batches differ
    more than by chance is estimated from successive batches, and taken into account.

    Parameters
    ----------
    expected : DropResult, CountedDrops, str or Path
        Simulated drops: a result, or a file as in `compare`.
    counts : str, Path, (b, c) int or ObservedCounts
        Newly supplied parts, each counted once: a CSV, an array with a row for each batch and a
        column for each symmetry class, or what `read_observed` returned. Unclassified parts are
        not tested.
    window : int, optional
        Minimum number of parts in a window; batches are not divided. By default the number with
        which a class that deviates by ``shift`` is found with a probability of 80 %. If fewer
        parts were counted, they are one window.
    level : float
        Probability of an alarm in a window without drift, 0.0001 to 0.25.
    shift : float
        The deviation of a class that should be found, 0.0001 to 0.4.
    confidence : float
        Confidence of the intervals: more than 0.5 and less than 1.

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
    simulated = counted_by_class(counted_drops(expected))
    observed = _observed(counts, simulated)
    counted = tuple(sorted(number for group in observed.groups for number in group))
    if simulated.members != counted:
        raise InvalidValueError(
            f'invalid classes {list(simulated.members)} in {simulated.source!r}: expected those '
            f'of the counted parts, {list(counted)} (a class that was never seen has count 0)'
        )
    groups = common_groups(simulated.groups, observed.groups)
    simulated, observed = simulated.grouped(groups), observed.grouped(groups)
    drops = simulated.tally.counts
    live = LiveCounts(simulated.ids, drops, observed.totals)
    needed = _needed(drops, observed, shift, level)
    if window is None and needed is None:
        warn(
            f'{drops.sum()} simulated drops are too few to find a class that deviates by '
            f'{100 * shift:g} points with a probability of {100 * POWER:g} %: a window has as '
            'many parts as drops; simulate more drops'
        )
    size = min(needed or int(drops.sum()), observed.parts) if window is None else window
    test = drift_test(observed, drops, size, level, confidence)
    return DriftResult(simulated, observed.source, test, live, shift, needed)


def drift_test(
    observed: ObservedCounts,
    simulated: Counts,
    window: int,
    level: float,
    confidence: float = CONFIDENCE,
) -> DriftTest:
    """Return the tests of windows; equal counts give equal p values. See `find_drift`."""
    generator = np.random.default_rng(SEED)
    return find_drift(observed, simulated, window, generator, level, confidence)


def _needed(drops: Counts, observed: ObservedCounts, shift: float, level: float) -> int | None:
    """Return the number of parts that finds the shift, with the scatter of the batches."""
    try:
        needed = parts_needed(drops, shift, level)
    except TooFewDropsError:
        return None
    scatter = batch_scatter(observed.windows(UNIT)[0])
    return math.ceil(needed * (1.0 if scatter is None else max(scatter.factor, 1.0)))


def _observed(
    counts: ObservedCounts | str | Path | npt.ArrayLike, simulated: CountedDrops
) -> ObservedCounts:
    if isinstance(counts, str | Path):
        return read_observed(Path(counts), simulated.members, simulated.part)
    if isinstance(counts, ObservedCounts):
        return counts
    return counts_from_array(counts, simulated.groups)


# -- Transitions ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MachineTransitions:
    """The transitions that a machine showed, beside the simulated ones.

    machine : TransitionMatrix
        Counts of the machine from each of the c symmetry classes (row) to each. Its
        ``probability`` and ``bounds`` are nan and 0 to 1 in a row without counts.
    simulated : TransitionMatrix
        The simulated action, by symmetry class.
    difference : (c, c) float
        The measured minus the simulated share; nan in a row without counts of one of them.
    lower, upper : (c, c) float
        Bounds of each difference by itself; see `square_and_add`.
    """

    machine: TransitionMatrix
    simulated: TransitionMatrix
    difference: Array
    lower: Array
    upper: Array


def machine_transitions(counts: npt.ArrayLike, simulated: TransitionMatrix) -> MachineTransitions:
    """Return the transition matrix of a machine beside the simulated one.

    Parameters
    ----------
    counts : (c, c) int
        Number of parts that came from each symmetry class (row) to each in an action. Parts are
        followed one by one, so that it is known which part was in which class before.
    simulated : TransitionMatrix
        The same action, over the aspects of the part: a `ReorientResult` has it.

    Raises
    ------
    InvalidValueError
        The counts are no integers, there are none, or too many, or the shape is wrong.
    """
    by_class = simulated.by_class()
    c = len(by_class.counts)
    given = counts_from_array(counts, single_groups(range(1, c + 1)), 'transitions')
    if given.count.size != c * c:
        raise InvalidValueError(f'invalid transitions {shown(counts)}: expected {c} rows')
    machine = no_actions(simulated.aspects, confidence=simulated.confidence).by_class()
    machine.counts[:, :c] = given.count.reshape(c, c)
    # Each difference by itself.
    wilson = dataclasses.replace(by_class, interval=INTERVAL)
    difference = machine.probability - by_class.probability
    lower, upper = square_and_add(
        machine.probability, machine.bounds(), wilson.probability, wilson.bounds()
    )
    return MachineTransitions(machine, by_class, difference[:, :c], lower[:, :c], upper[:, :c])

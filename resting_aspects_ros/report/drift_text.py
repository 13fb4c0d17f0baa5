"""The windows of a drift test, and its result in sentences."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.statistics.drift import Deviation, DriftTest
from resting_aspects_ros.core.statistics.drift_power import MAX_SHIFT, detectable_shift
from resting_aspects_ros.core.statistics.intervals import Counts, Interval
from resting_aspects_ros.core.statistics.live_counts import LiveCounts
from resting_aspects_ros.report.rounding import decimals_of, points, share_text, shown_difference


@dataclass(frozen=True, eq=False)
class DriftWindows:
    """The windows of a drift test, as reports show them.

    live : LiveCounts
        All counted parts, with the numbers of the classes.
    ends : (w + 1,) int
        Number of parts before the first window, 0, and up to the end of each window.
    labels : sequence of str
        Batch or time of the begin of each window; empty if not known.
    confidence : float
        Confidence of the intervals of deviations, for all classes together.
    power : float
        Probability with which `detectable` is found.
    groups : tuple of tuples of int
        The symmetry classes of each column of the windows, which can be counted together; empty
        if each class was counted alone.
    unclassified : int
        Number of further parts that were counted in no class, and are not tested.
    """

    test: DriftTest
    live: LiveCounts
    ends: Counts
    labels: Sequence[str]
    confidence: float
    power: float
    groups: tuple[tuple[int, ...], ...] = ()
    unclassified: int = 0

    @property
    def classes(self) -> list[list[int]]:
        """The symmetry classes of each column of the windows."""
        return [list(group) for group in self.groups or ((number,) for number in self.live.ids)]

    @property
    def names(self) -> list[str]:
        """The names of the columns: '3', or '3+4' for classes that were counted together."""
        return ['+'.join(map(str, group)) for group in self.classes]

    @property
    def untested(self) -> int:
        """Number of parts at the end that do not fill a window."""
        return self.live.parts - int(self.ends[-1])

    @property
    def parts(self) -> int:
        """Mean number of parts in a window, rounded."""
        return round(int(self.ends[-1]) / len(self.test.windows))

    @property
    def detectable(self) -> float:
        """Shift that a window of `parts` finds with `power`; nan if it finds none."""
        test = self.test
        return detectable_shift(test.simulated, self.parts, test.level, self.power, test.scatter)

    @property
    def run_length(self) -> float:
        """Mean number of parts between false alarms."""
        return self.parts / self.test.level

    @property
    def deviation(self) -> Deviation | None:
        """Deviation of the drifted windows; None without an alarm."""
        drifted = self.test.drifted
        return self.test.deviation(drifted, self.confidence) if drifted else None


def drift_sentence(tested: DriftWindows) -> str:
    """Return whether there is drift, which class deviates, by how much and when, and what is open.

    It also states how many parts at the end were not tested.
    """
    return ' '.join([_result(tested), *_other_alarms(tested), *_untested(tested)])


def _result(tested: DriftWindows) -> str:
    found = tested.deviation
    if found is None:
        windows = len(tested.test.windows)
        many = f'{windows} window{"s" if windows > 1 else ""}'
        sizes = set(np.diff(tested.ends).tolist())
        of = f'{tested.parts} parts' if len(sizes) == 1 else f'about {tested.parts} parts'
        return f'No drift in {many} of {of}.'
    interval = Interval(found.difference, found.lower, found.upper)
    decimals = decimals_of(interval)
    share, expected = (f'{100 * x:.{decimals}f} %' for x in (found.share, found.expected))
    difference, low, high = (
        points(x, decimals)
        for x in (
            shown_difference(found.share, found.expected, decimals),
            found.lower,
            found.upper,
        )
    )
    seen = f'lass {tested.names[found.index]} is seen in {share} instead of {expected}'
    numbers = f'({difference} points, {100 * found.confidence:.10g} % interval {low} to {high})'
    if found.lower <= 0 <= found.upper:
        return (
            f'The shares deviate {_when(tested)}, but no single class does significantly: '
            f'c{seen} {numbers}.'
        )
    return f'C{seen} {numbers} {_when(tested)}.'


def _when(tested: DriftWindows) -> str:
    drifted, windows = tested.test.drifted, len(tested.test.windows)
    first, last = int(tested.ends[drifted.start]) + 1, int(tested.ends[drifted.stop])
    label = f' ({tested.labels[drifted.start]})' if tested.labels else ''
    if windows == 1:
        return f'in the only window, parts 1 to {last}'
    if drifted.stop < windows:
        return f'in parts {first} to {last}{label}, but not in the later parts together'
    if drifted.start == 0:
        return f'in all {windows} windows, parts 1 to {last}'
    return f'since part {first}{label}'


def _other_alarms(tested: DriftWindows) -> Iterator[str]:
    """Yield a sentence about the alarms that are not among the drifted windows."""
    others = [k for k in tested.test.alarms.tolist() if k not in tested.test.drifted]
    if len(others) == 1:
        first, last = (int(end) for end in tested.ends[others[0] : others[0] + 2])
        yield f'There is another alarm in parts {first + 1} to {last}.'
    elif others:
        yield f'There are alarms in {len(others)} other windows.'


def _untested(tested: DriftWindows) -> Iterator[str]:
    """Yield a sentence about the parts that do not fill a window."""
    if tested.untested == 1:
        yield 'The last part is not tested: it does not fill a window.'
    elif tested.untested:
        yield f'The last {tested.untested} parts are not tested: they do not fill a window.'


def _scatter_sentence(tested: DriftWindows) -> str:
    """Return by how much batches scatter more than by chance."""
    scatter = tested.test.scatter
    if scatter is None:
        return 'There are too few batches to tell whether they scatter more than by chance.'
    if scatter.factor <= 1:
        return 'Successive batches scatter as by chance.'
    return (
        f'Successive batches scatter with {scatter.factor:.2g} times the variance of chance, '
        'which the test allows for.'
    )


def unclassified_text(tested: DriftWindows) -> str:
    """Return how many parts are in no class; empty if there are none."""
    number = tested.unclassified
    if not number:
        return ''
    share = share_text(number / (number + tested.live.parts))
    parts = 'part is' if number == 1 else 'parts are'
    return f'{number} unclassified {parts} not tested: {share} % of the counted parts.'


def power_sentences(tested: DriftWindows) -> str:
    """Return which shift a window finds, and how often there is a false alarm."""
    shift, level = tested.detectable, tested.test.level
    size = f'A window of {tested.parts} parts'
    if np.isnan(shift):
        finds = (
            f'{size} does not find a class that deviates by {100 * MAX_SHIFT:g} points with a '
            f'probability of {100 * tested.power:g} %.'
        )
    else:
        finds = (
            f'{size} finds a class that deviates by {100 * shift:.1f} points with a probability '
            f'of {100 * tested.power:g} %.'
        )
    return (
        f'{_scatter_sentence(tested)} {finds} Without drift, at most {100 * level:.3g} % of '
        f'windows raise an alarm: one in {tested.run_length:.0f} parts.'
    )

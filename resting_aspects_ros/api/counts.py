"""Counts of drops over aspects, or over groups of classes that a camera confuses, and their files.

A CSV of counts has a column ``aspect`` or ``class``, and a column ``count``. The rows of a batch
follow each other and have the same text in the column ``batch`` or ``time``; without this column,
all rows are one batch. Without a column ``count`` each row is one drop or part. Classes that a
camera confuses can be counted together, such as '3+4'. What is in no aspect is counted as
'unclassified', 'unsettled' or 'failed'.
"""

import dataclasses
import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.conditions import conditions_text
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError, LogError, one_line, shown
from resting_aspects_ros.input_files import MAX_COUNTED, CsvTable, open_text
from resting_aspects_ros.logs.bag import is_log
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.comparison import REST, DropCounts
from resting_aspects_ros.statistics.counted_parts import Groups, ObservedCounts, group_places
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.model_range import ModelRange

_NUMBER = r'(?:class(?:es)?[_ ]?)?0*[1-9]\d{0,8}'
_GROUP = re.compile(rf'{_NUMBER}(?:\s*\+\s*{_NUMBER})*', re.IGNORECASE)


def parse_group(text: str) -> tuple[int, ...] | None:
    """Return the classes of '3', 'class_3' or '3+4', ascending; None for any other text.

    A text that names a class twice is not a group either.
    """
    if not _GROUP.fullmatch(text.strip()):
        return None
    numbers = sorted(int(digits) for digits in re.findall(r'\d+', text))
    return tuple(numbers) if len(set(numbers)) == len(numbers) else None


def single_groups(ids: Iterable[int]) -> Groups:
    """Return groups of one class each."""
    return tuple((number,) for number in ids)


def common_groups(one: Groups, other: Groups) -> Groups:
    """Return the smallest groups that contain each group of both, in ascending order."""
    found: list[set[int]] = []
    for group in (*one, *other):
        touched = [each for each in found if not each.isdisjoint(group)]
        found = [each for each in found if each.isdisjoint(group)]
        found.append(set(group).union(*touched))
    return tuple(sorted(tuple(sorted(each)) for each in found))


# -- Counts ---------------------------------------------------------------------------------------


# Maximum size of a file of counts.
MAX_BYTES = 1 << 26


@dataclass(frozen=True, eq=False)
class CountedDrops:
    """Counts of drops over aspects, with the description of the run if it is known.

    source
        The file, or another name of the drops for messages.
    groups
        The k groups of ``tally``, ascending: each has the id of an aspect, or with ``by_class``
        the numbers of the symmetry classes that were counted together.
    down : (k, 3) float
        Unit vectors of gravity, part frame; NaN where the part rolls.
    complete
        False if more drops were requested than are counted.
    classes
        The symmetry class of each aspect.
    model
        The model ranges of the groups.

    What is not known is None, such as all of these of parts that were counted by hand.
    """

    source: str
    groups: Groups
    tally: DropCounts
    by_class: bool = False
    down: npt.NDArray[np.float64] | None = None
    run: RunDescription | None = None
    complete: bool = True
    classes: tuple[int, ...] | None = None
    model: ModelRange | None = None

    @property
    def part(self) -> str:
        """The name of the part; empty if it is not known."""
        return '' if self.run is None else self.run.part

    @property
    def part_sha256(self) -> str:
        """Empty if it is not known."""
        return '' if self.run is None else self.run.part_sha256

    @property
    def ids(self) -> tuple[int, ...]:
        """The first aspect or class of each group."""
        return tuple(group[0] for group in self.groups)

    @property
    def members(self) -> tuple[int, ...]:
        """The ids of all aspects or classes, including those that were counted together."""
        return tuple(sorted(number for group in self.groups for number in group))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the groups, such as '3+4' for classes that were counted together."""
        return tuple('+'.join(map(str, group)) for group in self.groups)

    @property
    def drops(self) -> int:
        """Return the number of all counted drops."""
        return self.tally.drops

    @property
    def title(self) -> str:
        """Return file, part, drops, surface and seed, as far as they are known."""
        source, run = one_line(self.source), self.run
        if run is None:
            return f'{source}, {self.drops} drops'
        where = conditions_text(run.conditions)
        return f'{source}, {run.part}, {self.drops} drops on {where}, seed {run.seed}'

    def grouped(self, into: Groups) -> 'CountedDrops':
        """Return the drops with larger groups, each of which contains whole groups."""
        if into == self.groups:
            return self
        counts = np.zeros(len(into), dtype=np.int64)
        np.add.at(counts, group_places(self.groups, into), self.tally.counts)
        tally = dataclasses.replace(self.tally, counts=counts)
        # The aspects of several classes have no common direction, and no range is known of them.
        return dataclasses.replace(self, groups=into, tally=tally, down=None, model=None)


def counts_of_run(
    source: str, distribution: Distribution, run: RunDescription, *, complete: bool
) -> CountedDrops:
    """Return the counts of a run; ``complete``: all drops that were requested are counted."""
    aspects = distribution.aspects
    return CountedDrops(
        source,
        single_groups(aspect.id for aspect in aspects),
        DropCounts(
            distribution.counts,
            distribution.unclassified,
            distribution.unsettled + distribution.lost + distribution.sliding,
            distribution.failed,
        ),
        down=np.array([np.full(3, np.nan) if a.rolls else a.down_in_part for a in aspects]),
        run=run,
        complete=complete,
        classes=tuple(aspect.symmetry_class for aspect in aspects),
        model=distribution.model,
    )


def counted_by_class(given: CountedDrops, aspects: AspectSet | None = None) -> CountedDrops:
    """Return the same drops counted by symmetry class, with the direction of its first aspect.

    The classes are those of ``aspects``, if these are given. Raises InvalidValueError if they are
    not known.
    """
    if given.by_class:
        return given
    classes = given.classes
    if aspects is not None:
        classes = tuple(aspect.symmetry_class for aspect in aspects)
    if classes is None:
        raise InvalidValueError(
            f'{given.source!r} counts by aspect and has no symmetry classes: expected a log, a '
            'JSON document, or a CSV with the column class'
        )
    numbers, first, which = np.unique(classes, return_index=True, return_inverse=True)
    of_class = np.bincount(which, weights=given.tally.counts).astype(np.int64)
    return dataclasses.replace(
        given,
        groups=single_groups(numbers.tolist()),
        tally=dataclasses.replace(given.tally, counts=of_class),
        by_class=True,
        down=None if given.down is None else given.down[first],
        classes=None,
        model=given.model and given.model.of_classes(),
    )


def check_counts(given: CountedDrops) -> None:
    """Raise InvalidValueError if no drop is in an aspect, or if there are too many drops."""
    if not given.tally.counts.any() or given.drops > MAX_COUNTED:
        raise InvalidValueError(
            f'invalid counts in {given.source!r}: expected at least one drop in an aspect, and at '
            f'most {MAX_COUNTED} drops; found {given.tally.counts.sum()} of {given.drops} drops'
        )


def check_same_part(one: tuple[str, str, str], other: tuple[str, str, str]) -> None:
    """Raise InvalidValueError if two results are known to be of different parts.

    Each is given as messages name it, with the name of its part and its part_sha256, which are
    empty if they are not known.
    """
    (result, name, digest), (second, other_name, other_digest) = one, other
    if not digest or not other_digest or digest == other_digest:
        return
    names = f'{result} is of {shown(name)}, {second} of {shown(other_name)}'
    if name == other_name:
        names += (
            ', but the mesh, the unit, the mass or the inertia differs '
            f'(part_sha256 {digest[:8]} and {other_digest[:8]})'
        )
    raise InvalidValueError(f'these are different parts: {names}')


def check_against(given: CountedDrops, part: str, part_sha256: str, aspects: AspectSet) -> None:
    """Raise InvalidValueError if the counts of --against have other aspects than a part."""
    path = given.source
    check_same_part(
        (f'--against {path!r}', given.part, given.part_sha256), ('the result', part, part_sha256)
    )
    ids = sorted({each.symmetry_class if given.by_class else each.id for each in aspects})
    if given.groups != single_groups(ids):
        many = 'classes' if given.by_class else 'aspects'
        raise InvalidValueError(
            f'invalid {many} [{", ".join(given.names)}] in --against {path!r}: expected those of '
            f'{part}, {ids} (what was never seen has count 0)'
        )


# -- Files ----------------------------------------------------------------------------------------


LABELS = ('batch', 'time')
_EXPECTED = (
    'columns aspect or class and, unless each row is one, count; optionally also batch or time'
)


def counted_drops(given: DropResult | CountedDrops | str | Path) -> CountedDrops:
    """Return the counts of a result or of a file; raises InvalidValueError."""
    if isinstance(given, CountedDrops):
        return given
    if isinstance(given, str | Path):
        return read_counts(Path(given))
    if not isinstance(given, DropResult):
        raise InvalidValueError(
            f'invalid result {shown(given)}: expected a result of drop, or a file'
        )
    counted = counts_of_run(
        f'run {given.run.run_id}', given.distribution, given.run, complete=given.complete
    )
    check_counts(counted)
    return counted


def read_counts(path: Path) -> CountedDrops:
    """Read a file of counts of any kind, all batches together; raises InvalidValueError."""
    if is_log(path):
        given = _last_of_log(path)
    else:
        with open_text(path, 'counts file', MAX_BYTES) as file:
            text = file.read()
            if path.suffix == '.json' or text.lstrip().startswith('{'):
                # This imports pydantic, which other files do not need.
                from resting_aspects_ros.api.result_json import counts_of, read_document

                given = counts_of(path, read_document(path, text))
            else:
                counts, rest, by_class = _read_csv(path, io.StringIO(text, newline=''))
                tally = DropCounts(counts.totals, *(rest[name] for name in REST))
                given = CountedDrops(str(path), counts.groups, tally, by_class)
    check_counts(given)
    return given


def read_observed(path: Path, ids: Sequence[int], part: str = '') -> ObservedCounts:
    """Read counts of parts by symmetry class, in batches, from a log of a feeder or a CSV.

    ``ids`` are the numbers of all symmetry classes of the part. A log states the name of the part
    with the counts; without ``part`` it has those of one part. Raises InvalidValueError.
    """
    if is_log(path):
        # ROS is imported only for a log.
        from resting_aspects_ros.run_logs.contents import observed_in_logs

        return observed_in_logs(path, part, ids)
    with open_text(path, 'counts file', MAX_BYTES) as file:
        observed, _, _ = _read_csv(path, file, ids)
    check_parts(observed)
    return observed


def counts_from_array(
    counts: npt.ArrayLike, groups: Groups, what: str = 'counts'
) -> ObservedCounts:
    """Return the counts of an array (b, c): a row for each batch, a column for each group.

    Raises InvalidValueError unless these are integers from 0 to MAX_COUNTED.
    """
    try:
        rows = np.asarray(counts, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = np.zeros(0)
    fits = (rows >= 0) & (rows <= MAX_COUNTED) & (rows == np.floor(rows))
    if rows.ndim != 2 or rows.shape[1] != len(groups) or not fits.all():
        raise InvalidValueError(
            f'invalid {what} {shown(counts)}: expected rows of {len(groups)} integers from 0 to '
            f'{MAX_COUNTED}, one for each class'
        )
    observed = ObservedCounts.of_rows(rows.astype(np.int64), what, groups)
    check_parts(observed)
    return observed


def check_parts(counts: ObservedCounts) -> None:
    """Raise InvalidValueError if no part was counted, or too many."""
    if not 1 <= counts.parts <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of counted parts {counts.parts} in {counts.source!r}: expected 1 to '
            f'{MAX_COUNTED}'
        )


def _last_of_log(path: Path) -> CountedDrops:
    """Read the last distribution in a log."""
    # This import takes a second, and other files do not need it.
    from resting_aspects_ros.run_logs.contents import read_logged_run

    try:
        logged = read_logged_run(path)
        counted = logged.last_distribution
    except LogError as error:
        raise InvalidValueError(str(error)) from None
    if counted is None:
        raise InvalidValueError(
            f'invalid log {str(path)!r}: expected a log with a message of type {DISTRIBUTION_TYPE}'
        )
    logged.warn_if_unfinished()
    distribution, run, complete = counted
    return counts_of_run(str(path), distribution, run, complete=complete)


def _read_csv(
    path: Path, lines: Iterable[str], ids: Sequence[int] | None = None
) -> tuple[ObservedCounts, Counter[str], bool]:
    """Read the counts in a CSV; of the classes ``ids`` if they are given.

    Returns the counts, the number in each of REST, and whether they are counts of classes.
    """
    table = CsvTable(path, lines)
    what = 'aspect' if 'aspect' in table.names and ids is None else 'class'
    of_key = table.column(what, _EXPECTED)
    of_count = table.column('count', _EXPECTED) if 'count' in table.names else None
    of_label = next((k for k, name in enumerate(table.names) if name in LABELS), None)
    if of_count is None and not {*table.names} <= {what, *LABELS}:  # a misspelt count
        raise table.wrong_header(_EXPECTED)
    among = '' if ids is None else f', one of {", ".join(map(str, ids))}'
    expected = f'the number of {what}{among}, in one group, or one of {", ".join(REST)}'
    labels: list[str] = []
    found: list[tuple[int, tuple[int, ...], int]] = []  # batch, group and number
    group_of: dict[int, tuple[int, ...]] = {}
    rest: Counter[str] = Counter()
    seen: set[object] = set()
    begun: set[str] = set()
    for line, row in table.rows():
        label = '' if of_label is None else row[of_label].strip()
        if of_count is None or not labels or label != labels[-1]:
            if of_count is not None and of_label is not None and label in begun:
                raise table.wrong(line, row, of_label, 'the rows of a batch together')
            begun.add(label)
            labels.append(label)
            seen.clear()
        word = row[of_key].strip().lower()
        number = 1 if of_count is None else table.count(line, row, of_count)
        group = parse_group(word) if what == 'class' or word.isdecimal() else None
        if word in REST:
            rest[word] += number
        elif (
            group is None
            or (ids is not None and not set(group) <= set(ids))
            or any(group_of.setdefault(each, group) != group for each in group)
        ):
            raise table.wrong(line, row, of_key, expected)
        else:
            found.append((len(labels) - 1, group, number))
        if (group or word) in seen:
            raise table.wrong(line, row, of_key, f'each {what} once in a batch')
        seen.add(group or word)
    unseen = ((each,) for each in ids or () if each not in group_of)
    groups = tuple(sorted({*group_of.values(), *unseen}))
    cells = [(batch, groups.index(group), number) for batch, group, number in found]
    batch, place, count = np.array(cells, dtype=np.int64).reshape(-1, 3).T
    given = tuple(labels) if any(labels) else ()
    observed = ObservedCounts(str(path), groups, batch, place, count, given, rest.total())
    return observed, rest, what == 'class'

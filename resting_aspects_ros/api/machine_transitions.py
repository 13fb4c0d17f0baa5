"""The transition matrix of a machine, from counts of parts before and after an action."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.inputs.csv_table import CsvTable, open_text
from resting_aspects_ros.api.measured_trials import (
    MeasuredComparison,
    MeasuredPair,
    MeasuredTrials,
    compare_measured,
    with_measured,
)
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.reorientation.transition_matrix import TransitionMatrix, no_actions

COLUMNS = ('from', 'to', 'count')
MAX_BYTES = 1 << 22
MAX_COUNT = 100_000_000


@dataclass(frozen=True, eq=False)
class MachineTransitions:
    """The transitions that a machine showed, beside the simulated ones.

    machine : TransitionMatrix
        Counts of the machine from each symmetry class (row) to each; counts (c, c + 4). Its
        ``probability`` and ``bounds`` are nan and 0 to 1 in a row without counts.
    simulated : TransitionMatrix
        The simulated action, by symmetry class.
    comparisons : tuple of MeasuredComparison
        Each pair of classes in the rows with counts, with the interval of the difference; the
        fields ``from_aspect`` and ``to_aspect`` of their pairs are symmetry classes.
    """

    machine: TransitionMatrix
    simulated: TransitionMatrix
    comparisons: tuple[MeasuredComparison, ...]


def machine_transitions(
    counts: str | Path | Iterable[tuple[int, int, int]], simulated: TransitionMatrix
) -> MachineTransitions:
    """Return the transition matrix of a machine beside the simulated one.

    Parameters
    ----------
    counts : str, Path or iterable of (int, int, int)
        For each pair of symmetry classes, the class before an action, the class after it, and the
        number of parts; or a CSV with the columns ``from``, ``to`` and ``count``. Parts are
        followed one by one, so that it is known which part was in which class before. A pair
        without an entry was not seen.
    simulated : TransitionMatrix
        The same action, over the aspects of the part: a `ReorientResult` has it.

    Raises
    ------
    InvalidValueError
        A class is unknown, a pair occurs twice, a count is not an integer from 0 to MAX_COUNT,
        there is no count, or the file has another format.
    """
    aspects = simulated.aspects
    ids = [members[0].symmetry_class for members in aspects.classes()]
    source = str(counts) if isinstance(counts, str | Path) else 'counts'
    rows = _read(Path(counts)) if isinstance(counts, str | Path) else list(counts)
    table = np.zeros((len(ids), len(ids)), dtype=np.int64)
    found = set()
    for before, after, count in rows:
        if before not in ids or after not in ids or (before, after) in found:
            raise InvalidValueError(
                f'invalid transition from {shown(before)} to {shown(after)} in {shown(source)}: '
                f'expected each pair of the classes {", ".join(map(str, ids))} once'
            )
        if not (isinstance(count, int | np.integer) and 0 <= count <= MAX_COUNT):
            raise InvalidValueError(
                f'invalid count {shown(count)} from {before} to {after} in {shown(source)}: '
                f'expected an integer from 0 to {MAX_COUNT}'
            )
        found.add((before, after))
        table[ids.index(before), ids.index(after)] = count
    if not table.any():
        raise InvalidValueError(f'invalid counts in {shown(source)}: expected at least one part')
    trials = table.sum(axis=1)
    pairs = tuple(
        MeasuredPair(source, ids[i], ids[j], int(trials[i]), int(table[i, j]))
        for i in np.flatnonzero(trials).tolist()
        for j in range(len(ids))
    )
    # The pairs are numbered by class, like the rows of the matrices, so no pose identifies them.
    measured = MeasuredTrials(source, (source,), {}, pairs)
    by_class = simulated.by_class()
    none = no_actions(aspects, confidence=simulated.confidence).by_class()
    return MachineTransitions(
        with_measured(measured, none, source, min_trials=1),
        by_class,
        compare_measured(measured, by_class, source),
    )


def _read(path: Path) -> list[tuple[int, int, int]]:
    with open_text(path, 'file of transitions', MAX_BYTES) as file:
        table = CsvTable(path, file)
        names = [name.lower() for name in table.header]
        if sorted(names) != sorted(COLUMNS):
            raise InvalidValueError(
                f'invalid column names {shown(", ".join(table.header))} in {table.where}: '
                f'expected {", ".join(COLUMNS)}'
            )
        places = [names.index(name) for name in COLUMNS]
        rows = []
        for line, row in table.rows():
            for place in places:
                text = row[place].strip()
                if not (text.isascii() and text.isdecimal() and len(text) <= 9):
                    raise table.wrong(line, row, place, f'an integer from 0 to {MAX_COUNT}')
            before, after, count = (int(row[place]) for place in places)
            rows.append((before, after, count))
    return rows

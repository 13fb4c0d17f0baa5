"""Pose roadmaps: JSON documents of poses and transitions, to which measured trials are added.

The format is that of the laboratory that published the seed method; see docs/reference/files.md.
"""

import dataclasses
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, StrictStr

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.support import NONE
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import (
    Count,
    CsvTable,
    Number,
    file_text,
    invalid_field,
    open_text,
    parse_json,
    validated,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import numbers, plain
from resting_aspects_ros.rotations import LENGTH_TOLERANCE, canonical
from resting_aspects_ros.statistics.comparison import square_and_add
from resting_aspects_ros.statistics.distribution import Distribution, Placements
from resting_aspects_ros.statistics.intervals import INTERVAL, Interval, intervals
from resting_aspects_ros.statistics.transitions import TransitionMatrix, no_actions

# -- Measured trials ------------------------------------------------------------------------------


# Columns of a file of transitions.
COLUMNS = ('from', 'to', 'count')
MAX_BYTES = 1 << 22
MAX_COUNT = 100_000_000


@dataclass(frozen=True)
class MeasuredPair:
    """The trials that were made of one transition.

    action : str
        Name of the action.
    from_aspect, to_aspect : int
        Ids of the aspects before and after the action.
    trials : int
        How many times the action was applied to a part in ``from_aspect``, 1 or more.
    successes : int
        How many of the trials ended in ``to_aspect``.
    """

    action: str
    from_aspect: int
    to_aspect: int
    trials: int
    successes: int


@dataclass(frozen=True, eq=False)
class MeasuredTrials:
    """The trials in a roadmap file.

    source : str
        Name of the file for messages.
    actions : tuple of str
        Names of all actions in the file, also of those without trials.
    orientations : dict of int to (4,) float
        Unit quaternion xyzw, tray from part, of each pose in the file, by id.
    pairs : tuple of MeasuredPair
        Each pair of aspects once for each action, in the order of the file; only those with
        trials.
    """

    source: str
    actions: tuple[str, ...]
    orientations: Mapping[int, Array]
    pairs: tuple[MeasuredPair, ...]


@dataclass(frozen=True)
class MeasuredComparison:
    """The measured and the simulated share of one transition.

    pair : MeasuredPair
    measured, simulated : Interval
        Share of the trials, and of the simulated actions, that ended in ``to_aspect``, each with
        its Wilson interval. Without simulated actions the share is nan and its interval 0 to 1.
    actions : int
        Number of simulated actions on parts in ``from_aspect``.
    difference : float
        The measured minus the simulated share; nan without simulated actions.
    lower, upper : float
        Bounds of the difference: method 10 of Newcombe 1998 (Statistics in Medicine 17:873), the
        hybrid score interval. They hold for this pair by itself.
    confidence : float
        Confidence of all intervals.
    """

    pair: MeasuredPair
    measured: Interval
    simulated: Interval
    actions: int
    difference: float
    lower: float
    upper: float
    confidence: float

    @property
    def verdict(self) -> str:
        """Return whether the interval of the difference contains zero, in words."""
        if not self.actions:
            return 'not simulated'
        return 'agrees within the interval' if self.lower <= 0 <= self.upper else 'differs'


def compare_measured(
    measured: MeasuredTrials, matrix: TransitionMatrix, action_name: str
) -> tuple[MeasuredComparison, ...]:
    """Return the comparison of each measured pair of an action with the simulation.

    The intervals have the confidence of the matrix. Each of them is that of a single pair: if
    measurement and simulation agree everywhere, about one pair in 20 differs at a confidence of
    95 %.

    Parameters
    ----------
    measured : MeasuredTrials
    matrix : TransitionMatrix
        Simulated actions of the same kind, by aspect; counts (k, k + 4).
    action_name : str
        Name of the action in ``measured``.

    Raises
    ------
    InvalidValueError
        If ``measured`` has no such action, or if a pose in it is not the aspect with its id.
    """
    pairs = _pairs_of(measured, matrix, action_name)
    each = dataclasses.replace(matrix, interval=INTERVAL)
    probability, actions, (lower, upper) = each.probability, each.actions, each.bounds()
    found = []
    for pair in pairs:
        place = pair.from_aspect - 1, pair.to_aspect - 1
        (share,) = intervals([pair.successes], pair.trials, confidence=matrix.confidence)
        simulated = Interval(float(probability[place]), float(lower[place]), float(upper[place]))
        low, high = square_and_add(*_arrays(share), *_arrays(simulated))
        found.append(
            MeasuredComparison(
                pair,
                share,
                simulated,
                int(actions[place[0]]),
                share.probability - simulated.probability,
                float(low),
                float(high),
                matrix.confidence,
            )
        )
    return tuple(found)


def with_measured(
    measured: MeasuredTrials, matrix: TransitionMatrix, action_name: str, min_trials: int
) -> TransitionMatrix:
    """Return the matrix with measured counts in the rows that have enough trials.

    The measured pairs of an action from one aspect are the outcomes of the same trials. So all
    pairs of a row must have the same number of trials n, which is also the number of trials of the
    row, and their successes must not exceed n together. If n is at least ``min_trials`` and each
    trial ended in one of the pairs, all counts of the simulated row are replaced by the measured
    successes. A row in which the outcome of some trials is not known, with fewer trials, or
    without any, remains as simulated; simulated and measured counts of a row are never added. The
    maximum of the energy growth remains too.

    Parameters
    ----------
    measured : MeasuredTrials
    matrix : TransitionMatrix
        Simulated actions of the same kind, by aspect; counts (k, k + 4).
    action_name : str
        Name of the action in ``measured``.
    min_trials : int
        1 or more.

    Raises
    ------
    InvalidValueError
        As in `compare_measured`; or if the pairs of any row, also of one with few trials, have
        different numbers of trials or more successes than trials.
    """
    if min_trials < 1:
        raise InvalidValueError(f'invalid min_trials {shown(min_trials)}: expected 1 or more')
    rows: dict[int, list[MeasuredPair]] = defaultdict(list)
    for pair in _pairs_of(measured, matrix, action_name):
        rows[pair.from_aspect].append(pair)
    counts = matrix.counts.copy()
    for aspect, pairs in rows.items():
        trials = {pair.trials for pair in pairs}
        successes = sum(pair.successes for pair in pairs)
        where = f'of {action_name} from pose {aspect} in {measured.source}'
        if len(trials) > 1:
            raise InvalidValueError(
                f'invalid trials {shown(sorted(trials))} {where}: expected the same number for '
                'all pairs of a row'
            )
        (n,) = trials
        if successes > n:
            raise InvalidValueError(
                f'invalid sum of successes {successes} {where}: expected at most {n}, the number '
                'of trials'
            )
        if n >= min_trials and successes == n:
            counts[aspect - 1] = 0
            counts[aspect - 1, [pair.to_aspect - 1 for pair in pairs]] = [
                pair.successes for pair in pairs
            ]
    return dataclasses.replace(matrix, counts=counts)


def _arrays(share: Interval) -> tuple[Array, tuple[Array, Array]]:
    return np.array(share.probability), (np.array(share.lower), np.array(share.upper))


def _pairs_of(
    measured: MeasuredTrials, matrix: TransitionMatrix, action_name: str
) -> list[MeasuredPair]:
    """Return the measured pairs of an action, after checks of the name and of all poses."""
    if action_name not in measured.actions:
        raise InvalidValueError(
            f'invalid action {shown(action_name)}: expected one of those in {measured.source}: '
            f'{shown(", ".join(measured.actions))}'
        )
    ids = list(measured.orientations)
    found = matrix.aspects.classify(np.array([measured.orientations[k] for k in ids]))
    for pose, aspect in zip(ids, found.tolist(), strict=True):
        if aspect == 0 or pose != aspect:
            described = f'of aspect {aspect}' if aspect else 'of no aspect'
            raise InvalidValueError(
                f'invalid pose {pose} in {measured.source}: expected an orientation of aspect '
                f'{pose} of the part, but it is {described}'
            )
    return [pair for pair in measured.pairs if pair.action == action_name]


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


# -- Roadmaps -------------------------------------------------------------------------------------


FORMAT = 'bibazu_pose_roadmap_handover'
SCHEMA_VERSION = 1
MAX_ROADMAP_BYTES = 1 << 26

if TYPE_CHECKING:
    Format: TypeAlias = str
    Version: TypeAlias = int
else:
    Format = Literal[FORMAT]
    Version = Literal[SCHEMA_VERSION]


def roadmap_document(
    part: Part,
    distribution: Distribution,
    csa_weights: npt.ArrayLike | None,
    matrices: Mapping[str, tuple[TransitionMatrix, Mapping[str, object]]],
) -> dict[str, object]:
    """Return the aspects of a part and their transitions as a document of plain JSON types.

    Nothing is rounded. `report.document.to_json` returns the document as text.

    Parameters
    ----------
    part : Part
    distribution : Distribution
        Drops of the part, in surroundings with walls with its contacts.
    csa_weights : (k,) array, optional
        Weights of the method 'csa' by aspect id, with a sum of 1: ``Estimate.probabilities``.
        None if the method is not defined for the part.
    matrices : mapping of str to (TransitionMatrix, mapping)
        By the name of the action: its simulated transitions by aspect, counts (k, k + 4), and its
        values in SI units.

    Returns
    -------
    dict
        ``poses`` by aspect id, ``actions`` with their values, and ``transitions``: an entry for
        each pair of aspects and each action that has a count, including pairs of an aspect with
        itself. All of them are untested.
    """
    aspects = distribution.aspects.aspects
    weights = [None] * len(aspects) if csa_weights is None else numbers(np.asarray(csa_weights))
    drops = distribution.drops
    return {
        'format': FORMAT,
        'schema_version': SCHEMA_VERSION,
        'part': {'name': part.name, 'part_sha256': part.part_sha256},
        'poses': [
            {
                'id': aspect.id,
                'stability': 'robust',
                'orientation_quaternion_xyzw': numbers(aspect.orientation),
                'observed_count': count,
                'observed_frequency_percent': 100 * count / drops if drops else None,
                'rocking_barrier_mm': plain(1000 * float(aspect.min_barrier)),
                'csa_stability_index': weight,
                **_contacts(aspect.id, count, distribution.contacts),
            }
            for aspect, count, weight in zip(
                aspects, distribution.counts.tolist(), weights, strict=True
            )
        ],
        'actions': [
            {
                'name': name,
                'confidence': matrix.confidence,
                'interval': matrix.interval,
                'values': plain(values),
            }
            for name, (matrix, values) in matrices.items()
        ],
        'transitions': [
            transition
            for name, (matrix, _) in matrices.items()
            for transition in _transitions(name, matrix)
        ],
    }


def _contacts(aspect: int, count: int, contacts: Placements | None) -> dict[str, object]:
    """Return what the drops in an aspect touch: more than half of them, and how many.

    The floor is the first plane, on which aspects are counted; all others are walls. Without
    drops in the aspect, it is not known whether a part there touches a wall.
    """
    floor, wall = count, 0
    if contacts is not None:
        on_floor = [p for p in contacts.placements if p.contacts[0] == aspect]
        floor = sum(p.count for p in on_floor)
        wall = sum(p.count for p in on_floor if any(code != NONE for code in p.contacts[1:]))
    at_wall: bool | None = 2 * wall > floor
    if contacts is not None and not floor:
        at_wall = None
    return {
        'contacts': {'floor': True, 'wall': at_wall},
        'contact_counts': {'floor': floor, 'wall': wall},
    }


def _transitions(name: str, matrix: TransitionMatrix) -> list[dict[str, object]]:
    """Return an entry for each pair of aspects that the action was seen to connect."""
    ids = [aspect.id for aspect in matrix.aspects.aspects]
    probability, actions, (lower, upper) = matrix.probability, matrix.actions, matrix.bounds()
    return [
        {
            'id': f'{name}:{ids[row]}->{ids[column]}',
            'from_pose': ids[row],
            'to_pose': ids[column],
            'directed': True,
            'type': 'actuated',
            'action': {
                'name': name,
                'axis': None,
                'direction': None,
                'commanded_angle_deg': None,
            },
            'capture': {
                'probability': float(probability[row, column]),
                'lower': float(lower[row, column]),
                'upper': float(upper[row, column]),
                'trials': int(actions[row]),
            },
            'experimental': {'status': 'untested', 'trials': None, 'successes': None},
        }
        for row, column in np.argwhere(matrix.counts[:, : len(ids)]).tolist()
    ]


class _Pose(BaseModel):
    id: Count
    orientation_quaternion_xyzw: tuple[Number, Number, Number, Number]


class _Action(BaseModel):
    name: StrictStr


class _Experiment(BaseModel):
    status: Literal['untested', 'tested']
    trials: Count | None = None
    successes: Count | None = None


class _Transition(BaseModel):
    from_pose: Count
    to_pose: Count
    action: _Action
    experimental: _Experiment


class _Roadmap(BaseModel):
    format: Format
    schema_version: Version
    poses: list[_Pose]
    transitions: list[_Transition]


def read_roadmap(path: Path) -> MeasuredTrials:
    """Read the measured trials in a roadmap, which a person may have edited.

    Of each pose the id and the orientation are read, and of each transition the two poses, the
    name of the action and ``experimental``. All other fields are ignored and may be missing.

    Raises
    ------
    InvalidValueError
        With a single line that names the file, the entry, its value and what was expected: if the
        file cannot be read, is too large, is not JSON or nested too deeply; if a field
        is missing or has a wrong type, or a number is not finite; if an id of a pose is not
        unique or not known, or a quaternion is not of unit length; if a pair of poses occurs
        twice for one action; if trials of a tested pair are missing or 0, its successes are
        missing or more than its trials, or an untested pair has trials.
    """
    with open_text(path, 'roadmap file', MAX_ROADMAP_BYTES) as file:
        roadmap = validated(_Roadmap, parse_json(path, file.read()), file_text(path))
    orientations: dict[int, npt.NDArray[np.float64]] = {}
    for k, pose in enumerate(roadmap.poses):
        if pose.id in orientations:
            raise invalid_field(path, f'poses[{k}].id', pose.id, 'each id once')
        xyzw = pose.orientation_quaternion_xyzw
        if not abs(math.hypot(*xyzw) - 1) <= LENGTH_TOLERANCE:
            name = f'poses[{k}].orientation_quaternion_xyzw'
            raise invalid_field(path, name, xyzw, 'a unit quaternion')
        orientations[pose.id] = canonical(np.array(xyzw, dtype=np.float64))
    pairs = []
    keys = set()
    for k, transition in enumerate(roadmap.transitions):
        key = (transition.action.name, transition.from_pose, transition.to_pose)
        for end in ('from_pose', 'to_pose'):
            if (pose_id := getattr(transition, end)) not in orientations:
                raise invalid_field(path, f'transitions[{k}].{end}', pose_id, 'the id of a pose')
        if key in keys:
            raise invalid_field(path, f'transitions[{k}]', key, 'each pair once for an action')
        keys.add(key)
        if _is_tested(path, f'transitions[{k}].experimental', transition.experimental):
            given = transition.experimental
            pairs.append(MeasuredPair(*key, given.trials or 0, given.successes or 0))
    actions = dict.fromkeys(each.action.name for each in roadmap.transitions)
    return MeasuredTrials(file_text(path), tuple(actions), orientations, tuple(pairs))


def _is_tested(path: Path, name: str, given: _Experiment) -> bool:
    """Return whether there are trials; raises InvalidValueError for contradictions."""
    if given.status == 'untested':
        if given.trials or given.successes:
            expected = "'tested', because there are trials or successes"
            raise invalid_field(path, f'{name}.status', given.status, expected)
        return False
    if not given.trials:
        expected = '1 or more, because the status is tested'
        raise invalid_field(path, f'{name}.trials', given.trials, expected)
    if given.successes is None or given.successes > given.trials:
        expected = f'0 to {given.trials}, the number of trials'
        raise invalid_field(path, f'{name}.successes', given.successes, expected)
    return True

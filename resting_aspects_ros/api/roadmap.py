"""Pose roadmaps: JSON documents of poses and transitions, to which measured trials are added.

The format is that of the laboratory that published the seed method; see docs/reference/files.md.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, StrictStr

from resting_aspects_ros.api.measured_trials import MeasuredPair, MeasuredTrials
from resting_aspects_ros.aspects.support import NONE
from resting_aspects_ros.input_files import (
    Count,
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
from resting_aspects_ros.statistics.distribution import Distribution, Placements
from resting_aspects_ros.statistics.transitions import TransitionMatrix

FORMAT = 'bibazu_pose_roadmap_handover'
SCHEMA_VERSION = 1
MAX_BYTES = 1 << 26

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
        file cannot be read, has more than MAX_BYTES, is not JSON or nested too deeply; if a field
        is missing or has a wrong type, or a number is not finite; if an id of a pose is not
        unique or not known, or a quaternion is not of unit length; if a pair of poses occurs
        twice for one action; if trials of a tested pair are missing or 0, its successes are
        missing or more than its trials, or an untested pair has trials.
    """
    with open_text(path, 'roadmap file', MAX_BYTES) as file:
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

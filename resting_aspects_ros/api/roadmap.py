"""Pose roadmaps: JSON documents of the aspects of a part and the transitions between them.

The format is that of the laboratory that published the seed method; see docs/reference/files.md.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.aspects.support import NONE
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import numbers, plain
from resting_aspects_ros.statistics.distribution import Distribution, Placements
from resting_aspects_ros.statistics.transitions import TransitionMatrix

FORMAT = 'bibazu_pose_roadmap_handover'
SCHEMA_VERSION = 1


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
    aspects = distribution.aspects
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
    ids = [aspect.id for aspect in matrix.aspects]
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

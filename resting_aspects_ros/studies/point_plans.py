"""How a point of a study is simulated: its job, and how its poses are counted."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.plan_actions import plan_actions
from resting_aspects_ros.api.surroundings import aspects_in, scene_of
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.statistics.distribution import aspect_ids
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.wanted_contacts import WantedContacts, finder_in

Counts = npt.NDArray[np.int64]
Wanted = Callable[[RestingPoses], npt.NDArray[np.bool_]]
# Parts at rest as wanted, and other parts at rest.
WANTED_OUTCOMES = 2

# How drops end that are in no aspect; the last columns of the counts.
OTHER = ('unclassified', 'unsettled', 'failed', 'lost', 'sliding')
_STATUS = {name: RestStatus[name.upper()] for name in OTHER[1:]}


@dataclass(frozen=True, eq=False)
class PointPlan:
    """A point that is ready to be simulated.

    aspects : AspectSet
        As they are counted in its surroundings.
    starts : int
        Number of rows of its counts: 1 for drops; for actions, one for each aspect, and drop i
        starts in row i mod ``starts``.
    wanted : callable, optional
        Returns which drops (n,) are at rest as wanted. The outcomes are then these, and other
        parts at rest, instead of the aspects.
    """

    job: DropJob
    aspects: AspectSet
    starts: int = 1
    wanted: Wanted | None = None

    def count(self, poses: RestingPoses) -> Counts:
        """Return counts (starts, k + 5): by aspect, then by OTHER."""
        if self.wanted is None:
            k = len(self.aspects)
            ends = aspect_ids(self.aspects, poses) - 1
            ends[ends < 0] = k
        else:
            k = WANTED_OUTCOMES
            ends = np.where(self.wanted(poses), 0, 1).astype(np.int64)
        for column, status in enumerate(_STATUS.values(), k + 1):
            ends[poses.status == status] = column
        counts = np.zeros((self.starts, k + len(OTHER)), dtype=np.int64)
        np.add.at(counts, (np.arange(poses.first_drop, poses.end) % self.starts, ends), 1)
        return counts


def plan_point(
    part: Part,
    setting: Setting,
    drops: int,
    seed: int,
    landscape: Landscape,
    aspects: AspectSet,
    rests: Callable[[Setting], RestingPoses] | None = None,
    contacts: Sequence[WantedContacts] = (),
) -> PointPlan:
    """Return how a point is simulated; raises InvalidValueError if it is impossible.

    Parameters
    ----------
    drops : int
        Number of drops, or of actions on all aspects together.
    landscape, aspects
        Of the part on a level plane.
    rests : callable, optional
        Returns resting poses in surroundings, from which actions start there.
    contacts : sequence of WantedContacts
        Count drops that are at rest with one of these, instead of aspects; not with actions.
    """
    conditions, action = setting.drop_conditions, setting.action
    counted = aspects_in(scene_of(part, conditions), aspects)
    if action is None:
        wanted = None
        if contacts:
            finder = finder_in(part, conditions, counted)

            def wanted(poses: RestingPoses) -> npt.NDArray[np.bool_]:
                return np.any([each.found(finder, poses) for each in contacts], axis=0)

        job = make_job(part, conditions, seed, landscape=landscape)
        return PointPlan(job, counted, wanted=wanted)
    planned = plan_actions(
        part,
        action,
        conditions,
        per_aspect=max(1, drops // len(aspects)),
        seed=seed,
        landscape=landscape,
        rests=rests(setting) if conditions.surroundings and rests is not None else None,
    )
    return PointPlan(planned.job, counted, len(aspects))


def point_key(part: Part, setting: Setting) -> str:
    """Return a hash of everything physical at a point: part, conditions and action."""
    action = setting.action
    values = {} if action is None else {**action.values, 'name': '', 'time': 0}
    document = [part.part_sha256, setting.drop_conditions.key(), values]
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode('ascii')).hexdigest()


def point_seed(seed: int, part: Part, setting: Setting) -> int:
    """Return the seed of a point, which follows from the study's seed and from the point.

    It does not depend on the other points, so that points can be added in any order.
    """
    text = f'{seed} {point_key(part, setting)}'.encode('ascii')
    return int.from_bytes(hashlib.sha256(text).digest()[:8], 'little')

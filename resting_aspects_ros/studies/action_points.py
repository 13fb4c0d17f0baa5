"""Drop parts at points, do one action on those at rest, and count where they end."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from resting_aspects_ros.api.plan_actions import check_speed
from resting_aspects_ros.api.surroundings import aspects_in, scene_of
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.statistics.distribution import aspect_ids
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.reorientation import action_starts, body_of
from resting_aspects_ros.simulation.starts import Starts
from resting_aspects_ros.simulation.step_action import Step
from resting_aspects_ros.simulation.surroundings.rest_starts import pose_starts
from resting_aspects_ros.simulation.vibration import Vibration
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.point_plans import OTHER, Counts, PointPlan, point_seed
from resting_aspects_ros.studies.point_runs import (
    PointCounts,
    PointTask,
    run_points,
)


@dataclass(frozen=True, eq=False)
class KeptPlan(PointPlan):
    """A point whose resting poses are kept, by the first drop of each chunk."""

    kept: dict[int, RestingPoses] = field(default_factory=dict)

    def count(self, poses: RestingPoses) -> Counts:
        """Keep the poses, and return their counts."""
        self.kept[poses.first_drop] = poses
        return super().count(poses)

    @property
    def poses(self) -> RestingPoses:
        """The poses that were kept, in the order of drops."""
        return RestingPoses.join([self.kept[first] for first in sorted(self.kept)])


def check_action_point(
    part: Part, setting: Setting, landscape: Landscape, aspects: AspectSet
) -> None:
    """Raise InvalidValueError if parts cannot be dropped, or the action not be done, there."""
    _dropped(part, setting, 0, landscape, aspects)
    if setting.action is None:
        return
    if scene_of(part, setting.drop_conditions) is not None:
        if isinstance(setting.action.action, Step):
            raise InvalidValueError(
                'invalid action step: expected without surroundings; it has its own, two belts'
            )
        return
    every = action_starts(part, aspects.aspects, setting.action.action, setting.conditions.gravity)
    _acted(part, setting, 0, landscape, every)


def act_at_points(
    part: Part,
    points: Sequence[Setting],
    drops: int,
    seed: int,
    workers: Workers,
    *,
    progress: Callable[[int], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
    landscape: Landscape | None = None,
) -> PointCounts:
    """Drop parts at each point, do its action once on each part in an aspect, and count the ends.

    A part that comes to rest in no aspect keeps that outcome. The parts of a point are a random
    sample of parts that were dropped and then moved once, so that the counts are multinomial. A
    point that ``stopped`` leaves unfinished has no counts.

    Parameters
    ----------
    drops : int
        Number of parts at each point.
    progress : callable
        Called often, with the number of parts that are done; a dropped part is half done.
    """
    landscape = Landscape(part) if landscape is None else landscape
    aspects = find_aspects(part, landscape)
    k, shape = len(aspects), (len(points), len(aspects) + len(OTHER))
    dropped, acted = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    seeds = [point_seed(seed, part, setting) for setting in points]
    skipped: dict[int, str] = {}
    plans: dict[int, KeptPlan] = {}

    def first(index: int) -> PointTask:
        def plan() -> PointPlan:
            check_action_point(part, points[index], landscape, aspects)
            plans[index] = _dropped(part, points[index], seeds[index], landscape, aspects)
            return plans[index]

        return PointTask(index, 0, drops, plan)

    def second(index: int, starts: Starts) -> PointTask:
        def plan() -> PointPlan:
            own = _seed_of_action(seeds[index])
            job = _acted(part, points[index], own, landscape, starts)
            return PointPlan(job, plans[index].aspects)

        return PointTask(index, 0, starts.rows, plan)

    def skip(task: PointTask, error: InvalidValueError) -> None:
        skipped[task.index] = str(error)

    def run(tasks: Sequence[PointTask], counts: Counts) -> None:
        def count(task: PointTask, _: tuple[int, int], found: Counts) -> None:
            counts[task.index] += found[0]

        run_points(tasks, workers, count, skip, show, stopped)

    def show() -> None:
        without = dropped[:, k:].sum()  # they are not moved
        progress(int(dropped.sum() + without + acted.sum()) // 2)

    run([first(index) for index in range(len(points))], dropped)
    complete = [i for i in plans if dropped[i].sum() == drops and i not in skipped]
    starts = {i: _starts(part, points[i], plans[i]) for i in complete if dropped[i, :k].any()}
    run([second(index, each) for index, each in starts.items()], acted)
    total = acted.copy()
    total[:, k:] += dropped[:, k:]
    total[(total.sum(axis=1) != drops)] = 0
    return PointCounts(aspects, total[:, :k], total[:, k:], skipped)


def _seed_of_action(seed: int) -> int:
    digest = hashlib.sha256(f'{seed} action'.encode('ascii')).digest()
    return int.from_bytes(digest[:8], 'little')


def _dropped(
    part: Part, setting: Setting, seed: int, landscape: Landscape, aspects: AspectSet
) -> KeptPlan:
    """Return how the parts of a point are dropped."""
    conditions = setting.drop_conditions
    job = make_job(part, conditions, seed, landscape=landscape)
    return KeptPlan(job, aspects_in(scene_of(part, conditions), aspects))


def _acted(
    part: Part, setting: Setting, seed: int, landscape: Landscape, starts: Starts
) -> DropJob:
    """Return the job of the action on parts at rest."""
    assert setting.action is not None
    job = make_job(part, setting.drop_conditions, seed, landscape=landscape, starts=starts)
    check_speed(part, setting.action, job)
    return job


def _starts(part: Part, setting: Setting, plan: KeptPlan) -> Starts:
    """Return where the actions of a point start: from each part that is at rest in an aspect."""
    assert setting.action is not None
    action, conditions = setting.action.action, setting.drop_conditions
    scene = scene_of(part, conditions)
    if scene is None:
        ids = aspect_ids(plan.aspects, plan.poses)
        each = [plan.aspects.aspects[k - 1] for k in ids[ids > 0].tolist()]
        return action_starts(part, each, action, conditions.gravity)
    motion = action if isinstance(action, Vibration) else None
    impulse = None if isinstance(action, Vibration) else action
    assert not isinstance(impulse, Step)
    return pose_starts(part, plan.aspects, scene, plan.poses, body_of(part), impulse, motion)

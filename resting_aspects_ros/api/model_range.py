"""Drops over the uncertainty of a surface, from which the model range follows."""

import dataclasses
from collections.abc import Callable, Iterator
from concurrent.futures import wait

import numpy as np

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.runner import PROGRESS_PERIOD, never
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import list_text
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, Samples
from resting_aspects_ros.simulation.job import BULLET, DropJob, RunDescription, make_job
from resting_aspects_ros.simulation.workers import LocalWorkers, Workers
from resting_aspects_ros.statistics.distribution import Distribution, aspect_ids
from resting_aspects_ros.statistics.model_range import Draws, with_model_range

# Number of draws of the uncertain conditions, and of drops at each. On two cores they take 0.1 to
# 0.3 s; the standard error of the standard deviation between 16 draws is 18 % of it.
DRAWS, DROPS = 16, 500
# Number of counted parts that narrows the ranges; see docs/explanation/trust.md.
ENOUGH_COUNTED = 200

# Why there is no model range.
OF_STATES = (
    'it is known for random releases, and these drops start from given states; give them noise '
    'instead'
)
OF_SURROUNDINGS = (
    'the error of the model was measured on level surfaces only, and these surroundings are not'
)


def missing_reason(job: DropJob) -> str:
    """Return why drops have no model range; empty if they have one."""
    return OF_STATES if job.starts is not None else missing_in(job.conditions)


def missing_in(conditions: DropConditions) -> str:
    """Return why random releases have no model range; empty if they have one."""
    return '' if conditions.surroundings is None else OF_SURROUNDINGS


def model_range_text(distribution: Distribution, missing: str = '') -> str:
    """Describe what the model range covers, or why there is none; empty if nothing is known."""
    if distribution.model is None:
        return f'No model range: {missing}.' if missing else ''
    names = [QUANTITIES[name].label for name in distribution.model.uncertain]
    known = 'takes the conditions as exact and covers only'
    covers = f'covers what is uncertain of {list_text(names)}, and' if names else known
    return (
        'Model range: where the probability on a real surface is with '
        f'{100 * distribution.confidence:g} % confidence, if no parts were counted there. It '
        f'{covers} how far measured bodies deviate from the model. About {ENOUGH_COUNTED} '
        'counted parts of your own narrow it (calibrate).'
    )


def add_model_range(
    distribution: Distribution,
    part: Part,
    job: DropJob,
    workers: Workers,
    stopped: Callable[[], bool] = never,
) -> Distribution:
    """Return the distribution of a job with its model range, for which further drops are made.

    The draws are made in the kernel with the random numbers of the job. If the job is simulated in
    Bullet, the range is about its own shares, and only the width is that of the draws. The
    distribution is returned without a range if there is none, without drops, or if it was stopped.
    """
    if missing_reason(job) or not distribution.drops:
        return distribution
    uncertainty, draws = shipped_surfaces().uncertainty_of(job.conditions), None
    if uncertainty:
        draws = _draws(distribution, part, job, uncertainty, workers, stopped)
        if draws is None:
            return distribution
    return with_model_range(distribution, draws, about_draws=job.engine != BULLET)


def model_range_of(distribution: Distribution, part: Part, run: RunDescription) -> Distribution:
    """Return a distribution of a run that released parts with its model range.

    For programs that count drops that were made elsewhere; the draws are made in one thread.
    """
    if missing_in(run.conditions):
        return distribution
    job = make_job(part, run.conditions, run.seed, engine=BULLET if run.engine == BULLET else '')
    workers = LocalWorkers(1)
    try:
        return add_model_range(distribution, part, job, workers)
    finally:
        workers.stop()


def _draws(
    distribution: Distribution,
    part: Part,
    job: DropJob,
    uncertainty: Samples,
    workers: Workers,
    stopped: Callable[[], bool],
) -> Draws | None:
    """Return the outcomes at each draw; None if it was stopped."""
    futures = [workers.submit(each, 0, DROPS) for each in _jobs(part, job, uncertainty)]
    waiting = set(futures)
    try:
        while waiting:
            if stopped():
                return None
            waiting = wait(waiting, PROGRESS_PERIOD).not_done
        ids = [aspect_ids(distribution.aspects, each.result()) for each in futures]
    finally:
        for each in waiting:
            each.cancel()
    return Draws(np.array(ids).reshape(len(ids), -1), tuple(uncertainty[0]))


def _jobs(part: Part, job: DropJob, uncertainty: Samples) -> Iterator[DropJob]:
    """Yield a job for each draw; draws that are impossible for the part are left out."""
    chosen = np.linspace(0, len(uncertainty) - 1, min(DRAWS, len(uncertainty))).round()
    known = dataclasses.replace(job.conditions, uncertainty=())
    for k in chosen.astype(int).tolist():
        try:
            conditions = known.changed(**uncertainty[k])
            yield make_job(part, conditions, job.seed, landscape=job.rest.landscape)
        except InvalidValueError:
            continue

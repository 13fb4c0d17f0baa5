"""Drops over the uncertainty of a surface, from which the model range follows."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import wait

import numpy as np

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.runner import PROGRESS_PERIOD, never
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import BULLET, QUANTITIES, DropConditions, Surfaces
from resting_aspects_ros.simulation.job import DropJob, RunDescription, make_job
from resting_aspects_ros.simulation.workers import LocalWorkers, Workers
from resting_aspects_ros.statistics.distribution import Distribution, aspect_ids
from resting_aspects_ros.statistics.intervals import CONFIDENCE
from resting_aspects_ros.statistics.model_range import Draws, ModelRange, with_model_range

# Number of draws of the uncertain conditions, and of drops at each. On two cores they take 0.1 to
# 0.3 s; the standard error of the standard deviation between 16 draws is 18 % of it.
DRAWS, DROPS = 16, 500
# Fewer draws at which the part can be released leave no range.
MIN_DRAWS = 8
# Number of counted parts whose interval is half as wide as the range; see
# docs/explanation/trust.md.
ENOUGH_COUNTED = 200
# Why parts after an action have no model range.
OF_ACTIONS = 'it is known for drops, and these parts undergo actions'


def missing_in(run: RunDescription, surfaces: Surfaces | None = None) -> str:
    """Return why the drops of a run that was recorded have no model range; can be empty."""
    if missing := missing_at(run.conditions):
        return missing
    known = shipped_surfaces() if surfaces is None else surfaces
    recorded = known.recorded_uncertainty(run.conditions)
    return 'the uncertainty of this surface is not recorded' if recorded is None else ''


def missing_at(conditions: DropConditions, *, acted: bool = False) -> str:
    """Return why drops, perhaps with an action after them, have no model range; can be empty."""
    if acted:
        return OF_ACTIONS
    if conditions.surroundings is None:
        return ''
    return (
        'the error of the model was measured on level surfaces only, and these surroundings are '
        'not'
    )


def model_range_text(model: ModelRange | None, missing: str = '') -> str:
    """Describe what the model range covers, or why there is none; empty if nothing is known."""
    if model is None:
        return f'No model range: {missing}.' if missing else ''
    return covered_text(model.uncertain, model.confidence)


def covered_text(uncertain: Sequence[str], confidence: float = CONFIDENCE) -> str:
    """Describe what a model range covers if these conditions are uncertain."""
    from resting_aspects_ros.report.format import list_text

    names = [QUANTITIES[name].label for name in uncertain]
    known = 'takes the conditions as exact and covers only'
    covers = f'covers what is uncertain of {list_text(names)}, and' if names else known
    return (
        'Model range: where the probability on a real surface is with '
        f'{100 * confidence:g} % confidence. It {covers} how far measured bodies deviate from the '
        f'model, but no counts of this part: those of about {ENOUGH_COUNTED} tell more (report '
        '--against).'
    )


def add_model_range(
    distribution: Distribution,
    part: Part,
    job: DropJob,
    workers: Workers,
    stopped: Callable[[], bool] = never,
) -> tuple[Distribution, str]:
    """Return the distribution of a job with its model range, or without it, and then why.

    Drops over the uncertainty of the conditions are made in the kernel with the random numbers of
    the job. If the job is simulated in Bullet, the range is about its own shares, and only the
    width is that of these drops. Without drops there is neither a range nor a reason.
    """
    if not distribution.drops:
        return distribution, ''
    if job.starts is not None:
        why = 'it is known for random releases, and these drops start from given states'
        return distribution, why
    if missing := missing_at(job.conditions):
        return distribution, missing
    uncertainty, draws = job.conditions.uncertainty, None
    if uncertainty:
        jobs = list(_jobs(part, job))
        if len(jobs) < min(MIN_DRAWS, len(uncertainty)):
            return distribution, 'the part cannot be released under most conditions'
        if (ids := _drops_at(distribution, jobs, workers, stopped)) is not None:
            draws = Draws(ids, job.conditions.uncertain, about=job.engine != BULLET)
    if stopped() or (uncertainty and draws is None):
        return distribution, 'the run was stopped'
    return with_model_range(distribution, draws), ''


def model_range_of(
    distribution: Distribution, part: Part, run: RunDescription, surfaces: Surfaces | None = None
) -> Distribution:
    """Return a distribution of a run that released parts with its model range, if it has one.

    For programs that count drops that were made elsewhere; the draws are made in one thread.

    surfaces : Surfaces, optional
        With the uncertainty of their conditions; None: the surfaces of the suite.
    """
    known = shipped_surfaces() if surfaces is None else surfaces
    uncertainty = known.recorded_uncertainty(run.conditions)
    if uncertainty is None:
        return distribution
    conditions = dataclasses.replace(run.conditions, uncertainty=uncertainty)
    job = make_job(part, conditions, run.seed, engine=BULLET if run.engine == BULLET else '')
    workers = LocalWorkers(1)
    try:
        return add_model_range(distribution, part, job, workers)[0]
    finally:
        workers.stop()


def _drops_at(
    distribution: Distribution,
    jobs: Sequence[DropJob],
    workers: Workers,
    stopped: Callable[[], bool],
) -> Counts | None:
    """Return the aspects (s, m) in which drops at each draw ended; None if it was stopped."""
    futures = [workers.submit(each, 0, DROPS) for each in jobs]
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
    return np.array(ids)


def _jobs(part: Part, job: DropJob) -> Iterator[DropJob]:
    """Yield a job for each draw; draws that are impossible for the part are left out."""
    uncertainty = job.conditions.uncertainty
    chosen = np.linspace(0, len(uncertainty) - 1, min(DRAWS, len(uncertainty))).round()
    known = dataclasses.replace(job.conditions, uncertainty=())
    for k in chosen.astype(int).tolist():
        try:
            conditions = known.changed(**uncertainty[k])
            yield make_job(part, conditions, job.seed, landscape=job.rest.landscape)
        except InvalidValueError:
            continue

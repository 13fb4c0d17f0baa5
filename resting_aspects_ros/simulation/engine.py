"""The entry to the engines: the resting poses of any range of drops of a job."""

from resting_aspects_ros.simulation.job import BULLET, DropJob
from resting_aspects_ros.statistics.poses import RestingPoses


def drop_range(job: DropJob, first: int, end: int) -> RestingPoses:
    """Simulate the drops ``first`` to ``end - 1`` until they end.

    The pose of a drop depends only on the job and its index. Several threads can make drops of the
    kernel at the same time.
    """
    if not 0 <= first < end:
        raise ValueError(f'invalid drops {first} to {end - 1}: expected one or more from 0')
    # An engine is imported only if it is needed.
    if job.engine == BULLET:
        from resting_aspects_ros.simulation import bullet_engine

        return bullet_engine.drop_range(job, first, end)
    from resting_aspects_ros.simulation import kernel_engine

    return kernel_engine.drop_range(job, first, end)

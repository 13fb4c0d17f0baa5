"""Start the workers that --workers or --scheduler requests."""

import argparse
from contextlib import ExitStack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.workers import Workers


def start_workers(arguments: argparse.Namespace, stack: ExitStack) -> 'Workers':
    """Return the workers of this machine, or those of a Dask cluster; the stack stops them.

    Raises InvalidValueError.
    """
    # These imports are slow because of NumPy.
    if arguments.scheduler is not None:
        from resting_aspects_ros.simulation.workers import ClusterWorkers

        cluster = ClusterWorkers(arguments.scheduler)
        stack.callback(cluster.stop)
        return cluster
    from resting_aspects_ros.simulation.workers import LocalWorkers, default_workers

    count = default_workers() if arguments.workers is None else arguments.workers
    workers = LocalWorkers(count)
    stack.callback(workers.stop)
    return workers

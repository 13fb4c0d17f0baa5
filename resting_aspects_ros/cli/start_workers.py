"""Start the workers that --workers or --scheduler requests."""

import argparse
from contextlib import ExitStack

from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.process_workers import ProcessWorkers, default_workers


def start_workers(arguments: argparse.Namespace, stack: ExitStack) -> Workers:
    """Return worker processes, or those of a Dask cluster; the stack stops them."""
    if arguments.scheduler is None:
        count = default_workers() if arguments.workers is None else arguments.workers
        processes = ProcessWorkers(count)
        stack.callback(processes.stop)
        return processes
    from resting_aspects_ros.simulation.dask_workers import ClusterWorkers

    cluster = ClusterWorkers(arguments.scheduler)
    stack.callback(cluster.stop)
    return cluster

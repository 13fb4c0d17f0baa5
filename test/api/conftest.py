"""What the tests of the Python interface share."""

import pytest

from resting_aspects_ros.simulation.process_workers import ProcessWorkers


@pytest.fixture(scope='module')
def workers():
    """Two processes that all drops of a module share."""
    workers = ProcessWorkers(2)
    yield workers
    workers.stop()

"""What the tests of the Python interface share."""

import pytest

from resting_aspects_ros.simulation.workers import LocalWorkers


@pytest.fixture(scope='module')
def workers():
    """Two workers that all drops of a module share."""
    workers = LocalWorkers(2)
    yield workers
    workers.stop()

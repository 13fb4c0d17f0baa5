"""What the tests of the Python interface share."""

import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.simulation.workers import LocalWorkers


@pytest.fixture(scope='module')
def workers():
    """Two workers that all drops of a module share."""
    workers = LocalWorkers(2)
    yield workers
    workers.stop()


@pytest.fixture(scope='session')
def crate():
    """A box of 10 x 20 x 30 mm, whose aspects have three heights."""
    return ra.load_part('box_10x20x30')

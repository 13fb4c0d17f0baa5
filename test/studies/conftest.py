"""Workers in this process, for the tests of studies."""

from concurrent.futures import Future

import pytest

from resting_aspects_ros.simulation.workers import drop_range


class Here:
    """Workers that simulate in this process; the listed submissions fail."""

    def __init__(self, failing=(), lookahead=3):
        self.failing, self.submitted = failing, []
        self._lookahead = lookahead

    def lookahead(self):
        return self._lookahead

    def submit(self, job, first, end):
        future = Future()
        number = len(self.submitted)
        self.submitted.append((job, first, end))
        if number in self.failing:
            future.set_exception(ValueError('broken'))
        else:
            future.set_result(drop_range(job, first, end))
        return future


@pytest.fixture(scope='session')
def here():
    """The class of such workers."""
    return Here

"""Workers in this process, for the tests of studies."""

from concurrent.futures import Future

import pytest

from resting_aspects_ros.simulation.workers import WorkerDiedError, drop_range


class Here:
    """Workers that simulate in this process; the listed submissions die or fail."""

    def __init__(self, dying=(), failing=(), lookahead=3):
        self.dying, self.failing, self.submitted = dying, failing, []
        self._lookahead = lookahead

    def lookahead(self):
        return self._lookahead

    def submit(self, job, first, end):
        future = Future()
        number = len(self.submitted)
        self.submitted.append((job, first, end))
        if number in self.dying:
            future.set_exception(WorkerDiedError('a worker process died'))
        elif number in self.failing:
            future.set_exception(ValueError('broken'))
        else:
            future.set_result(drop_range(job, first, end))
        return future


@pytest.fixture(scope='session')
def here():
    """The class of such workers."""
    return Here

"""A disk that is full."""

import resource
from contextlib import contextmanager

import pytest


@pytest.fixture
def no_space_after():
    """Limit the size of files to a number of bytes, as on a full disk.

    Only inside the test: it holds for the file that pytest may be writing to as well.
    """

    @contextmanager
    def no_space_after(size):
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return no_space_after

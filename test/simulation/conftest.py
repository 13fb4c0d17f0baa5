"""Drops of example parts, for the tests of the engines."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation


@pytest.fixture(scope='module')
def mat(surfaces):
    return surfaces.get('rubber_mat')


@pytest.fixture(scope='session')
def hull_in_tray():
    """Return the hull vertices (n, k, 3) of each drop where it rests."""

    def hull_in_tray(part, poses):
        matrices = Rotation.from_quat(poses.orientation).as_matrix()
        return part.hull_vertices @ matrices.transpose(0, 2, 1) + poses.position[:, None]

    return hull_in_tray


@pytest.fixture(scope='session')
def assert_deviations():
    """Hold samples (n, k) to the mean and the standard deviation of each column."""

    def check(samples, means, deviations):
        n, deviations = len(samples), np.array(deviations)
        # Four standard errors: of the mean s / sqrt(n), of s about s / sqrt(2 n).
        assert (np.abs(samples.mean(axis=0) - means) < 4 * deviations / math.sqrt(n)).all()
        off = np.abs(samples.std(axis=0) - deviations)
        assert (off < 4 * deviations / math.sqrt(2 * n)).all()

    return check

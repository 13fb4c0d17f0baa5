"""Rows of parts on a track, whose aspects have equal shares."""

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.tracks.orientations import orientations_on


@pytest.fixture(scope='session')
def rows_of():
    def make(part, *wall):
        aspects = find_aspects(part)
        return orientations_on(part, aspects, np.full(len(aspects), 1 / len(aspects)), *wall)

    return make


@pytest.fixture(scope='session')
def box(solid, rows_of):
    """A box of 30 x 20 x 10 mm; and its row flat on the track, with its long side at the wall."""
    part = solid(trimesh.creation.box((30, 20, 10)))
    flat = next(row for row in rows_of(part) if row.height < 0.011 and row.length > 0.029)
    return part, flat

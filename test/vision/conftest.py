"""Parts that are looked for, with equal shares of their classes."""

import functools

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.vision.outline import find_outlines
from resting_aspects_ros.vision.rolling import KnownPart


@pytest.fixture(scope='session')
def known_of():
    def make(part):
        aspects = find_aspects(part)
        outlines = find_outlines(part, aspects)
        return KnownPart(part, aspects, outlines, np.full(len(outlines), 1 / len(outlines)))

    return make


@pytest.fixture(scope='session')
def known(part, known_of):
    """Give the known part of the name of an example part."""
    return functools.cache(lambda name: known_of(part(name)))

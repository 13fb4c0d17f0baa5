"""Parts that are looked for, with equal shares of their classes."""

import functools

import numpy as np
import pytest
import shapely
import trimesh
from scipy.ndimage import gaussian_filter1d

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.vision.identification import observed_polygon
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


@pytest.fixture(scope='session')
def pin(solid, known_of):
    """A pin of 8 x 40 mm with a cross hole of 3 mm, off its middle."""
    rod = trimesh.creation.cylinder(4, 40, sections=48)
    drill = trimesh.creation.cylinder(1.5, 20, sections=24)
    drill.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    drill.apply_translation([0, 0, 5])
    return known_of(solid(trimesh.boolean.difference([rod, drill], engine='manifold')))


# Distance of the points of a noisy boundary, m, and that after which their errors are independent.
SPACING, CORRELATION = 2e-4, 1e-3


@pytest.fixture(scope='session')
def noisy():
    """Give a function that moves the boundary of a polygon by errors normal to it."""

    def errors(ring, sd, generator):
        count = int(ring.length / SPACING)
        along = np.arange(count) * ring.length / count
        points = shapely.get_coordinates(shapely.line_interpolate_point(ring, along))
        tangent = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
        normal = tangent[:, ::-1] * [1, -1] / np.linalg.norm(tangent, axis=1)[:, None]
        # The integral of the autocorrelation of noise smoothed with a width s is 2 s sqrt(pi).
        width = CORRELATION / SPACING / (2 * np.sqrt(np.pi))
        error = gaussian_filter1d(generator.normal(size=count), width, mode='wrap')
        return points + error[:, None] * normal * sd * np.sqrt(2 * np.sqrt(np.pi) * width)

    def noisy(polygon, sd, generator):
        outer, *holes = (errors(ring, sd, generator) for ring in shapely.get_rings(polygon))
        return observed_polygon({'outer': outer, 'holes': holes})

    return noisy

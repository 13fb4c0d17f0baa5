"""Parts seen by a pinhole camera beside its foot point: posteriors, poses and refusals.

The images come from a renderer of their own: the union of the projected triangles.
"""

import numpy as np
import pytest
import shapely
import trimesh
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.vision.camera import Pinhole
from resting_aspects_ros.core.vision.identification import identify
from resting_aspects_ros.core.vision.known_part import KnownPart
from resting_aspects_ros.core.vision.likelihood import (
    MAX_NOISE,
    MIN_NOISE,
    UNCERTAIN,
    OutlineNoise,
)
from resting_aspects_ros.core.vision.observation import observed_polygon
from resting_aspects_ros.core.vision.outline import find_outlines

CAMERA = np.array([0.02, -0.03, 0.5])
SD, CORRELATION = 1e-4, 1e-3
# Distance of the points of an image along its boundary, m.
SPACING = 2e-4


def prism(points, depth):
    """Return the solid between two parallel polygons, mm."""
    return trimesh.creation.extrude_polygon(shapely.Polygon(points), depth)


# Heights up to 30 mm. Some classes of each differ by less than the parallax, at most 3 mm.
MESHES = {
    'key': lambda: trimesh.creation.box((8.0, 22.0, 22.16)),
    'block': lambda: trimesh.creation.box((30.0, 29.85, 20.0)),
    'angle': lambda: prism([(0, 0), (30, 0), (30, 8), (8, 8), (8, 29.8), (0, 29.8)], 12.0),
    'wedge': lambda: prism([(0, 0), (24, 0), (20, 9), (2, 16)], 15.8),
}


@pytest.fixture(scope='module')
def known(solid):
    made = {}

    def find(name):
        if name not in made:
            part = solid(MESHES[name]())
            aspects = find_aspects(part)
            outlines = find_outlines(part, aspects)
            shares = np.linspace(1, 2, len(outlines))
            made[name] = KnownPart(part, aspects, outlines, shares / shares.sum())
        return made[name]

    return find


def image(part, orientation, x, y):
    """Return what the camera sees of a part whose centre of mass is above (x, y)."""
    corners = Rotation.from_quat(orientation).apply(part.vertices - part.centre_of_mass)
    corners += [x, y, -corners[:, 2].min()]
    rays = corners - CAMERA
    plane = (CAMERA - rays * (CAMERA[2] / rays[:, 2])[:, None])[:, :2]
    triangles = shapely.polygons(plane[part.faces])
    return shapely.union_all(triangles, grid_size=1e-10).simplify(1e-9)


def noisy(polygon, sd, generator):
    """Return a polygon with errors normal to its boundary, independent after CORRELATION."""
    count = int(polygon.exterior.length / SPACING)
    along = np.arange(count) * polygon.exterior.length / count
    points = shapely.get_coordinates(shapely.line_interpolate_point(polygon.exterior, along))
    tangent = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    normal = tangent[:, ::-1] * [1, -1] / np.linalg.norm(tangent, axis=1)[:, None]
    # The integral of the autocorrelation of noise that is smoothed with a width s is 2 s sqrt(pi).
    width = CORRELATION / SPACING / (2 * np.sqrt(np.pi))
    error = gaussian_filter1d(generator.normal(size=count), width, mode='wrap')
    error *= sd * np.sqrt(2 * np.sqrt(np.pi) * width)
    return observed_polygon(points + error[:, None] * normal)


def random_noise(generator):
    """Return a standard deviation from the distribution that the likelihood assumes, m."""
    factors = np.geomspace(MIN_NOISE, MAX_NOISE, 10)
    weights = np.exp(-0.5 * (np.log(factors) / np.log(UNCERTAIN)) ** 2)
    return SD * generator.choice(factors, p=weights / weights.sum())


def random_image(known, generator):
    """Return the number of a random class, its true pose and its image."""
    k = generator.choice(len(known.outlines), p=known.shares)
    aspect = generator.choice(known.outlines[k].aspects)
    yaw = Rotation.from_euler('z', generator.uniform(-np.pi, np.pi))
    turned = yaw * Rotation.from_quat(known.aspects.aspects[aspect - 1].orientation)
    x, y = generator.uniform(-0.1, 0.1, 2)
    seen = image(known.part, turned.as_quat(), x, y)
    return k, (x, y), turned, noisy(seen, random_noise(generator), generator)


@pytest.mark.parametrize('name', MESHES)
def test_posteriors_beside_the_foot_point_are_calibrated(known, name):
    """Right answers are as frequent as stated, and the logarithmic score is the expected one."""
    generator = np.random.default_rng(7)
    part, camera = known(name), Pinhole(np.diag([1.0, -1.0, 1.0]), CAMERA)
    best, right, score, expected, variance = [], [], 0.0, 0.0, 0.0
    for _ in range(60):
        k, _, _, seen = random_image(part, generator)
        found = identify(seen, [part], OutlineNoise(SD, CORRELATION), camera)
        # The last outcome is no known part.
        shares = np.full(len(part.outlines) + 1, 1e-9)
        shares[-1] += found.none + found.touching
        for each in found.candidates:
            shares[each.symmetry_class - 1] += each.posterior
        shares /= shares.sum()
        best.append(shares.max())
        right.append(shares.argmax() == k)
        entropy = -(shares * np.log(shares)).sum()
        score -= np.log(shares[k])
        expected += entropy
        variance += (shares * np.log(shares) ** 2).sum() - entropy**2
    best = np.array(best)
    spread = np.sqrt((best * (1 - best)).sum())
    print(name, sum(right), best.sum(), spread, score, expected, variance**0.5)
    # The last term is for a wrong answer among those that are certain.
    assert abs(sum(right) - best.sum()) < 3 * spread + 0.5
    assert abs(score - expected) < 3 * np.sqrt(variance) + 0.5

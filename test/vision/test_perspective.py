"""Parts seen by a pinhole camera beside its foot point: posteriors, poses and refusals.

The images come from a renderer of their own: the union of the projected triangles.
"""

import functools

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial.transform import Rotation
from shapely import affinity

from resting_aspects_ros.vision.camera import surface_pinhole
from resting_aspects_ros.vision.fitting import (
    MAX_NOISE,
    MIN_NOISE,
    UNCERTAIN,
    OutlineNoise,
)
from resting_aspects_ros.vision.identification import identify

CAMERA = np.array([0.02, -0.03, 0.5])
SD = 1e-4


def prism(points, depth):
    """Return the solid between two parallel polygons, mm."""
    return trimesh.creation.extrude_polygon(shapely.Polygon(points), depth)


# Parts up to 30 mm high. Classes of each differ by much less than the parallax, up to 9 mm.
MESHES = {
    'key': lambda: trimesh.creation.box((8.0, 22.0, 22.07)),
    'angle': lambda: prism([(0, 0), (30, 0), (30, 8), (8, 8), (8, 29.93), (0, 29.93)], 12.0),
    'wedge': lambda: prism([(0, 0), (24, 0), (20, 9), (2, 16)], 15.95),
    'tube': lambda: trimesh.creation.annulus(5.0, 9.0, 18.05, sections=48),
}


@pytest.fixture(scope='module')
def known(solid, known_of):
    return functools.cache(lambda name: known_of(solid(MESHES[name]())))


def image(part, orientation, x, y):
    """Return what the camera sees of a part whose centre of mass is above (x, y)."""
    corners = Rotation.from_quat(orientation).apply(part.vertices - part.centre_of_mass)
    corners += [x, y, -corners[:, 2].min()]
    rays = corners - CAMERA
    plane = (CAMERA - rays * (CAMERA[2] / rays[:, 2])[:, None])[:, :2]
    triangles = shapely.polygons(plane[part.faces])
    union = shapely.union_all(triangles, grid_size=1e-10).simplify(1e-9)
    # Without the gaps of rounding between triangles.
    holes = [hole for hole in union.interiors if shapely.Polygon(hole).area > 1e-9]
    return shapely.Polygon(union.exterior, holes)


def random_image(known, noisy, generator):
    """Return the number of a random class, its place and its image."""
    k = generator.choice(len(known.outlines), p=known.shares)
    aspect = generator.choice(known.outlines[k].aspects)
    yaw = Rotation.from_euler('z', generator.uniform(-np.pi, np.pi))
    turned = yaw * Rotation.from_quat(known.aspects[aspect - 1].orientation)
    x, y = generator.uniform(-0.12, 0.12, 2)
    seen = image(known.part, turned.as_quat(), x, y)
    # Standard deviations from the distribution that the likelihood assumes.
    factors = np.geomspace(MIN_NOISE, MAX_NOISE, 10)
    weights = np.exp(-0.5 * (np.log(factors) / np.log(UNCERTAIN)) ** 2)
    sd = SD * generator.choice(factors, p=weights / weights.sum())
    return k, (x, y), noisy(seen, sd, generator)


def probabilities(part, found):
    """Return the posteriors of all classes; the last outcome is none of the classes."""
    shares = np.full(len(part.outlines) + 1, 1e-9)
    shares[-1] += found.none + found.touching
    for each in found.candidates:
        shares[each.symmetry_class - 1] += each.posterior
    return shares / shares.sum()


def centre(part, pose):
    """Return where the centre of mass of a part is above the surface, (2,) m."""
    turned = Rotation.from_quat(pose.orientation).as_matrix() @ part.part.centre_of_mass
    return (pose.position + turned)[:2]


@pytest.mark.slow
def test_mirror_image_beside_the_foot_point_is_named(known):
    """The coordinates of the image and of the camera have y down."""
    part = known('angle')
    for outline in (each for each in part.outlines if not each.mirror_symmetric):
        seen = image(part.part, outline.orientation, -0.05, 0.08)
        found = identify(
            affinity.scale(seen, 1, -1, origin=(0, 0)),
            [part],
            camera=surface_pinhole(CAMERA * [1, -1, 1]),
        )
        assert outline.symmetry_class in {each.symmetry_class for each in found.mirrored}


@pytest.mark.slow
def test_rolling_part_beside_the_foot_point_is_found(pin):
    (k,) = [k for k, views in enumerate(pin.views) if len(views.shapes) > 1]
    views = pin.views[k]
    turned = Rotation.from_euler('z', 1.3)
    turned *= Rotation.from_quat(views.orientations[len(views.shapes) // 3])
    seen = image(pin.part, turned.as_quat(), 0.08, -0.1)
    found = identify(seen, [pin], camera=surface_pinhole(CAMERA))
    assert found.best.symmetry_class == pin.outlines[k].symmetry_class
    places = [centre(pin, pose) for pose in found.best.poses]
    assert min(np.linalg.norm(each - (0.08, -0.1)) for each in places) < 1e-4


@pytest.mark.slow
def test_posteriors_beside_the_foot_point_are_calibrated(known, noisy):
    """The number of right answers and the logarithmic score are those of the posteriors.

    If these are the frequencies of the classes, an answer is right with the probability p_max, the
    variance of this is p_max (1 - p_max), and the score - log p of the true class has the
    expectation of the entropy.
    """
    generator, camera = np.random.default_rng(7), surface_pinhole(CAMERA)
    right, given, score, entropy, variance = np.zeros((5, 4, 3))
    for i, part in enumerate(map(known, MESHES)):
        for j in range(3):
            k, place, seen = random_image(part, noisy, generator)
            answer = identify(seen, [part], OutlineNoise(SD), camera)
            shares = probabilities(part, answer)
            logs = np.log(shares)
            right[i, j], given[i, j], score[i, j] = shares.argmax() == k, shares.max(), -logs[k]
            entropy[i, j] = -(shares * logs).sum()
            variance[i, j] = (shares * logs**2).sum() - entropy[i, j] ** 2
            for each in answer.candidates:
                if each.symmetry_class == k + 1:
                    off = min(np.linalg.norm(centre(part, pose) - place) for pose in each.poses)
                    # Boundaries of 8 mm or more across each direction: 8 independent errors.
                    assert off < 4 * MAX_NOISE * SD / np.sqrt(8)
    assert entropy.sum() > 0.6
    # The last term is for one wrong answer among many that are almost certain.
    spread = (given * (1 - given)).sum()
    assert abs(right.sum() - given.sum()) < 3 * np.sqrt(spread) + 1
    assert abs(score.sum() - entropy.sum()) < 3 * np.sqrt(variance.sum()) + 1

"""Parts seen by a pinhole camera beside its foot point: posteriors, poses and refusals.

The images come from a renderer of their own: the union of the projected triangles.
"""

import functools

import numpy as np
import pytest
import shapely
import trimesh
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from shapely import affinity

from resting_aspects_ros.vision.camera import surface_pinhole
from resting_aspects_ros.vision.fitting import (
    MAX_NOISE,
    MIN_NOISE,
    UNCERTAIN,
    OutlineNoise,
)
from resting_aspects_ros.vision.identification import identify, observed_polygon

CAMERA = np.array([0.02, -0.03, 0.5])
SD, CORRELATION = 1e-4, 1e-3
# Distance of the points of an image along its boundary, m.
SPACING = 2e-4


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


def image(part, orientation, x, y, camera=CAMERA):
    """Return what the camera sees of a part whose centre of mass is above (x, y)."""
    corners = Rotation.from_quat(orientation).apply(part.vertices - part.centre_of_mass)
    corners += [x, y, -corners[:, 2].min()]
    rays = corners - camera
    plane = (camera - rays * (camera[2] / rays[:, 2])[:, None])[:, :2]
    triangles = shapely.polygons(plane[part.faces])
    union = shapely.union_all(triangles, grid_size=1e-10).simplify(1e-9)
    # Without the gaps of rounding between triangles.
    holes = [hole for hole in union.interiors if shapely.Polygon(hole).area > 1e-9]
    return shapely.Polygon(union.exterior, holes)


def noisy(polygon, sd, generator):
    """Return a polygon with errors normal to its boundary, independent after CORRELATION."""
    rings = [_noisy(ring, sd, generator) for ring in (polygon.exterior, *polygon.interiors)]
    return observed_polygon({'outer': rings[0], 'holes': rings[1:]})


def _noisy(ring, sd, generator):
    count = int(ring.length / SPACING)
    along = np.arange(count) * ring.length / count
    points = shapely.get_coordinates(shapely.line_interpolate_point(ring, along))
    tangent = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    normal = tangent[:, ::-1] * [1, -1] / np.linalg.norm(tangent, axis=1)[:, None]
    # The integral of the autocorrelation of noise that is smoothed with a width s is 2 s sqrt(pi).
    width = CORRELATION / SPACING / (2 * np.sqrt(np.pi))
    error = gaussian_filter1d(generator.normal(size=count), width, mode='wrap')
    error *= sd * np.sqrt(2 * np.sqrt(np.pi) * width)
    return points + error[:, None] * normal


def random_noise(generator):
    """Return a standard deviation from the distribution that the likelihood assumes, m."""
    factors = np.geomspace(MIN_NOISE, MAX_NOISE, 10)
    weights = np.exp(-0.5 * (np.log(factors) / np.log(UNCERTAIN)) ** 2)
    return SD * generator.choice(factors, p=weights / weights.sum())


def random_image(known, generator):
    """Return the number of a random class, its place and its image."""
    k = generator.choice(len(known.outlines), p=known.shares)
    aspect = generator.choice(known.outlines[k].aspects)
    yaw = Rotation.from_euler('z', generator.uniform(-np.pi, np.pi))
    turned = yaw * Rotation.from_quat(known.aspects[aspect - 1].orientation)
    x, y = generator.uniform(-0.12, 0.12, 2)
    seen = image(known.part, turned.as_quat(), x, y)
    return k, (x, y), noisy(seen, random_noise(generator), generator)


class Calibration:
    """Sums over answers: how often they are right, and their logarithmic score.

    If the posteriors p are the frequencies of the classes, the number of right answers has the
    expectation sum p_max and the variance sum p_max (1 - p_max), and the score - log p of the true
    class has the expectation of the entropy.
    """

    def __init__(self):
        self.right, self.given, self.spread = 0, 0.0, 0.0
        self.score, self.entropy, self.variance = 0.0, 0.0, 0.0

    def add(self, part, k, found):
        """Add the answer to an image of class ``k``; the last outcome is none of the classes."""
        shares = np.full(len(part.outlines) + 1, 1e-9)
        shares[-1] += found.none + found.touching
        for each in found.candidates:
            shares[each.symmetry_class - 1] += each.posterior
        shares /= shares.sum()
        logs = np.log(shares)
        entropy = -(shares * logs).sum()
        self.right += shares.argmax() == k
        self.given += shares.max()
        self.spread += shares.max() * (1 - shares.max())
        self.score -= logs[k]
        self.entropy += entropy
        self.variance += (shares * logs**2).sum() - entropy**2

    def check(self):
        # The last term is for one wrong answer among many that are almost certain.
        assert abs(self.right - self.given) < 3 * np.sqrt(self.spread) + 1
        assert abs(self.score - self.entropy) < 3 * np.sqrt(self.variance) + 1


def centre(part, pose):
    """Return where the centre of mass of a part is above the surface, (2,) m."""
    turned = Rotation.from_quat(pose.orientation).as_matrix() @ part.part.centre_of_mass
    return (pose.position + turned)[:2]


@pytest.mark.slow
def test_key_on_its_edge_is_not_taken_for_the_other_class(solid, known_of):
    """The classes differ by 0.16 mm; the parallax 17 mm off the axis is up to 0.75 mm."""
    key = known_of(solid(trimesh.creation.box((8.0, 7.84, 22.0))))
    camera, x = np.array([0.0, 0.0, 0.5]), 0.017
    for outline in key.outlines:
        seen = image(key.part, outline.orientation, x, -x / 2, camera)
        found = identify(seen, [key], camera=surface_pinhole(camera))
        assert found.best.symmetry_class == outline.symmetry_class
        assert found.best.posterior > 0.9
        assert (found.best.x, found.best.y) == pytest.approx((x, -x / 2), abs=1e-5)


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
def test_rolling_part_beside_the_foot_point_is_found(solid, known_of):
    """A roller with a hole across it, which shows how far it has rolled."""
    place = trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0))
    place[0, 3] = 3
    hole = trimesh.creation.cylinder(1.5, 30, sections=12, transform=place)
    roller = known_of(solid(trimesh.creation.cylinder(6, 30, sections=24).difference(hole)))
    (k,) = [k for k, views in enumerate(roller.views) if len(views.shapes) > 1]
    views = roller.views[k]
    turned = Rotation.from_euler('z', 1.3)
    turned *= Rotation.from_quat(views.orientations[len(views.shapes) // 3])
    seen = image(roller.part, turned.as_quat(), 0.08, -0.1)
    found = identify(seen, [roller], camera=surface_pinhole(CAMERA))
    assert found.best.symmetry_class == roller.outlines[k].symmetry_class
    places = [centre(roller, pose) for pose in found.best.poses]
    assert min(np.linalg.norm(each - (0.08, -0.1)) for each in places) < 1e-4


@pytest.mark.slow
def test_posteriors_beside_the_foot_point_are_calibrated(known):
    generator, found, camera = np.random.default_rng(7), Calibration(), surface_pinhole(CAMERA)
    for part in map(known, MESHES):
        for _ in range(3):
            k, place, seen = random_image(part, generator)
            answer = identify(seen, [part], OutlineNoise(SD, CORRELATION), camera)
            found.add(part, k, answer)
            for each in answer.candidates:
                if each.symmetry_class == k + 1:
                    off = min(np.linalg.norm(centre(part, pose) - place) for pose in each.poses)
                    # Boundaries of 8 mm or more across each direction: 8 independent errors.
                    assert off < 4 * MAX_NOISE * SD / np.sqrt(8)
    assert found.entropy > 0.6
    found.check()

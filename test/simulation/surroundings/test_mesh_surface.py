"""Mesh surfaces: flat sides become prisms, and parts come to rest as they do on planes.

Curved sides have fewer triangles within the tolerance.
"""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from surroundings_symmetry import LEVEL, counts_on_belt, groove_and_mesh, poses_from, same

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.mesh_simplification import (
    DEPTH,
    GRID,
    TOLERANCE,
    merged_mesh,
    simplified,
)
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import MeshSurface
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.poses import RestStatus


def strip(profile, length, cells):
    """A surface along x with a profile (k, 2) of y and z, in mm, open below."""
    profile = np.asarray(profile, dtype=float)
    x = np.linspace(-length / 2, length / 2, cells + 1)
    points = np.array([(a, y, z) for a in x for y, z in profile])
    k, low = len(profile), np.arange(len(profile) - 1)
    first = (np.arange(cells)[:, None] * k + low).ravel()
    upper = np.stack([first, first + k, first + k + 1], axis=1)
    lower = np.stack([first, first + k + 1, first + 1], axis=1)
    return trimesh.Trimesh(points, np.concatenate([upper, lower]), process=False)


def plate(cells, size=600.0):
    y = np.linspace(-size / 2, size / 2, cells + 1)
    return strip(np.stack([y, 0 * y], axis=1), size, cells)


@pytest.fixture(scope='module')
def on_mesh(tmp_path_factory, mat):
    """Make the job of a part on a mesh, in mm."""

    def make(part, mesh, conditions=mat, **more):
        path = tmp_path_factory.mktemp('mesh') / 'surface.stl'
        path.write_bytes(mesh.export(file_type='stl'))
        surface = Surroundings(MeshSurface(mesh=str(path)), **more)
        return make_job(part, dataclasses.replace(conditions, surroundings=surface), 1)

    return make


# -- Flat sides ----------------------------------------------------------------------------------


@pytest.mark.parametrize('cells', [1, 8])
def test_a_plate_is_one_prism_whatever_its_triangles(cells):
    mesh = plate(cells)
    found = merged_mesh(np.array(mesh.vertices), np.array(mesh.faces), 20.0)
    assert (found.sides, len(found.remaining)) == (1, 0)
    (prism,) = found.prisms
    depth = 20 * DEPTH
    # A frustum whose sides are inclined by 45 degrees.
    top, bottom = 600.0**2, (600 - 2 * depth) ** 2
    expected = depth / 3 * (top + bottom + math.sqrt(top * bottom))
    assert ConvexHull(prism).volume == pytest.approx(expected, rel=1e-6)
    assert prism[:, 2].max() == pytest.approx(0, abs=1e-9)


def test_prisms_of_a_solid_are_inside_it_and_reach_its_surface():
    """A step: its inner edge is concave, and a side of it is no convex polygon."""
    outline = [(0, 0), (300, 0), (300, 100), (150, 100), (150, 200), (0, 200)]
    solid = trimesh.creation.extrude_polygon(trimesh.path.polygons.Polygon(outline), 400)
    found = merged_mesh(np.array(solid.vertices), np.array(solid.faces), 30.0)
    assert (found.sides, len(found.remaining)) == (8, 0)
    corners = np.concatenate(found.prisms)
    near = 2 * GRID * 30  # corners are moved to a grid
    outside = (corners[:, 0] > 150 + near) & (corners[:, 1] > 100 + near)
    assert not outside.any()
    assert (corners > -near).all()
    assert (corners < np.array([300, 200, 400]) + near).all()
    # Each point of the surface is on a prism.
    points = trimesh.sample.sample_surface(solid, 300, seed=1)[0]
    planes = [ConvexHull(prism).equations for prism in found.prisms]
    gaps = [(points @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes]
    assert np.min(gaps, axis=0).max() < 1e-3 * 30


def test_a_thin_sheet_with_a_hole_stays_thin_and_open():
    square = trimesh.path.polygons.Polygon(
        [(-200, -200), (200, -200), (200, 200), (-200, 200)],
        [[(-40, -40), (-40, 40), (40, 40), (40, -40)]],
    )
    sheet = trimesh.creation.extrude_polygon(square, 2)
    found = merged_mesh(np.array(sheet.vertices), np.array(sheet.faces), 30.0)
    near = 2 * GRID * 30
    inside = np.array([(x, y, z) for x in (-39, 0, 39) for y in (-39, 0, 39) for z in (0.5, 1.5)])
    for prism in found.prisms:
        assert prism[:, 2].min() > -near
        assert prism[:, 2].max() < 2 + near
        planes = ConvexHull(prism).equations
        assert (inside @ planes[:, :3].T + planes[:, 3]).max(axis=1).min() > 0.5


def test_a_flat_side_between_fillets_stays_flat():
    """Its neighbours bend gently, but it is too wide to be a facet of an arc."""
    angles = np.radians(np.arange(0, 91, 5))
    arc = np.stack([1 + np.sin(angles), 1 - np.cos(angles)], axis=1)
    mesh = strip(np.vstack([arc[::-1] * [-1, 1], arc]), 10.0, 1)
    assert merged_mesh(np.array(mesh.vertices), np.array(mesh.faces), 1.0).sides == 1


# Half the side of a square bowl, and the height of its corners above its middle.
HALF, RISE = 5.0, 0.7


def height(x, y):
    return RISE * (x**2 + y**2) / (2 * HALF**2)


def bowl(squares):
    """Vertices and triangles of z = RISE (x^2 + y^2) / (2 HALF^2)."""
    mesh = plate(squares, 2 * HALF)
    x, y, _ = mesh.vertices.T
    return np.stack([x, y, height(x, y)], axis=1), np.array(mesh.faces)


@pytest.mark.slow
def test_a_bowl_has_fewer_triangles_within_the_tolerance():
    vertices, triangles = bowl(40)
    corners, distance = simplified(vertices, triangles)
    assert len(corners) < len(triangles) / 4
    assert 0 < distance <= TOLERANCE
    # From the formula: the paraboloid is at most the sagitta of a square above its triangles.
    weights = np.random.default_rng(1).dirichlet(np.ones(3), 200)
    x, y, z = (weights @ corners).reshape(-1, 3).T
    sagitta = height(HALF / 40, HALF / 40)
    # The slope is small: a vertical distance is longer than that to the surface by this factor.
    steepest = np.hypot(1.0, np.sqrt(2) * RISE / HALF)
    assert np.abs(z - height(x, y)).max() < TOLERANCE * steepest + sagitta
    # All triangles together cover the bowl once, from the same side.
    a, b, c = np.moveaxis(corners[:, :, :2], 1, 0)
    areas = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(4 * HALF**2, rel=1e-9)


@pytest.mark.slow
def test_facets_of_a_curved_side_are_not_flat_sides():
    """They are wider than the narrowest flat side, but bend by less than the tolerance."""
    squares = 12
    vertices, triangles = bowl(squares)
    found = merged_mesh(1000 * vertices, triangles, 1000.0)
    assert len(found.prisms) <= 4  # at corners, two of the four edges are free
    assert len(found.remaining) < len(triangles) - 8 * squares
    assert 0 < found.distance <= 1000 * TOLERANCE


# -- Bad input -----------------------------------------------------------------------------------


def test_a_mesh_that_is_open_below_the_release_is_refused(part, on_mesh):
    both = trimesh.util.concatenate([plate(1, 200.0), plate(1, 200.0)])
    both.vertices[:4, 0] -= 250
    both.vertices[4:, 0] += 250
    with pytest.raises(InvalidValueError, match=r'release at x 0 mm, y 0 mm.*above the mesh'):
        on_mesh(part('l_bracket'), both)
    assert on_mesh(part('l_bracket'), both, release={'x_min': 0.25}).scene.bodies


def test_a_mesh_that_is_seen_from_inside_is_refused(part, on_mesh):
    mesh = plate(1)
    mesh.invert()
    with pytest.raises(InvalidValueError, match=r'points down.*point outward'):
        on_mesh(part('l_bracket'), mesh)


# -- The same distribution as planes -------------------------------------------------------------


def test_drops_on_a_mesh_depend_on_their_index_only(part, on_mesh, assert_same_poses):
    job = on_mesh(part('tetrahedron'), plate(1))
    many = drop_range(job, 0, 20)
    assert_same_poses(drop_range(job, 3, 9), many.between(3, 9))
    assert (many.status == RestStatus.SETTLED).all()


@pytest.mark.slow
def test_a_groove_of_triangles_gives_the_distribution_of_planes(part, surfaces):
    # Samples of 50 tell differences of 0.3; `make validate` compares larger ones.
    shape, n, cells = part('u_bracket'), 50, 100
    aspects = find_aspects(shape)
    jobs = groove_and_mesh(shape, surfaces.get('rubber_mat'), 1, math.radians(90), cells)
    counts = []
    for job in jobs:
        poses = poses_from(job, jobs[0], n)
        assert np.count_nonzero(poses.status == RestStatus.SETTLED) > 0.99 * n
        counts.append(counts_on_belt(jobs[0], aspects, poses, 1))
    assert same(*counts) > LEVEL

"""Hulls with too many corners: the simplification is small, reported and changes no aspect."""

import re

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from solids import directions

from resting_aspects_ros.aspects.find import join_minima
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.part import loading
from resting_aspects_ros.part.hull import FINE, MAX_CORNERS, simplify_hull
from resting_aspects_ros.part.loading import part_from_bytes

# Of more than MAX_CORNERS corners, and how many aspects each has.
FINE_SOLIDS = [
    ('filleted_box', ((10, 14, 20), 2, 24), 6),
    ('random_sphere', (3500, (3, 2, 1)), 2),
]


def shares_of(landscape):
    groups = join_minima(landscape)
    return [landscape.basin_shares[[*g.minima, *g.drained]].sum() for g in groups]


@pytest.fixture
def whole(monkeypatch, solid):
    """Make a part of a trimesh with all corners of its hull."""

    def make(mesh):
        with monkeypatch.context() as patch:
            patch.setattr(loading, 'simplify_hull', lambda corners, *_: (corners, 0.0))
            return solid(mesh)

    return make


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'arguments', 'aspects'), FINE_SOLIDS)
def test_a_fine_mesh_has_the_aspects_of_its_shape(solids, solid, whole, name, arguments, aspects):
    mesh = solids.turned(getattr(solids, name)(*arguments), solids.a_turn(1))
    all_corners, part = whole(mesh), solid(mesh)
    assert part.hull_error > 0
    assert len(part.hull_vertices) <= MAX_CORNERS
    full, few = Landscape(all_corners), Landscape(part)
    shares, found = shares_of(full), shares_of(few)
    assert len(found) == len(shares) == aspects
    # A flat in the middle of a fillet belongs to either of the sides beside it.
    np.testing.assert_allclose(sorted(found), sorted(shares), atol=1e-2)
    assert abs(few.heights.min() - full.heights.min()) <= part.hull_error
    # The error bounds the height in every direction.
    down, corners = directions(1, 2000), all_corners.hull_vertices
    lost = (down @ corners.T).max(axis=1) - (down @ part.hull_vertices.T).max(axis=1)
    assert lost.min() >= 0
    assert lost.max() <= part.hull_error
    # A corner that is outside by the error is further down than all others in some direction.
    planes = ConvexHull(part.hull_vertices).equations
    out = corners @ planes[:, :3].T + planes[:, 3]
    assert out.max() == pytest.approx(part.hull_error, rel=1e-6)


@pytest.mark.slow
def test_flat_sides_keep_their_corners(solids, solid, whole):
    """Each of six sides has four corners, where the fillets begin."""
    mesh = solids.filleted_box((10, 14, 20), 4, 24)
    full, part = whole(mesh), solid(mesh)
    kept = set(map(tuple, part.hull_vertices.tolist()))
    assert kept < set(map(tuple, full.hull_vertices.tolist()))
    for axis in range(3):
        for side in (1, -1):
            reach = side * full.hull_vertices[:, axis]
            flat = full.hull_vertices[reach >= reach.max() - 1e-9]
            assert len(flat) == 4
            assert kept.issuperset(map(tuple, flat.tolist()))


@pytest.mark.slow
def test_a_cylinder_of_thousands_of_sides_stays_straight(solids, solid):
    pose = solids.a_turn(0)
    cylinder = trimesh.creation.cylinder(10, 20, sections=2000)
    sides = Landscape(solid(solids.turned(cylinder, pose))).hull
    lean = np.abs(sides.normals @ pose[:, 2])
    ends = lean > 0.9
    assert np.count_nonzero(ends) == 2
    assert lean[~ends].max() < FINE


@pytest.fixture
def few(monkeypatch):
    """Let a hull have 50 corners, but for those of its first sides."""
    monkeypatch.setattr(loading, 'simplify_hull', lambda *hull: simplify_hull(*hull, 50))


@pytest.mark.usefixtures('few')
def test_warning_states_the_simplification_error(solids, solid):
    part = solid(solids.random_sphere(100))
    (sentence,) = part.warnings
    assert f'simplified from 100 to {len(part.hull_vertices)} corners' in sentence
    error = re.search(r'at most ([\d.e-]+) mm', sentence)[1]
    assert float(error) == pytest.approx(1e3 * part.hull_error, rel=0.05)  # two digits


@pytest.mark.slow
@pytest.mark.usefixtures('few')
def test_result_does_not_depend_on_order_and_scale(solids):
    mesh = solids.random_sphere(100)
    mesh.vertices = mesh.vertices.astype(np.float32)

    def part(faces, scale=1.0):
        scaled = trimesh.Trimesh(mesh.vertices * scale, faces, process=False)
        return part_from_bytes(scaled.export(file_type='stl'), 'stl', 'ball')

    one = part(mesh.faces)
    shuffled = part(np.random.default_rng(5).permutation(mesh.faces))
    np.testing.assert_array_equal(one.hull_vertices, shuffled.hull_vertices)
    assert one.hull_error == shuffled.hull_error > 0
    large = part(mesh.faces, 64.0)  # a power of two: nothing is rounded
    np.testing.assert_allclose(large.hull_vertices, 64 * one.hull_vertices, rtol=1e-14)
    assert large.hull_error == pytest.approx(64 * one.hull_error)

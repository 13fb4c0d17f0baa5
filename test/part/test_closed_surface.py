"""What is repaired in a mesh, what is reported, and what stays unchanged."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.surface import closed_surface

Mesh = trimesh.Trimesh


def box(x=40.0, y=30.0, z=20.0, at=(0.0, 0.0, 0.0)) -> Mesh:
    """A box with its middle somewhere."""
    mesh = trimesh.creation.box((x, y, z))
    mesh.apply_translation(at)
    return mesh


def both(*meshes: Mesh) -> Mesh:
    return trimesh.util.concatenate(meshes)


def inverted(mesh: Mesh, which=slice(None)) -> Mesh:
    faces = mesh.faces.copy()
    faces[which] = faces[which][:, ::-1]
    return Mesh(mesh.vertices, faces, process=False)


def part_of(mesh: Mesh, **given) -> Part:
    triangles = np.asarray(mesh.triangles).tolist()
    lines = ['solid']
    for triangle in triangles:
        lines += [
            'facet normal 0 0 0',
            'outer loop',
            *(f'vertex {x!r} {y!r} {z!r}' for x, y, z in triangle),
            'endloop',
            'endfacet',
        ]
    return part_from_bytes('\n'.join([*lines, 'endsolid']).encode(), 'stl', 'bracket', **given)


def cubic_mm(part: Part) -> float:
    return round(part.volume * 1e9, 6)


def cubes_in_disorder(flips: list[bool]) -> Mesh:
    """Two boxes that touch at a corner; some of their 24 triangles face the other way."""
    return inverted(both(box(), box(10, 10, 10, at=(25, 20, 15))), np.array(flips))


@pytest.mark.parametrize(('missing', 'edges'), [([0], 3), ([0, 2], 4)])
def test_error_for_an_open_mesh(missing, edges):
    """The triangles 0 and 2 of the box are one side of it, and share one edge."""
    opened = Mesh(box().vertices, np.delete(box().faces, missing, axis=0), process=False)
    with pytest.raises(PartError, match=f"part 'bracket' .*not watertight.* {edges} open edges"):
        part_of(opened)


ALL = {'mass': 1, 'centre_of_mass': (0, 0, 0.001), 'inertia': [1e-4, 0, 0, 1e-4, 0, 1e-4]}


@pytest.mark.parametrize('missing', ALL)
def test_open_mesh_needs_all_mass_properties(missing):
    opened = Mesh(box().vertices, box().faces[1:], process=False)
    with pytest.raises(PartError, match='3 open edges'):
        part_of(opened, **{key: value for key, value in ALL.items() if key != missing})


def test_open_mesh_with_all_mass_properties_is_a_part():
    opened = Mesh(box().vertices, box().faces[1:], process=False)
    part = part_of(opened, **ALL)
    assert (part.mass, part.centre_of_mass.tolist()) == (1, [0, 0, 0.001])
    assert len(part.hull_vertices) == 8
    assert len(part.warnings) == 1
    assert '3 open edges' in part.warnings[0]


@given(seed=st.integers(0, 2**32 - 1))
def test_flat_mesh_of_any_outline_and_orientation_has_no_volume(seed):
    """The corners are in float32, which leaves them 1e-7 off the plane."""
    generator = np.random.default_rng(seed)
    corners = generator.uniform(-20, 20, size=(5, 2)) @ generator.normal(size=(2, 3))
    corners = (corners + generator.uniform(-20, 20, size=3)).astype(np.float32)
    faces = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (2, 1, 0), (3, 2, 0), (4, 3, 0)]
    with pytest.raises(PartError, match='has no volume'):
        part_of(Mesh(corners.astype(float), faces, process=False))


@pytest.mark.parametrize('scale', [(1, 0, 0), (0, 0, 0)])
def test_line_or_point_has_no_volume(scale):
    with pytest.raises(PartError, match='has no volume'):
        part_of(Mesh(box().vertices * scale + 7, box().faces, process=False), **ALL)


def test_sheet_folded_onto_itself_encloses_no_volume():
    """Both sides of two triangles at an angle: closed, with a hull, but no solid."""
    corners = [(0, 0, 0), (10, 0, 0), (0, 10, 0), (0, 0, 10)]
    sheet = Mesh(corners, [(0, 1, 2), (0, 2, 1), (0, 2, 3), (0, 3, 2)], process=False)
    with pytest.raises(PartError, match='encloses no volume: it has each triangle twice'):
        part_of(sheet)


def test_mesh_inside_out_is_turned_with_a_warning():
    part = part_of(inverted(box()))
    assert cubic_mm(part) == 24000
    assert len(part.warnings) == 1
    assert 'inside out' in part.warnings[0]
    outward = np.einsum(
        'ij,ij->i',
        Mesh(part.vertices, part.faces, process=False).face_normals,
        part.vertices[part.faces].mean(axis=1),
    )
    assert (outward > 0).all()


@given(flips=st.lists(st.booleans(), min_size=24, max_size=24))
def test_triangles_of_mixed_orientation_are_flipped_outward(flips):
    part = part_of(cubes_in_disorder(flips))
    assert cubic_mm(part) == 25000
    *turned, touching = part.warnings
    assert bool(turned) == any(flips)
    assert 'bodies that touch' in touching
    np.testing.assert_allclose(part.centre_of_mass, [1e-3, 0.8e-3, 0.6e-3], atol=1e-12)


CAVITY = inverted(box(10, 10, 10, at=(5, 0, 0)))


@pytest.mark.parametrize(
    ('mesh', 'warns'),
    [
        (both(box(), CAVITY), ''),
        (both(CAVITY, box()), ''),
        (inverted(both(box(), CAVITY)), 'was inside out and was flipped'),
        (both(inverted(box()), CAVITY), '1 of 2 bodies'),
        (
            inverted(both(box(), CAVITY), [0, 1, 14]),
            'did not face the same way as their neighbours',
        ),
    ],
)
def test_cavity_stays_a_cavity(mesh, warns):
    part = part_of(mesh)
    assert cubic_mm(part) == 23000
    np.testing.assert_allclose(part.centre_of_mass, [-5e-3 / 23, 0, 0], atol=1e-12)
    assert len(part.warnings) == bool(warns)
    assert warns in ' '.join(part.warnings)


def test_cavity_may_touch_the_outside():
    """Where it does, the wall has no thickness, and the largest triangles of both are there."""
    part = part_of(both(box(10, 30, 20), inverted(box(10, 28, 18))))
    assert (cubic_mm(part), part.warnings) == (10 * (30 * 20 - 28 * 18), ())


@pytest.mark.filterwarnings('error')
def test_sheets_and_needles_beside_a_body_change_nothing():
    """Each is closed, as its two sides are there, but has no volume, or not even an area."""
    corners = [(0, 0, 0), (5, 0, 0), (0, 5, 0), (10, 0, 0)]
    sheet = Mesh(corners[:3], [(0, 1, 2), (0, 2, 1)], process=False)
    needle = Mesh([corners[i] for i in (0, 1, 3)], [(0, 1, 2), (0, 2, 1)], process=False)
    for extra in (sheet, needle):
        part = part_of(both(box(), extra))
        assert (cubic_mm(part), part.warnings) == (24000, ())


def test_mesh_with_excessive_nesting_is_rejected():
    dolls = [box(1 + size, 1 + size, 1 + size) for size in range(102)]
    with pytest.raises(PartError, match='more than 100 bodies inside each other; either repair'):
        part_of(both(*dolls))


def test_duplicate_triangles_count_once():
    part = part_of(both(box(), box()))
    assert cubic_mm(part) == 24000
    assert 'duplicate triangles were removed: 12' in part.warnings[0]
    assert part.faces.shape == (12, 3)


def test_triangles_without_area_are_dropped():
    mesh = box()
    middle = mesh.vertices[mesh.faces[0, :2]].mean(axis=0)
    extra = [(*mesh.faces[0, :2], 8), (*mesh.faces[0, :2], mesh.faces[0, 0])]
    part = part_of(Mesh([*mesh.vertices, middle], [*mesh.faces, *extra], process=False))
    assert (cubic_mm(part), part.faces.shape, part.warnings) == (24000, (12, 3), ())


def test_needle_that_closes_a_gap_stays():
    """An edge cut on one side only is bridged by a triangle with its three corners on a line."""
    mesh = box()
    a, b, c = mesh.faces[0]
    middle = mesh.vertices[[a, b]].mean(axis=0)
    faces = [*mesh.faces[1:], (a, 8, c), (8, b, c)]
    with pytest.raises(PartError, match='3 open edges'):
        part_of(Mesh([*mesh.vertices, middle], faces, process=False))
    part = part_of(Mesh([*mesh.vertices, middle], [*faces, (a, b, 8)], process=False))
    assert (cubic_mm(part), part.warnings) == (24000, ())


@given(seed=st.integers(0, 2**32 - 1))
def test_corners_separated_by_float32_noise_are_welded(seed):
    """Each triangle of the file gets its own noise, of up to half the tolerance in all."""
    triangles = np.asarray(box().triangles)
    noise = np.random.default_rng(seed).uniform(-1, 1, size=triangles.shape)
    triangles = triangles + noise * 1e-6 * 20 / 2 / np.sqrt(3)
    part = part_of(Mesh(triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False))
    assert len(part.vertices) == 8
    assert part.volume == pytest.approx(24000e-9, rel=1e-5)


def test_small_features_are_not_welded():
    """A box of 0.1 um on a part of 40 mm is five tolerances wide."""
    part = part_of(both(box(), box(1e-4, 1e-4, 1e-4, at=(20, 0, 0))))
    assert len(part.vertices) == 16


def test_negative_zero_equals_zero():
    """Or the bits of a vertex would depend on which triangle of the file comes first."""
    mesh = box(at=(20, 15, 10))
    vertices = np.where(mesh.vertices == 0, -0.0, mesh.vertices)
    found = closed_surface(vertices, np.array(mesh.faces)).vertices
    assert np.count_nonzero(found == 0) == 12
    assert not np.signbit(found).any()


def test_order_of_the_file_does_not_matter():
    mesh = both(box(), CAVITY)
    shuffled = np.random.default_rng(2).permutation(mesh.faces)
    surfaces = [
        closed_surface(mesh.vertices, faces)
        for faces in (mesh.faces, np.roll(shuffled, 1, axis=1))
    ]
    np.testing.assert_array_equal(surfaces[0].vertices, surfaces[1].vertices)
    as_sets = [{tuple(np.roll(f, -f.argmin())) for f in surface.faces} for surface in surfaces]
    assert as_sets[0] == as_sets[1]


def test_surface_without_an_inside_is_no_solid():
    """A closed band with half a turn, both rims on one point: every edge has two triangles."""
    n = 12
    turns = 2 * np.pi * np.arange(n) / n
    rim = np.array(
        [
            [
                (20 + r * np.cos(t / 2)) * np.cos(t),
                (20 + r * np.cos(t / 2)) * np.sin(t),
                r * np.sin(t / 2),
            ]
            for r in (5, -5)
            for t in turns
        ]
    )
    band = [
        face
        for i in range(n)
        for j, a, b in [((i + 1) % n, *((0, n) if i < n - 1 else (n, 0)))]
        for face in ((i, j + a, i + n), (j + a, j + b, i + n))
    ]
    edge = [*range(n), *range(n, 2 * n)]
    fan = [(edge[k], 2 * n, edge[(k + 1) % (2 * n)]) for k in range(2 * n)]
    mesh = Mesh([*rim, (0, 0, 40)], band + fan, process=False)
    with pytest.raises(PartError, match='cannot be flipped to face the same way'):
        part_of(mesh)

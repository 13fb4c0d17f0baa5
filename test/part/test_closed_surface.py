"""What is repaired in a mesh, what is reported, and how its bodies are united or chosen."""

import sys

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.surface import closed_surface

Mesh = trimesh.Trimesh


def box(sides=(40.0, 30.0, 20.0), at=(0.0, 0.0, 0.0)) -> Mesh:
    """A box with its middle somewhere."""
    mesh = trimesh.creation.box(sides)
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
    return inverted(both(box(), box((10, 10, 10), (25, 20, 15))), np.array(flips))


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


@pytest.mark.slow
@given(flips=st.lists(st.booleans(), min_size=24, max_size=24))
def test_triangles_of_mixed_orientation_are_flipped_outward(flips):
    part = part_of(cubes_in_disorder(flips))
    assert cubic_mm(part) == 25000
    *turned, touching = part.warnings
    assert bool(turned) == any(flips)
    assert 'bodies that touch' in touching
    np.testing.assert_allclose(part.centre_of_mass, [1e-3, 0.8e-3, 0.6e-3], atol=1e-12)


CAVITY = inverted(box((10, 10, 10), (5, 0, 0)))


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
    part = part_of(both(box((10, 30, 20)), inverted(box((10, 28, 18)))))
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
    dolls = [box((1 + size, 1 + size, 1 + size)) for size in range(102)]
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
    part = part_of(both(box(), box((1e-4, 1e-4, 1e-4), (20, 0, 0))))
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
    """The projective plane: every edge has two triangles, but it has only one side."""
    faces = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5), (0, 5, 1)]
    faces += [(1, 2, 4), (2, 3, 5), (3, 4, 1), (4, 5, 2), (5, 1, 3)]
    corners = np.random.default_rng(1).uniform(-20, 20, (6, 3))
    with pytest.raises(PartError, match='cannot be flipped to face the same way'):
        part_of(Mesh(corners, faces, process=False))


# -- Several bodies -------------------------------------------------------------------------------


def tube(sections=32):
    return trimesh.creation.annulus(r_min=10, r_max=20, height=30, sections=sections)


def ply_part(mesh, **given):
    data = mesh.export(file_type='ply', vertex_normal=False)
    return part_from_bytes(data, 'ply', 'bracket', unit='mm', **given)


def refusal(mesh, **given):
    with pytest.raises((PartError, InvalidValueError)) as caught:
        ply_part(mesh, **given)
    return str(caught.value)


def bolt(shift=0.0, turn=0.0):
    """A hexagon head of 5 mm on a shank of 20 mm that ends inside the head."""
    head = trimesh.creation.cylinder(radius=8, height=5, sections=6)
    shank = trimesh.creation.cylinder(radius=4, height=20, sections=24)
    shank.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 0, 1)))
    shank.apply_translation((shift, 0, -10 + 1))
    return head, shank


@pytest.mark.parametrize('shift', [0.0, 1.3, 3.0])
@pytest.mark.parametrize('turn', [0.0, 0.1])
def test_overlapping_bodies_are_united_with_a_warning(shift, turn):
    """The end of the shank, 3.5 mm, is in the head."""
    head, shank = bolt(shift, turn)
    common = shank.volume * 3.5 / 20
    part = ply_part(both(head, shank))
    total = head.volume + shank.volume - common
    assert cubic_mm(part) == pytest.approx(total, rel=1e-6)
    centre = (shank.volume * -9 - common * (-2.5 + 3.5 / 2)) / total
    assert part.centre_of_mass[2] * 1e3 == pytest.approx(centre, rel=1e-5)
    (warning,) = part.warnings
    change = 100 * (total / (head.volume + shank.volume) - 1)
    assert (
        f'2 bodies that overlap; they were united, which changed the volume by {change:.2g} %'
        in (warning)
    )


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_volume_of_the_union_of_three_boxes(seed):
    """Whole numbers, so that the unit cubes in any of them can be counted."""
    generator = np.random.default_rng(seed)
    low = generator.integers(0, 4, (3, 3))
    high = generator.integers(4, 8, (3, 3))
    cells = np.stack(np.meshgrid(*[np.arange(10)] * 3), axis=-1)[..., None, :]
    inside = ((cells >= low) & (cells < high)).all(axis=-1)
    mesh = both(*(box(b - a, (a + b) / 2) for a, b in zip(low, high, strict=True)))
    part = ply_part(mesh)
    assert cubic_mm(part) == pytest.approx(np.count_nonzero(inside.any(axis=-1)), rel=1e-9)


def test_the_same_union_is_made_every_time():
    mesh = both(*bolt(1.3, 0.1), trimesh.creation.icosphere(3, radius=5))
    assert len({ply_part(mesh).part_sha256 for _ in range(3)}) == 1


def test_bodies_may_touch_at_an_edge_or_share_a_side():
    """At an edge of both four triangles meet; a shared side is there twice, and cancels."""
    assert cubic_mm(ply_part(both(box(), box(at=(40, 30, 0))))) == pytest.approx(48000)
    shared = ply_part(both(box(), box(at=(40, 0, 0))))
    assert cubic_mm(shared) == pytest.approx(48000)
    assert shared.warnings == ()


@pytest.mark.parametrize(
    ('other', 'volume'),
    [
        (box((10, 10, 10), (25, 0, 0)), 1000),  # on a side, without a common corner
        (box((10, 10, 10), (25, 20, 0)), 1000),  # along a part of an edge
        (box((10, 10, 10), (25, 20, 15)), 1000),  # at a corner
        (box((10, 10, 10), (25 + 1e-5, 0, 0)), 1000),  # but for what float32 can make of it
    ],
)
def test_bodies_that_touch_are_one_part(other, volume):
    part = ply_part(both(box(), other))
    assert cubic_mm(part) == pytest.approx(24000 + volume, rel=1e-6)
    (warning,) = part.warnings
    assert 'has 2 bodies that touch each other and are treated as one part' in warning


def test_bodies_that_touch_are_not_inside_each_other():
    """The four sides of a short square bar lie on those of the square hole around it."""
    bar = box((10 * np.sqrt(2), 10 * np.sqrt(2), 20))
    bar.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (0, 0, 1)))
    part = ply_part(both(tube(4), bar))
    assert cubic_mm(part) == pytest.approx(tube(4).volume + bar.volume, rel=1e-6)


def test_a_body_inside_a_solid_counts_once():
    part = ply_part(both(box(), box((10, 10, 10))))
    assert cubic_mm(part) == pytest.approx(24000)
    (warning,) = part.warnings
    assert 'changed the volume by -4 %. A body inside another one is a cavity only if' in warning


def test_a_cavity_stays_one_beside_bodies_that_are_united():
    cavity = inverted(box((10, 10, 10), (-5, 0, 0)))
    part = ply_part(both(cavity, box(), box((20, 20, 10), (20, 0, 0))))
    assert cubic_mm(part) == pytest.approx(24000 - 1000 + 2000)


TWO = both(box((10, 10, 10), (60, 0, 0)), box())


@pytest.mark.parametrize(
    ('mesh', 'expected'),
    [
        (TWO, '2 bodies that do not touch each other (1: 40 x 30 x 20 mm, 2: 10 x 10 x 10 mm)'),
        (both(tube(), box((8, 8, 8))), '2 bodies that do not touch'),  # a peg in a hole
        (
            both(box(), inverted(box((16, 16, 16))), box((2, 2, 2))),  # a body in a cavity
            '2 bodies that do not touch each other (1: 40 x 30 x 20 mm, 2: 2 x 2 x 2 mm)',
        ),
        (both(*bolt(), box((1, 1, 1), (30, 0, 0))), '2 bodies that do not touch'),
        (both(*(box((1, 1, 1), (3 * k, 0, 0)) for k in range(9))), '5: 1 x 1 x 1 mm, ...)'),
        (both(box(), box((10, 10, 10), (25.01, 0, 0))), '2 bodies that do not touch'),
    ],
)
def test_separate_bodies_are_rejected_with_instructions(mesh, expected):
    message = refusal(mesh)
    assert expected in message
    assert 'choose one with --body, or with "body" in the YAML file' in message
    assert message.isprintable()
    with pytest.raises(PartError):  # also with a given mass, it is not a rigid part
        ply_part(mesh, mass=1, centre_of_mass=(0, 0, 0.001), inertia=[1e-4, 0, 0, 1e-4, 0, 1e-4])


def test_a_chosen_body_is_the_part_that_it_would_be_alone():
    for number, alone in ((1, box()), (2, box((10, 10, 10), (60, 0, 0)))):
        chosen, part = ply_part(TWO, body=number), ply_part(alone)
        assert (chosen.body, chosen.warnings) == (number, ())
        for name in ('vertices', 'faces', 'hull_vertices', 'centre_of_mass', 'inertia'):
            np.testing.assert_allclose(
                getattr(chosen, name), getattr(part, name), rtol=1e-12, atol=1e-20
            )
    united = ply_part(both(*bolt(), box((1, 1, 1), (30, 0, 0))), body=1)
    assert 'they were united' in united.warnings[0]
    assert cubic_mm(united) == pytest.approx(cubic_mm(ply_part(both(*bolt()))))


def test_body_number_does_not_depend_on_file_order():
    boxes = [box((k, 5, 5), (0, 8 * k, 0)) for k in (4, 5, 5, 6)]
    generator = np.random.default_rng(1)
    found = {
        tuple(ply_part(both(*(boxes[k] for k in order)), body=2).centre_of_mass.tolist())
        for order in (generator.permutation(4) for _ in range(6))
    }
    assert len(found) == 1


def test_part_sha256_depends_on_the_body():
    given = {'mass': 1, 'centre_of_mass': (0, 0, 0), 'inertia': [1e-4, 0, 0, 1e-4, 0, 1e-4]}
    around = both(*(trimesh.creation.annulus(r, r + 5, 30, sections=32) for r in (5, 20, 30)))
    parts = [ply_part(around, body=number, **given) for number in (1, 2, 3)]
    assert len({part.part_sha256 for part in parts}) == 3
    # The only body of a mesh is the mesh.
    assert ply_part(box(), body=1).part_sha256 == ply_part(box()).part_sha256


@pytest.mark.parametrize('body', [0, 3, -1, True, 1.0, 'x', 10**400, [1]])
def test_invalid_body_number_is_rejected(body):
    message = refusal(TWO, body=body)
    assert message.startswith('invalid body ')
    assert message.endswith("of part 'bracket': expected 1 to 2")
    assert len(message) < 200


def test_no_body_of_an_open_mesh_can_be_chosen():
    opened = Mesh(box().vertices, box().faces[1:], process=False)
    assert '3 open edges: no body of it can be chosen' in refusal(opened, body=1)


def test_error_without_manifold3d_explains_installation(monkeypatch):
    monkeypatch.setitem(sys.modules, 'manifold3d', None)
    assert 'manifold3d' in refusal(both(*bolt()))
    assert 'pip install manifold3d' in refusal(both(*bolt()))
    assert cubic_mm(ply_part(box())) == pytest.approx(24000)  # is not needed for one body


def test_fragments_are_inside_or_beside_a_body():
    """Round a ring: where they are follows from how far they are from its circle."""
    generator = np.random.default_rng(0)
    places = generator.uniform(-1, 1, (60, 3)) * [13, 13, 3]
    from_circle = np.hypot(np.hypot(places[:, 0], places[:, 1]) - 10, places[:, 2])
    apart = np.linalg.norm(places[:, None] - places, axis=-1) + 9 * np.eye(len(places))
    clear = (np.abs(from_circle - 3) > 0.3) & (apart.min(axis=1) > 0.3)
    ring = trimesh.creation.torus(10, 3, major_sections=64, minor_sections=32)
    fragments = [trimesh.creation.icosphere(0, radius=0.1) for _ in places[clear]]
    for fragment, place in zip(fragments, places[clear], strict=True):
        fragment.apply_translation(place)
    mesh = both(ring, *fragments)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(generator.random(3)))
    inside = np.count_nonzero(from_circle[clear] < 3)
    beside = np.count_nonzero(clear) - inside
    assert f'has {1 + beside} bodies that do not touch' in refusal(mesh)
    part = ply_part(mesh, body=1)
    assert cubic_mm(part) == pytest.approx(ring.volume)
    assert f'{1 + inside} bodies that overlap' in part.warnings[0]


@pytest.mark.slow
def test_a_mesh_of_thousands_of_bodies_is_read():
    """Each is in no other's box, so none is compared with all others."""
    boxes = np.stack(np.meshgrid(*[np.arange(11)] * 3), axis=-1).reshape(-1, 3) * 3
    one = box((2, 2, 2))
    vertices = (boxes[:, None] + one.vertices).reshape(-1, 3)
    faces = (len(one.vertices) * np.arange(len(boxes))[:, None, None] + one.faces).reshape(-1, 3)
    mesh = Mesh(vertices, faces, process=False)
    assert 'has 1331 bodies that do not touch' in refusal(mesh)
    assert cubic_mm(ply_part(mesh, body=1331)) == pytest.approx(8)


def test_too_many_bodies_that_may_touch_are_refused():
    small = [
        box((1, 1, 1), at)
        for at in np.stack(np.meshgrid(*[np.arange(7)] * 3), -1).reshape(-1, 3) * 0.9
    ]
    assert 'pairs may touch: expected at most 2000; unite them' in refusal(both(*small))

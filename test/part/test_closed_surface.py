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

Mesh = trimesh.Trimesh
ALL = {'mass': 1, 'centre_of_mass': (0, 0, 0.001), 'inertia': [1e-4, 0, 0, 1e-4, 0, 1e-4]}


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


def tube(sections=32):
    return trimesh.creation.annulus(r_min=10, r_max=20, height=30, sections=sections)


def part_of(mesh: Mesh, **given) -> Part:
    data = mesh.export(file_type='off', digits=15).encode()
    return part_from_bytes(data, 'off', 'bracket', unit='mm', **given)


def refusal(mesh, **given):
    with pytest.raises((PartError, InvalidValueError)) as caught:
        part_of(mesh, **given)
    return str(caught.value)


def cubic_mm(part: Part) -> float:
    return part.volume * 1e9


def test_open_mesh_needs_all_mass_properties():
    """The triangles 0 and 2 of the box are one side of it, and share one edge."""
    opened = Mesh(box().vertices, np.delete(box().faces, [0, 2], axis=0), process=False)
    for lacking in ALL:
        message = refusal(opened, **{key: ALL[key] for key in ALL if key != lacking})
        assert "part 'bracket' is not watertight: it has 4 open edges" in message
    part = part_of(opened, **ALL)
    assert (part.mass, part.centre_of_mass.tolist()) == (1, [0, 0, 0.001])
    (warning,) = part.warnings
    assert ' 4 open edges' in warning
    assert 'no body of it can be chosen' in refusal(opened, body=1)


@given(seed=st.integers(0, 2**32 - 1))
def test_flat_mesh_of_any_outline_and_orientation_has_no_volume(seed):
    """The corners are in float32, which leaves them 1e-7 off the plane."""
    generator = np.random.default_rng(seed)
    corners = generator.uniform(-20, 20, size=(5, 2)) @ generator.normal(size=(2, 3))
    corners = (corners + generator.uniform(-20, 20, size=3)).astype(np.float32)
    faces = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (2, 1, 0), (3, 2, 0), (4, 3, 0)]
    assert 'has no volume' in refusal(Mesh(corners.astype(float), faces, process=False), **ALL)


def turned_bar():
    bar = box((10 * np.sqrt(2), 10 * np.sqrt(2), 20))
    return bar.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (0, 0, 1)))


def extra(*faces):
    """A box, and triangles without volume or area: 8 is in the middle of an edge of it."""
    mesh = box()
    a, b, _ = mesh.faces[0]
    corners = [*mesh.vertices, mesh.vertices[[a, b]].mean(axis=0), (0, 0, 0), (5, 0, 0), (0, 5, 0)]
    more = [[{'a': a, 'b': b}.get(k, k) for k in face] for face in faces]
    return Mesh(corners, [*mesh.faces, *more], process=False)


SMALL = (10, 10, 10)
# The end of the shank, 5 mm, is in the head.
HEAD, SHANK = (trimesh.creation.cylinder(radius, height=20) for radius in (8, 4))
BOLT = both(HEAD, SHANK.apply_translation((1.3, 0, -15)))
CAVITY = inverted(box(SMALL, (5, 0, 0)))
TOUCH = 'has 2 bodies that touch each other and are treated as one part'
# The mesh, its volume in mm^3, and what the only warning says, or nothing.
REPAIRED = {
    'inside out': (inverted(both(box(), CAVITY)), 23000, 'was inside out and was flipped'),
    'cavity': (both(CAVITY, box()), 23000, ''),
    'outside inside out': (both(inverted(box()), CAVITY), 23000, '1 of 2 bodies'),
    'triangles inside out': (
        inverted(both(box(), CAVITY), [0, 1, 14]),
        23000,
        'did not face the same way as their neighbours',
    ),
    # The wall has no thickness, and the largest triangles of both are there.
    'cavity at the outside': (both(box((10, 30, 20)), inverted(box((10, 28, 18)))), 960, ''),
    'sheet beside the body': (extra((9, 10, 11), (9, 11, 10)), 24000, ''),
    'triangles without area': (extra(('a', 'b', 8), ('a', 'b', 'a')), 24000, ''),
    'duplicates': (both(box(), box()), 24000, 'duplicate triangles were removed: 12'),
    'common edge': (both(box(), box(at=(40, 30, 0))), 48000, ''),
    # The triangles of the common side are there twice, and cancel.
    'common side': (both(box(), box(at=(40, 0, 0))), 48000, ''),
    'on a side': (both(box(), box(SMALL, (25, 0, 0))), 25000, TOUCH),
    'but for float32': (both(box(), box(SMALL, (25 + 1e-5, 0, 0))), 25000, TOUCH),
    # The four sides of a short square bar lie on those of the square hole around it.
    'bar in a hole': (both(tube(4), turned_bar()), tube(4).volume + 4000, TOUCH),
    'body in a solid': (
        both(box(), box(SMALL)),
        24000,
        'changed the volume by -4 %. A body inside another one is a cavity only if',
    ),
    'bolt': (BOLT, HEAD.volume + SHANK.volume * 3 / 4, '2 bodies that overlap; they were united'),
    'cavity beside a union': (
        both(inverted(box(SMALL, (-5, 0, 0))), box(), box((20, 20, 10), (20, 0, 0))),
        25000,
        '2 bodies that overlap; they were united',
    ),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('kind', REPAIRED)
def test_volume_and_warning_of_a_repaired_mesh(kind):
    mesh, volume, expected = REPAIRED[kind]
    part = part_of(mesh)
    assert cubic_mm(part) == pytest.approx(volume, rel=1e-6)
    assert len(part.warnings) == bool(expected)
    assert expected in ' '.join(part.warnings)
    # Facing outward, the triangles enclose that volume.
    solid = Mesh(part.vertices * 1e3, part.faces, process=False)
    assert solid.volume == pytest.approx(volume, rel=1e-6)
    np.testing.assert_allclose(part.centre_of_mass * 1e3, solid.center_mass, atol=1e-9)


@pytest.mark.slow
@given(flips=st.lists(st.booleans(), min_size=24, max_size=24))
def test_triangles_of_mixed_orientation_are_flipped_outward(flips):
    """Two boxes that touch at a corner; some of their 24 triangles face the other way."""
    part = part_of(inverted(both(box(), box(SMALL, (25, 20, 15))), np.array(flips)))
    assert cubic_mm(part) == pytest.approx(25000)
    *turned, touching = part.warnings
    assert bool(turned) == any(flips)
    assert 'bodies that touch' in touching
    np.testing.assert_allclose(part.centre_of_mass, [1e-3, 0.8e-3, 0.6e-3], atol=1e-12)


def test_mesh_with_excessive_nesting_is_rejected():
    dolls = [box((1 + size, 1 + size, 1 + size)) for size in range(102)]
    assert 'more than 100 bodies inside each other; either repair' in refusal(both(*dolls))


def test_needle_that_closes_a_gap_stays():
    """An edge cut on one side only is bridged by a triangle with its three corners on a line."""
    mesh = box()
    a, b, c = mesh.faces[0]
    corners = [*mesh.vertices, mesh.vertices[[a, b]].mean(axis=0)]
    faces = [*mesh.faces[1:], (a, 8, c), (8, b, c)]
    assert '3 open edges' in refusal(Mesh(corners, faces, process=False))
    part = part_of(Mesh(corners, [*faces, (a, b, 8)], process=False))
    assert (cubic_mm(part), part.warnings) == (pytest.approx(24000), ())


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


def test_surface_without_an_inside_is_no_solid():
    """The projective plane: every edge has two triangles, but it has only one side."""
    faces = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5), (0, 5, 1)]
    faces += [(1, 2, 4), (2, 3, 5), (3, 4, 1), (4, 5, 2), (5, 1, 3)]
    corners = np.random.default_rng(1).uniform(-20, 20, (6, 3))
    message = refusal(Mesh(corners, faces, process=False))
    assert 'cannot be flipped to face the same way' in message


# -- Several bodies -------------------------------------------------------------------------------


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
    part = part_of(mesh)
    assert cubic_mm(part) == pytest.approx(np.count_nonzero(inside.any(axis=-1)), rel=1e-9)


def test_the_same_union_is_made_every_time():
    mesh = both(BOLT, trimesh.creation.icosphere(3, radius=5))
    assert len({part_of(mesh).part_sha256 for _ in range(3)}) == 1


TWO = both(box(SMALL, (60, 0, 0)), box())


@pytest.mark.parametrize(
    ('mesh', 'expected'),
    [
        (both(tube(), box((8, 8, 8))), '2 bodies that do not touch'),  # a peg in a hole
        (
            both(box(), inverted(box((16, 16, 16))), box((2, 2, 2))),  # a body in a cavity
            '2 bodies that do not touch each other (1: 40 x 30 x 20 mm, 2: 2 x 2 x 2 mm)',
        ),
        (both(box(), box(SMALL, (25.01, 0, 0))), '2 bodies that do not touch'),
    ],
)
def test_separate_bodies_are_rejected_with_instructions(mesh, expected):
    message = refusal(mesh, **ALL)
    assert expected in message
    assert 'choose one with --body, or with "body" in the YAML file' in message


def test_a_chosen_body_is_the_part_that_it_would_be_alone():
    for number, alone in ((1, box()), (2, box(SMALL, (60, 0, 0)))):
        chosen, part = part_of(TWO, body=number), part_of(alone)
        assert (chosen.body, chosen.warnings) == (number, ())
        for name in ('vertices', 'faces', 'hull_vertices', 'centre_of_mass', 'inertia'):
            one, other = getattr(chosen, name), getattr(part, name)
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-18)
    united = part_of(both(BOLT, box((1, 1, 1), (30, 0, 0))), body=1)
    assert 'they were united' in united.warnings[0]
    assert cubic_mm(united) == pytest.approx(cubic_mm(part_of(BOLT)))


def test_body_number_does_not_depend_on_file_order():
    boxes = [box((k, 5, 5), (0, 8 * k, 0)) for k in (4, 5, 5, 6)]
    generator = np.random.default_rng(1)
    found = {
        tuple(part_of(both(*(boxes[k] for k in order)), body=2).centre_of_mass.tolist())
        for order in (generator.permutation(4) for _ in range(6))
    }
    assert len(found) == 1


def test_part_sha256_depends_on_the_body():
    around = both(*(trimesh.creation.annulus(r, r + 5, 30, sections=32) for r in (5, 20)))
    one, other = (part_of(around, body=number, **ALL) for number in (1, 2))
    assert one.part_sha256 != other.part_sha256
    # The only body of a mesh is the mesh.
    assert part_of(box(), body=1).part_sha256 == part_of(box()).part_sha256


@pytest.mark.parametrize('body', [0, 3, True, 'x', 10**400])
def test_invalid_body_number_is_rejected(body):
    message = refusal(TWO, body=body)
    assert message.startswith('invalid body ')
    assert message.endswith("of part 'bracket': expected 1 to 2")


def test_error_without_manifold3d_explains_installation(monkeypatch):
    monkeypatch.setitem(sys.modules, 'manifold3d', None)
    assert 'pip install manifold3d' in refusal(BOLT)
    assert cubic_mm(part_of(box())) == pytest.approx(24000)  # is not needed for one body


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
    part = part_of(mesh, body=1)
    assert cubic_mm(part) == pytest.approx(ring.volume)
    assert f'{1 + inside} bodies that overlap' in part.warnings[0]


@pytest.mark.parametrize(('apart', 'expected'), [
    (3.0, 'has 343 bodies that do not touch'),
    (0.9, 'pairs may touch: expected at most 2000; unite them'),
])  # fmt: skip
def test_hundreds_of_bodies_are_compared_where_boxes_meet(apart, expected):
    places = np.stack(np.meshgrid(*[np.arange(7)] * 3), axis=-1).reshape(-1, 3) * apart
    mesh = both(*(box((1, 1, 1), place) for place in places))
    assert expected in refusal(mesh)

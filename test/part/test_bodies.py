"""Meshes of several bodies: those that touch are one part, of others one is chosen."""

import sys

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.part.loading import part_from_bytes

BOX = (40.0, 30.0, 20.0)


def box(sides=BOX, at=(0.0, 0.0, 0.0)):
    """A box with its middle somewhere."""
    mesh = trimesh.creation.box(sides)
    mesh.apply_translation(at)
    return mesh


def both(*meshes):
    return trimesh.util.concatenate(meshes)


def inverted(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def tube(sections=32):
    return trimesh.creation.annulus(r_min=10, r_max=20, height=30, sections=sections)


def part_of(mesh, **given):
    data = mesh.export(file_type='ply', vertex_normal=False)
    return part_from_bytes(data, 'ply', 'bracket', unit='mm', **given)


def cubic_mm(part):
    return part.volume * 1e9


def refusal(mesh, **given):
    with pytest.raises((PartError, InvalidValueError)) as caught:
        part_of(mesh, **given)
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
    part = part_of(both(head, shank))
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
    part = part_of(mesh)
    assert cubic_mm(part) == pytest.approx(np.count_nonzero(inside.any(axis=-1)), rel=1e-9)


def test_the_same_union_is_made_every_time():
    mesh = both(*bolt(1.3, 0.1), trimesh.creation.icosphere(3, radius=5))
    assert len({part_of(mesh).part_sha256 for _ in range(3)}) == 1


def test_bodies_may_touch_at_an_edge_or_share_a_side():
    """At an edge of both four triangles meet; a shared side is there twice, and cancels."""
    assert cubic_mm(part_of(both(box(), box(at=(40, 30, 0))))) == pytest.approx(48000)
    shared = part_of(both(box(), box(at=(40, 0, 0))))
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
    part = part_of(both(box(), other))
    assert cubic_mm(part) == pytest.approx(24000 + volume, rel=1e-6)
    (warning,) = part.warnings
    assert 'has 2 bodies that touch each other and are treated as one part' in warning


def test_bodies_that_touch_are_not_inside_each_other():
    """The four sides of a short square bar lie on those of the square hole around it."""
    bar = box((10 * np.sqrt(2), 10 * np.sqrt(2), 20))
    bar.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (0, 0, 1)))
    part = part_of(both(tube(4), bar))
    assert cubic_mm(part) == pytest.approx(tube(4).volume + bar.volume, rel=1e-6)


def test_a_body_inside_a_solid_counts_once():
    part = part_of(both(box(), box((10, 10, 10))))
    assert cubic_mm(part) == pytest.approx(24000)
    (warning,) = part.warnings
    assert 'changed the volume by -4 %. A body inside another one is a cavity only if' in warning


def test_a_cavity_stays_one_beside_bodies_that_are_united():
    cavity = inverted(box((10, 10, 10), (-5, 0, 0)))
    part = part_of(both(cavity, box(), box((20, 20, 10), (20, 0, 0))))
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
    assert 'choose one with --body N, or with "body: N" in the YAML file' in message
    assert message.isprintable()
    with pytest.raises(PartError):  # also with a given mass, it is not a rigid part
        part_of(mesh, mass=1, centre_of_mass=(0, 0, 0.001), inertia=[1e-4, 0, 0, 1e-4, 0, 1e-4])


def test_a_chosen_body_is_the_part_that_it_would_be_alone():
    for number, alone in ((1, box()), (2, box((10, 10, 10), (60, 0, 0)))):
        chosen, part = part_of(TWO, body=number), part_of(alone)
        assert (chosen.body, chosen.warnings) == (number, ())
        for name in ('vertices', 'faces', 'hull_vertices', 'centre_of_mass', 'inertia'):
            np.testing.assert_allclose(
                getattr(chosen, name), getattr(part, name), rtol=1e-12, atol=1e-20
            )
    united = part_of(both(*bolt(), box((1, 1, 1), (30, 0, 0))), body=1)
    assert 'they were united' in united.warnings[0]
    assert cubic_mm(united) == pytest.approx(cubic_mm(part_of(both(*bolt()))))


def test_body_number_does_not_depend_on_file_order():
    boxes = [box((k, 5, 5), (0, 8 * k, 0)) for k in (4, 5, 5, 6)]
    generator = np.random.default_rng(1)
    found = {
        tuple(part_of(both(*(boxes[k] for k in order)), body=2).centre_of_mass.tolist())
        for order in (generator.permutation(4) for _ in range(6))
    }
    assert len(found) == 1


def test_part_sha256_depends_on_the_body():
    given = {'mass': 1, 'centre_of_mass': (0, 0, 0), 'inertia': [1e-4, 0, 0, 1e-4, 0, 1e-4]}
    around = both(*(trimesh.creation.annulus(r, r + 5, 30, sections=32) for r in (5, 20, 30)))
    parts = [part_of(around, body=number, **given) for number in (1, 2, 3)]
    assert len({part.part_sha256 for part in parts}) == 3
    # The only body of a mesh is the mesh.
    assert part_of(box(), body=1).part_sha256 == part_of(box()).part_sha256


@pytest.mark.parametrize('body', [0, 3, -1, True, 1.0, 'x', 10**400, [1]])
def test_invalid_body_number_is_rejected(body):
    message = refusal(TWO, body=body)
    assert message.startswith('invalid body ')
    assert message.endswith("of part 'bracket': expected 1 to 2")
    assert len(message) < 200


def test_no_body_of_an_open_mesh_can_be_chosen():
    opened = trimesh.Trimesh(box().vertices, box().faces[1:], process=False)
    assert '3 open edges: no body of it can be chosen' in refusal(opened, body=1)


def test_error_without_manifold3d_explains_installation(monkeypatch):
    monkeypatch.setitem(sys.modules, 'manifold3d', None)
    assert 'manifold3d' in refusal(both(*bolt()))
    assert 'pip install manifold3d' in refusal(both(*bolt()))
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


def test_a_mesh_of_thousands_of_bodies_is_read():
    """Each is in no other's box, so none is compared with all others."""
    boxes = np.stack(np.meshgrid(*[np.arange(17)] * 3), axis=-1).reshape(-1, 3) * 3
    one = box((2, 2, 2))
    vertices = (boxes[:, None] + one.vertices).reshape(-1, 3)
    faces = (len(one.vertices) * np.arange(len(boxes))[:, None, None] + one.faces).reshape(-1, 3)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert 'has 4913 bodies that do not touch' in refusal(mesh)
    assert cubic_mm(part_of(mesh, body=4913)) == pytest.approx(8)


def test_too_many_bodies_that_may_touch_are_refused():
    small = [
        box((1, 1, 1), at)
        for at in np.stack(np.meshgrid(*[np.arange(14)] * 3), -1).reshape(-1, 3) * 0.9
    ]
    assert 'pairs may touch: expected at most 2000; unite them' in refusal(both(*small))

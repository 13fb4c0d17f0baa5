"""Aspects of parts, held to symmetry, to what was measured, and to what must not matter."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from solids import a_turn, box, icosphere, irregular, tetrahedron, turned

from resting_aspects_ros.aspects.aspect_set import POSE_ANGLE
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import STABLE_MARGIN, Landscape
from resting_aspects_ros.rotations import down_in_part, random_orientations, rotate


def mesh_of(part):
    """The part as a mesh in mm."""
    return trimesh.Trimesh(part.vertices * 1e3, part.faces, process=False)


def downs(aspects):
    return np.array([a.down_in_part for a in aspects])


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('mesh', 'faces'), [(tetrahedron(), 4), (box(9, 9, 9), 6), (icosphere(0), 20)]
)
def test_platonic_solids_have_one_aspect_for_each_face(solid, mesh, faces):
    aspects = find_aspects(solid(turned(mesh, a_turn(1))))
    assert len(aspects) == faces
    share = [a.basin_share for a in aspects]
    np.testing.assert_allclose(share, 1 / faces, rtol=1e-5)  # float32 in the file


def test_aspects_of_the_example_parts(part):
    expected = {'tetrahedron': 4, 'box_10x20x30': 6, 'hex_nut': 6 + 2, 'l_bracket': 5}
    expected['u_bracket'] = 6  # its hull is a box
    expected |= {'cylinder_d20_h20': 3, 'washer': 3}  # two flat sides, and a curved one
    assert {name: len(find_aspects(part(name))) for name in expected} == expected


@pytest.mark.parametrize('ending', ['stl', 'stl_ascii', 'obj', 'ply'])
def test_l_bracket_has_five_aspects_in_any_file(part, solid, ending):
    turn = a_turn(len(ending))
    aspects = find_aspects(solid(turned(mesh_of(part('l_bracket')), turn, (100, -50, 7)), ending))
    assert len(aspects) == 5
    # The centre of mass is over the edge of the long leg's end face: that one is unstable.
    directions = downs(aspects) @ turn
    assert (directions @ [1, 0, 0]).max() < 0.6
    expected = {(0, 0, 1), (0, 0, -1), (0, -1, 0), (-1, 0, 0)}
    found = {tuple(np.round(d).astype(int) + 0) for d in directions}
    assert expected <= found
    # The fifth is on the two leg tips: the line between them rises 20 over 30.
    tips = np.array([2, 3, 0]) / np.sqrt(13)
    assert (directions @ tips).max() == pytest.approx(1, abs=1e-9)


def test_aspects_are_numbered_by_height_then_share_then_direction(part):
    for name in ('l_bracket', 'angle_45x30x8', 't_prism', 'u_bracket', 'box_10x20x30', 'washer'):
        shape = part(name)
        aspects = find_aspects(shape).aspects
        assert [a.id for a in aspects] == list(range(1, len(aspects) + 1))
        step = 1e-3
        for low, high in pairwise(aspects):
            rise = (high.com_height - low.com_height) / shape.hull_radius
            assert rise >= -step
            share = low.basin_share - high.basin_share
            if rise <= step:
                assert share >= -step
            # In the intrinsic frame, of aspects that are alike otherwise.
            along = (low.down_in_part - high.down_in_part) @ shape.principal_axes
            if rise <= step and share <= step and not low.sweep.curved:
                assert along[np.abs(along) > step][0] > 0


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', ['angle_45x30x8', 'u_bracket', None])
def test_ids_do_not_depend_on_how_a_part_is_meshed(part, solid, name):
    mesh = irregular(3) if name is None else mesh_of(part(name))
    order = np.random.default_rng(1).permutation(len(mesh.faces))
    shuffled = trimesh.Trimesh(mesh.vertices, np.roll(mesh.faces[order], 1, axis=1))
    plain = downs(find_aspects(solid(mesh)))
    for other in (mesh.subdivide(), mesh.subdivide().subdivide(), shuffled):
        np.testing.assert_allclose(downs(find_aspects(solid(other))), plain, atol=1e-5)


def tipping_box(solid, inside):
    """A box with its centre of mass near the face +x: it is near an edge of four of the others."""
    corner = np.array([5.0, 10.0, 15.0])
    centre = np.array([corner[0] - inside, 0, 0])
    return solid(trimesh.creation.box(2 * corner), 'obj', centre_of_mass=centre * 1e-3)


@pytest.mark.parametrize(('share', 'minima'), [(1.01, 6), (0.99, 2)])
def test_facet_is_stable_beyond_the_margin(solid, share, minima):
    radius = np.linalg.norm([10, 10, 15])  # to the far corners; the margin is 1e-4 of it
    landscape = Landscape(tipping_box(solid, share * STABLE_MARGIN * radius))
    assert len(landscape.minima) == minima


@pytest.mark.parametrize(('inside', 'aspects'), [(0.7, 6), (0.5, 4), (0.4, 2)])
def test_barrier_below_noise_does_not_separate_aspects(solid, inside, aspects):
    # Over the edge the centre of mass rises by sqrt(h^2 + inside^2) - h, for h = 10 and 15; noise
    # is up to 1e-3 h: 0.45 to the one side, 0.67 to the other.
    found = find_aspects(tipping_box(solid, inside))
    assert len(found) == aspects
    assert abs(np.abs(downs(found)[:, 0]).sum() - 2) < 1e-12  # on +x and -x in any case


def test_orientation_of_each_aspect_is_in_the_aspect(part):
    shape = part('angle_45x30x8')
    for aspect in find_aspects(shape).aspects:
        np.testing.assert_allclose(
            down_in_part(aspect.orientation), aspect.down_in_part, atol=1e-12
        )
        hull = rotate(aspect.orientation, shape.hull_vertices - shape.centre_of_mass)
        assert -hull[:, 2].min() == pytest.approx(aspect.com_height)
        # The support is what touches the surface, and the centre of mass is over its inside.
        touching = hull[hull[:, 2] < hull[:, 2].min() + 1e-9, :2]
        assert len(aspect.support) == len(touching)
        apart = np.linalg.norm(touching[:, None] - aspect.support[None], axis=2)
        assert apart.min(axis=1).max() < 1e-12
        x, y = aspect.support.T
        assert (x * np.roll(y, -1) - y * np.roll(x, -1) != 0).all()


def test_classify_agrees_with_exhaustive_search(part):
    aspects = find_aspects(part('l_bracket'))
    poses = random_orientations(np.random.default_rng(2), 120_000)  # more than are found at once
    angle = np.arccos(np.clip(down_in_part(poses) @ downs(aspects).T, -1, 1))
    expected = np.where(angle.min(axis=1) <= POSE_ANGLE, angle.argmin(axis=1) + 1, 0)
    np.testing.assert_array_equal(aspects.classify(poses), expected)
    assert aspects.classify(poses[:0]).shape == (0,)


INVARIANT = [
    ('irregular', (4,)),
    # With three steps a fillet has a minimum halfway, which falls to one side.
    ('rounded_prism', (8, 9, 1.5, 3)),
    ('revolved', (((10, 0), (0, 20)), 32)),
    ('blocks', (5,)),
    # Two moments of inertia are equal.
    ('ratchet', (12,)),
    ('disphenoid', ()),
]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('name', 'arguments'), INVARIANT)
def test_aspects_do_not_depend_on_the_frame_or_scale_of_the_mesh(solids, solid, name, arguments):
    """The same aspects in the same order, turned, up to the symmetry of the part."""
    mesh = getattr(solids, name)(*arguments)
    turn = solids.a_turn(7)
    expected = find_aspects(solid(mesh))
    found = find_aspects(solid(turned(mesh, turn, (1000, -300, 200)), unit='um'))
    assert len(found) == len(expected)
    for a, b in zip(expected.aspects, found.aspects, strict=True):
        # Noise of float32 at 1000 is 6e-5, of 10 it is 6e-6; shares change by a few times as much.
        assert b.com_height == pytest.approx(1e-3 * a.com_height, rel=1e-3)
        assert b.basin_share == pytest.approx(a.basin_share, abs=1e-3)
        assert (b.symmetry_class, b.multiplicity) == (a.symmetry_class, a.multiplicity)
        assert (b.sweep, b.rolls) == (a.sweep, a.rolls)
        # Aspects of one class may change places; a symmetry takes one to the other.
        ids, angles = found.locate(found.symmetry.rotations @ (turn @ a.down_in_part))
        assert b.id in ids[angles <= POSE_ANGLE]
    assert sum(a.basin_share for a in expected) == pytest.approx(1, abs=1e-9)
    for alike in expected.classes():
        assert {a.multiplicity for a in alike} == {len(alike)}
        assert len({a.basin_share for a in alike}) == 1


def test_barrier_of_a_box_is_over_its_nearest_edge(solid):
    half = {0: 5e-3, 1: 10e-3, 2: 15e-3}
    aspects = find_aspects(solid(trimesh.creation.box((10, 20, 30))))
    for aspect in aspects:
        axis = int(np.abs(aspect.down_in_part).argmax())
        rises = {k: np.hypot(h, half[axis]) - half[axis] for k, h in half.items() if k != axis}
        nearest = min(rises, key=rises.get)
        assert aspect.min_barrier == pytest.approx(rises[nearest], rel=1e-5)  # float32
        over = aspects[aspect.neighbour - 1].down_in_part
        assert int(np.abs(over).argmax()) == nearest


def test_of_equal_barriers_the_neighbour_with_the_lowest_id_is_named(solids, solid):
    box = solids.turned(trimesh.creation.box((10, 20, 30)), solids.a_turn(1))
    found = find_aspects(solid(box)).aspects
    assert [aspect.neighbour for aspect in found] == [3, 3, 1, 1, 1, 1]


def test_binom3_rests_on_the_four_published_faces(solids, solid):
    # Baktash et al. 2025. Unstable facets lie 0.3 and 0.7 degrees from the stable ones.
    aspects = find_aspects(solid(solids.binom3()))
    published = [(0.910, y, -0.004) for y in (0.415, -0.415)]
    published += [(-0.347, y, -0.006) for y in (0.938, -0.938)]
    assert len(aspects) == 4
    apart = np.linalg.norm(np.array(published)[:, None] - downs(aspects)[None], axis=2)
    assert apart.min(axis=1).max() < 9e-4  # three digits of three coordinates


def test_ignored_barrier_of_a_round_side_is_that_of_its_flats(solids, solid):
    n = 16
    for aspect in find_aspects(solid(solids.prism(n, 10.0, 20.0))).aspects:
        expected = 10e-3 * (1 - np.cos(np.pi / n)) if aspect.rolls else 0
        assert aspect.merged == pytest.approx(expected, rel=1e-4, abs=1e-12)

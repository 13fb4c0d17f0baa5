"""Orientations at a wall, against closed forms and pushing by brute force."""

import math

import numpy as np
import pytest
import shapely
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.rotations import product, rotate, turned_about_vertical
from resting_aspects_ros.simulation.surroundings_kinds import tray_from_scene
from resting_aspects_ros.tracks.orientations import PushedOutline, orientations_on


def rectangle(a, b):
    return np.array([(-a / 2, -b / 2), (a / 2, -b / 2), (a / 2, b / 2), (-a / 2, b / 2)])


@pytest.mark.parametrize(('a', 'b'), [(20, 10), (30, 20), (40, 10)])
def test_shares_of_a_rectangle(a, b):
    yaws = PushedOutline(rectangle(a, b)).yaws()
    assert sum(yaw.share for yaw in yaws) == pytest.approx(1)
    share = sum(yaw.share for yaw in yaws if yaw.length == pytest.approx(a))
    assert share == pytest.approx(2 / math.pi * math.atan(a / b))


def pushed(corners, direction, tilt):
    """The edge at the wall after pushing in small steps, by the sign of the moment."""
    step = 1e-3
    for _ in range(20_000):
        along = corners @ [math.cos(direction), math.sin(direction)]
        first, second = np.argsort(-along)[:2]
        size = np.linalg.norm(corners[first] - corners[second])
        if along[first] - along[second] < 1.5 * step * size:
            # Both ends of an edge touch: it is stable if its ends turn towards each other.
            moments = [_moment(corners[k], direction, tilt) for k in (first, second)]
            edge = corners[first] - corners[second]
            if moments[0] * moments[1] < 0:
                return math.atan2(-edge[0], edge[1]) % math.pi
        direction += step * np.sign(_moment(corners[first], direction, tilt))
    return math.nan


def _moment(corner, direction, tilt):
    """Positive if the wall turns towards larger directions, in axes of the part."""
    return math.sin(direction + tilt - math.atan2(corner[1], corner[0]))


@pytest.mark.parametrize(('seed', 'tilt'), [(0, 0.0), (1, 0.15), (2, -0.15), (3, 0.15)])
def test_basins_are_those_of_pushing(seed, tilt):
    random = np.random.default_rng(seed)
    points = random.standard_normal((7, 2)) * [2, 1]
    hull = shapely.MultiPoint(points).convex_hull
    corners = np.array(hull.exterior.coords)[:-1] - np.array(hull.centroid.coords[0])
    outline = PushedOutline(corners)
    starts, edges = outline._basins(tilt)
    for direction in random.uniform(0, 2 * np.pi, 12):
        if np.abs(np.angle(np.exp(1j * (starts - direction)))).min(initial=1) < 0.01:
            continue
        k = edges[np.searchsorted(starts, direction % (2 * np.pi), side='right') - 1]
        found = pushed(outline.corners, direction, tilt)
        assert abs(np.angle(np.exp(2j * (outline.normal[k] - found)))) < 0.02


def test_friction_of_the_wall_widens_the_bounds():
    yaws = PushedOutline(rectangle(30, 20)).yaws(0.2)
    turn = math.atan(0.2) / (2 * math.pi)
    for yaw in yaws:
        assert yaw.low == pytest.approx(yaw.share - 2 * turn, abs=1e-3)
        assert yaw.high == pytest.approx(yaw.share + 2 * turn, abs=1e-3)


@pytest.mark.slow
def test_pushes_in_the_engine_are_within_the_bounds(box):
    # A box of 30 x 20 mm slides along a wall, from uniform yaws.
    part, flat = box
    number, friction, (roll, pitch) = 60, 0.2, np.radians([10.0, 10.0])
    starts = (np.arange(number) + 0.5) / number * np.pi
    turned = np.array([turned_about_vertical(flat.orientation, each) for each in starts])
    around = flat.corners - [0.0, flat.yaw.distance, flat.com_height]
    y = [5e-4 - (around[:, :2] @ [math.sin(each), math.cos(each)]).min() for each in starts]
    places = np.stack([0 * starts, y, np.full(number, flat.com_height + 2e-5)], axis=1)
    turn = np.tile(tray_from_scene(roll, pitch), (number, 1))
    found = ra.drop(
        part,
        initial_states=ra.GivenStates(rotate(turn, places), product(turn, turned)),
        surroundings=ra.surroundings(
            'chute',
            roll=float(roll),
            pitch=float(pitch),
            belt={'friction': 0.02, 'speed': 0.0, 'restitution': 0.0},
            wall={'friction': friction, 'restitution': 0.0},
        ),
        rolling_friction=0.0,
        workers=1,
    )
    ends = product(turn * [-1, -1, -1, 1], found.poses.orientation)
    along = rotate(ends, np.tile(part.principal_axes[:, 0], (number, 1)))
    long_side = next(
        yaw for yaw in PushedOutline(around[:, :2]).yaws(friction, 2) if yaw.length > 0.029
    )
    share = float((np.abs(along[:, 0]) > 0.99).mean())
    assert long_side.low - 0.02 < share < long_side.high + 0.02


def test_a_box_has_a_row_for_each_side_and_edge(part, rows_of):
    found = rows_of(part('box_10x20x30'))
    assert len(found) == 6
    by_size = {(round(1e3 * r.height), round(1e3 * r.length)): r.probability for r in found}
    assert by_size[10, 30] == pytest.approx(2 / 6 * 2 / math.pi * math.atan(30 / 20))
    assert by_size[10, 20] == pytest.approx(2 / 6 * 2 / math.pi * math.atan(20 / 30))


def test_rows_do_not_depend_on_the_frame_of_the_mesh(part, solid, rows_of):
    bracket = part('u_bracket')
    mesh = trimesh.Trimesh(1000 * bracket.vertices, bracket.faces)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(np.array([0.1, 0.5, 0.7])))
    one, other = rows_of(bracket), rows_of(solid(mesh))
    assert [r.probability for r in other] == pytest.approx([r.probability for r in one], abs=1e-5)
    assert [r.height for r in other] == pytest.approx([r.height for r in one], abs=1e-5)


def test_a_standing_cylinder_is_one_row(part, rows_of):
    found = [row for row in rows_of(part('cylinder_d20_h20'), math.inf, 0.2) if not row.rolls]
    assert len(found) == 1
    # At every force of the wall, also those at which it rolls along the wall.
    assert found[0].low == pytest.approx(found[0].probability) == pytest.approx(found[0].high)


def test_a_low_wall_touches_only_what_is_below_its_top(solid, rows_of):
    # A T that stands on its foot: the bar overhangs a foot of 10 mm on both sides.
    foot = trimesh.creation.box((20, 10, 20))
    bar = trimesh.creation.box((20, 30, 10)).apply_translation((0, 0, 15))
    part = solid(trimesh.boolean.union([foot, bar]))
    high, low = (
        [
            row
            for row in rows_of(part, wall)
            if row.contact.area == pytest.approx(0.02 * 0.01, rel=1e-3) and row.height > 0.029
        ]
        for wall in (math.inf, 0.005)
    )
    assert {round(2e3 * row.yaw.distance) for row in low} == {10, 20}
    assert {round(2e3 * row.yaw.distance) for row in high} == {20, 30}


def test_model_range_contains_all_shares_of_aspects_and_frictions(solid):
    part, friction = solid(trimesh.creation.box((30, 20, 10))), 0.3
    aspects, rng = find_aspects(part), np.random.default_rng(1)
    model = np.sort(rng.uniform(0, 1 / len(aspects), (len(aspects), 2)), axis=1)
    nominal = orientations_on(part, aspects, model.mean(axis=1), np.inf, friction, model)
    for _ in range(8):
        shares = rng.uniform(*model.T).tolist()
        rows = orientations_on(part, aspects, shares, np.inf, rng.uniform(0, friction))
        found = {(row.aspects, round(row.length, 6)): row for row in rows}
        for row in nominal:
            other = found[row.aspects, round(row.length, 6)]
            assert row.model[0] - 1e-9 <= other.low <= other.high <= row.model[1] + 1e-9


def test_numbers_of_rows_do_not_depend_on_the_shares(part):
    bracket = part('l_bracket')
    aspects = find_aspects(bracket)
    rows = [
        [(row.aspects, row.yaw.angle) for row in orientations_on(bracket, aspects, shares)]
        for shares in ([0.2] * 5, [0.1, 0.3, 0.3, 0.2, 0.1], [0.0, 0.0, 0.0, 0.0, 1.0])
    ]
    assert rows[0] == rows[1] == rows[2]

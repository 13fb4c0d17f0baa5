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


def pushed(corners, direction, tilt):
    """The direction of the wall after pushing in small steps, by the sign of the moment.

    At a stable edge, its two ends turn the wall to and fro.
    """
    for _ in range(4000):
        corner = corners[np.argmax(corners @ [math.cos(direction), math.sin(direction)])]
        moment = math.sin(direction + tilt - math.atan2(corner[1], corner[0]))
        direction += math.copysign(2e-3, moment)
    return direction


@pytest.mark.parametrize(('seed', 'tilt'), [(0, 0.0), (1, 0.15), (2, -0.15)])
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
        assert abs(np.angle(np.exp(1j * (outline.normal[k] - found)))) < 0.01


@pytest.mark.slow
def test_pushes_in_the_engine_are_within_the_bounds(box, rows_of):
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
    share = (np.abs(along[:, 0]) > 0.99).mean()
    (row,) = (
        r
        for r in rows_of(part, math.inf, friction)
        if r.aspects == flat.aspects and r.length > 0.029
    )
    assert row.yaw.low - 0.02 < share < row.yaw.high + 0.02


def test_shares_of_the_sides_of_a_box(part, rows_of):
    sizes, friction = {10, 20, 30}, 0.2
    found = rows_of(part('box_10x20x30'), math.inf, friction)
    assert len(found) == 6
    # Friction moves both ends of the basins of two equal sides.
    shift = 2 / 6 * 4 * math.atan(friction) / (2 * math.pi)
    for row in found:
        height, along = round(1e3 * row.height), round(1e3 * row.length)
        (across,) = sizes - {height, along}
        share = 2 / 6 * 2 / math.pi * math.atan(along / across)
        assert row.probability == pytest.approx(share)
        assert (row.low, row.high) == pytest.approx((share - shift, share + shift), abs=1e-3)


def test_rows_do_not_depend_on_the_frame_of_the_mesh(part, solid, rows_of):
    bracket = part('u_bracket')
    mesh = trimesh.Trimesh(1000 * bracket.vertices, bracket.faces)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(np.array([0.1, 0.5, 0.7])))
    one, other = rows_of(bracket), rows_of(solid(mesh))
    for name in ('probability', 'height'):
        values = [getattr(row, name) for row in one]
        assert [getattr(row, name) for row in other] == pytest.approx(values, abs=1e-5)


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
    for wall, distances in ((math.inf, {20, 30}), (0.005, {10, 20})):
        rows = [row for row in rows_of(part, wall) if row.height > 0.029]
        upright = [r for r in rows if r.contact.area == pytest.approx(0.02 * 0.01, rel=1e-3)]
        assert {round(2e3 * row.yaw.distance) for row in upright} == distances


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

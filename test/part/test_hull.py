"""The smallest rectangle around points, against triangles and rectangles of known sides."""

import numpy as np
import pytest

from resting_aspects_ros.part.hull import smallest_rectangle

# Corners, and the sides of the smallest rectangle with the shortest perimeter. All rectangles
# along the sides of a triangle without an obtuse angle have twice its area.
SHAPES = {
    'right triangle': ([(0, 0), (30, 0), (0, 20)], (30, 20)),
    'acute triangle': ([(0, 0), (14, 0), (5, 12)], (13, 168 / 13)),
    'obtuse triangle': ([(0, 0), (20, 0), (30, 5)], (np.hypot(30, 5), 100 / np.hypot(30, 5))),
    'rectangle': ([(0, 0), (12, 0), (12, 30), (0, 30)], (30, 12)),
    'square': ([(0, 0), (7, 0), (7, 7), (0, 7)], (7, 7)),
}


@pytest.mark.parametrize('name', SHAPES)
def test_smallest_rectangle_does_not_depend_on_rounding(name):
    points, expected = SHAPES[name]
    generator = np.random.default_rng(3)
    found = []
    for _ in range(50):
        noise = generator.uniform(-1e-6, 1e-6, (len(points), 2))  # below float32 of 30
        order = generator.permutation(len(points))
        middle, sides = smallest_rectangle((np.array(points) + noise)[order])
        np.testing.assert_allclose(np.linalg.norm(sides, axis=1), expected, atol=1e-5)
        assert abs(sides[0] @ sides[1]) < 1e-9
        long = np.exp(2j * np.arctan2(sides[0][1], sides[0][0]))  # opposite directions are equal
        found.append([*middle, long.real, long.imag])
    np.testing.assert_allclose(found, np.tile(found[0], (50, 1)), atol=1e-5)


def test_no_rectangle_of_any_direction_is_smaller():
    generator = np.random.default_rng(4)
    angles = np.linspace(0, np.pi, 2000)
    across = np.stack([np.cos(angles), np.sin(angles)])
    for number in (3, 4, 5, 9, 40):
        points = generator.standard_normal((number, 2))
        middle, sides = smallest_rectangle(points)
        area = np.linalg.norm(sides, axis=1).prod()
        others = np.ptp(points @ across, axis=0) * np.ptp(
            points @ np.stack([-across[1], across[0]]), axis=0
        )
        assert area <= others.min() * (1 + 1e-5)
        units = sides / np.linalg.norm(sides, axis=1)[:, None]
        inside = np.abs((points - middle) @ units.T) <= np.linalg.norm(sides, axis=1) / 2 + 1e-9
        assert inside.all()

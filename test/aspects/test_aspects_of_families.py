"""The aspects of convex parts of many families are those of an independent landscape."""

import numpy as np
import pytest
import trimesh
from fuzz import aspects as fuzz_aspects
from fuzz import part_families
from solids import hull

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.rotations import orientation_with_down


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('seed', 'numbers'),
    [
        (101, [41]),
        # The others were wrong once, too.
        *[(101, [195]), (301, [505]), (302, [827]), (302, [869])],
        (14, range(len(part_families.FAMILIES))),
    ],
    ids=['11', '14', 'spiral', 'cut_corner', 'simplified_64', 'one of each family'],
)
def test_random_parts_have_the_aspects_of_the_landscape(seed, numbers):
    assert list(fuzz_aspects.findings(numbers, seed)) == []


@pytest.mark.slow
def test_a_pose_between_a_flat_and_the_round_side_of_a_ball_is_in_no_aspect(solid):
    """Four flats, as on a tetrahedron; the round side has directions all around."""
    points = part_families.ball(30, 'ico', np.random.default_rng(1))
    corners = np.array([(1, 1, 1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1)]) / np.sqrt(3)
    for normal in corners:
        turn = trimesh.geometry.align_vectors(normal, [0, 0, -1])[:3, :3]
        points = part_families.cut(points @ turn.T, -0.85) @ turn
    aspects = find_aspects(solid(hull(10 * points)))
    assert [a.sweep.name for a in aspects] == [*4 * ['POINT'], 'SPHERE']
    side = np.cross(corners[0], [0.3, 0.5, -0.8])
    tilts = np.radians([0, 10, 20, 25, 40])[:, None]
    down = np.cos(tilts) * corners[0] + np.sin(tilts) * side / np.linalg.norm(side)
    ids = aspects.classify(np.array([orientation_with_down(d) for d in down]))
    assert ids[0] in {1, 2, 3, 4}
    assert ids.tolist()[1:] == [0, 0, 0, 5]


@pytest.mark.slow
def test_the_round_side_between_two_flats_of_a_shaft_is_an_arc(solid):
    outline = part_families.circle(24)
    for axis in (0, 1):
        outline = outline[outline[:, axis] < 0.97]
    half = np.sqrt(1 - 0.97**2)
    cuts = [(0.97, half), (0.97, -half), (half, 0.97), (-half, 0.97)]
    outline = np.concatenate([outline, cuts])
    part = solid(hull(10 * part_families.extruded(outline, 3.0)))
    curved = [a for a in find_aspects(part).aspects if a.sweep.curved]
    assert [a.sweep.name for a in curved] == ['ARC', 'ARC']
    assert [abs(a.axis[2]) for a in curved] == pytest.approx([1, 1], abs=1e-6)

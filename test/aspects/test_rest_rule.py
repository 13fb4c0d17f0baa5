"""The energies below which the aspect of a moving part is decided."""

import math

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.aspects.find import join_minima
from resting_aspects_ros.aspects.landscape import ENERGY_MARGIN, Landscape, RestRule


@pytest.fixture
def rule_of(solid):
    """Give the rule of a mesh, in mm, and the hull radius, mm."""

    def rule_of(mesh):
        part = solid(mesh)
        landscape = Landscape(part)
        return RestRule(landscape, join_minima(landscape)), part.hull_radius * 1e3

    return rule_of


def decided_sides(rule, down, energy):
    """The directions of the minima that are decided; NaN while open."""
    minima = rule.decided(np.array([down], dtype=float), np.array([energy]))
    return rule.directions[minima[0]] if minima[0] >= 0 else np.full(3, np.nan)


def test_box_is_decided_below_its_lowest_edge(rule_of):
    # On edge, a box a x b x c has its centre of mass at half the diagonal of two of its sides. The
    # lowest way from either of its two largest sides is over the long edge.
    rule, radius = rule_of(trimesh.creation.box((10, 20, 30)))
    edge = math.hypot(10, 20) / 2 / radius
    down = np.array([0.9, 0.3, 0.3]) / np.linalg.norm([0.9, 0.3, 0.3])
    below, above = edge - 1.001 * ENERGY_MARGIN, edge - 0.999 * ENERGY_MARGIN
    np.testing.assert_allclose(decided_sides(rule, down, below), [1, 0, 0], atol=1e-9)
    assert np.isnan(decided_sides(rule, down, above)).all()
    # The smallest sides are left over the edges to the largest ones first.
    high = math.hypot(10, 30) / 2 / radius
    assert rule.highest == pytest.approx(high - ENERGY_MARGIN)


def test_rolling_cylinder_is_decided_below_its_rim(rule_of):
    rule, radius = rule_of(trimesh.creation.cylinder(10, 20, sections=64))
    # Any amount of rolling leads over no saddle but those between the flats of its side.
    generator = np.random.default_rng(1)
    angle = generator.uniform(0, 2 * np.pi, 50)
    down = np.stack([np.cos(angle), np.sin(angle), np.zeros(50)], axis=1)
    rim = math.hypot(10, 10) / radius
    minima = rule.decided(down, np.full(50, rim - 0.03))
    assert (minima >= 0).all()
    reach = (rule.directions[minima] * down).sum(axis=1)
    assert (reach > np.cos(np.pi / 64) - 1e-9).all()


def test_barely_stable_side_is_not_decided_by_energy(rule_of):
    # A washer on its rim: 0.005 R and it falls flat, which an impact's error could do.
    rule, _ = rule_of(trimesh.creation.annulus(4.2, 8.0, 1.6, sections=64))
    rim = rule.directions[np.abs(rule.directions[:, 2]) < 0.1]
    assert len(rim) > 3
    assert (rule.decided(rim, np.zeros(len(rim))) == -1).all()
    assert (rule.decided(np.array([[0, 0, 1.0]]), np.array([0.2])) >= 0).all()


def test_sliding_box_stays_while_friction_cannot_tip_it(rule_of):
    """On 20 x 30 mm the nearest edge is 10 mm from the middle; half of that is the limit."""
    rule, radius = rule_of(trimesh.creation.box((10, 20, 30)))
    down = np.tile([1.0, 0.0, 0.0], (4, 1))
    limit = 10 / radius / 2
    low = np.full(4, 5 / radius)
    found = rule.sliding(down, np.array([0, 0.99, 1.01, 3]) * limit, low)
    np.testing.assert_allclose(rule.directions[found[:2]], down[:2], atol=1e-9)
    assert found[2:].tolist() == [-1, -1]
    high = np.full(4, math.hypot(10, 20) / 2 / radius)
    assert (rule.sliding(down, np.zeros(4), high) == -1).all()
    tilted = np.array([[math.cos(0.01), math.sin(0.01), 0.0]])
    assert rule.sliding(tilted, np.zeros(1), low[:1]) == -1

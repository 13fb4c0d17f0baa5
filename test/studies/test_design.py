"""Factors, what is simulated at a point, and the points and lines of designs."""

from dataclasses import replace

import numpy as np
import pytest

from resting_aspects_ros.api.conditions import given_conditions
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.actions import Kick, NamedAction
from resting_aspects_ros.simulation.surroundings import named_surroundings
from resting_aspects_ros.studies.design import (
    Factor,
    Setting,
    check_factors,
    gauss_lobatto,
    make_design,
    parse_ranges,
    read_factor,
)

MAT = given_conditions('rubber_mat', {})
PLAIN = Setting(MAT)


ONE, TWO = Factor('friction', 0.1, 0.5, 3), Factor('restitution', 0.2, 0.8)
THREE = Factor('height', 0.02, 0.2)
SLOPE = Setting(MAT, named_surroundings('slope', {'angle': 0.0}))
KICK = Setting(MAT, action=NamedAction('tap', Kick(speed=0.3)))


def parse_factor(text):
    ((name, given),) = parse_ranges([text]).items()
    return read_factor(name, given, PLAIN)


def test_factor_is_parsed():
    height = Factor('height', 0.02, 0.2, None, True, unit='m', label='height')
    assert parse_factor('height = 2cm : 0.2 : log') == height
    rolling = Factor('rolling_friction', 0.001, 0.1, 5, True, label='rolling friction')
    assert parse_factor('rolling-friction=1e-3:0.1:5:LOG') == rolling
    assert read_factor(rolling.name, rolling.document, PLAIN) == rolling


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('height', 'expected NAME=LOW:HIGH'),
        ('height=20mm:200mm:1', 'levels 1 of height: expected an integer from 2 to 1000'),
        ('height=10mm:20mm:' + '9' * 400, 'expected LOW:HIGH'),
        ('height=10mm:10.00000000000001mm:3', 'expected a lower and a higher'),
        ('height=10mm:20mm:00', 'levels 0 of height: expected an integer from 2 to 1000'),
        ('restitution=0.3:1.2', 'high of restitution 1.2: expected 0 to 1'),
        ('restitution=0:1:log', 'expected more than 0 for logarithmic'),
        ('hight=1:2', "expected one of height, .*; did you mean 'height'"),
        ('surroundings.angle=0:1', 'expected surroundings'),
    ],
)
def test_invalid_factor_is_refused(text, message):
    with pytest.raises(InvalidValueError, match=message):
        parse_factor(text)


def test_a_factor_is_needed_once():
    with pytest.raises(InvalidValueError, match='restitution only once'):
        check_factors([TWO, TWO], PLAIN, [])
    with pytest.raises(InvalidValueError, match='restitution only once'):
        parse_ranges(['restitution=0:1', 'restitution = 0.2:1'])


@pytest.mark.parametrize('logarithmic', [False, True])
def test_values_and_shares_are_inverse_and_reach_the_ends(logarithmic):
    factor = Factor('height', 0.02, 0.2, logarithmic=logarithmic)
    shares = np.linspace(0, 1, 7)
    values = factor.values(shares)
    assert values[[0, -1]].tolist() == [0.02, 0.2]
    np.testing.assert_allclose(factor.shares(values), shares, atol=1e-11)
    steps = np.diff(np.log(values) if logarithmic else values)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9)


def test_conditions_surroundings_and_actions_vary():
    changed = SLOPE.changed({'surroundings.angle': 0.25, 'friction': 0.2})
    assert changed.surroundings.shape.angle == 0.25
    assert (changed.drop_conditions.friction, changed.drop_conditions.surface) == (0.2, '')
    assert changed.drop_conditions.surroundings.shape.angle == 0.25
    assert SLOPE.drop_conditions.surroundings is None  # angle 0 is the level plane
    chute = Setting(MAT, named_surroundings('l_chute'))
    chute = chute.changed({'surroundings.belt.speed': 0.1, 'surroundings.release.x_min': 0.02})
    assert chute.surroundings.bodies['belt']['speed'] == 0.1
    assert chute.surroundings.release['x_min'] == 0.02
    assert KICK.changed({'action.speed': 0.5}).action.action.speed == 0.5
    with pytest.raises(InvalidValueError, match='invalid factor'):
        PLAIN.changed({'surroundings.angle': 0.1})


def test_factorial_design_has_all_combinations():
    design = make_design('factorial', [ONE, replace(TWO, levels=2)], 1, 1)
    assert design.points.tolist() == [[a, b] for a in (0, 0.5, 1) for b in (0, 1)]
    one, two = design.lines
    assert one.points.tolist() == [[0, 2, 4], [1, 3, 5]]
    assert two.points.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert one.weights.tolist() == [1 / 3] * 3


def test_lines_vary_one_factor_from_each_base_point():
    design = make_design('curves', [TWO, THREE], 8, 1)
    for k, lines in enumerate(design.lines):
        points = design.points[lines.points]
        assert points.shape == (8, 7, 2)
        assert (points[..., k] == lines.levels).all()
        assert (np.ptp(points[..., 1 - k], axis=1) == 0).all()
        assert not lines.fixed
    (only,) = make_design('curves', [TWO], 16, 1).lines
    assert (only.points.shape, only.fixed) == ((1, 7), True)


def test_base_points_are_balanced_and_the_first_ones_stay():
    few, many = (make_design('curves', [TWO, THREE], n, 1) for n in (5, 64))
    assert (many.points[: len(few.points)] == few.points).all()
    base = many.points[many.lines[0].points[:, 0]][:, 1]
    assert sorted(np.floor(64 * base).astype(int)) == list(range(64))


def test_levels_are_kept_and_no_point_is_simulated_twice():
    design = make_design('curves', [ONE, replace(TWO, levels=2)], 64, 1)
    assert len(np.unique(design.points, axis=0)) == len(design.points) == 6
    # All lines of the other factor are there, each once.
    assert [(len(each.points), each.fixed) for each in design.lines] == [(2, True), (3, True)]


@pytest.mark.parametrize('count', [3, 7])
def test_averages_over_the_nodes_are_exact_for_polynomials(count):
    nodes, weights = gauss_lobatto(count)
    assert nodes[[0, -1]].tolist() == [0, 1]
    for degree in range(2 * count - 2):
        assert weights @ nodes**degree == pytest.approx(1 / (degree + 1), rel=1e-12)


def test_invalid_design_is_refused():
    with pytest.raises(InvalidValueError, match="design 'x': expected one of curves"):
        make_design('x', [ONE], 4, 1)
    with pytest.raises(InvalidValueError, match='number of points 0'):
        make_design('curves', [ONE], 0, 1)
    many = [Factor(f'f{k}', 0, 1, 10) for k in range(6)]
    with pytest.raises(InvalidValueError, match='design of 1000000 points: expected at most'):
        make_design('factorial', many, 1, 1)

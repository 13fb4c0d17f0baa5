"""Conditions: allowed values, rejected values and their messages."""

import dataclasses
import math

import pytest

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf

PLAIN = DropConditions(
    height=0.06,
    restitution=0.64,
    friction=0.25,
    rolling_friction=0.003,
    spinning_friction=0.0,
    gravity=9.81,
    speed_horizontal=0.0,
    speed_vertical=0.0,
    spin=0.0,
    surface='mat',
)
names = pytest.mark.parametrize('name', sorted(QUANTITIES))


@names
def test_bounds_are_inclusive_and_enforced(name):
    quantity = QUANTITIES[name]
    lowest = math.nextafter(quantity.low, 1) if quantity.above else quantity.low
    for value in (lowest, quantity.high):
        assert getattr(dataclasses.replace(PLAIN, **{name: value}), name) == value
    beyond = [math.nextafter(lowest, -1), math.nextafter(quantity.high, math.inf)]
    for value in beyond:
        with pytest.raises(InvalidValueError):
            dataclasses.replace(PLAIN, **{name: value})


@names
@pytest.mark.parametrize(
    'value', [math.nan, math.inf, -math.inf, -1, 10**5000, True, '0.5', None, [0.5], 1j], ids=shown
)
def test_invalid_numbers_are_rejected(name, value):
    with pytest.raises(InvalidValueError, match=f'^invalid {name} '):
        dataclasses.replace(PLAIN, **{name: value})


@pytest.mark.parametrize('value', [1, HeightOf.CENTRE_OF_MASS])
def test_height_of_accepts_code_or_member(value):
    assert dataclasses.replace(PLAIN, height_of=value).height_of is HeightOf.CENTRE_OF_MASS


@pytest.mark.parametrize('value', [2, -1, 'LOWEST_POINT', None, math.nan, []])
def test_invalid_height_of_is_rejected(value):
    with pytest.raises(InvalidValueError, match=r'^invalid height_of '):
        dataclasses.replace(PLAIN, height_of=value)


@names
def test_only_a_changed_value_removes_the_surface_name(name):
    value = getattr(PLAIN, name)
    assert PLAIN.changed(**{name: value}) is PLAIN
    other = PLAIN.changed(**{name: value / 2 + 1e-3})
    assert other.surface == ''
    assert getattr(other, name) == value / 2 + 1e-3
    assert other.values() != PLAIN.values()

"""Conditions: allowed values, rejected values and their messages."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


def test_numbers_are_declared_quantities():
    fields = {f.name for f in dataclasses.fields(DropConditions)}
    assert fields - set(QUANTITIES) == {'height_of', 'surface', 'surroundings'}
    units = {name: quantity.unit for name, quantity in QUANTITIES.items()}
    assert units == {
        'height': 'm',
        'restitution': '',
        'friction': '',
        'rolling_friction': '',
        'spinning_friction': '',
        'gravity': 'm/s2',
        'speed_horizontal': 'm/s',
        'speed_vertical': 'm/s',
        'spin': 'rad/s',
    }
    assert all(q.text and math.isfinite(q.high) for q in QUANTITIES.values())


def test_labels_are_readable():
    labels = [*(q.label for q in QUANTITIES.values()), *(h.label for h in HeightOf)]
    assert len(set(labels)) == len(labels)
    assert all(label.replace(' ', '').isalpha() and label.islower() for label in labels)
    assert QUANTITIES['speed_horizontal'].label == 'horizontal speed spread'
    assert HeightOf.CENTRE_OF_MASS.label == 'centre of mass'


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
    with pytest.raises(InvalidValueError) as caught:
        dataclasses.replace(PLAIN, **{name: value})
    quantity = QUANTITIES[name]
    message = str(caught.value)
    assert message.startswith(f'invalid {name} {shown(value)}: expected ')
    assert message.endswith(quantity.allowed())
    # Text may have a unit, which a file does not take.
    plain = isinstance(value, str) and quantity.unit
    assert (f'a plain number in {quantity.unit}, ' in message) == bool(plain)


@pytest.mark.parametrize(
    ('name', 'allowed'),
    [
        ('height', 'more than 0 and at most 100 m'),
        ('restitution', '0 to 1'),
        ('gravity', '1e-06 to 1000 m/s2'),
        ('spin', '0 to 10000 rad/s'),
    ],
)
def test_allowed_range_includes_the_unit(name, allowed):
    assert QUANTITIES[name].allowed() == allowed


@pytest.mark.parametrize('value', [1, np.float64(1)])
def test_integers_and_numpy_numbers_become_floats(value):
    changed = dataclasses.replace(PLAIN, height=value)
    assert type(changed.height) is float
    assert changed.height == 1.0


@pytest.mark.parametrize('value', [1, HeightOf.CENTRE_OF_MASS])
def test_height_of_accepts_code_or_member(value):
    assert dataclasses.replace(PLAIN, height_of=value).height_of is HeightOf.CENTRE_OF_MASS


@pytest.mark.parametrize('value', [2, -1, 'LOWEST_POINT', None, math.nan, []])
def test_invalid_height_of_is_rejected(value):
    with pytest.raises(InvalidValueError) as caught:
        dataclasses.replace(PLAIN, height_of=value)
    assert str(caught.value) == (
        f'invalid height_of {value!r}: expected 0 (LOWEST_POINT) or 1 (CENTRE_OF_MASS)'
    )


def test_conditions_are_immutable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        PLAIN.height = 1.0


@names
def test_only_a_changed_value_removes_the_surface_name(name):
    value = getattr(PLAIN, name)
    assert PLAIN.changed(**{name: value}) is PLAIN
    other = PLAIN.changed(**{name: value / 2 + 1e-3})
    assert other.surface == ''
    assert getattr(other, name) == value / 2 + 1e-3
    assert other.values() != PLAIN.values()


def test_changed_height_of_removes_the_surface_name():
    other = PLAIN.changed(height_of=HeightOf.CENTRE_OF_MASS)
    assert (other.surface, other.height_of) == ('', HeightOf.CENTRE_OF_MASS)


def test_invalid_change_is_rejected():
    with pytest.raises(InvalidValueError, match=r'^invalid friction -1: expected 0 to 10$'):
        PLAIN.changed(friction=-1)


@given(st.sampled_from(sorted(QUANTITIES)), st.floats(1e-6, 0.1))
def test_surface_name_does_not_affect_equal_values(name, value):
    a = dataclasses.replace(PLAIN, **{name: value})
    b = dataclasses.replace(a, surface='other')
    assert a.values() == b.values()
    assert (a.values() == PLAIN.values()) == (getattr(PLAIN, name) == value)

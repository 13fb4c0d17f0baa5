"""Conditions: allowed values, rejected values and their messages."""

import dataclasses
import math
import re
from pathlib import Path

import pytest
import yaml

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SURFACE,
    QUANTITIES,
    HeightOf,
    Surfaces,
    all_surfaces,
)

names = pytest.mark.parametrize('name', sorted(QUANTITIES))


@names
def test_bounds_are_inclusive_and_enforced(mat, name):
    quantity = QUANTITIES[name]
    lowest = math.nextafter(quantity.low, 1) if quantity.above else quantity.low
    for value in (lowest, quantity.high):
        assert getattr(dataclasses.replace(mat, **{name: value}), name) == value
    beyond = math.nextafter(lowest, -1), math.nextafter(quantity.high, math.inf)
    for value in (*beyond, math.nan, 10**5000, True, 'half', None):
        with pytest.raises(InvalidValueError, match=f'^invalid {name} '):
            dataclasses.replace(mat, **{name: value})


@names
def test_only_a_changed_value_removes_the_surface_name(mat, name):
    value = getattr(mat, name)
    assert mat.changed(**{name: value}) == mat
    other = mat.changed(**{name: value / 2 + 1e-3})
    assert other.surface == ''
    assert other.values() != mat.values()


# -- Surfaces: the shipped file, names, and files that cannot be used -----------------------------


SHIPPED = Path(__file__).resolve().parents[2] / 'config' / 'surfaces.yaml'


def test_the_default_is_the_rubber_mat_of_the_published_method(mat):
    assert mat.surface == DEFAULT_SURFACE == 'rubber_mat'
    # Bounciness 0.8 and friction 0.5 of each body, multiplied; from 60 mm, at rest.
    assert mat.restitution == pytest.approx(0.8 * 0.8)
    assert mat.friction == pytest.approx(0.5 * 0.5)
    assert (mat.height, mat.height_of, mat.gravity) == (0.06, HeightOf.LOWEST_POINT, 9.81)
    assert (mat.speed_horizontal, mat.speed_vertical, mat.spin) == (0, 0, 0)
    assert mat.rolling_friction > 0  # or cylinders roll for ever


def test_surface_name_is_kept_only_for_equal_values(surfaces, mat):
    assert surfaces.named(dataclasses.replace(mat)) is mat
    assert surfaces.named(dataclasses.replace(mat, friction=0.26)).surface == ''
    assert surfaces.named(dataclasses.replace(mat, surface='ice')).surface == ''
    # Not looked up by value: the conditions do not name the mat.
    assert surfaces.named(dataclasses.replace(mat, surface='')).surface == ''


# Changes of the entry of the rubber mat, or the whole file.
REFUSED = [
    ({'height': -1}, ', rubber_mat: invalid height -1: expected more than 0 and at most 100 m'),
    ({'frction': 1}, ", rubber_mat: invalid key 'frction': expected one of height, restitution"),
    ({'height': '50s'}, ", rubber_mat: invalid height '50s': expected a number, in m or with "),
    ({'spin': None}, ', rubber_mat: missing spin'),
    ({'uncertainty': {'spin': [1] * 7}}, ", rubber_mat: invalid uncertainty {'spin': [1, 1,"),
    ({'uncertainty': {'spin': [-1] * 8}}, ', rubber_mat: invalid spin -1'),
    ('my mat: {height: 1}', ": invalid name 'my mat' of a surface"),
]


@pytest.mark.parametrize(('content', 'expected'), REFUSED)
def test_invalid_value_is_reported_with_file_and_surface(tmp_path, content, expected):
    if not isinstance(content, str):
        entry = yaml.safe_load(SHIPPED.read_text(encoding='utf-8'))[DEFAULT_SURFACE] | content
        content = yaml.safe_dump(
            {DEFAULT_SURFACE: {k: entry[k] for k in entry if entry[k] is not None}}
        )
    path = tmp_path / 'surfaces.yaml'
    path.write_text(content, encoding='utf-8')
    with pytest.raises(InvalidValueError, match=re.escape(f"surfaces file '{path}'{expected}")):
        Surfaces.read(path)


def test_surfaces_of_a_file_are_beside_those_of_the_suite(tmp_path):
    text = SHIPPED.read_text(encoding='utf-8').replace('steel:', 'ice:')
    path = tmp_path / 'surfaces.yaml'
    changed = text.replace('restitution: 0.64', 'restitution: 0.5')
    path.write_text(changed.replace('LOWEST_POINT ', 'CENTRE_OF_MASS '), encoding='utf-8')
    found = all_surfaces(path)
    assert found.names() == ['ice', 'rubber_mat', 'steel', 'thrown']
    assert found.get().restitution == 0.5
    assert found.get().height_of == HeightOf.CENTRE_OF_MASS
    assert all_surfaces('').get().restitution == 0.64

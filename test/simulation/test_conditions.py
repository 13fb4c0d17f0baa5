"""Conditions: allowed values, rejected values and their messages."""

import dataclasses
import math
import re
from pathlib import Path

import pytest
import yaml

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SURFACE,
    QUANTITIES,
    DropConditions,
    HeightOf,
    Surfaces,
    all_surfaces,
)

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


@pytest.mark.parametrize(
    'value', [math.nan, math.inf, -1, 10**5000, True, '0.5', None, [0.5], 1j], ids=shown
)
def test_invalid_numbers_are_rejected(value):
    for name in QUANTITIES:
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


# -- Surfaces: the shipped file, names, and files that cannot be used -----------------------------


SHIPPED = Path(__file__).resolve().parents[2] / 'config' / 'surfaces.yaml'


@pytest.fixture
def file(tmp_path):
    """Write a surfaces file: text, or rubber_mat with changes."""

    def write(text=None, drop=(), **changes):
        if text is None:
            entry = yaml.safe_load(SHIPPED.read_text(encoding='utf-8'))[DEFAULT_SURFACE] | changes
            text = yaml.safe_dump(
                {DEFAULT_SURFACE: {k: v for k, v in entry.items() if k not in drop}}
            )
        path = tmp_path / 'surfaces.yaml'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_the_default_is_the_rubber_mat_of_the_published_method(surfaces):
    mat = surfaces.get()
    assert mat.surface == DEFAULT_SURFACE == 'rubber_mat'
    assert mat is surfaces.get('rubber_mat')
    # Bounciness 0.8 and friction 0.5 of each body, multiplied; from 60 mm, at rest.
    assert mat.restitution == pytest.approx(0.8 * 0.8)
    assert mat.friction == pytest.approx(0.5 * 0.5)
    assert (mat.height, mat.height_of, mat.gravity) == (0.06, HeightOf.LOWEST_POINT, 9.81)
    assert (mat.speed_horizontal, mat.speed_vertical, mat.spin) == (0, 0, 0)
    assert mat.rolling_friction > 0  # or cylinders roll for ever


def test_surface_name_is_kept_only_for_equal_values(surfaces):
    mat = surfaces.get()
    copy = dataclasses.replace(mat)
    assert surfaces.named(copy) is mat
    assert surfaces.named(dataclasses.replace(mat, friction=0.26)).surface == ''
    assert surfaces.named(dataclasses.replace(mat, surface='ice')).surface == ''
    # Not looked up by value: the conditions do not name the mat.
    assert surfaces.named(dataclasses.replace(mat, surface='')).surface == ''


def test_a_file_reads_back_what_was_written(file):
    surfaces = Surfaces.read(file(height=0.5, height_of='CENTRE_OF_MASS', spin=3))
    mat = surfaces.get()
    assert (mat.height, mat.height_of, mat.spin) == (0.5, HeightOf.CENTRE_OF_MASS, 3.0)


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'height': -1}, 'rubber_mat: invalid height -1: expected more than 0 and at most 100 m'),
        ({'spin': float('nan')}, 'rubber_mat: invalid spin nan: expected 0 to 10000 rad/s'),
        ({'height_of': 'TOP'}, "rubber_mat: invalid height_of 'TOP': expected LOWEST_POINT or "),
        ({'height_of': [1]}, 'rubber_mat: invalid height_of [1]: expected LOWEST_POINT or '),
        ({'frction': 1}, "rubber_mat: invalid key 'frction': expected one of height, restitution"),
        ({'height': '50mm'}, "rubber_mat: invalid height '50mm': expected a plain number in m,"),
        ({'drop': ('spin',)}, 'rubber_mat: missing spin'),
        ({'uncertainty': {'spin': [1] * 7}}, "rubber_mat: invalid uncertainty {'spin': [1, 1,"),
        ({'uncertainty': {'spin': 3}}, "rubber_mat: invalid uncertainty {'spin': 3}: expected"),
        ({'uncertainty': {'colour': [1] * 8}}, 'rubber_mat: invalid uncertainty '),
        ({'uncertainty': {'spin': [1] * 8, 'height': [1] * 9}}, 'rubber_mat: invalid uncertainty'),
        ({'uncertainty': {'spin': [-1] * 8}}, 'rubber_mat: invalid spin -1'),
    ],
)
def test_invalid_value_is_reported_with_file_and_surface(file, changes, expected):
    path = file(**changes)
    with pytest.raises(InvalidValueError, match=re.escape(f"surfaces file '{path}', {expected}")):
        Surfaces.read(path)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('', 'expected a mapping of names to conditions'),
        ('- a\n- b\n', 'expected a mapping of names to conditions'),
        (b'\xff\xfe\x00', 'is not valid YAML: '),
        ('rubber_mat: 3', 'rubber_mat: invalid content 3: expected a mapping with the keys'),
        ('7: {height: 1}', 'invalid name 7 of a surface'),
        ('my mat: {height: 1}', "invalid name 'my mat' of a surface"),
    ],
)
def test_invalid_files_are_rejected_in_one_line(file, text, expected):
    path = file(text)
    with pytest.raises(InvalidValueError) as caught:
        Surfaces.read(path)
    message = str(caught.value)
    assert message.removeprefix('invalid ').startswith(f"surfaces file '{path}'")
    assert expected in message
    assert '\n' not in message


def test_surfaces_of_a_file_are_beside_those_of_the_suite(file):
    text = SHIPPED.read_text(encoding='utf-8').replace('steel:', 'ice:')
    found = all_surfaces(file(text.replace('restitution: 0.64', 'restitution: 0.5')))
    assert found.names() == ['ice', 'rubber_mat', 'steel', 'thrown']
    assert found.get().restitution == 0.5
    assert all_surfaces('').get().restitution == 0.64


def test_text_names_nearest_surface_and_differences(surfaces):
    mat, steel = surfaces.get('rubber_mat'), surfaces.get('steel')
    assert surfaces.text(steel) == 'steel'
    assert surfaces.text(mat.changed(friction=0.3)) == 'rubber_mat with friction 0.3'
    changed = steel.changed(spin=5.0, height=0.1)
    assert surfaces.text(changed) == 'steel with height 0.1 m and spin spread 5 rad/s'
    assert surfaces.text(mat.changed(height=mat.height)) == 'rubber_mat'
    everything = {'height': 1.0, 'friction': 1.0, 'restitution': 0.1, 'gravity': 1.6, 'spin': 1.0}
    assert surfaces.text(mat.changed(**everything)) == 'own conditions'

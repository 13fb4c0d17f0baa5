"""A part matches its file: compared with formulas, in every unit, and through a message."""

import hashlib
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.part.loading import load_part, part_from_bytes
from resting_aspects_ros.part.part import UNITS

# STL holds float32: a coordinate is off by up to 6e-8 of itself, and a volume by three times it.
FLOAT32 = 2e-7

L_CENTRE = np.array([0.015, 0.010, 0.010])


def stl(mesh: trimesh.Trimesh) -> bytes:
    return mesh.export(file_type='stl')


def box(x: float = 10, y: float = 20, z: float = 30) -> trimesh.Trimesh:
    """A box with a corner at 0."""
    mesh = trimesh.creation.box((x, y, z))
    mesh.apply_translation((x / 2, y / 2, z / 2))
    return mesh


@pytest.fixture(scope='module')
def l_bracket(part):
    """The mesh, in mm, of 40 x 30 x 20, 10 thick, with a corner at 0."""
    bracket = part('l_bracket')
    return trimesh.Trimesh(bracket.vertices * 1e3, bracket.faces, process=False)


def rotation(seed: int) -> Rotation:
    return Rotation.from_quat(np.random.default_rng(seed).normal(size=4))


def test_mass_follows_from_the_density():
    """test_example_parts.py compares the other mass properties with formulas."""
    part = part_from_bytes(stl(box()), 'stl', 'box', density=2700)
    assert part.mass == pytest.approx(2700 * 6e-6, rel=FLOAT32)
    np.testing.assert_array_equal(part.principal_moments, np.sort(np.diag(part.inertia)))
    assert part_from_bytes(stl(box()), 'stl', 'box').mass == pytest.approx(6e-3, rel=FLOAT32)


@pytest.mark.parametrize('unit', UNITS)
def test_units_scale_lengths(unit):
    metres = {'um': 1e-6, 'mm': 1e-3, 'cm': 1e-2, 'm': 1, 'in': 0.0254, 'ft': 0.3048}[unit]
    part = part_from_bytes(stl(box(1, 2, 3)), 'stl', 'box', unit=unit)
    np.testing.assert_allclose(np.ptp(part.vertices, axis=0), np.array([1, 2, 3]) * metres)
    np.testing.assert_allclose(part.centre_of_mass, np.array([0.5, 1, 1.5]) * metres)
    assert part.volume == pytest.approx(6 * metres**3)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
def test_centre_of_mass_of_a_degenerate_part_is_exact(solid, l_bracket, seed):
    """It is over an edge of the long leg's end; an aspect hangs on its last digits."""
    turn = rotation(seed)
    mesh = trimesh.Trimesh(turn.apply(l_bracket.vertices), l_bracket.faces, process=False)
    for mesh_format in ('stl', 'stl_ascii', 'obj', 'ply'):
        part = solid(mesh, mesh_format)
        off = np.linalg.norm(part.centre_of_mass - turn.apply(L_CENTRE))
        assert off < 1e-7 * part.hull_radius


def test_hull_does_not_depend_on_the_order_in_the_file(solid):
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=7)
    before = solid(mesh)
    shuffled = np.roll(np.random.default_rng(5).permutation(mesh.faces), 1, axis=1)
    after = solid(trimesh.Trimesh(mesh.vertices, shuffled, process=False))
    assert before.mesh_sha256 != after.mesh_sha256
    np.testing.assert_array_equal(before.hull_vertices, after.hull_vertices)


def test_hull_keeps_fine_details_above_noise():
    """720 sides on a diameter of 20 mm: each corner is 0.1 um above the line of the next two."""
    mesh = trimesh.creation.cylinder(radius=10, height=20, sections=720)
    assert len(part_from_bytes(stl(mesh), 'stl', 'pin').hull_vertices) == 1440


def test_given_mass_properties_replace_those_of_the_solid():
    solid = part_from_bytes(stl(box()), 'stl', 'box', mass=1)
    heavy = part_from_bytes(stl(box()), 'stl', 'box', mass=2, centre_of_mass=(0.004, 0.01, 0.02))
    np.testing.assert_allclose(heavy.inertia, 2 * solid.inertia)
    assert heavy.hull_radius == pytest.approx(np.sqrt(6**2 + 10**2 + 20**2) * 1e-3)
    # In the order of ROS.
    inertia = [2e-4, 1e-6, 2e-6, 1e-4, 3e-6, 1.5e-4]
    given = part_from_bytes(stl(box()), 'stl', 'box', mass=1, inertia=inertia)
    np.testing.assert_array_equal(
        given.inertia, [[2e-4, 1e-6, 2e-6], [1e-6, 1e-4, 3e-6], [2e-6, 3e-6, 1.5e-4]]
    )


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({'density': 0}, ['density', '0', 'above 0']),
        ({'mass': 10**400}, ['mass', '1000', 'above 0']),
        ({'mass': 1, 'density': 2}, ['density (2)', 'mass (1)', 'only one of them']),
        ({'unit': 'furlong'}, ['unit', "'furlong'", 'um, mm, cm, m, in, ft']),
        ({'centre_of_mass': (0, 0, float('inf'))}, ['centre of mass', 'inf', 'three finite']),
        ({'centre_of_mass': (5, 10, 15)}, ['[5.0, 10.0, 15.0]', 'inside the convex hull', '0.02']),
        ({'inertia': [[1, 2], [3]]}, ['inertia', '[[1, 2], [3]]', 'six finite numbers']),
        ({'inertia': [1e308] * 6}, ['inertia', '1e+308', 'six finite numbers']),
        ({'inertia': [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}, ['inertia', 'symmetric']),
        ({'inertia': [1, 0, 0, -1, 0, 1]}, ['inertia', '-1', 'above 0']),
        ({'inertia': [1e-7, 0, 0, 1e-7, 0, 3e-7]}, ['inertia', '3e-07', 'sum of the other two']),
        ({'inertia': [6.5e-1, 0, 0, 5e-1, 0, 2.5e-1]}, ['inertia', '0.65', 'kg m^2?']),
    ],
)
@pytest.mark.filterwarnings('error')
def test_error_for_invalid_mass_properties(given, expected):
    with pytest.raises(InvalidValueError) as caught:
        part_from_bytes(stl(box()), 'stl', 'bracket_7', **given)
    for word in ['bracket_7', *expected]:
        assert word in str(caught.value)


@pytest.mark.parametrize('name', ['', 'Box', '7up', 'a' * 65, 'ä', 'box\n'])
def test_invalid_name_is_rejected(name):
    with pytest.raises(InvalidValueError, match='lower case letters, digits and _'):
        part_from_bytes(stl(box()), 'stl', name)


def test_an_inertia_rounded_as_in_a_data_sheet_is_accepted():
    """A thin plate has Izz = Ixx + Iyy but for its thickness; three digits can exceed that."""
    plate = part_from_bytes(
        stl(box(100, 100, 0.1)),
        'stl',
        'plate',
        mass=1,
        inertia=[8.33e-4, 0, 0, 8.33e-4, 0, 1.667e-3],
    )
    assert plate.principal_moments[2] > plate.principal_moments[:2].sum()


def test_part_sha256_agrees_with_its_documentation():
    data = stl(box())
    part = part_from_bytes(data, 'stl', 'box', mass=2)
    i = part.inertia
    numbers = [2, *part.centre_of_mass, i[0, 0], i[0, 1], i[0, 2], i[1, 1], i[1, 2], i[2, 2]]
    mesh_sha256 = hashlib.sha256(data).hexdigest()
    text = f'{mesh_sha256} mm '.encode() + struct.pack('<10d', *numbers)
    assert part.mesh_sha256 == mesh_sha256
    assert part.part_sha256 == hashlib.sha256(text).hexdigest()


@pytest.mark.parametrize(
    ('stem', 'name'),
    [('M8 washer (DIN 125)', 'm8_washer_din_125_'), ('10x20', 'part_10x20'), ('q' * 99, 'q' * 64)],
)
def test_default_name_is_the_file_stem(tmp_path, stem, name):
    file = tmp_path / f'{stem}.STL'
    file.write_bytes(stl(box()))
    assert load_part(file).name == name


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('bracket.stl', 'does not exist'),
        ('bracket.3ds', r'expected one of \.stl, \.obj, \.ply'),
        ('bracket.IGS', 'export one of these from your CAD program'),
    ],
)
def test_file_that_is_no_mesh_is_refused(tmp_path, name, expected):
    with pytest.raises(PartError, match=expected) as caught:
        load_part(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


@pytest.mark.parametrize(
    ('sides', 'unit', 'expected'),
    [
        ((1.24, 1.63, 0.98), None, ['1.24 x 1.63 x 0.98', 'in inches it would be 31.5 x 41.4 x']),
        ((1e4, 2e4, 3e4), 'mm', ['10000 x 20000', 'in micrometres it would be 10 x 20 x 30 mm']),
        *(((size, size, size), None, []) for size in (3.1, 1999)),
        *(((size, size, size), 'mm', []) for size in (0.1001, 1.5)),
    ],
)
def test_unusual_size_is_a_warning_that_suggests_units(sides, unit, expected):
    warnings = part_from_bytes(stl(box(*sides)), 'stl', 'box', unit=unit).warnings
    assert len(warnings) == bool(expected)
    for word in expected:
        assert word in warnings[0]

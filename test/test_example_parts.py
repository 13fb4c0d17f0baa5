"""The example parts: identical to the output of tools/setup/make_parts.py, and to formulas."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.part.loading import part_from_bytes

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / 'config' / 'parts'
LIBRARY = PartLibrary(FOLDER)

# STL holds float32: a coordinate is off by up to 6e-8 of itself, and a volume by three times it.
FLOAT32 = 2e-7

N = 64
DISC = N / 2 * np.sin(2 * np.pi / N)  # area of the polygon in a circle of radius 1

# Volume, mm^3, centre, mm, and the corners of the hull.
PARTS = {
    'l_bracket': ((40 * 10 + 20 * 10) * 20, (15, 10, 10), 10),
    'angle_45x30x8': (
        (45 * 8 + 22 * 8) * 20,
        ((360 * 22.5 + 176 * 4) / 536, (360 * 4 + 176 * 19) / 536, 10),
        10,
    ),
    't_prism': ((40 * 10 + 10 * 30) * 20, (0, (400 * 35 + 300 * 15) / 700, 10), 12),
    'box_10x20x30': (10 * 20 * 30, (5, 10, 15), 8),
    'cylinder_d20_h20': (DISC * 10**2 * 20, (0, 0, 10), 128),
    'washer': (DISC * (8**2 - 4.2**2) * 1.6, (0, 0, 0.8), 128),
    'hex_nut': ((np.sqrt(3) / 2 * 17**2 - DISC * 5**2) * 8.4, (0, 0, 4.2), 12),
    'u_bracket': ((30 * 25 - 20 * 20) * 20, (15, (150 * 2.5 + 200 * 15) / 350, 10), 8),
    'tetrahedron': (30**3 / (6 * np.sqrt(2)), (0, 0, 0), 4),
}


def polygon_prism(radius, height):
    """Inertia / mass of a regular prism of N sides about its middle, axis z, mm^2.

    The polar moment of a regular polygon's area is r^2 / 6 (2 + cos(2 pi / n)) of it.
    """
    polar = radius**2 / 6 * (2 + np.cos(2 * np.pi / N))
    return np.array([polar / 2 + height**2 / 12, polar / 2 + height**2 / 12, polar])


INERTIAS = {  # / mass, mm^2, along x y z
    'box_10x20x30': np.array([20**2 + 30**2, 10**2 + 30**2, 10**2 + 20**2]) / 12,
    'tetrahedron': np.full(3, 30**2 / 20),
    'washer': (64 * polygon_prism(8, 1.6) - 4.2**2 * polygon_prism(4.2, 1.6)) / (64 - 4.2**2),
}


def test_script_writes_these_files_and_no_others(tmp_path):
    runpy.run_path(str(ROOT / 'tools' / 'setup' / 'make_parts.py'))['main'](tmp_path, tmp_path)
    made = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    folders = (FOLDER, ROOT / 'config' / 'surroundings')
    kept = {file.name: file.read_bytes() for each in folders for file in each.glob('*.stl')}
    assert made == kept
    assert LIBRARY.names() == sorted(PARTS)


@pytest.mark.parametrize('name', PARTS)
def test_part_has_the_volume_and_centre_of_the_formula(name):
    part, (volume, centre, _) = LIBRARY.load(name), PARTS[name]
    assert part.volume == pytest.approx(volume * 1e-9, rel=FLOAT32)
    np.testing.assert_allclose(part.centre_of_mass * 1e3, centre, atol=FLOAT32 * 40)
    assert part.warnings == ()


@pytest.mark.parametrize('name', INERTIAS)
def test_part_has_the_inertia_of_the_formula(name):
    part = LIBRARY.load(name)
    expected = part.mass * INERTIAS[name] * 1e-6
    np.testing.assert_allclose(part.inertia, np.diag(expected), atol=3 * FLOAT32 * expected.max())


def test_values_in_example_yaml_comments_are_correct(tmp_path):
    text = (FOLDER / 'l_bracket.yaml').read_text()
    for key in ('centre_of_mass', 'inertia'):
        assert f'# {key}: ' in text
        text = text.replace(f'# {key}: ', f'{key}: ')
    (tmp_path / 'l_bracket.yaml').write_text(text)
    (tmp_path / 'l_bracket.stl').write_bytes((FOLDER / 'l_bracket.stl').read_bytes())
    shown, own = (PartLibrary(folder).load('l_bracket') for folder in (tmp_path, FOLDER))
    np.testing.assert_allclose(shown.centre_of_mass, own.centre_of_mass, rtol=FLOAT32)
    np.testing.assert_allclose(shown.inertia, own.inertia, atol=1e-5 * own.inertia.max())
    assert '`mass: 0.0942`' in text
    assert own.mass == pytest.approx(0.0942)


def test_l_bracket_has_the_inertia_of_its_two_legs_of_steel():
    part = LIBRARY.load('l_bracket')
    expected = np.zeros((3, 3))
    for size, middle in (((40, 10, 20), (20, 5, 10)), ((10, 20, 20), (5, 20, 10))):
        x, y, z = size
        mass = 7850e-9 * x * y * z
        arm = np.subtract(middle, (15, 10, 10))
        expected += mass / 12 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
        expected += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(part.inertia, expected * 1e-6, atol=3 * FLOAT32 * 2e-5)


@pytest.mark.parametrize('name', PARTS)
def test_hull_has_the_corners_of_the_shape_in_every_orientation(name):
    """The nut's bore ends in its facets: 64 vertices that noise could lift above them."""
    corners = PARTS[name][2]
    assert len(LIBRARY.load(name).hull_vertices) == corners
    for turn in Rotation.random(2, random_state=1):
        mesh = trimesh.load_mesh(FOLDER / f'{name}.stl')
        mesh.vertices = turn.apply(mesh.vertices)
        part = part_from_bytes(mesh.export(file_type='stl'), 'stl', name)
        assert len(part.hull_vertices) == corners

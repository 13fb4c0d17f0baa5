"""Coordinates that a file stores in coarse steps: a warning or an error, and none without."""

import re

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part.loading import part_from_bytes

COARSE = 'are stored in steps of'
SHAPES = {
    'washer': lambda: trimesh.creation.annulus(5, 10, 2, sections=64),
    'thick washer': lambda: trimesh.creation.annulus(15, 40, 20, sections=48),
    'disc': lambda: trimesh.creation.cylinder(40, 0.5, sections=24),
    'rod': lambda: trimesh.creation.cylinder(1, 200, sections=16),
}


def placed(mesh, distance):
    """A tilted mesh at a distance from the origin."""
    mesh.vertices = Rotation.from_rotvec((0.3, 0.5, 0.7)).apply(mesh.vertices)
    mesh.apply_translation(np.array((1, 0.7, 0.3)) * distance)
    return mesh


def ascii_stl(mesh, number):
    rows = [' '.join(map(number, row)) for row in np.asarray(mesh.triangles).reshape(-1, 3)]
    facets = [
        f'facet normal 0 0 0\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet'
        for a, b, c in zip(rows[::3], rows[1::3], rows[2::3], strict=True)
    ]
    return '\n'.join(['solid', *facets, 'endsolid\n']).encode(), 'stl'


def obj(mesh, number):
    lines = ['v ' + ' '.join(map(number, row)) for row in np.asarray(mesh.vertices)]
    lines += [f'f {a} {b} {c}' for a, b, c in np.asarray(mesh.faces) + 1]
    return '\n'.join(lines).encode(), 'obj'


SINGLE = {
    'binary STL': lambda mesh: (mesh.export(file_type='stl'), 'stl'),
    'STL with 7 digits': lambda mesh: ascii_stl(mesh, lambda x: f'{np.float32(x):e}'),
    'OBJ with the shortest text': lambda mesh: obj(mesh, lambda x: str(np.float32(x))),
    'PLY': lambda mesh: (mesh.export(file_type='ply', vertex_normal=False), 'ply'),
}
DOUBLE = {
    'STL': lambda mesh: ascii_stl(mesh, lambda x: repr(float(x))),
    'OBJ with 9 decimals': lambda mesh: obj(mesh, lambda x: f'{x:.9f}'),
    'OFF': lambda mesh: (mesh.export(file_type='off').encode(), 'off'),
}


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    exponent=st.floats(3, 7),
    shape=st.sampled_from(sorted(SHAPES)),
    file=st.sampled_from(sorted(SINGLE)),
)
def test_part_far_from_the_origin_is_exact_or_has_a_warning(seed, exponent, shape, file):
    """The volume is right within 1e-4, and a washer has three classes: two sides and the rim."""
    generator = np.random.default_rng(seed)
    mesh = SHAPES[shape]()
    volume = mesh.volume
    mesh.vertices = Rotation.from_quat(generator.normal(size=4)).apply(mesh.vertices)
    direction = generator.normal(size=3)
    mesh.apply_translation(10**exponent * direction / np.linalg.norm(direction))
    data, mesh_format = SINGLE[file](mesh)
    try:
        part = part_from_bytes(data, mesh_format, 'part', unit='mm')
    except PartError as caught:
        error = str(caught)
        assert re.search(f'{COARSE}|at most 1e.06 m|zero area', error), error
        return
    if any(COARSE in warning for warning in part.warnings):
        return
    assert part.warnings == ()
    assert part.volume * 1e9 == pytest.approx(volume, rel=1.1e-4)
    if 'washer' in shape:
        assert len(find_aspects(part)) == 3


@pytest.mark.slow
@pytest.mark.parametrize('file', DOUBLE)
def test_fine_coordinates_are_right_at_any_place(file):
    data, mesh_format = DOUBLE[file](placed(SHAPES['thick washer'](), 1e6))
    part = part_from_bytes(data, mesh_format, 'washer', unit='mm')
    assert part.warnings == ()
    assert len(find_aspects(part)) == 3
    assert part.volume == pytest.approx(SHAPES['thick washer']().volume * 1e-9, rel=1e-6)


def box(sides, place=(0, 0, 0)):
    """A box with a corner at a place, and only numbers with one decimal."""
    mesh = trimesh.creation.box(sides)
    mesh.apply_translation(np.array(sides) / 2 + place)
    mesh.vertices = mesh.vertices.round(1)
    return mesh


DESIGNS = {
    'whole numbers far away': box((10, 20, 30), (1e5, 1e5, -1e5)),
    'whole numbers about a million': box((10, 20, 30), (1_000_040, 1_000_040, -1_000_040)),
    'tenths': box((10.3, 20.7, 7.1)),
}


@pytest.mark.parametrize('number', ['{:.1f}', '{:.10g}'])
@pytest.mark.parametrize('design', DESIGNS)
def test_design_values_are_exact_with_few_digits(design, number):
    mesh = DESIGNS[design]
    for text in (obj, ascii_stl):
        part = part_from_bytes(*text(mesh, lambda x: number.format(float(x))), 'p', unit='mm')
        assert part.warnings == ()
        assert part.volume * 1e9 == pytest.approx(mesh.volume, rel=1e-9)


@pytest.mark.parametrize('text', [obj, ascii_stl])
@pytest.mark.parametrize('number', ['{:.1f}', '{!r}'])
def test_one_decimal_is_coarse_for_a_tilted_part(number, text):
    cylinder = trimesh.creation.cylinder(3.7, 9.3, sections=40)
    data, mesh_format = text(placed(cylinder, 0), lambda x: number.format(round(float(x), 1)))
    try:
        notes = part_from_bytes(data, mesh_format, 'part', unit='mm').warnings
    except PartError as error:
        notes = [str(error)]
    assert any(f'{COARSE} 0.1 mm' in note for note in notes)


@pytest.mark.parametrize(
    ('distance', 'number'), [(1e6, lambda x: f'{x:.6g}'), (2e5, lambda x: f'{x:.5e}')]
)
def test_steps_as_large_as_the_part_are_refused(distance, number):
    mesh = placed(SHAPES['washer'](), distance)
    with pytest.raises(PartError, match=r'cannot be used: .* are stored in steps of'):
        part_from_bytes(*ascii_stl(mesh, number), 'washer', unit='mm')


BALL = trimesh.creation.icosphere(2, 10)
EMPTY = {
    'each triangle twice': np.concatenate([BALL.triangles, BALL.triangles[:, ::-1]]),
    'in a plane': np.array([[(0, 0, 0), (10, 0, 0), (10, 10, 0)]], dtype=float),
}


@pytest.mark.parametrize('cause', EMPTY)
def test_mesh_without_volume_is_not_called_coarse(cause):
    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(EMPTY[cause] + (1e3, 0, 0)))
    with pytest.raises(PartError) as caught:
        part_from_bytes(mesh.export(file_type='stl'), 'stl', 'empty', unit='mm')
    assert cause in str(caught.value)
    assert COARSE not in str(caught.value)

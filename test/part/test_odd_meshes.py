"""Meshes that enclose no solid, or that are made to keep the computer busy: one error each."""

import time

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part import mesh_files
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.mass import solid_integrals


def self_intersecting(seed, kind):
    """A closed mesh whose corners were moved at random."""
    generator = np.random.default_rng(seed)
    if kind == 'prism':
        outline = generator.uniform(0, 20, (generator.integers(4, 9), 2))
        n = len(outline)
        vertices = [(x, y, z) for z in (0, 10) for x, y in outline]
        caps = [(0, k + 1, k) for k in range(1, n - 1)]
        faces = caps + [(a + n, c + n, b + n) for a, b, c in caps]
        pairs = [(k, (k + 1) % n) for k in range(n)]
        faces += [t for a, b in pairs for t in ((a, b, b + n), (a, b + n, a + n))]
        return trimesh.Trimesh(vertices, faces, process=False)
    mesh = {
        'ball': lambda: trimesh.creation.icosphere(1, radius=10),
        'box': lambda: trimesh.creation.box((20, 20, 20)),
        'ring': lambda: trimesh.creation.torus(10, 3, major_sections=6, minor_sections=4),
    }[kind]()
    mesh.vertices += generator.normal(size=mesh.vertices.shape) * generator.uniform(2, 30)
    return mesh


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(['prism', 'ball', 'box', 'ring']))
def test_self_intersecting_mesh_is_plausible_or_rejected(seed, kind):
    data = self_intersecting(seed, kind).export(file_type='stl')
    try:
        part = part_from_bytes(data, 'stl', 'odd')
    except PartError:
        return
    assert part.volume > 0
    moments = part.principal_moments
    assert moments[0] > 0
    assert moments[2] <= (moments[0] + moments[1]) * 1.002
    planes = ConvexHull(part.hull_vertices * 1e3).equations
    assert (planes[:, :3] @ part.centre_of_mass * 1e3 + planes[:, 3]).max() < 1e-6
    assert len(find_aspects(part).aspects) >= 1


@given(seed=st.integers(0, 2**32 - 1))
def test_volume_integrals_equal_those_of_trimesh(seed):
    generator = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(2, radius=0.7)
    mesh.vertices += generator.normal(size=mesh.vertices.shape) * 0.02
    vertices = np.asarray(mesh.vertices)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scale = 2.0 ** np.ceil(np.log2(np.ptp(vertices, axis=0).max()))
    triangles = ((vertices - middle) / scale)[mesh.faces]
    expected = trimesh.triangles.mass_properties(triangles)
    found = solid_integrals(vertices, np.asarray(mesh.faces))
    assert found.volume == expected.volume * scale**3
    np.testing.assert_array_equal(found.centre_of_mass, expected.center_mass * scale + middle)
    np.testing.assert_array_equal(found.inertia, expected.inertia * scale**5)


ADVERSARIAL = {
    'digits': ('v {}x 0 0\n', '0'),
    'many numbers': ('v {}x\n', '1 '),
    'corners': ('f {}x\n', '1/2/3 '),
    'continued': ('v {}\n', '\\\n'),
    'blanks of STL': ('solid\n{}vertex\nendsolid', ' '),
    'words of STL': ('solid\n{}\nendsolid', 'vertex '),
}
PLY = 'ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n'


def seconds(text, mesh_format):
    start = time.perf_counter()
    with pytest.raises(PartError):
        mesh_files.read_triangles(text.encode(), mesh_format, 'odd')
    return time.perf_counter() - start


@pytest.mark.slow
@pytest.mark.parametrize('kind', ADVERSARIAL)
def test_long_text_is_checked_in_linear_time(kind):
    """Ten times the text may take a hundred times as long at most; quadratic ones took minutes."""
    line, piece = ADVERSARIAL[kind]
    for mesh_format, head in (('obj', ''), ('ply', PLY), ('stl', 'solid\n')):
        texts = [head + line.format(piece * (n // len(piece))) for n in (20_000, 200_000)]
        few, many = (seconds(text, mesh_format) for text in texts)
        assert many < 100 * max(few, 0.05)


def test_too_many_triangles_are_rejected_before_reading():
    count = mesh_files.MAX_TRIANGLES + 1
    data = bytes(80) + count.to_bytes(4, 'little') + bytes(50 * count)
    with pytest.raises(PartError, match='has 1000001 triangles: expected at most 1000000; simpl'):
        mesh_files.read_triangles(data, 'stl', 'odd')

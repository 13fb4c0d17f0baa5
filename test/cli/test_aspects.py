"""`resting_aspects aspects`: its table and its document."""

import json

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.aspects.find import find_aspects


@pytest.fixture
def document(run):
    def read(*words):
        ended = run('aspects', *words, '--json')
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return read


def test_a_box_has_its_six_sides_in_three_classes(document):
    found = document('box_10x20x30')
    assert (found['part'], found['symmetry'], found['symmetry_order']) == (
        'box_10x20x30',
        'finite',
        4,
    )
    assert [a['id'] for a in found['aspects']] == [1, 2, 3, 4, 5, 6]
    assert [a['symmetry_class'] for a in found['aspects']] == [1, 1, 2, 2, 3, 3]
    assert {a['multiplicity'] for a in found['aspects']} == {2}
    assert [a['com_height'] for a in found['aspects']] == pytest.approx(
        [5e-3, 5e-3, 10e-3, 10e-3, 15e-3, 15e-3], rel=1e-6
    )
    # Over the nearest edge: from height 5 to sqrt(5^2 + 10^2), from 10 and 15 over an edge at 5.
    rise = np.sqrt([125, 125, 125, 125, 250, 250]) - [5, 5, 10, 10, 15, 15]
    assert [a['min_barrier'] for a in found['aspects']] == pytest.approx(rise * 1e-3, rel=1e-5)
    assert sum(a['basin_share'] for a in found['aspects']) == pytest.approx(1)
    assert not any(a['rolls'] for a in found['aspects'])


def test_a_cylinder_rolls_about_its_axis_and_has_two_ends(document):
    found = document('cylinder_d20_h20')
    assert (found['symmetry'], found['symmetry_order']) == ('axial', 2)
    assert [a['sweep'] for a in found['aspects']] == ['RING', 'POINT', 'POINT']
    assert [a['rolls'] for a in found['aspects']] == [True, False, False]
    assert [a['multiplicity'] for a in found['aspects']] == [1, 2, 2]
    for axis in (found['symmetry_axis'], found['aspects'][0]['axis']):
        assert np.abs(axis) == pytest.approx([0, 0, 1], abs=1e-6)


def test_the_document_is_what_the_core_finds(document, part):
    shape = part('angle_45x30x8')
    found, expected = document('angle_45x30x8'), find_aspects(shape)
    assert found['part_sha256'] == shape.part_sha256
    for one, other in zip(found['aspects'], expected.aspects, strict=True):
        assert one['down_in_part'] == pytest.approx(other.down_in_part.tolist(), abs=0)
        assert one['basin_share'] == other.basin_share


def test_a_sphere_cannot_leave_its_only_aspect(document, tmp_path):
    trimesh.creation.icosphere(2, radius=10).export(tmp_path / 'ball.stl')
    found = document(tmp_path / 'ball.stl')
    (only,) = found['aspects']
    assert (found['symmetry'], only['sweep'], only['rolls']) == ('spherical', 'SPHERE', True)
    assert (only['min_barrier'], only['neighbour']) == (None, 0)


@pytest.mark.parametrize('name', ['hex_nut', 'cylinder_d20_h20', 'l_bracket'])
def test_table_fits_80_columns_without_truncation(run, name):
    ended = run('aspects', name)
    assert ended.returncode == 0
    assert max(map(len, ended.stdout.splitlines())) <= 80
    assert '…' not in ended.stdout
    assert 'Symmetry: ' in ended.stdout


def test_a_part_that_is_not_registered_is_refused(refused):
    assert 'hex_nut' in refused('aspects', 'gizmo')

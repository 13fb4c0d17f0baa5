"""What surroundings are for results: whether the floor is level, and the shapes that are used."""

import dataclasses

import pytest

from resting_aspects_ros.api.simulated_shapes import simulated_shapes
from resting_aspects_ros.api.surroundings import has_level_floor, with_surroundings

LEVEL = {'plane', 'tray', 'wall'}


@pytest.mark.parametrize(
    'name',
    ['bowl_track', 'corner', 'l_chute', 'plane', 'pocket', 'slope', 'tray', 'v_groove', 'wall'],
)
def test_only_level_floors_are_level(surfaces, name):
    conditions = with_surroundings(surfaces.get('rubber_mat'), name)
    assert has_level_floor(conditions) is (name in LEVEL)


def test_shapes_are_known_where_more_than_planes_meet_the_part(part, surfaces):
    shape, rubber = part('tetrahedron'), surfaces.get('rubber_mat')
    for name in ('plane', 'slope', 'tray', 'l_chute'):
        assert simulated_shapes(shape, with_surroundings(rubber, name)) is None
    track = simulated_shapes(shape, with_surroundings(rubber, 'bowl_track'))
    assert (len(track.pieces.corners), track.mesh) == (1, None)
    mesh = simulated_shapes(shape, with_surroundings(rubber, 'pocket'))
    assert mesh.document()['mesh_surface']['flat_sides'] == 11
    assert len(list(mesh.sentences())) == 2


def test_shapes_are_not_known_without_the_mesh(part, surfaces):
    key = '{"kind":"mesh","mesh":"x.stl","mesh_sha256":"0"}'
    conditions = dataclasses.replace(surfaces.get('rubber_mat'), surroundings=key)
    assert simulated_shapes(part('tetrahedron'), conditions) is None
    assert not has_level_floor(conditions)

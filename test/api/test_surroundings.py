"""What surroundings are for results: whether the floor is level, and the shapes that are used."""

import dataclasses

import pytest

from resting_aspects_ros.api.conditions import (
    has_level_floor,
    simulated_shapes,
    with_surroundings,
)
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import MeshSurface


@pytest.mark.parametrize(
    'name',
    ['bowl_track', 'corner', 'l_chute', 'plane', 'pocket', 'slope', 'tray', 'v_groove', 'wall'],
)
def test_only_level_floors_are_level(surfaces, name):
    conditions = with_surroundings(surfaces.get('rubber_mat'), name)
    assert has_level_floor(conditions) is (name in ('plane', 'tray', 'wall'))


def test_shapes_are_known_where_more_than_planes_meet_the_part(part, surfaces):
    shape, rubber = part('tetrahedron'), surfaces.get('rubber_mat')
    assert simulated_shapes(shape, with_surroundings(rubber, 'l_chute')) is None
    track = simulated_shapes(shape, with_surroundings(rubber, 'bowl_track'))
    assert (len(track.pieces.corners), track.mesh) == (1, None)
    mesh = simulated_shapes(shape, with_surroundings(rubber, 'pocket'))
    assert mesh.document()['mesh_surface']['distance'] == 0
    assert len(list(mesh.sentences())) == 2


def test_shapes_are_not_known_without_the_mesh(part, surfaces):
    mesh = Surroundings(MeshSurface('x.stl', mesh_sha256='0'))
    conditions = dataclasses.replace(surfaces.get('rubber_mat'), surroundings=mesh)
    assert simulated_shapes(part('tetrahedron'), conditions) is None
    assert not has_level_floor(conditions)

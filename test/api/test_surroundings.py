"""The shapes with which surroundings and parts are simulated."""

import dataclasses

from resting_aspects_ros.api.conditions import (
    simulated_shapes,
    with_surroundings,
)
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import MeshSurface


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

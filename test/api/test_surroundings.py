"""What surroundings are for results: whether the floor is level, and the shapes that are used."""

import dataclasses
import math
import warnings

import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import (
    has_level_floor,
    simulated_shapes,
    warn_of_surroundings,
    with_surroundings,
)
from resting_aspects_ros.errors import RestingAspectsWarning
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
    assert mesh.document()['mesh_surface']['flat_sides'] == 11
    assert len(list(mesh.sentences())) == 2


def test_shapes_are_not_known_without_the_mesh(part, surfaces):
    mesh = Surroundings(MeshSurface('x.stl', mesh_sha256='0'))
    conditions = dataclasses.replace(surfaces.get('rubber_mat'), surroundings=mesh)
    assert simulated_shapes(part('tetrahedron'), conditions) is None
    assert not has_level_floor(conditions)


def test_a_groove_in_which_parts_wedge_is_named_before_the_drops(surfaces):
    # The opening below which friction holds a part between the planes: the sum of both angles.
    limit = math.atan(0.25) + math.atan(0.5)

    def in_groove(opening):
        groove = ra.surroundings('v_groove', opening=opening, left={'friction': 0.5})
        return with_surroundings(surfaces.get('rubber_mat'), groove)

    with pytest.warns(RestingAspectsWarning, match='parts can wedge in the groove') as caught:
        warn_of_surroundings(in_groove(limit - 0.01), 0.02)
    assert f'{math.degrees(limit):.3g} degrees' in str(caught[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        warn_of_surroundings(in_groove(limit + 0.01), 0.02)
        warn_of_surroundings(surfaces.get('rubber_mat'), 0.02)


@pytest.mark.filterwarnings('error')
def test_wedging_is_named_by_drop_and_reorient():
    # The warning is an exception here, so that the drops, which take minutes, do not begin.
    given = {'surroundings': ra.surroundings('v_groove', opening='28deg'), 'workers': 1}
    with pytest.raises(RestingAspectsWarning, match='parts can wedge in the groove'):
        ra.drop('tetrahedron', drops=1, **given)
    with pytest.raises(RestingAspectsWarning, match='parts can wedge in the groove'):
        ra.reorient('tetrahedron', 'tap', 1, **given)

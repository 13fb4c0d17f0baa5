"""Drops in surroundings: what they must not depend on, outcomes, and truth from symmetry."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from surroundings_symmetry import CHIRAL, LEVEL, counts_on_belt, mirrored_chute, same, tilted_plane

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.simulation import kernel_engine, settling
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import (
    BowlTrack,
    Chute,
    Plane,
    Slope,
    Tray,
    VGroove,
)
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses
from resting_aspects_ros.statistics.poses import RestStatus


@pytest.fixture(scope='module')
def rubber(surfaces):
    return surfaces.get('rubber_mat')


@pytest.fixture(scope='module')
def make(rubber):
    def make(part, kind=None, engine='', **more):
        around = None if kind is None else Surroundings(kind, **more)
        return make_job(part, dataclasses.replace(rubber, surroundings=around), 1, engine=engine)

    return make


# -- Nothing but the index decides ---------------------------------------------------------------


@pytest.mark.parametrize('engine', [KERNEL, BULLET])
@pytest.mark.parametrize('kind', [Slope(0.0), Plane()], ids=['slope', 'plane'])
def test_a_level_slope_is_the_plane(part, make, assert_same_poses, kind, engine):
    shape = part('tetrahedron')
    one, other = (drop_range(make(shape, each, engine), 0, 20) for each in (kind, None))
    assert_same_poses(one, other)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('kind', 'engine', 'n'),
    [(Tray(length=0.2, width=0.1), KERNEL, 700), (Chute(), BULLET, 28)],
    ids=['tray', 'chute'],
)
def test_drops_do_not_depend_on_other_drops(part, make, assert_same_poses, kind, engine, n):
    job = make(part('tetrahedron'), kind, engine)
    many = drop_range(job, 0, n)
    for first, end in [(24, 27), (4, 8), (0, 1)]:
        assert_same_poses(drop_range(job, first, end), many.between(first, end))


# -- Outcomes ------------------------------------------------------------------------------------


def test_parts_beyond_the_edge_of_a_track_are_lost(part, make):
    shape, n = part('tetrahedron'), 125
    width = 0.04
    job = make(shape, BowlTrack(width=width), release={'y_min': 0.03, 'y_max': 0.06})
    poses = drop_range(job, 0, n)
    found = count_poses(find_aspects(shape), poses)
    assert found.lost == np.count_nonzero(poses.status == RestStatus.LOST) > 0
    counted = (found.unclassified, found.unsettled, found.failed, found.lost, found.sliding)
    assert found.counts.sum() + sum(counted) == n
    # Those that stay have their centre of mass above the track, those that fell are below it.
    centre = poses.position + rotate(poses.orientation, shape.centre_of_mass)
    in_scene = job.scene.in_scene(centre)
    assert (in_scene[poses.status == RestStatus.SETTLED, 1] < width).all()
    assert (in_scene[poses.status == RestStatus.LOST, 2] < 0).all()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('engine', 'n'), [(KERNEL, 1000), (BULLET, 50)])
def test_parts_on_a_steep_slope_slide(part, make, rubber, engine, n):
    shape = part('tetrahedron')
    angle = math.atan(rubber.friction) + math.radians(10)
    poses = drop_range(make(shape, Slope(angle), engine), 0, n)
    assert (poses.status == RestStatus.SLIDING).all()


@pytest.mark.parametrize(('engine', 'n'), [(KERNEL, 1000), (BULLET, 50)])
def test_the_time_limit_holds(part, make, monkeypatch, engine, n):
    for module in (settling, kernel_engine):
        monkeypatch.setattr(module, 'TIME_LIMIT', 3.0)
    shape = part('tetrahedron')
    found = count_poses(find_aspects(shape), drop_range(make(shape, Chute(), engine), 0, n))
    assert found.unsettled + found.sliding > 0
    outside = found.unclassified + found.unsettled + found.failed + found.lost + found.sliding
    assert found.counts.sum() + outside == n


# -- Truth from symmetry, and the other engine ---------------------------------------------------


@pytest.mark.slow
def test_a_plane_tilted_with_gravity_gives_the_distribution_of_the_plane(part, make):
    shape, n = part('l_bracket'), 2000
    level = dataclasses.replace(make(shape), until_still=True)
    tilted = tilted_plane(level, 0.5)
    np.testing.assert_allclose(tilted.scene.down, -tilted.scene.bodies[0].normal, atol=1e-12)
    runs = [count_poses(find_aspects(shape), drop_range(each, 0, n)) for each in (level, tilted)]
    assert min(found.counts.sum() for found in runs) > 0.999 * n
    assert same(*(found.counts for found in runs)) > LEVEL


@pytest.mark.slow
def test_a_mirrored_chute_gives_mirrored_shares_of_the_mirrored_part(solid, make):
    shape, image = (solid(trimesh.convex.convex_hull(CHIRAL * [1, y, 1])) for y in (1, -1))
    n, job = 1000, make(shape, Chute())
    other = mirrored_chute(make(image, Chute()))
    aspects = find_aspects(shape)
    counts = []
    for each, flip in ((job, 1), (other, -1)):
        poses = drop_range(each, 0, n)
        assert (poses.status == RestStatus.SETTLED).all()
        counts.append(counts_on_belt(each, aspects, poses, flip))
    assert same(*counts) > LEVEL


FLAT = {
    'groove': (VGroove(math.radians(100), pitch=0.1), {}),
    'chute with a belt': (Chute(roll=0.3), {'bodies': {'belt': {'speed': 0.2}}}),
}


@pytest.mark.slow
@pytest.mark.parametrize('name', FLAT)
def test_both_engines_have_the_same_outcomes(part, make, name):
    """By aspect on the first plane; other outcomes together."""
    shape = part('l_bracket')
    kind, more = FLAT[name]
    aspects = find_aspects(shape)
    counts = []
    for engine, n in ((KERNEL, 2000), (BULLET, 80)):  # tells differences of 0.25
        job = dataclasses.replace(make(shape, kind, engine, **more), seed=2)
        counts.append(counts_on_belt(job, aspects, drop_range(job, 0, n), 1))
    assert same(*counts) > LEVEL

"""Identification and location, and why an outline is not identified."""

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation
from shapely import affinity

import resting_aspects_ros as ra
from resting_aspects_ros.api.identify import (
    identification_hint,
    identify_part,
    known_part,
    locate_part,
)
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.vision.identification import observed_polygon
from resting_aspects_ros.vision.outline import seen_outline


@pytest.fixture(scope='module')
def bracket():
    return known_part('l_bracket')


def rotation_error(known, one, other):
    """Return the angle between two orientations modulo the symmetry of the part, degrees."""
    a, b = Rotation.from_quat(one), Rotation.from_quat(other)
    turns = [a.inv() * b * Rotation.from_matrix(s) for s in known.aspects.symmetry.rotations]
    return min(np.degrees(turn.magnitude()) for turn in turns)


def centre(known, position, orientation):
    turn = Rotation.from_quat(orientation).as_matrix()
    return position + turn @ known.part.centre_of_mass


@pytest.mark.slow
@pytest.mark.parametrize('name', ['l_bracket', 't_prism'])
def test_dropped_parts_are_identified_and_located(name, workers):
    known = known_part(name)
    poses = ra.drop(name, drops=40, seed=3, model_range=False, workers=workers).poses
    ids = known.aspects.classify(poses.orientation)
    assert (ids > 0).sum() > 30
    for k in np.flatnonzero(ids > 0):
        true = poses.orientation[k]
        place = centre(known, poses.position[k], true)
        seen = affinity.translate(seen_outline(known.part, true), *place[:2])
        found = identify_part(seen, known)
        # Two classes of the prism look alike; those of the bracket do not.
        candidates = [found.best] if name == 'l_bracket' else found.candidates
        assert any(
            rotation_error(known, true, each.orientation) < 0.5
            and np.linalg.norm((centre(known, each.position, each.orientation) - place)[:2]) < 1e-4
            for candidate in candidates
            for each in candidate.poses
        )


def test_prior_is_that_of_drops_or_is_given(bracket):
    result = ra.drop('l_bracket', model_range=False)
    expected = result.distribution.by_class().counts + 0.5
    np.testing.assert_allclose(bracket.shares, expected / expected.sum())
    np.testing.assert_allclose(known_part('l_bracket', result).shares, bracket.shares)
    assert known_part('t_prism', [0, 1, 1, 2, 0, 0]).shares.tolist() == [0.25, 0.25, 0.5, 0]
    assert known_part('t_prism', {6: 2, 1: 6}).shares.tolist() == [0.75, 0, 0, 0.25]
    with pytest.raises(InvalidValueError, match='same part'):
        known_part('t_prism', result)


@pytest.mark.parametrize('shares', [{7: 1}, [1, 2], [0] * 5, [np.nan] * 5, 'many'])
def test_wrong_shares_are_refused(shares):
    with pytest.raises(InvalidValueError, match='shares'):
        known_part('l_bracket', shares)


def test_look_alikes_of_two_parts_share_the_probability(bracket):
    rectangle = {'outer': [[0, 0], [0.02, 0], [0.02, 0.03], [0, 0.03]]}
    found = identify_part(rectangle, [bracket, ra.load_part('box_10x20x30')])
    assert {each.part for each in found.candidates} == {'l_bracket', 'box_10x20x30'}
    assert all(0.01 < each.posterior < 0.99 for each in found.candidates)


def test_pose_has_its_centre_at_that_of_the_outline(bracket):
    for aspect in (1, 2, 3, 4, 5):
        pose, *others = locate_part(bracket, aspect, 0.1, 0.05, 1.0)
        assert pose.aspect == aspect
        place = centre(bracket, pose.position, pose.orientation)
        np.testing.assert_allclose(place[:2], (0.1, 0.05), atol=1e-12)
        assert len(others) == (aspect > 2)
    for wrong in (0, 6, True):
        with pytest.raises(InvalidValueError, match='expected 1 to 5'):
            locate_part(bracket, wrong, 0, 0, 0)


def test_part_is_located_without_a_drop(monkeypatch, bracket):
    monkeypatch.setattr('resting_aspects_ros.api.identify.drop', None)
    (expected,) = locate_part(bracket, 1, 0.1, 0.05, 1.0)
    (pose,) = locate_part('l_bracket', 1, 0.1, 0.05, 1.0)
    np.testing.assert_array_equal(pose.orientation, expected.orientation)


def test_size_of_an_unknown_outline_is_named():
    washer = known_part('washer')
    outline = washer.outlines[0].polygon
    for scale, answer, words in ((1.0, 'part', ''), (10.0, 'none', 'It is 160 mm long')):
        polygon = affinity.rotate(affinity.scale(outline, scale, scale, origin=(0, 0)), 25)
        seen = observed_polygon(affinity.translate(polygon, 0.1, -0.05))
        found = identify_part(seen, washer)
        assert found.answer == answer
        assert identification_hint(found, seen, [washer]).startswith(words)
    # A missing hole does not make it touching parts.
    assert identify_part(shapely.Polygon(outline.exterior), washer).answer == 'none'

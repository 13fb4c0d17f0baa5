"""Aspects of designs are matched in the frame of their meshes."""

import numpy as np
import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.studies.batch import compare_cases, match_aspects
from resting_aspects_ros.studies.points import Case


@pytest.fixture(scope='module')
def bracket():
    part = ra.load_part('l_bracket')
    return part, ra.find_aspects(part)


def design(part, transform):
    mesh = trimesh.Trimesh(1000 * part.vertices, part.faces)
    mesh.apply_transform(transform)
    changed = part_from_bytes(mesh.export(file_type='stl'), 'stl', 'changed')
    return changed, ra.find_aspects(changed)


def test_design_in_the_same_frame_is_matched(bracket):
    longer = design(bracket[0], np.diag([1.1, 1, 1, 1]))
    pairs, apart = match_aspects(*bracket, *longer)
    assert pairs == tuple((k, k) for k in range(1, 6))
    assert 0 < apart < 0.1


def test_other_part_shares_no_aspects(bracket):
    rod = trimesh.creation.box((200, 3, 3))
    other = part_from_bytes(rod.export(file_type='stl'), 'stl', 'rod')
    assert match_aspects(*bracket, other, ra.find_aspects(other))[0] == ()


def test_difference_of_shared_aspects_is_within_its_interval(bracket):
    points, drops = 50, 1000
    generator = np.random.default_rng(1)
    shares = np.array([[0.3, 0.3, 0.2, 0.1, 0.1], [0.25, 0.3, 0.2, 0.1, 0.15]])
    other = np.zeros((points, 5), dtype=int)
    longer = design(bracket[0], np.diag([1.1, 1, 1, 1]))
    cases = [
        Case(*each, generator.multinomial(drops, p, size=points), other)
        for each, p in zip((bracket, longer), shares, strict=True)
    ]
    (found,) = compare_cases(cases, 0.999)
    assert len(found.shared) == 5
    for pair, truth in zip(found.shared, shares[1] - shares[0], strict=True):
        assert pair.lower < truth < pair.upper
        # The standard error of the mean of differences of two binomial shares.
        assert pair.upper - pair.lower < 7 * np.sqrt(2 * 0.25 / drops / points)

"""Transition matrices: every action is counted once, by aspect and by symmetry class."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.statistics.intervals import METHODS, intervals
from resting_aspects_ros.statistics.transitions import (
    OUTCOMES,
    TransitionMatrix,
    no_actions,
)

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope='module')
def aspects(solid, solids):
    """The six sides of a box, in three symmetry classes of two."""
    found = find_aspects(solid(solids.box(10, 20, 30)))
    assert [a.symmetry_class for a in found.aspects] == [1, 1, 2, 2, 3, 3]
    return found


def counted(aspects, seed, mean=20):
    shape = (len(aspects), len(aspects) + len(OUTCOMES))
    counts = np.random.default_rng(seed).poisson(mean, shape)
    return TransitionMatrix(aspects, counts.astype(np.int64))


@given(seeds, st.sampled_from([0.1, 1, 100]))
def test_probabilities_are_counts_over_the_actions_of_the_row(aspects, seed, mean):
    matrix = counted(aspects, seed, mean)
    for row, n, probability in zip(
        matrix.counts.tolist(), matrix.actions.tolist(), matrix.probability, strict=True
    ):
        assert n == sum(row)
        assert probability.tolist() == [c / n for c in row] if n else np.isnan(probability).all()


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(('by_precision', 'used'), [(False, 0.9), (True, 0.92)])
def test_bounds_of_a_row_are_the_intervals_of_its_counts(aspects, method, by_precision, used):
    # After a stop by precision the error probability is 0.8 times as large.
    matrix = dataclasses.replace(
        counted(aspects, 1), interval=method, confidence=0.9, by_precision=by_precision
    )
    lower, upper = matrix.bounds()
    for i, row in enumerate(matrix.counts):
        expected = intervals(row, int(row.sum()), method, used)
        assert lower[i] == pytest.approx([each.lower for each in expected], abs=1e-12)
        assert upper[i] == pytest.approx([each.upper for each in expected], abs=1e-12)


def test_row_without_actions_is_unknown_with_bounds_zero_to_one(aspects):
    matrix = no_actions(aspects)
    matrix.counts[1, 2] = 5
    lower, upper = matrix.bounds()
    assert np.isnan(matrix.probability).all(axis=1).tolist() == [i != 1 for i in range(6)]
    assert np.isnan(matrix.left).tolist() == [i != 1 for i in range(6)]
    assert (lower[0] == 0).all()
    assert (upper[0] == 1).all()
    assert upper[1, 2] == 1


@given(seeds)
def test_by_class_counts_each_action_by_the_classes_of_its_aspects(aspects, seed):
    # Single actions are counted by aspect, and counted again by class.
    generator = np.random.default_rng(seed)
    n = 300
    start, end = generator.integers(6, size=n), generator.integers(10, size=n)
    matrix = no_actions(aspects)
    np.add.at(matrix.counts, (start, end), 1)
    number = [a.symmetry_class - 1 for a in aspects.aspects] + [3, 4, 5, 6]
    expected = np.zeros((3, 7), dtype=np.int64)
    for i, j in zip(start.tolist(), end.tolist(), strict=True):
        expected[number[i], number[j]] += 1
    found = matrix.by_class()
    assert found.counts.tolist() == expected.tolist()
    assert found.transitions.shape == (3, 3)
    assert found.transitions.sum(axis=1) + found.left == pytest.approx(np.ones(3))


def test_matrices_of_different_actions_can_be_added(aspects):
    first = dataclasses.replace(counted(aspects, 3), energy_growth=0.2)
    second = dataclasses.replace(counted(aspects, 4), energy_growth=0.1)
    total = first + second + no_actions(aspects)
    assert total.counts.tolist() == (first.counts + second.counts).tolist()
    assert total.energy_growth == 0.2
    other = no_actions(AspectSet('another', aspects.aspects))
    with pytest.raises(ValueError, match='different parts'):
        first + other


def test_part_without_aspects_has_an_empty_matrix():
    matrix = no_actions(AspectSet('a', ()))
    assert matrix.counts.shape == matrix.by_class().counts.shape == (0, 4)
    assert [bound.shape for bound in matrix.bounds()] == [(0, 4), (0, 4)]

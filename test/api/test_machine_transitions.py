"""The transition matrix of a machine, from counts by class before and after an action."""

import dataclasses

import numpy as np
import pytest

from resting_aspects_ros.api.compare import machine_transitions
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.intervals import INTERVAL, SIMULTANEOUS, intervals
from resting_aspects_ros.statistics.transitions import no_actions


@pytest.fixture(scope='session')
def simulated(part):
    """Give a matrix of the nut: eight aspects in two classes."""
    none = no_actions(find_aspects(part('hex_nut')))
    counts = np.random.default_rng(1).integers(1, 20, size=none.counts.shape)
    return dataclasses.replace(none, counts=counts)


def test_matrix_of_the_machine_has_its_counts(simulated):
    found = machine_transitions([(1, 1, 30), (1, 2, 10)], simulated)
    assert found.machine.counts.tolist() == [[30, 10, 0, 0, 0, 0], [0] * 6]
    assert found.machine.transitions[0].tolist() == [0.75, 0.25]
    assert np.isnan(found.machine.transitions[1]).all()
    lower, upper = found.machine.bounds()
    (theirs,) = intervals([30], 40)
    assert (lower[0, 0], upper[0, 0]) == (theirs.lower, theirs.upper)
    np.testing.assert_array_equal(found.simulated.counts, simulated.by_class().counts)


def test_pairs_are_compared_with_the_simulation_by_class(simulated):
    found = machine_transitions([(1, 1, 0), (1, 2, 40)], simulated)
    by_class = simulated.by_class()
    first, second = found.comparisons
    assert (first.before, first.after, first.trials, first.successes) == (1, 1, 40, 0)
    assert second.measured.probability == 1
    assert second.difference == pytest.approx(1 - by_class.transitions[0, 1])
    assert second.lower <= second.difference <= second.upper


@pytest.mark.parametrize(
    ('measured', 'actions', 'lower', 'upper'),
    # Newcombe 1998, Statistics in Medicine 17:873, table II, method 10.
    [
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((9, 10), (3, 10), 0.1705, 0.8090),
        ((10, 10), (0, 10), 0.6075, 1.0000),
        ((0, 10), (0, 20), -0.1611, 0.2775),
    ],
)
@pytest.mark.parametrize('interval', [INTERVAL, SIMULTANEOUS])
def test_difference_has_its_published_interval(
    simulated, interval, measured, actions, lower, upper
):
    hits, trials = measured
    counts = np.zeros_like(simulated.counts)
    counts[0, [0, -1]] = actions[0], actions[1] - actions[0]
    matrix = dataclasses.replace(simulated, counts=counts, interval=interval)
    first, _ = machine_transitions([(1, 1, hits), (1, 2, trials - hits)], matrix).comparisons
    assert first.difference == pytest.approx(hits / trials - actions[0] / actions[1])
    assert (first.lower, first.upper) == pytest.approx((lower, upper), abs=5e-5)


def test_row_that_was_not_simulated_has_no_difference(simulated):
    nothing = dataclasses.replace(simulated, counts=np.zeros_like(simulated.counts))
    first, _ = machine_transitions([(1, 1, 5)], nothing).comparisons
    assert np.isnan(first.difference)
    assert (first.simulated.lower, first.simulated.upper) == (0, 1)


def test_table_is_read_from_a_file(simulated, tmp_path):
    path = tmp_path / 'pairs.csv'
    path.write_text('to;From;count\n1;2;7\n2;2;3\n')
    found = machine_transitions(path, simulated)
    assert found.machine.counts[1].tolist() == [7, 3, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ('rows', 'message'),
    [
        ([(1, 3, 5)], 'invalid transition from 1 to 3 in .*: expected each pair of the classes'),
        ([(1, 2, 5), (1, 2, 6)], 'expected each pair of the classes 1, 2 once'),
        ([(1, 2, -5)], 'invalid count -5 from 1 to 2'),
        ([(1, 2, 0.5)], 'invalid count 0.5'),
        ([(1, 2, 0)], 'expected at least one part'),
        ([], 'expected at least one part'),
    ],
)  # fmt: skip
def test_wrong_counts_are_named(simulated, rows, message):
    with pytest.raises(InvalidValueError, match=message):
        machine_transitions(rows, simulated)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'invalid column names'),
        ('class,count\n1,2\n', 'invalid column names .* expected from, to, count'),
        ('from,to,count\n1,2,nan\n', "invalid count 'nan' .* line 2"),
        ('from,to,count\n1,x,3\n', "invalid to 'x'"),
    ],
)
def test_wrong_files_are_named(simulated, tmp_path, text, message):
    path = tmp_path / 'pairs.csv'
    path.write_text(text)
    with pytest.raises(InvalidValueError, match=message):
        machine_transitions(path, simulated)

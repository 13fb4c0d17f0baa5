"""Round trips between actions, transition matrices and ROS messages, through real CDR."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import FeederAction
from wire import over_the_wire

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros.conversions import run_from, time_msg
from resting_aspects_ros.ros.distribution_conversions import (
    action_from,
    action_msg,
    check_transitions,
    serialized_transitions,
    transition_matrix_from,
    transitions_msg,
)
from resting_aspects_ros.simulation.actions import Kick, NamedAction
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix

ACTION = NamedAction('own_tap', Kick(speed=0.31, spin=11.0), 0.7)


@pytest.fixture(scope='module')
def result(part, surfaces):
    """Return a result with the given counts of the tetrahedron."""
    tetrahedron = part('tetrahedron')
    aspects = find_aspects(tetrahedron)
    _, run = plan_run(
        tetrahedron, surfaces.get(), seed=3, drops=400, run_id='4f1c', started=10**18
    )

    def result(counts, dropped=(5, 6, 7, 8), **changes):
        matrix = TransitionMatrix(aspects, np.array(counts), energy_growth=0.02, **changes)
        drop = Distribution(aspects, np.array(dropped), unclassified=1, unsettled=2, failed=3)
        return ReorientResult(matrix, ACTION, run, tetrahedron, drop, True)

    return result


@pytest.fixture(scope='module')
def message(result):
    """Return the message of distinct counts, as received."""
    made = result(np.arange(1, 33).reshape(4, 8), confidence=0.9, sliding=5)
    return over_the_wire(transitions_msg(made, time_msg(17), ended=False, frame='cell'))


def test_action_round_trip():
    shipped = shipped_actions()
    for action in (*map(shipped.get, shipped.names()), ACTION):
        message = over_the_wire(action_msg(action))
        assert message.name == action.name
        assert action_from(message).values == action.values
    rows = list(zip(message.names, message.values, message.units, strict=True))
    assert rows[0] == ('time', 0.7, 's')
    assert {('speed', 0.31, 'm/s'), ('spin', 11.0, 'rad/s')} <= set(rows)


def test_matrix_round_trip(message, result):
    made = result(np.arange(1, 33).reshape(4, 8), confidence=0.9)
    assert [getattr(message, name.upper()) for name in OUTCOMES] == list(range(message.OUTCOMES))
    assert list(message.long_run) == []
    assert (message.header.stamp, message.header.frame_id) == (time_msg(17), 'cell')
    assert (message.complete, message.ended) == (True, False)
    assert run_from(message.run) == made.run
    assert action_from(message.action) == ACTION
    assert list(message.actions) == made.matrix.actions.tolist()
    sent = [
        np.reshape(each, (4, 8)) for each in (message.probability, message.lower, message.upper)
    ]
    np.testing.assert_array_equal(sent, [made.matrix.probability, *made.matrix.bounds()])
    again = transition_matrix_from(message)
    np.testing.assert_array_equal(again.counts, made.matrix.counts)
    assert (again.interval, again.confidence) == ('wilson', 0.9)
    assert (again.energy_growth, again.sliding) == (0.02, 5)
    assert again.aspects.part_sha256 == made.part.part_sha256
    # The aspects have the counts of the drops.
    assert message.drops == made.drop.drops == 32
    assert [aspect.count for aspect in message.aspects] == [5, 6, 7, 8]


def test_long_run_describes_each_closed_class(result):
    """Aspects 1 and 2 alternate, 3 stays, and parts leave 4 for both; none is dropped into 3."""
    counts = np.zeros((4, 8), dtype=int)
    counts[0, 1] = counts[1, 0] = counts[2, 2] = 10
    counts[3, [0, 2]] = 5
    made = result(counts, dropped=(1, 0, 0, 1))
    bounded = (made.long_run, *made.long_run_bounds)
    message = over_the_wire(transitions_msg(made, time_msg(1), ended=True, long_run=bounded))
    np.testing.assert_allclose(message.long_run, [0.375, 0.375, 0.25, 0])
    assert list(message.closed_class) == [1, 1, 2, 0]
    np.testing.assert_allclose(message.closed_class_share, [0.5, 0.5, 1, 0])
    np.testing.assert_allclose(message.closed_class_weight, [0.75, 0.25])
    sent = (message.long_run_lower, message.long_run_upper)
    np.testing.assert_array_equal(sent, made.long_run_bounds)


@pytest.mark.parametrize(
    ('field', 'value', 'expected'),
    [
        ('counts', [1] * 31, 'invalid transition matrix of run '),
        ('aspects', [], 'expected a row for each aspect'),
        ('confidence', 7.0, 'invalid confidence 7.0: expected'),
        ('aspect_numbering', ASPECT_NUMBERING + 1, f'expected {ASPECT_NUMBERING}'),
        ('action', FeederAction(kind='no_kind'), 'invalid kind of action'),
        ('action', FeederAction(kind='kick', values=[1.0]), 'expected a different one for each'),
        ('action', FeederAction(kind='kick', values=[1.0], names=['mass']), 'invalid value'),
    ],
)
def test_inconsistent_matrix_is_rejected(message, field, value, expected):
    changed = over_the_wire(message)
    setattr(changed, field, value)
    assert serialized_transitions(serialize_message(message)) == message
    with pytest.raises(InvalidValueError, match=expected):
        serialized_transitions(serialize_message(changed))
    with pytest.raises(InvalidValueError, match='of part tetrahedron: expected l_bracket'):
        check_transitions(message, 'l_bracket')

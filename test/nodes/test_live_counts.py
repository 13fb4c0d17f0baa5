"""Counted parts over ROS: posterior, drift and forecasts of aspect_classifier."""

import math
import os

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from resting_aspects_interfaces.msg import (
    ObservedCounts,
    PartDescription,
    Posterior,
    Status,
    TransitionMatrix,
)
from resting_aspects_interfaces.srv import FeederForecast
from ros_graph import Diagnostics
from std_msgs.msg import Header

from resting_aspects_ros.api.compare import watch_drift
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.forecast import cycle_times, forecast_from, with_live_counts
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.logs.bag import LogOutcome
from resting_aspects_ros.ros.conversions import part_msg, time_msg
from resting_aspects_ros.ros.distribution_conversions import distribution_msg, transitions_msg
from resting_aspects_ros.ros.interface import ALL_LATCHED, LATCHED, SERVICES
from resting_aspects_ros.statistics.counted_parts import LiveCounts

PART = 'hex_nut'
SECOND = 10**9
WINDOW = 100
TRAY = [0.06, 0.06]  # a small tray is quickly forecast
QUICK = {
    'nodes.aspect_classifier.live.PERIOD': 0.05,
    'nodes.aspect_classifier.known.QUIET_PERIOD': 0.5,
    'ros.health.DIAGNOSTICS_PERIOD': 0.1,
}


@pytest.fixture(scope='module')
def simulated(part, invented):
    """An action on a nut, and its drops: invented counts of a run."""
    aspects = find_aspects(part(PART))
    first, second = (alike[0].id - 1 for alike in aspects.classes())
    counts, moved = np.zeros(len(aspects), int), np.zeros((len(aspects), len(aspects)), int)
    counts[[first, second]] = 7200, 2800
    moved[:, [first, second]] = 60, 40
    return invented(PART, counts, moved)


@pytest.fixture(scope='module')
def logs(simulated, tmp_path_factory, write_run):
    """The folder with the log of the drops."""
    message = distribution_msg(simulated.drop, simulated.run, Time(sec=1), complete=True)
    outcome = LogOutcome(simulated.drop.drops, whole=True)
    folder = tmp_path_factory.mktemp('logs')
    write_run(folder, simulated.run, outcome, distribution=message)
    return folder


class Machine:
    """A counter, a simulator that offers the nut, and a classifier."""

    def __init__(self, client, simulated):
        self.client, self.now = client, client.node.get_clock().now
        publish = client.node.create_publisher
        self.parts = publish(PartDescription, f'parts/{PART}', LATCHED)
        self.moves = publish(TransitionMatrix, f'transitions/{PART}', LATCHED)
        self.counts = publish(ObservedCounts, f'observed_counts/{PART}', LATCHED)
        self.received = client.listen(Posterior, f'posterior/{PART}', ALL_LATCHED)
        self.description = part_msg(simulated.part)

    def send(self, supplied=(), **fields):
        message = ObservedCounts(part=PART, supplied=[int(k) for k in supplied], **fields)
        self.counts.publish(message)

    def posterior(self, holds):
        def found():
            return self.received and holds(self.received[-1]) and self.received[-1]

        return self.client.wait(found, 'posterior')


@pytest.fixture(scope='module')
def machine(start, connect, simulated, logs):
    namespace = f'/test_live_counts_{os.getpid()}'
    given = {'log_folder': logs, 'drift_window': WINDOW}
    machine = Machine(connect(namespace), simulated)
    # Before the classifier starts, and before the part is known: they are received, and wait.
    machine.send([1, 0], session='before')
    machine.process = start('aspect_classifier', namespace, given, QUICK)
    return machine


@pytest.fixture(scope='module')
def status(machine):
    """Wait for the status of the classifier."""
    diagnostics = Diagnostics(machine.client)
    return lambda holds: diagnostics.wait('aspect_classifier', holds, 'status')


def test_counts_before_the_part_is_known_wait_for_it(machine, status):
    _, message, _ = status(lambda _, text, __: 'wait' in text)
    assert message == f'counts of {PART} wait: no such part is offered'
    machine.parts.publish(machine.description)
    found = machine.posterior(lambda each: each.run.run_id == 'a')
    assert (list(found.simulated), list(found.observed)) == ([7200, 2800], [1, 0])
    assert list(found.concentration) == pytest.approx([44.2, 16.8], abs=0.01)
    assert (found.window, found.message, found.drift, found.first_part) == (WINDOW, '', False, 0)
    status(lambda level, text, values: level == b'\0' and values['parts counted'] == '1')


def test_posterior_and_drift_are_those_of_the_command(machine, simulated, status):
    batches = [[36, 14], [34, 16], [30, 20], [25, 25], [24, 26], [26, 24], [3, 0]]
    for total in np.cumsum(batches, axis=0).tolist():
        machine.send(total, session='b', header=Header(stamp=time_msg(total[0] * SECOND)))
        known = 1 + sum(total)
        machine.posterior(lambda each, known=known: each.parts == known)
    found = machine.posterior(lambda each: each.drift and each.parts == 304)
    dropped = DropResult(simulated.drop, simulated.run, simulated.part, complete=True)
    expected = watch_drift(dropped, [[1, 0], *batches], window=WINDOW)
    test = expected.test
    assert list(found.concentration) == expected.live.concentration.tolist()
    assert list(found.window_end) == test.ends[1:].tolist() == [101, 201, 301]
    assert list(found.statistic) == test.g.tolist()
    assert list(found.p_value) == test.p_values.tolist()
    deviation = test.deviation
    assert (found.drift_class, found.share) == (deviation.index + 1, deviation.share)
    assert (found.deviation_lower, found.deviation_upper) == (deviation.lower, deviation.upper)
    assert found.first_part == test.ends[test.drifted.start] + 1
    # In words, with the time of the first part, also as a warning.
    assert f'since part {found.first_part} (1970-01-01 00:02:29 UTC).' in found.message
    status(lambda level, text, _: level == b'\1' and text == f'{PART}: {found.message}')


def test_invalid_counts_are_refused_with_a_reason(machine, status):
    before = machine.received[-1].parts
    for fields, message in (
        ({'part_sha256': 'other'}, "part_sha256 'other' of counts of hex"),
        ({'header': Header(stamp=Time(sec=2**31 - 1))}, 'in the future'),
    ):
        machine.send([900, 9], session='b', **fields)
        status(lambda level, text, _, message=message: level == b'\1' and message in text)
    machine.send([1, 0], session='valid')
    machine.posterior(lambda each: each.parts == before + 1)


def test_moved_parts_give_the_transitions_of_the_machine(machine, simulated):
    machine.send(session='moves', action='flip', moved=[3, 7, 40, 50])
    found = machine.posterior(lambda each: each.actions)
    assert (found.actions, found.action_run_ids) == (['flip'], [''])
    assert list(found.moved_probability) == pytest.approx([3 / 10, 7 / 10, 4 / 9, 5 / 9])
    assert all(map(math.isnan, found.simulated_probability))
    machine.moves.publish(transitions_msg(simulated, Time(sec=1), ended=True))
    # The next counts show them.
    machine.send(session='moves', action='flip', moved=[3, 7, 40, 51])
    found = machine.posterior(lambda each: list(each.moved) == [3, 7, 40, 51])
    assert found.action_run_ids == ['a']
    assert list(found.simulated_probability) == pytest.approx([0.6, 0.4, 0.6, 0.4])
    assert found.action_messages[0].startswith(
        '44 % of class 2 come to class 1 instead of 60 %: -16 (-27 to'
    )


@pytest.fixture
def ask(machine, simulated):
    """Request a forecast, once the transitions of the action are known."""
    client = machine.client.node.create_client(FeederForecast, 'forecast', qos_profile=SERVICES)
    machine.moves.publish(transitions_msg(simulated, Time(sec=1), ended=True))
    given = {'part': PART, 'classes': [1]}
    return lambda **fields: machine.client.call(client, FeederForecast.Request(**given | fields))


def forecast_of(result, *pickable, **options):
    """Return the forecast of the Python interface with the defaults of the service."""
    given = {'vibrate': None, 'settle': None, 'overlap': False, 'place': None}
    times = cycle_times(result.action, robot=1.2, image=0.2, supply=0.0, **given)
    return forecast_from(result, pickable, Tray(tuple(TRAY), 0.005), times, **options)


@pytest.mark.slow
def test_forecast_is_that_of_the_python_interface(ask, simulated, machine):
    alike = simulated.drop.aspects.classes()[0]
    expected = forecast_of(simulated, *[each.id for each in alike])
    found = ask(tray=TRAY)
    assert found.status.code == Status.OK, found.status.message
    for name in ('sentence', 'parts_per_minute', 'lower', 'upper', 'best_number', 'limited_by'):
        assert getattr(found, name) == getattr(expected, name)
    assert (found.prediction_lower, found.prediction_upper) == expected.named.forecast.prediction
    assert (found.run_id, found.drops, found.counted_parts) == ('a', 10_000, 0)

    # With the counts of the machine, of which fewer parts are pickable.
    counted = ask(use_counts=True, tray=TRAY, parts_on_tray=3)
    observed = np.array(list(machine.received[-1].observed))
    live = LiveCounts((1, 2), np.array([7200, 2800]), observed, 60.0)
    both = with_live_counts(simulated, live, np.array([[3, 7], [40, 51]]))
    expected = forecast_of(both, *[each.id for each in alike], parts_on_tray=3)
    assert counted.parts_per_minute == expected.parts_per_minute < found.parts_per_minute
    assert counted.counted_parts == observed.sum()


def test_totals_survive_a_restart_of_the_classifier(machine, start, logs):
    machine.send([5, 7], session='latched')
    machine.posterior(lambda each: each.parts > 300)
    machine.process.end()
    namespace = machine.client.node.get_namespace()
    machine.received.clear()
    machine.process = start('aspect_classifier', namespace, {'log_folder': logs}, QUICK)
    # The last message of the old process can arrive after it has ended.
    found = machine.posterior(lambda each: each.run.run_id == 'a' and each.parts < 300)
    assert list(found.observed) == [5, 7]  # of the newest message that is latched

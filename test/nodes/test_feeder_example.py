"""The example controller: a process that hears the distribution of its part, whenever it comes."""

import math
import re
import shutil
import signal
from pathlib import Path

import pytest
from resting_aspects_interfaces.msg import AspectDistribution
from scipy.stats import binomtest
from std_msgs.msg import Float64MultiArray

from resting_aspects_ros.examples import feeder
from resting_aspects_ros.ros.interface import ASPECT_DISTRIBUTIONS, LATCHED
from resting_aspects_ros.simulation.config_files import parts_folder

BOX = 'box_10x20x30'
QUICK = {'examples.feeder.HINT_DELAY': 2.0}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('parts')
    for name in (BOX, 'hex_nut', 'tetrahedron', 'washer'):
        shutil.copy(parts_folder() / f'{name}.stl', folder)
    return folder


@pytest.fixture(scope='module')
def suite(fresh_suite, folder):
    return fresh_suite(
        {'drop_simulator': {'nodes.drop_simulator.part_publisher.SCAN_PERIOD': 0.2}},
        parts_folder=folder,
    )


@pytest.fixture
def feed(start):
    """Start the feeder of a part; it ends with the test, in order."""
    started = []

    def feed(namespace, part, pickable, constants=()):
        parameters = {'part': part, 'pickable': pickable}
        started.append(start('feeder_example', namespace, parameters, constants, 'waiting for'))
        return started[-1]

    yield feed
    for process in started:
        assert process.end(signal.SIGINT) == 0
        assert 'Traceback' not in process.output


@pytest.fixture
def rates(suite):
    """Listen to what it publishes."""
    return suite.client.listen(Float64MultiArray, 'expected_pick_rate', LATCHED)


def expected(distribution, *ids):
    """Share and Wilson's interval of a sum, by an implementation that is not ours."""
    count = sum(aspect.count for aspect in distribution.aspects if aspect.id in ids)
    found = binomtest(count, distribution.drops)
    interval = found.proportion_ci(method='wilson')
    return pytest.approx([found.statistic, interval.low, interval.high], abs=1e-12)


def wait_for_rate(client, rates, values):
    """Its words and its rates come in any order, and a rate may be of the middle of a run."""
    client.wait(lambda: rates and list(rates[-1].data) == values, 'rate')


def errors(process):
    return [line for line in process.output.splitlines() if '[ERROR]' in line]


def warnings(process):
    return [line for line in process.output.splitlines() if '[WARN]' in line]


def test_late_feeder_receives_changes(suite, feed, rates):
    first = suite.client.ask('tetrahedron', 300, seed=[1]).distribution
    feeder = feed(suite.namespace, 'tetrahedron', [4, 2, 4])
    wait_for_rate(suite.client, rates, expected(first, 2, 4))
    assert [d.label for d in rates[-1].layout.dim] == ['probability, lower, upper']
    line = (
        f'{rates[-1].data[0]:.1%} of tetrahedron can be picked ({rates[-1].data[1]:.1%} to '
        f'{rates[-1].data[2]:.1%}): 300 of 300 drops on rubber_mat\n'
    )
    suite.client.wait(lambda: line in feeder.output, 'line of the answer')

    more = suite.client.ask('tetrahedron', 1500, seed=[2]).distribution
    last = expected(more, 2, 4)
    wait_for_rate(suite.client, rates, last)
    assert len(rates) > 3  # also from the middle of the run
    suite.client.wait(lambda: '1500 of 1500 drops on rubber_mat\n' in feeder.output, 'its line')
    # One when it began, one when it was over.
    assert feeder.output.count('of 1500 drops') == 2
    assert ' of 1500 drops on rubber_mat (the run continues)\n' in feeder.output
    assert warnings(feeder) == []

    late = suite.client.listen(Float64MultiArray, 'expected_pick_rate', LATCHED)
    wait_for_rate(suite.client, late, last)
    assert len(late) == 1


def test_other_conditions_are_warned_of_once(suite, feed, rates):
    feeder = feed(suite.namespace, 'washer', [1])
    suite.client.ask('washer', 40)
    suite.client.wait(lambda: '40 of 40 drops on rubber_mat' in feeder.output, 'first')
    steel = suite.client.ask('washer', 600, surface='steel').distribution
    suite.client.wait(lambda: '600 of 600 drops on steel' in feeder.output, 'second')
    wait_for_rate(suite.client, rates, expected(steel, 1))
    (line,) = warnings(feeder)
    assert line.endswith(
        f'the conditions of run {steel.run.run_id} (steel) differ from those of the previous run '
        '(rubber_mat)'
    )


@pytest.mark.slow
def test_replaced_mesh_is_warned_of_once(suite, feed, rates, folder):
    feeder = feed(suite.namespace, BOX, [1, 6])
    before = suite.client.ask(BOX, 50).distribution
    wait_for_rate(suite.client, rates, expected(before, 1, 6))
    old = suite.client.parts()[BOX].part_sha256
    shutil.copy(parts_folder() / 'cylinder_d20_h20.stl', folder / 'new')
    (folder / 'new').replace(folder / f'{BOX}.stl')
    suite.client.wait(lambda: suite.client.parts()[BOX].part_sha256 != old, 'another version')
    after = suite.client.ask(BOX, 600).distribution
    # Neither the old number, which is latched, nor one of the ids that are there.
    suite.client.wait(lambda: all(map(math.isnan, rates[-1].data)), 'no number')
    new = after.run.part_sha256
    error = suite.client.wait(lambda: errors(feeder), 'error')
    assert error[0].endswith(
        f'invalid pickable [1, 6]: expected ids from 1 to 3, the aspects of {BOX} '
        f'(part_sha256 {new}); expected_pick_rate is NaN'
    )
    (version,) = warnings(feeder)
    assert version.endswith(
        f'{BOX} has changed (part_sha256 {new}): its ids may refer to other aspects'
    )
    assert len(errors(feeder)) == 1
    assert '600 of 600 drops' not in feeder.output


@pytest.mark.parametrize('pickable', [[99], [1, 5]])
def test_unknown_aspect_is_an_error_and_the_rate_is_nan(suite, feed, rates, pickable):
    suite.client.ask('tetrahedron', 300, seed=[1])
    feeder = feed(suite.namespace, 'tetrahedron', pickable)
    suite.client.wait(lambda: rates, 'rate')
    assert [d.label for d in rates[-1].layout.dim] == ['probability, lower, upper']
    suite.client.ask('tetrahedron', 900, seed=[5])
    (line,) = suite.client.wait(lambda: errors(feeder), 'error')
    assert f'invalid pickable {pickable}: expected ids from 1 to 4' in line
    assert len(rates[-1].data) == 3
    assert all(math.isnan(number) for rate in rates for number in rate.data)
    assert 'can be picked' not in feeder.output


def test_part_without_drops_is_reported(suite, feed, wait, rates):
    feeder = feed(suite.namespace, 'hex_nut', [1])
    (line,) = wait(lambda: warnings(feeder), 'warning')
    assert line.endswith(
        'there are no drops of hex_nut yet: run "resting_aspects request hex_nut"'
    )
    assert rates == []


@pytest.mark.slow
def test_feeder_follows_a_restarted_classifier(suite, feed, rates):
    feeder = feed(suite.namespace, 'tetrahedron', [1, 3])
    few = suite.client.ask('tetrahedron', 1600, seed=[11]).distribution
    wait_for_rate(suite.client, rates, expected(few, 1, 3))
    assert suite.processes['aspect_classifier'].end() == 0
    suite.start_again('aspect_classifier')
    more = suite.client.ask('tetrahedron', 1700, seed=[12]).distribution
    wait_for_rate(suite.client, rates, expected(more, 1, 3))
    assert warnings(feeder) == []


def test_distribution_with_fewer_drops_is_ignored(suite, feed, connect, namespace):
    """As of two runs at once, of which now one and now the other is published."""
    found = {
        drops: suite.client.ask('tetrahedron', drops, seed=[drops]).distribution
        for drops in (70, 90)
    }
    steel = suite.client.ask('tetrahedron', 40, surface='steel').distribution
    client = connect(namespace)
    received = client.listen(Float64MultiArray, 'expected_pick_rate', LATCHED)
    topic = f'{ASPECT_DISTRIBUTIONS}/tetrahedron'
    classifier = client.node.create_publisher(AspectDistribution, topic, LATCHED)
    feeder = feed(namespace, 'tetrahedron', [2])
    classifier.publish(found[90])
    wait_for_rate(client, received, expected(found[90], 2))
    classifier.publish(found[70])
    client.spin(1.0)
    classifier.publish(found[90])
    client.wait(lambda: len(received) == 2, 'the same again')
    assert received[1] == received[0]
    # Of other conditions what is newest counts.
    classifier.publish(steel)
    wait_for_rate(client, received, expected(steel, 2))
    assert '70 of 70 drops' not in feeder.output
    assert feeder.output.count('90 of 90 drops') == 1


def test_example_uses_only_public_names():
    source = Path(feeder.__file__).read_text(encoding='utf-8')
    modules = re.findall(r'^\s*(?:from|import) (resting_aspects_ros[\w.]*)', source, re.MULTILINE)
    assert set(modules) == {'resting_aspects_ros.client'}


def test_feeder_can_start_before_the_suite(feed, start, connect, namespace, folder, wait):
    feeder = feed(namespace, 'tetrahedron', [1], QUICK)
    wait(lambda: warnings(feeder), 'warning')
    start('drop_simulator', namespace, {'workers': 1, 'parts_folder': folder})
    start('aspect_classifier', namespace)
    client = connect(namespace)
    rates = client.listen(Float64MultiArray, 'expected_pick_rate', LATCHED)
    found = client.ask('tetrahedron', 200).distribution
    wait_for_rate(client, rates, expected(found, 1))
    (line,) = warnings(feeder)
    topic = f'{namespace}/aspect_distributions/tetrahedron'
    assert line.endswith(
        f'{topic} has no publisher: start the suite with "resting_aspects nodes", and check that '
        'it has a part tetrahedron'
    )


def test_run_canceled_before_its_first_drop_is_ignored(suite, feed, connect, namespace):
    found = suite.client.ask('tetrahedron', 300, seed=[1]).distribution
    client = connect(namespace)
    rates = client.listen(Float64MultiArray, 'expected_pick_rate', LATCHED)
    topic = f'{ASPECT_DISTRIBUTIONS}/tetrahedron'
    classifier = client.node.create_publisher(AspectDistribution, topic, LATCHED)
    classifier.publish(AspectDistribution(run=found.run, aspects=found.aspects, complete=True))
    feeder = feed(namespace, 'tetrahedron', [3])
    # It comes when the feeder has found the topic, with what is latched there.
    client.wait(lambda: warnings(feeder), 'warning')
    assert 'there are no drops of tetrahedron yet' in feeder.output
    assert rates == []
    classifier.publish(found)
    wait_for_rate(client, rates, expected(found, 3))
    assert len(rates) == 1


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('part', 'a nut', 'Invalid topic name: '),
        ('pickable', [0, 2], 'invalid pickable [0, 2]: expected ids from 1'),
        ('pickable', [], 'invalid pickable []: expected ids from 1'),
        ('pickable', [1.5], "'pickable' to '[1.5]' of type 'DOUBLE_ARRAY', expecting"),
    ],
)
def test_invalid_parameter_is_reported_in_one_line(
    start, namespace, traceback, name, value, message
):
    process = start('feeder_example', namespace, {name: value}, ready='')
    assert process.end(number=0) == 2
    (line,) = process.output.splitlines()
    assert line.startswith('error: ')
    assert message in line
    assert not traceback(process.output)

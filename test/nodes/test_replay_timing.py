"""When replayed messages are published: rate, pause and resume, loop."""

import re
import statistics

import pytest
from resting_aspects_interfaces.msg import AspectDistribution, RestingPoses, Status
from std_srvs.srv import Trigger

from resting_aspects_ros.nodes.interface import ALL_LATCHED, LEAST_BATCH, POSES

# Batches of the log, and the time between two of them, s.
COUNT, GAP = 41, 0.1
LENGTH = COUNT * GAP
SECOND = 10**9


@pytest.fixture(scope='module')
def written(batches):
    return list(batches(COUNT))


@pytest.fixture(scope='module')
def log(written, write_log, tmp_path_factory):
    return write_log(tmp_path_factory.mktemp('log'), written, gap=GAP)


@pytest.fixture
def client(connect, namespace):
    return connect(namespace)


@pytest.fixture
def heard(client, listen_raw):
    """Batches and the times at which they were sent, ns."""
    return listen_raw(client, RestingPoses, 'resting_poses', POSES)


@pytest.fixture
def call(client):
    """Call a service of the replayer; its success, words, and position: s, length, drops."""
    services = {
        name: client.node.create_client(Trigger, f'log_replayer/{name}')
        for name in ('pause', 'resume')
    }

    def call(name):
        for service in services.values():  # resume is met last
            client.meet_service(service)
        answer = client.call(services[name], Trigger.Request())
        found = re.fullmatch(
            r'([\w ]+), at (\d+\.\d{3}) s of (\d+\.\d{3}) s, (\d+) drops', answer.message
        )
        assert found, answer.message
        return answer.success, found[1], *map(float, found.groups()[1:])

    return call


def sent(heard):
    return [time / SECOND for _, time in heard]


@pytest.mark.parametrize('rate', [1.0, 4.0])
def test_messages_are_as_far_apart_as_they_were_recorded_by_the_rate(
    client, heard, replay, log, written, rate
):
    """By the median of 21 distances over half the log, which a machine that stops hardly moves.

    A message that goes out late moves no other: its bound is 5 %, where adding up 5 ms a message
    would make 5 % at rate 1 and 20 % at rate 4.
    """
    replay(log, rate=rate)
    client.wait(lambda: len(heard) == COUNT, 'all batches')
    assert [data for data, _ in heard] == written
    times = sent(heard)
    half = COUNT // 2
    distances = [times[k + half] - times[k] for k in range(COUNT - half)]
    assert statistics.median(distances) == pytest.approx(half * GAP / rate, rel=0.05)


def test_a_pause_holds_it_up_and_then_it_goes_on_as_recorded(client, heard, replay, log, call):
    rate = 0.5
    replayer = replay(log, rate=rate)
    assert call('resume')[:2] == (True, 'not paused')
    client.wait(lambda: len(heard) >= 5, 'some batches')
    success, words, seconds, length, drops = call('pause')
    assert (success, words, length) == (True, 'paused', pytest.approx(LENGTH))
    client.spin(1.0)  # five batches would come
    count = len(heard)
    assert drops == count * LEAST_BATCH
    # The first comes a gap after the part; one that is due may not have gone out yet.
    assert count * GAP < seconds + 0.001 < (count + 2) * GAP
    assert call('pause') == (True, 'paused already', seconds, length, drops)
    assert len(heard) == count
    assert call('resume') == (True, 'resumed', seconds, length, drops)
    client.wait(lambda: len(heard) == COUNT, 'all batches')
    times = sent(heard)
    late = [time - k * GAP / rate for k, time in enumerate(times)]
    # No burst: what was due in the pause comes as far apart as it was recorded.
    before, after = statistics.median(late[:count]), statistics.median(late[count:])
    steps = [later - earlier for earlier, later in zip(late[count:], late[count + 1 :])]  # noqa: B905
    assert statistics.median(map(abs, steps)) < GAP / rate / 4
    assert after - before > 1.0
    assert times[count] - times[count - 1] >= 1.0
    client.wait(lambda: call('pause')[1] == 'over', 'end')
    for name in ('pause', 'resume'):
        assert call(name) == (False, 'over', *[pytest.approx(LENGTH)] * 2, COUNT * LEAST_BATCH)
    for word in ('paused', 'resumed'):
        told = f']: {word}, at {seconds:.3f} s of {LENGTH:.3f} s, {drops:.0f} drops'
        client.wait(lambda told=told: told in replayer.said, told)
    assert not re.search(r'\]: (paused already|not paused|over)', replayer.said)


def test_a_loop_publishes_the_same_again_and_a_classifier_counts_it_once(
    start, client, heard, replay, log, written, call, diagnostics_of
):
    told = diagnostics_of(client)
    start('aspect_classifier', client.node.get_namespace())
    distributions = client.listen(
        AspectDistribution, 'aspect_distributions/tetrahedron', ALL_LATCHED
    )
    replay(log, rate=10.0, loop=True)
    client.wait(lambda: len(heard) >= 2 * COUNT + 5, 'two rounds and more')
    assert call('pause')[:2] == (True, 'paused')
    rounds = [data for data, _ in heard]
    assert rounds == (written * (len(rounds) // COUNT + 1))[: len(rounds)]
    times = sent(heard)
    assert times[COUNT] - times[COUNT - 1] > 1.0  # a second, and the gap before the first
    told.wait(
        'log_replayer',
        lambda _, message, values: (
            (message, values['round']) == ('paused', str(len(rounds) // COUNT + 1))
        ),
        'round',
    )
    drops = COUNT * LEAST_BATCH
    client.wait(lambda: distributions and distributions[-1].complete, 'complete distribution')
    assert {one.drops for one in distributions if one.complete} == {drops}
    assert max(one.drops for one in distributions) == drops
    answer = client.ask('tetrahedron', drops, seed=[1], only_known=True)
    assert (answer.status.code, answer.distribution.drops) == (Status.OK, drops)
    assert answer.distribution.run.run_id == 'recorded'

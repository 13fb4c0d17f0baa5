"""What of a log is published again, under which names and QoS, and when."""

import pytest
from mcap.writer import Writer

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.logs.reader import Recording
from resting_aspects_ros.logs.topics import Qos, qos_profiles
from resting_aspects_ros.nodes.log_replayer.node import PAUSE_BEFORE, LogPlayer, replayed_topics
from resting_aspects_ros.ros.interface import LATCHED, offered_qos
from resting_aspects_ros.ros.interface import POSES as DEEP

# -- names and QoS --------------------------------------------------------------------------------

KINDS = {
    'poses': 'resting_aspects_interfaces/msg/RestingPoses',
    'part': 'resting_aspects_interfaces/msg/PartDescription',
    'distribution': 'resting_aspects_interfaces/msg/AspectDistribution',
    'text': 'std_msgs/msg/String',
}


@pytest.fixture
def recording(tmp_path):
    """Record a message of each topic, given by name and kind or type, with optional metadata."""

    def recording(topics, encoding='cdr', **metadata):
        path = tmp_path / 'log.mcap'
        with path.open('wb') as file:
            writer = Writer(file)
            writer.start()
            for name, kind in topics.items():
                schema = writer.register_schema(KINDS.get(kind, kind), 'ros2msg', b'')
                channel = writer.register_channel(name, encoding, schema, metadata)
                writer.add_message(channel, 1, b'\0' * 8, 1)
            writer.finish()
        return Recording(path)

    return recording


def names(recording):
    """The new names by the recorded ones, and what is left out."""
    topics, skipped = replayed_topics(recording)
    return {topic.recorded: topic.name for topic in topics}, skipped


ONE = {
    'resting_poses': 'poses',
    'parts/nut': 'part',
    'aspect_distributions/nut': 'distribution',
    'camera/left/note': 'text',
}
SEVERAL = {
    'cell_1/resting_poses': 'poses',
    'cell_2/resting_poses': 'poses',
    'cell_2/sub/parts/nut': 'part',
    'note': 'text',
}


@pytest.mark.parametrize(('namespace', 'kinds'), [('', ONE), ('/parts', ONE), ('/plant', SEVERAL)])
def test_names_are_relative_to_the_namespace_of_all_suites(recording, namespace, kinds):
    log = recording({f'{namespace}/{name}': kind for name, kind in kinds.items()})
    assert names(log) == ({f'{namespace}/{name}': name for name in kinds}, [])


def test_topics_that_cannot_be_replayed_are_skipped_and_reported(recording):
    skipped = {
        '/note': 'not in /cell, the namespace of the suite in the log',
        '/cell/drop_part/_action/status': 'hidden, as the topics of an action are',
        '/cell/a b': 'not a valid ROS topic name',
    }
    log = recording({'/cell/resting_poses': 'poses', **dict.fromkeys(skipped, 'text')})
    expected = [f'{name}: {why}' for name, why in skipped.items()]
    assert names(log) == ({'/cell/resting_poses': 'resting_poses'}, expected)


def test_log_without_a_replayable_topic_is_rejected(recording):
    log = recording({'/a': 'text', 'b': 'text'}, encoding='json')
    with pytest.raises(LogError, match=r'/a: not ROS 2 messages .*b: not in /, '):
        replayed_topics(log)


def test_recorded_qos_is_offered_or_else_the_default(recording):
    """The depth is not in a bag that rosbag2 recorded; a log of another writer has no QoS."""

    def offered(kind, **metadata):
        ((topic,), _) = replayed_topics(recording({'/x': kind}, **metadata))
        return offered_qos(topic.qos)

    given = Qos(7, 'best_effort', 'volatile', 'keep_all')
    assert offered('poses', offered_qos_profiles=yaml_text(qos_profiles(given))) == given
    bag = qos_profiles(Qos(0, durability='transient_local'))
    bag[0]['history'] = 'unknown'
    for kind, usual in (('poses', DEEP), ('distribution', LATCHED)):
        assert offered(kind) == offered_qos(usual)
        assert offered(kind, offered_qos_profiles=yaml_text(bag)) == offered_qos(usual)


# -- times ----------------------------------------------------------------------------------------

SECOND = 10**9
# Batches of the log, its first message is the part, and the time between two messages.
COUNT, GAP = 41, SECOND // 10
POSES, PART = '/cell/resting_poses', '/cell/parts/tetrahedron'
START = 5 * SECOND + PAUSE_BEFORE


class Player:
    """A replay with a simulated clock.

    published : the clock and the message, of each
    """

    def __init__(self, log, rate=None, *, loop=False):
        self.now = 5 * SECOND
        self.published = []
        recording = Recording(log)
        topics, _ = replayed_topics(recording)
        self.replay = LogPlayer(
            recording,
            topics,
            lambda message: self.published.append((self.now, message)),
            rate=rate,
            loop=loop,
            clock=lambda: self.now,
        )

    def run(self, until=None, late=0):
        """Play until the end, or until a time; each call comes so late."""
        while (wait := self.replay.play()) is not None:
            if until is not None and self.now + wait > until:
                self.now = until
                return
            self.now += wait + late

    def times(self, topic=POSES):
        return [now for now, message in self.published if message.topic == topic]


@pytest.fixture(scope='module')
def log(batches, write_log, tmp_path_factory):
    return write_log(tmp_path_factory.mktemp('log'), batches(COUNT), gap=GAP / SECOND)


@pytest.mark.parametrize(('rate', 'late'), [(0.001, 0), (1000.0, 0), (2.0, GAP // 4 - 1)])
def test_messages_have_their_time_and_delays_do_not_add_up(log, rate, late):
    player = Player(log, rate)
    player.run(late=late)
    due = [START + k * GAP / rate + late for k in range(1, COUNT + 1)]
    assert player.times() == pytest.approx(due, abs=1)
    assert player.times(PART) == [START + late]


def test_pause_delays_the_following_messages(log):
    whole, player = Player(log, 0.5), Player(log, 0.5)
    whole.run()
    player.run(until=START + SECOND)
    count = len(player.times())
    before = player.replay.position
    assert before.startswith('0.500 s of ')
    player.replay.pause()
    player.now += 100 * SECOND
    assert player.replay.play() is None
    assert (player.replay.paused, player.replay.position) == (True, before)
    player.replay.resume()
    assert (player.replay.paused, player.replay.position) == (False, before)
    player.run()
    later = [now - 100 * SECOND for now in player.times()[count:]]
    assert later == whole.times()[count:]


def test_loop_repeats_after_a_second(log):
    player = Player(log, 10.0, loop=True)
    player.run(until=20 * SECOND)
    data = [message.data for _, message in player.published]
    once = COUNT + 1
    assert len(data) > 2 * once
    assert all(data[k] == data[k % once] for k in range(len(data)))
    assert player.times(PART)[1] - player.times()[COUNT - 1] == PAUSE_BEFORE
    assert player.replay.round == len(data) // once + 1

"""Names, types and QoS under which the topics of a log are published again."""

import pytest
from mcap.writer import Writer
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.logs.reader import Recording
from resting_aspects_ros.logs.topics import Qos, qos_profiles
from resting_aspects_ros.nodes.log_replayer.node import replayed_topics
from resting_aspects_ros.ros.interface import LATCHED, POSES

INTERFACES = 'resting_aspects_interfaces/msg'
KINDS = {
    'poses': f'{INTERFACES}/RestingPoses',
    'part': f'{INTERFACES}/PartDescription',
    'distribution': f'{INTERFACES}/AspectDistribution',
    'transitions': f'{INTERFACES}/TransitionMatrix',
    'markers': 'visualization_msgs/msg/MarkerArray',
    'text': 'std_msgs/msg/String',
}


@pytest.fixture
def recording(tmp_path):
    """Record a message of each topic, given by name and kind or type, with optional metadata."""

    def recording(*topics, encoding='cdr', **metadata):
        path = tmp_path / 'log.mcap'
        with path.open('wb') as file:
            writer = Writer(file)
            writer.start()
            for name, kind in topics:
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


@pytest.mark.parametrize('namespace', ['', '/plant/cell_1', '/parts'])
def test_names_are_relative_to_the_recorded_namespace(recording, namespace):
    expected = {
        f'{namespace}/resting_poses': 'resting_poses',
        f'{namespace}/parts/nut': 'parts/nut',
        f'{namespace}/aspect_distributions/nut': 'aspect_distributions/nut',
        f'{namespace}/transitions/nut': 'transitions/nut',
        f'{namespace}/markers': 'markers',
        f'{namespace}/camera/left/note': 'camera/left/note',
    }
    kinds = ['poses', 'part', 'distribution', 'transitions', 'markers', 'text']
    assert names(recording(*zip(expected, kinds, strict=True))) == (expected, [])


def test_several_suites_keep_their_namespaces(recording):
    kinds = {
        'cell_1/resting_poses': 'poses',
        'cell_2/resting_poses': 'poses',
        'cell_2/sub/parts/nut': 'part',
        'note': 'text',
    }
    log = recording(*((f'/plant/{name}', kind) for name, kind in kinds.items()))
    assert names(log) == ({f'/plant/{name}': name for name in kinds}, [])


@pytest.mark.parametrize(
    ('name', 'kind', 'why'),
    [
        ('/note', 'text', 'not in /cell, the namespace of the suite in the log'),
        ('/cell/drop_part/_action/status', 'text', 'hidden, or not a valid ROS topic name'),
        ('/cell/a b', 'text', 'hidden, or not a valid ROS topic name'),
        ('/cell/x', 'a/srv/X_Event', 'not ROS 2 messages (type a/srv/X_Event, encoding cdr)'),
        ('/cell/x', '../msg/X', 'not ROS 2 messages (type ../msg/X, encoding cdr)'),
    ],
)
def test_topic_that_cannot_be_replayed_is_skipped_and_reported(recording, name, kind, why):
    log = recording(('/cell/resting_poses', 'poses'), (name, kind))
    assert names(log) == ({'/cell/resting_poses': 'resting_poses'}, [f'{name}: {why}'])


def test_log_without_a_replayable_topic_is_rejected(recording):
    log = recording(('/a', 'text'), ('b', 'text'), encoding='json')
    with pytest.raises(LogError) as caught:
        replayed_topics(log)
    for words in (str(log.path), '/a: not ROS 2 messages', 'b: not in /, '):
        assert words in str(caught.value)


def offered(recording):
    ((topic,), _) = replayed_topics(recording)
    qos = topic.qos
    return (qos.depth, qos.reliability, qos.durability, qos.history)


@pytest.mark.parametrize('kind', ['poses', 'part', 'text'])
def test_recorded_qos_is_offered(recording, kind):
    qos = Qos(7, 'best_effort', 'volatile', 'keep_all')
    profiles = yaml_text(qos_profiles(qos))
    assert offered(recording(('/x', kind), offered_qos_profiles=profiles)) == (
        7,
        ReliabilityPolicy.BEST_EFFORT,
        DurabilityPolicy.VOLATILE,
        HistoryPolicy.KEEP_ALL,
    )


@pytest.mark.parametrize(
    ('kind', 'usual'), [('poses', POSES), ('part', LATCHED), ('distribution', LATCHED)]
)
def test_missing_qos_of_a_suite_topic_is_the_default(recording, kind, usual):
    """The depth is not in a bag that rosbag2 recorded; a log of another writer has no QoS."""
    bag = qos_profiles(Qos(0, durability='transient_local'))
    bag[0]['history'] = 'unknown'
    expected = (usual.depth, usual.reliability, usual.durability, usual.history)
    assert offered(recording(('/x', kind))) == expected
    assert offered(recording(('/x', kind), offered_qos_profiles=yaml_text(bag))) == expected

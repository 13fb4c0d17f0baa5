"""The configs of RViz and rosbag2 name what the nodes publish. They are read here."""

from pathlib import Path

import yaml
from geometry_msgs.msg import PoseArray
from visualization_msgs.msg import MarkerArray

from resting_aspects_ros.logs.topics import Qos, qos_profiles
from resting_aspects_ros.nodes.aspect_classifier.publishers import BODIES, NAMES
from resting_aspects_ros.ros import interface
from resting_aspects_ros.ros.interface import FRAME, LATCHED

ROOT = Path(__file__).resolve().parents[2]
# The types that these displays of rviz_default_plugins subscribe to.
TYPES = {
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'rviz_default_plugins/PoseArray': 'geometry_msgs/msg/PoseArray',
}


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding='utf-8'))


def test_displays_of_rviz_match_the_messages_of_the_classifier(suite):
    manager = read('rviz/resting_aspects.rviz')['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == FRAME
    displays = {each['Topic']['Value']: each for each in manager['Displays'] if 'Topic' in each}
    assert set(displays) == {'markers', 'surroundings_markers', 'current_poses'}  # relative
    for topic, display in displays.items():

        def publishers(topic=topic):
            name = suite.client.node.resolve_topic_name(topic)
            found = suite.client.node.get_publishers_info_by_topic(name)
            # A node that is just being discovered has topics before it has a name.
            return [each for each in found if each.node_name != '_NODE_NAME_UNKNOWN_']

        (publisher,) = suite.client.wait(publishers, topic)
        assert publisher.node_name == 'aspect_classifier'
        assert publisher.topic_type == TYPES[display['Class']]
        offered, asked = publisher.qos_profile, display['Topic']
        for policy in ('Reliability', 'Durability'):
            name = getattr(offered, policy.lower()).name
            assert asked[f'{policy} Policy'].replace(' ', '_').upper() == name
        assert (asked['History Policy'], asked['Depth']) == ('Keep Last', LATCHED.depth)
    received = suite.client.listen(MarkerArray, interface.MARKERS, LATCHED)
    poses = suite.client.listen(PoseArray, interface.CURRENT_POSES, LATCHED)
    suite.client.ask('tetrahedron', 20)
    suite.client.wait(lambda: received and poses, 'markers and poses')
    assert poses[-1].header.frame_id == FRAME
    assert {marker.header.frame_id for marker in received[-1].markers} == {FRAME}
    shown = {marker.ns for marker in received[-1].markers if marker.ns}
    assert set(displays[interface.MARKERS]['Namespaces']) == shown
    assert set(displays[interface.SURROUNDINGS_MARKERS]['Namespaces']) == {BODIES, NAMES}


def test_rosbag2_receives_the_deep_topic_with_its_qos():
    """All others have at most the depth 10 with which rosbag2 subscribes."""
    ((topic, written),) = read('config/rosbag2_qos.yaml').items()
    (expected,) = qos_profiles(Qos(interface.POSES.depth, durability='transient_local'))
    assert topic == f'/{interface.RESTING_POSES}'
    assert written.items() <= expected.items()

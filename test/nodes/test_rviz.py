"""RViz's config names what the nodes publish. RViz is not on PyPI, so the config is read."""

from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import PoseArray
from visualization_msgs.msg import MarkerArray

from resting_aspects_ros.nodes.aspect_classifier.publishers import BODIES, NAMES
from resting_aspects_ros.ros.interface import (
    CURRENT_POSES,
    FRAME,
    LATCHED,
    MARKERS,
    SURROUNDINGS_MARKERS,
)

FILE = Path(__file__).resolve().parents[2] / 'rviz' / 'resting_aspects.rviz'
# The types that these displays of rviz_default_plugins subscribe to.
TYPES = {
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'rviz_default_plugins/PoseArray': 'geometry_msgs/msg/PoseArray',
}


@pytest.fixture(scope='module')
def manager():
    return yaml.safe_load(FILE.read_text(encoding='utf-8'))['Visualization Manager']


@pytest.fixture(scope='module')
def displays(manager):
    """The displays that subscribe to something, by topic."""
    return {each['Topic']['Value']: each for each in manager['Displays'] if 'Topic' in each}


def test_topics_have_the_type_and_qos_of_the_classifier(suite, displays):
    assert set(displays) == {'markers', 'surroundings_markers', 'current_poses'}  # relative
    assert all(display['Enabled'] for display in displays.values())
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
        assert asked['History Policy'] == 'Keep Last'
        assert asked['Depth'] == LATCHED.depth


def test_frame_and_namespaces_match_the_messages(suite, manager, displays):
    assert manager['Global Options']['Fixed Frame'] == FRAME
    received = suite.client.listen(MarkerArray, MARKERS, LATCHED)
    poses = suite.client.listen(PoseArray, CURRENT_POSES, LATCHED)
    suite.client.ask('tetrahedron', 20)
    suite.client.wait(lambda: received and poses, 'markers and poses')
    assert poses[-1].header.frame_id == FRAME
    assert poses[-1].poses
    assert {marker.header.frame_id for marker in received[-1].markers} == {FRAME}
    shown = {marker.ns for marker in received[-1].markers if marker.ns}
    assert set(displays[MARKERS]['Namespaces']) == shown
    assert set(displays[SURROUNDINGS_MARKERS]['Namespaces']) == {BODIES, NAMES}

"""The views of RViz and Foxglove and the QoS for rosbag2 fit what the nodes publish."""

import re
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from resting_aspects_interfaces.msg import AspectDistribution, DetectionArray, FeederAdvice
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import MarkerArray

from resting_aspects_ros.logs.topics import Qos, qos_profiles
from resting_aspects_ros.nodes.aspect_classifier.publishers import BODIES, MESHES, NAMES, TEXTS
from resting_aspects_ros.nodes.vision_example.node import ANNOTATED, CAMERA_INFO, IMAGES
from resting_aspects_ros.ros import interface
from resting_aspects_ros.ros.interface import CELL, FRAME, LATCHED

ROOT = Path(__file__).resolve().parents[2]
# Type and QoS of the topics in the views; other tests receive them with these from the nodes.
TOPICS = {
    interface.MARKERS: (MarkerArray, LATCHED),
    interface.SURROUNDINGS_MARKERS: (MarkerArray, LATCHED),
    interface.CURRENT_POSES: (PoseArray, LATCHED),
    ANNOTATED: (Image, IMAGES),
    CAMERA_INFO: (CameraInfo, IMAGES),
    interface.DETECTIONS: (DetectionArray, CELL),
    'aspect_distributions/l_bracket': (AspectDistribution, LATCHED),
    'feeder_advice/l_bracket': (FeederAdvice, LATCHED),
    'diagnostics': (DiagnosticArray, CELL),
}
NAMESPACES = {
    interface.MARKERS: {MESHES, TEXTS},
    interface.SURROUNDINGS_MARKERS: {BODIES, NAMES},
}


def read(path):
    return (ROOT / path).read_text(encoding='utf-8')


@pytest.mark.parametrize('view', ['resting_aspects', 'feeder'])
def test_displays_of_rviz_show_what_the_nodes_publish(view):
    manager = yaml.safe_load(read(f'rviz/{view}.rviz'))['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == FRAME
    displays = [each for each in manager['Displays'] if 'Topic' in each]
    assert displays
    for display in displays:
        asked = display['Topic']
        kind, qos = TOPICS[asked['Value']]  # relative names, for any namespace
        assert display['Class'] == f'rviz_default_plugins/{kind.__name__}'
        for policy in ('Reliability', 'Durability'):
            name = getattr(qos, policy.lower()).name
            assert asked[f'{policy} Policy'].replace(' ', '_').upper() == name
        assert (asked['History Policy'], asked['Depth']) == ('Keep Last', qos.depth)
        assert set(display.get('Namespaces', ())) == NAMESPACES.get(asked['Value'], set())


def test_foxglove_layout_shows_what_the_nodes_publish():
    # Types that these panels show.
    panels = {
        'imageTopic': Image,
        'calibrationTopic': CameraInfo,
        'topicToRender': DiagnosticArray,
    }
    found = re.findall(r'"(\w+)": "/([^"]+)"', read('config/foxglove/feeder.json'))
    assert {key for key, _ in found} == {*panels, 'topicPath', 'value'}
    for key, path in found:
        topic, _, field = path.partition('.')
        kind, _ = TOPICS[topic]
        assert kind == panels.get(key, kind)
        if field:
            assert field.removesuffix('[:]') in kind.get_fields_and_field_types()


def test_rosbag2_receives_the_deep_topic_with_its_qos():
    """All others have at most the depth 10 with which rosbag2 subscribes."""
    ((topic, written),) = yaml.safe_load(read('config/rosbag2_qos.yaml')).items()
    (expected,) = qos_profiles(Qos(interface.POSES.depth, durability='transient_local'))
    assert topic == f'/{interface.RESTING_POSES}'
    assert written.items() <= expected.items()

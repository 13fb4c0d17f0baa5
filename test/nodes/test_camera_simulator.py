"""camera_simulator, vision_example and feeder_controller together over ROS."""

import importlib
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from rclpy.qos import ReliabilityPolicy
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image

from resting_aspects_ros.cli.feeder_display import foxglove_layout
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.nodes.camera_simulator.node import (
    IMAGES,
    camera_info_msg,
    camera_transform,
)
from resting_aspects_ros.nodes.vision_example.node import camera_from, grey_image
from resting_aspects_ros.ros.interface import ALL_LATCHED, CELL, FRAME
from resting_aspects_ros.vision.tray_image import TrayCamera

PART = 'l_bracket'
QUICK = {'ros.diagnostics.PERIOD': 0.1, 'ros.callbacks.LOG_PERIOD': 0.0}
SECOND = 10**9


def seconds(stamp):
    return stamp.sec + stamp.nanosec / SECOND


class Watch:
    """Everything that a running cell says."""

    def __init__(self, client, namespace):
        self.client = client
        self.images = client.listen(Image, 'camera/image_raw', IMAGES)
        self.seen = client.listen(DetectionArray, 'detections', CELL)
        self.results = client.listen(PickResult, 'pick_result', CELL)
        self.advice = client.listen(FeederAdvice, f'feeder_advice/{PART}', ALL_LATCHED)
        self.clock = client.listen(Clock, f'{namespace}/clock', IMAGES)

    def picked(self):
        return [each for each in self.results if each.result == PickResult.PICKED]


@pytest.fixture(scope='module')
def cell(start, connect, few_parts):
    """A running cell."""
    namespace = f'/test_camera_simulator_{os.getpid()}'
    clock = ['-r', f'/clock:={namespace}/clock']
    simulated = {'part': PART, 'use_sim_time': 'true'}
    camera = {'part': PART, 'px_per_mm': 3.0, 'seed': 2}
    watch = Watch(connect(namespace), namespace)
    nodes = {
        'drop_simulator': start('drop_simulator', namespace, {'parts_folder': few_parts(PART)}),
        'aspect_classifier': start('aspect_classifier', namespace, {'log_folder': "''"}),
        'feeder_controller': start(
            'feeder_controller', namespace, simulated, QUICK, arguments=clock
        ),
        'vision_example': start('vision_example', namespace, simulated, QUICK, arguments=clock),
        'camera_simulator': start('camera_simulator', namespace, camera, QUICK, arguments=clock),
    }
    return watch, nodes, namespace


@pytest.mark.slow
def test_parts_are_picked_in_simulated_time(cell):
    watch, _, _ = cell
    watch.client.wait(lambda: len(watch.picked()) >= 8, 'picks')
    results = list(watch.results)
    assert all(each.result in (PickResult.PICKED, PickResult.MOVED) for each in results)
    stamps = [seconds(each.header.stamp) for each in results]
    assert stamps == sorted(stamps)
    # A pick takes 1.2 s, and a flip or a supply at least 0.6 s.
    for before, after, each in zip(stamps, stamps[1:], results[1:], strict=False):
        least = 1.2 if each.result == PickResult.PICKED else 0.6
        assert after - before > least - 1e-6
    clock = [seconds(each.clock) for each in watch.clock]
    assert clock == sorted(clock)
    # The advice to an image that was exposed at a time is given at that time.
    exposed = {each.image: each.header.stamp for each in watch.seen}
    advised = [each for each in watch.advice if each.picks and each.image in exposed]
    assert advised
    for each in advised:
        assert seconds(each.header.stamp) >= seconds(exposed[each.image])


@pytest.mark.slow
def test_vision_that_stops_is_named_and_continued(cell, start, diagnostics_of):
    watch, nodes, namespace = cell
    diagnostics = diagnostics_of(watch.client)
    nodes['vision_example'].end()
    diagnostics.wait(
        'camera_simulator', lambda level, text, _: 'no advice' in text, 'missing vision'
    )
    time = watch.clock[-1].clock
    nodes['vision_example'] = start(
        'vision_example',
        namespace,
        {'part': PART, 'use_sim_time': 'true'},
        arguments=['-r', f'/clock:={namespace}/clock'],
    )
    picks = len(watch.picked())
    watch.client.wait(lambda: len(watch.picked()) > picks, 'picks')
    # Simulated time stood still.
    assert any(each.clock == time for each in watch.clock[-2000:])


# -- without a graph -----------------------------------------------------------------------------


def test_camera_info_is_the_camera_of_the_simulator():
    camera = TrayCamera((0.2, 0.1), 4.0)
    found = camera_from(camera_info_msg(camera, Image().header))
    pixels = np.array([[0.0, 0.0], [300.0, 20.0], [17.5, 401.0]])
    np.testing.assert_allclose(found.to_tray(pixels), camera.model.to_tray(pixels), atol=1e-12)
    with pytest.raises(InvalidValueError, match='invalid K'):
        camera_from(CameraInfo())


def test_transform_to_the_optical_frame_gives_the_pixels_of_the_camera():
    camera = TrayCamera((0.2, 0.1), 4.0)
    transform = camera_transform('tray', 'camera_optical_frame')
    assert (transform.header.frame_id, transform.child_frame_id) == (
        'tray',
        'camera_optical_frame',
    )
    place, turn = transform.transform.translation, transform.transform.rotation
    tray_from_camera = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
    points = np.array([[0.01, 0.02, 0.0], [-0.03, 0.04, 0.0]])
    seen = tray_from_camera.inv().apply(points - [place.x, place.y, place.z])
    assert (seen[:, 2] > 0).all()  # z is forward
    matrix = np.reshape(camera_info_msg(camera, Image().header).k, (3, 3))
    pixels = (matrix @ (seen / seen[:, 2:]).T).T[:, :2]
    np.testing.assert_allclose(camera.model.to_tray(pixels), points[:, :2], atol=1e-12)


@pytest.mark.parametrize(
    'values', [{'encoding': '16UC1'}, {'data': bytes(2)}, {'height': 0, 'data': b''}]
)
def test_bad_image_is_refused(values):
    good = {'height': 2, 'width': 3, 'step': 3, 'encoding': 'mono8', 'data': bytes(6)}
    with pytest.raises(InvalidValueError):
        grey_image(Image(**{**good, **values}))


def test_qos_overrides_of_a_parameter_are_checked(start, connect, namespace):
    client, topic = connect(namespace), f'{namespace}/camera/image_raw'
    name = f'qos_overrides.{topic}.subscription.reliability'
    start('vision_example', namespace, {name: 'best_effort'})
    client.wait(lambda: client.node.count_subscribers(topic), topic)
    (found,) = client.node.get_subscriptions_info_by_topic(topic)
    assert found.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    with pytest.raises(InvalidValueError, match='qos_overrides'):
        start('vision_example', namespace, {name: 'some'})


@pytest.mark.parametrize('encoding', ['mono8', 'rgb8', 'bgr8'])
def test_images_are_read_with_padding_of_their_rows(encoding):
    channels = 1 if encoding == 'mono8' else 3
    pixels = np.zeros((2, 3, channels), dtype=np.uint8)
    pixels[1, 2] = 200
    rows = np.pad(pixels.reshape(2, -1), ((0, 0), (0, 5)), constant_values=77)
    message = Image(height=2, width=3, step=rows.shape[1], encoding=encoding, data=rows.tobytes())
    assert grey_image(message).tolist() == [[0, 0, 0], [0, 0, 200]]


VIEWS = Path(__file__).resolve().parents[2]
# Types that the panels of Foxglove and the display of RViz show.
PANEL_TYPES = {
    'imageTopic': 'sensor_msgs/msg/Image',
    'calibrationTopic': 'sensor_msgs/msg/CameraInfo',
    'topicToRender': 'diagnostic_msgs/msg/DiagnosticArray',
}


def shown_paths(value, key=''):
    """Give (key, path) of everything in a Foxglove layout that is the path of a message."""
    if isinstance(value, dict):
        for name, each in value.items():
            yield from shown_paths(each, name)
    elif isinstance(value, list):
        for each in value:
            yield from shown_paths(each, key)
    elif isinstance(value, str) and value.startswith('/'):
        yield key, value


def fields_of(kind):
    """Return the types of the fields of a message type such as std_msgs/msg/Header."""
    package, _, name = kind.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name).get_fields_and_field_types()


def published_type(watch, topic):
    """Return the only type of a topic, when it has a publisher."""

    def types():
        found = watch.client.node.get_publishers_info_by_topic(topic)
        return {each.topic_type for each in found}

    (kind,) = watch.client.wait(types, topic)
    return kind


def test_foxglove_layout_shows_what_the_nodes_publish(cell):
    watch, _, namespace = cell
    found = list(shown_paths(json.loads(foxglove_layout(PART, namespace))))
    text = (VIEWS / 'config' / 'foxglove' / 'feeder.json').read_text(encoding='utf-8')
    assert json.loads(foxglove_layout(PART)) == json.loads(text)
    assert {'imageTopic', 'calibrationTopic', 'topicToRender', 'topicPath', 'value'} == {
        key for key, _ in found
    }
    for key, path in found:
        topic, *fields = re.split(r'[.\[]', path)
        kind = published_type(watch, topic)
        assert kind == PANEL_TYPES.get(key, kind)
        for field in [each for each in fields if not each.endswith(']')]:
            kind = fields_of(kind)[field]
            indexed = f'{field}[' in path
            assert indexed == kind.startswith('sequence<')
            kind = kind.removeprefix('sequence<').removesuffix('>')


@pytest.mark.slow
def test_rviz_shows_the_annotated_image(cell):
    watch, _, namespace = cell
    text = (VIEWS / 'rviz' / 'feeder.rviz').read_text(encoding='utf-8')
    manager = yaml.safe_load(text)['Visualization Manager']
    (display,) = [each for each in manager['Displays'] if 'Topic' in each]
    asked = display['Topic']
    assert display['Class'] == 'rviz_default_plugins/Image'
    assert not asked['Value'].startswith('/')
    topic = f'{namespace}/{asked["Value"]}'
    assert published_type(watch, topic) == 'sensor_msgs/msg/Image'
    (publisher,) = watch.client.node.get_publishers_info_by_topic(topic)
    assert asked['Reliability Policy'].upper() == publisher.qos_profile.reliability.name
    assert asked['Durability Policy'].upper() == publisher.qos_profile.durability.name
    images = watch.client.listen(Image, topic, IMAGES)
    watch.client.wait(lambda: images, 'annotated images')
    assert images[-1].header.frame_id == 'camera_optical_frame'
    assert manager['Global Options']['Fixed Frame'] == FRAME
    assert images[-1].encoding == 'rgb8'

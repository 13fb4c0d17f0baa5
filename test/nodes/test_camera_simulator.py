"""camera_simulator, vision_example and feeder_controller together over ROS."""

import itertools
import os

import numpy as np
import pytest
from rclpy.qos import ReliabilityPolicy
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from ros_graph import Diagnostics
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.nodes.camera_simulator.node import (
    IMAGES,
    camera_info_msg,
    camera_transform,
)
from resting_aspects_ros.nodes.vision_example.node import camera_from, grey_image
from resting_aspects_ros.ros.interface import ALL_LATCHED, CELL
from resting_aspects_ros.vision.tray_image import TrayCamera

PART = 'l_bracket'
QUICK = {'ros.health.DIAGNOSTICS_PERIOD': 0.1, 'ros.callbacks.LOG_PERIOD': 0.0}


def seconds(stamp):
    return stamp.sec + stamp.nanosec / 1e9


class Watch:
    """Everything that a running cell says."""

    def __init__(self, client, namespace):
        self.client, self.namespace = client, namespace
        self.seen = client.listen(DetectionArray, 'detections', CELL)
        self.results = client.listen(PickResult, 'pick_result', CELL)
        self.advice = client.listen(FeederAdvice, f'feeder_advice/{PART}', ALL_LATCHED)
        self.clock = client.listen(Clock, f'{namespace}/clock', IMAGES)

    def picks(self):
        return [each.result for each in self.results].count(PickResult.PICKED)


@pytest.fixture(scope='module')
def cell(start, connect, few_parts):
    """A running cell."""
    namespace = f'/test_camera_simulator_{os.getpid()}'
    watch = Watch(connect(namespace), namespace)

    def begin(node, **parameters):
        clock = ['-r', f'/clock:={namespace}/clock']
        given = {'part': PART, **parameters}
        return start(node, namespace, given, QUICK, arguments=clock)

    start('drop_simulator', namespace, {'parts_folder': few_parts(PART)})
    start('aspect_classifier', namespace, {'log_folder': "''"})
    begin('feeder_controller', use_sim_time='true')
    watch.begin_vision = lambda: begin('vision_example', use_sim_time='true')
    watch.vision = watch.begin_vision()
    begin('camera_simulator', px_per_mm=3.0, seed=2)
    return watch


@pytest.mark.slow
def test_parts_are_picked_in_simulated_time(cell):
    cell.client.wait(lambda: cell.picks() >= 5, 'picks')
    # A pick takes 1.2 s, and a flip or a supply at least 0.6 s.
    for before, each in itertools.pairwise(list(cell.results)):
        least = 1.2 if each.result == PickResult.PICKED else 0.6
        assert seconds(each.header.stamp) - seconds(before.header.stamp) > least - 1e-6
    # The advice to an image that was exposed at a time is given at that time.
    exposed = {each.image: each.header.stamp for each in cell.seen}
    advised = [each for each in cell.advice if each.picks and each.image in exposed]
    assert advised
    for each in advised:
        assert seconds(each.header.stamp) >= seconds(exposed[each.image])


@pytest.mark.slow
def test_vision_that_stops_is_named_and_continued(cell):
    diagnostics = Diagnostics(cell.client)
    cell.vision.end()
    diagnostics.wait('camera_simulator', lambda _, text, __: 'no advice' in text, 'no vision')
    time = cell.clock[-1].clock
    cell.vision = cell.begin_vision()
    picks = cell.picks()
    cell.client.wait(lambda: cell.picks() > picks, 'picks')
    # Simulated time stood still.
    assert any(each.clock == time for each in cell.clock[-2000:])


def test_transform_to_the_camera_gives_its_pixels():
    camera = TrayCamera((0.2, 0.1), 4.0)
    transform = camera_transform('tray', 'camera_optical_frame').transform
    place, turn = transform.translation, transform.rotation
    tray_from_camera = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
    points = np.array([[0.01, 0.02, 0.0], [-0.03, 0.04, 0.0]])
    seen = tray_from_camera.inv().apply(points - [place.x, place.y, place.z])
    assert (seen[:, 2] > 0).all()  # z is forward
    info = camera_info_msg(camera, Image().header)
    pixels = (np.reshape(info.k, (3, 3)) @ (seen / seen[:, 2:]).T).T[:, :2]
    for model in (camera.model, camera_from(info)):
        np.testing.assert_allclose(model.to_tray(pixels), points[:, :2], atol=1e-12)
    with pytest.raises(InvalidValueError, match='invalid K'):
        camera_from(CameraInfo())


def test_images_are_read_with_padding_of_their_rows():
    for encoding, channels in (('mono8', 1), ('rgb8', 3)):
        pixels = np.zeros((2, 3, channels), dtype=np.uint8)
        pixels[1, 2] = 200
        rows = np.pad(pixels.reshape(2, -1), ((0, 0), (0, 5)), constant_values=77)
        good = {'height': 2, 'width': 3, 'step': rows.shape[1], 'data': rows.tobytes()}
        found = grey_image(Image(encoding=encoding, **good))
        assert found.tolist() == [[0, 0, 0], [0, 0, 200]]
    for wrong in ({'encoding': '16UC1'}, {'data': bytes(2)}, {'height': 0, 'data': b''}):
        with pytest.raises(InvalidValueError):
            grey_image(Image(**{'encoding': 'rgb8', **good, **wrong}))


def test_qos_overrides_of_a_parameter_are_checked(start, connect, namespace):
    client, topic = connect(namespace), f'{namespace}/camera/image_raw'
    name = f'qos_overrides.{topic}.subscription.reliability'
    start('vision_example', namespace, {name: 'best_effort'})
    client.wait(lambda: client.node.count_subscribers(topic), topic)
    (found,) = client.node.get_subscriptions_info_by_topic(topic)
    assert found.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    with pytest.raises(InvalidValueError, match='qos_overrides'):
        start('vision_example', namespace, {name: 'some'})

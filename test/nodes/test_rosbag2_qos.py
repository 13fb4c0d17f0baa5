"""The QoS overrides for `ros2 bag record`, read as rosbag2 reads them."""

from pathlib import Path

import pytest
import rclpy
import yaml
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from resting_aspects_interfaces.msg import RestingPoses

from resting_aspects_ros.ros import interface

FILE = Path(__file__).resolve().parents[2] / 'config' / 'rosbag2_qos.yaml'
# What rosbag2 subscribes with by default, but for what it adapts to the publisher.
ROSBAG2_DEPTH = 10
POLICIES = {
    'history': HistoryPolicy,
    'reliability': ReliabilityPolicy,
    'durability': DurabilityPolicy,
}


def overrides():
    """The profiles by topic, as ros2bag.api.convert_yaml_to_qos_profile makes them."""
    return {
        topic: QoSProfile(
            **{
                key: POLICIES[key].get_from_short_key(value) if key in POLICIES else value
                for key, value in profile.items()
            }
        )
        for topic, profile in yaml.safe_load(FILE.read_text(encoding='utf-8')).items()
    }


def test_deep_topics_are_overridden_with_their_qos():
    published = {
        f'/{interface.RESTING_POSES}': interface.POSES,
        f'/{interface.MARKERS}': interface.LATCHED,
        f'/{interface.CURRENT_POSES}': interface.LATCHED,
        f'/{interface.DEFAULT_CONDITIONS}': interface.LATCHED,
    }
    assert overrides() == {
        topic: qos for topic, qos in published.items() if qos.depth > ROSBAG2_DEPTH
    }


@pytest.mark.parametrize('count', [48, 150])
def test_late_subscriber_with_overrides_gets_all_batches(wait, count):
    profile = overrides()['/resting_poses']
    default = QoSProfile(depth=ROSBAG2_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    received, kept = [], []
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        node = rclpy.create_node('rosbag2_qos', context=context, namespace=f'qos_{count}')
        publisher = node.create_publisher(RestingPoses, 'resting_poses', interface.POSES)
        for k in range(count):
            publisher.publish(RestingPoses(first_drop=k))
        node.create_subscription(
            RestingPoses, 'resting_poses', lambda message: kept.append(message.first_drop), default
        )
        node.create_subscription(
            RestingPoses,
            'resting_poses',
            lambda message: received.append(message.first_drop),
            profile,
        )
        assert publisher.wait_for_all_acked()
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        wait(
            lambda: count - 1 in received and count - 1 in kept,
            'the last batch',
            step=lambda: executor.spin_once(0.1),
        )
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)
    assert received == list(range(count))
    assert len(kept) < count  # so the overrides are needed

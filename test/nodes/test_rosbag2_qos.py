"""The QoS overrides for `ros2 bag record`, read as rosbag2 reads them."""

from pathlib import Path

import yaml
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

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

"""The QoS overrides for `ros2 bag record`."""

from pathlib import Path

import yaml

from resting_aspects_ros.logs.topics import Qos, qos_profiles
from resting_aspects_ros.ros.interface import POSES, RESTING_POSES

FILE = Path(__file__).resolve().parents[2] / 'config' / 'rosbag2_qos.yaml'


def test_deep_topic_is_overridden_with_its_qos():
    """All others have at most the depth 10 with which rosbag2 subscribes."""
    (written,) = qos_profiles(Qos(POSES.depth, durability='transient_local'))
    (found,) = yaml.safe_load(FILE.read_text(encoding='utf-8')).items()
    assert found[0] == f'/{RESTING_POSES}'
    assert found[1].items() <= written.items()

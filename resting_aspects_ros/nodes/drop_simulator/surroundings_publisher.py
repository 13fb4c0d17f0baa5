"""Publisher of the surroundings of runs."""

from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import SurroundingsDescription

from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.interface import SURROUNDINGS, SURROUNDINGS_QOS
from resting_aspects_ros.ros.surroundings_conversions import surroundings_msg
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.scene import Scene


class SurroundingsPublisher:
    """Publishes surroundings/<part> before the first drop of each run in surroundings.

    Parameters
    ----------
    frame : frame of the published poses
    """

    def __init__(self, node: Node, frame: str) -> None:
        self._node = node
        self._frame = frame
        self._publishers: dict[str, Publisher] = {}

    def publish(self, run: RunDescription, scene: Scene) -> None:
        """Publish the surroundings of a new run; nothing for the infinite level plane."""
        if scene.level:
            return
        if run.part not in self._publishers:
            topic = f'{SURROUNDINGS}/{run.part}'
            self._publishers[run.part] = advertise(
                self._node, SurroundingsDescription, topic, SURROUNDINGS_QOS
            )
        self._publishers[run.part].publish(surroundings_msg(run, scene, self._frame))

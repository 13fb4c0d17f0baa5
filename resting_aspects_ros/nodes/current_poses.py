"""The newest resting poses of the newest run, as a type that RViz shows."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from std_msgs.msg import Header

from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.nodes.callbacks import advertise
from resting_aspects_ros.nodes.convert import pose_msg
from resting_aspects_ros.nodes.interface import CURRENT_POSES, FRAME, LATCHED

# All lie around the tray's origin: more than this cannot be told from each other.
MOST_SHOWN = 100


class CurrentPoses:
    """Publishes current_poses: the newest drops of a run that came to rest, as they came.

    Nothing is made while nobody listens; who comes later gets the newest.
    """

    def __init__(self, node: Node, frame: str = FRAME) -> None:
        self._frame = frame
        self._publisher = advertise(node, PoseArray, CURRENT_POSES, LATCHED)
        self._run_id = ''
        self._position = np.zeros((0, 3))
        self._orientation = np.zeros((0, 4))
        self._stamp = Time()
        self._changed = False

    def take(self, run_id: str, poses: RestingPoses, stamp: Time) -> None:
        """Take a batch; the poses of another run are forgotten."""
        known = len(self._position) if run_id == self._run_id else 0
        settled = np.flatnonzero(poses.status == RestStatus.SETTLED)[-MOST_SHOWN:]
        position = np.concatenate([self._position[:known], poses.position[settled]])
        orientation = np.concatenate([self._orientation[:known], poses.orientation[settled]])
        self._position, self._orientation = position[-MOST_SHOWN:], orientation[-MOST_SHOWN:]
        self._run_id, self._stamp, self._changed = run_id, stamp, True

    def publish(self) -> None:
        """Publish them if they are new and somebody listens."""
        if not self._changed or not self._publisher.get_subscription_count():
            return
        self._changed = False
        rows = zip(self._position.tolist(), self._orientation.tolist(), strict=True)
        self._publisher.publish(
            PoseArray(
                header=Header(stamp=self._stamp, frame_id=self._frame),
                poses=[pose_msg(position, orientation) for position, orientation in rows],
            )
        )

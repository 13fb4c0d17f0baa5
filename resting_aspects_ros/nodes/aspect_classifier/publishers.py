"""Publishers of the classifier: distributions by part, markers of one part, and poses."""

from collections.abc import Callable

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import AspectDistribution
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from resting_aspects_ros.nodes.aspect_classifier.markers import PartMarkers, SurroundingsMarkers
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.nodes.aspect_classifier.tallies import Tally
from resting_aspects_ros.ros.callbacks import WorkTimer, advertise
from resting_aspects_ros.ros.conversions import pose_msg
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    CURRENT_POSES,
    FRAME,
    LATCHED,
    MARKERS,
)
from resting_aspects_ros.ros.parameters import FRAME_ID, Parameter, check_frame, on_change
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# A message of markers can have 1.4 MB: a slow connection needs a longer period.
PUBLISH_PERIOD = Parameter(
    'publish_period',
    0.2,
    'interval at which distributions, markers and poses of active runs are published, s',
    bounds=(0.05, 10.0),
    changeable=True,
)
# Maximum number of poses. All are around the origin of the tray: more are indistinguishable.
MAX_SHOWN = 100


class DistributionPublisher:
    """Publishes aspect_distributions/<part>, markers of the last changed part, and current_poses.

    The markers are those of the part and those of its surroundings.

    It publishes at most every publish_period, a parameter of the node, and at the end of each run.
    Its timer runs only while something has changed or a subscriber has appeared.
    """

    def __init__(self, node: Node, parts: PartRegistry, files: FileWorker) -> None:
        self._node = node
        self._parts = parts
        self._outputs: dict[str, Publisher] = {}
        self._changed: dict[str, Tally] = {}  # by part, in the order of changes
        self._published: dict[str, tuple[tuple[object, ...], int]] = {}  # by part: kind, drops
        period = node.get_parameter(PUBLISH_PERIOD.name).value
        self._timer = WorkTimer(node, period, 'distributions are not published', self._work)
        self._markers = advertise(node, MarkerArray, MARKERS, LATCHED, matched=self._on_matched)
        # The distribution whose markers are not published yet, and its stamp.
        self._newest: tuple[Tally, Time] | None = None
        self._frame = check_frame(node.get_parameter(FRAME_ID.name).value)
        self._surroundings = SurroundingsMarkers(node, parts, files, self._frame)
        self.poses = CurrentPosesPublisher(node, self._timer.start, self._frame)
        self._shown: tuple[str, PartMarkers] | None = None  # part_sha256, its markers
        on_change(node, PUBLISH_PERIOD.name, PUBLISH_PERIOD.check, self._timer.set_period)

    def offer(self, part: str) -> Publisher:
        """Return the publisher of a part; creates it with the first call."""
        if part not in self._outputs:
            topic = f'{ASPECT_DISTRIBUTIONS}/{part}'
            self._outputs[part] = advertise(self._node, AspectDistribution, topic, LATCHED)
        return self._outputs[part]

    def change(self, tally: Tally) -> None:
        """Store a distribution to be published next, unless one with more drops is published.

        One of another version of the part or of other conditions is replaced in any case.
        """
        part, kind = tally.run.part, _kind(tally)
        waiting = self._changed.get(part)
        more = [self._published.get(part, (None, 0))]
        more += [(_kind(waiting), waiting.drops)] if waiting is not None else []
        if any(known == kind and drops > tally.drops for known, drops in more):
            return
        self._changed.pop(part, None)
        self._changed[part] = tally
        self._timer.start()

    def restore(self, tally: Tally) -> None:
        """Store the distribution of earlier runs, unless its part version is published."""
        part = tally.run.part
        published = self._published.get(part, ((None,), 0))[0]
        if published[0] != tally.run.part_sha256 and part not in self._changed:
            self.change(tally)

    def publish(self) -> None:
        """Publish the changed distributions, markers and poses."""
        changed, self._changed = self._changed, {}
        for part, tally in changed.items():
            stamp = self._node.get_clock().now().to_msg()
            message = distribution_msg(
                tally.counted, tally.run, stamp, tally.complete, self._frame
            )
            self.offer(part).publish(message)
            self._published[part] = _kind(tally), tally.drops
        if changed:
            newest = next(reversed(changed.values()))
            self._newest = newest, stamp
            self._surroundings.show(newest.run)
        self._publish_markers()
        self.poses.publish()

    def _publish_markers(self) -> None:
        """Publish the markers of the newest distribution: at its end, or for a subscriber.

        A message takes many times as long as a distribution.
        """
        if self._newest is None:
            return
        newest, stamp = self._newest
        if newest.complete or self._markers.get_subscription_count():
            self._newest = None
            markers = self._markers_of(newest.run.part_sha256)
            self._markers.publish(markers.message(newest.counted, stamp))

    def _work(self) -> bool:
        self.publish()
        return False

    def _on_matched(self, _: object) -> None:
        self._timer.start()

    def _markers_of(self, part_sha256: str) -> PartMarkers:
        if self._shown is None or self._shown[0] != part_sha256:
            part, aspects = self._parts.version(part_sha256)
            self._shown = (part_sha256, PartMarkers(part, aspects, self._frame))
        return self._shown[1]


def _kind(tally: Tally) -> tuple[str, object]:
    """Return what two distributions have in common that can replace each other."""
    return tally.run.part_sha256, tally.run.conditions.key()


class CurrentPosesPublisher:
    """Publishes current_poses: the newest settled drops of a run.

    Without a subscriber it does not create messages; a late subscriber receives the newest poses.

    changed : called when there are new poses, or a subscriber has appeared
    """

    def __init__(self, node: Node, changed: Callable[[], None], frame: str = FRAME) -> None:
        self._frame = frame
        self._on_change = changed
        self._publisher = advertise(
            node, PoseArray, CURRENT_POSES, LATCHED, matched=lambda _: changed()
        )
        self._run_id = ''
        self._position = np.zeros((0, 3))
        self._orientation = np.zeros((0, 4))
        self._stamp = Time()
        self._changed = False

    def take(self, run_id: str, poses: RestingPoses, stamp: Time) -> None:
        """Store the poses of a batch; those of another run are removed."""
        known = len(self._position) if run_id == self._run_id else 0
        settled = np.flatnonzero(poses.status == RestStatus.SETTLED)[-MAX_SHOWN:]
        position = np.concatenate([self._position[:known], poses.position[settled]])
        orientation = np.concatenate([self._orientation[:known], poses.orientation[settled]])
        self._position, self._orientation = position[-MAX_SHOWN:], orientation[-MAX_SHOWN:]
        self._run_id, self._stamp, self._changed = run_id, stamp, True
        self._on_change()

    def publish(self) -> None:
        """Publish the poses if they are new and the topic has a subscriber."""
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

"""Recording of the surroundings of runs."""

import time
from collections.abc import Mapping

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import SurroundingsDescription

from resting_aspects_ros.logs.topics import Topic
from resting_aspects_ros.nodes.drop_recorder.status_publisher import RecordedRunsPublisher
from resting_aspects_ros.ros.interface import SURROUNDINGS, SURROUNDINGS_QOS, offered_qos
from resting_aspects_ros.ros.surroundings_conversions import check_surroundings
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.run_logs.recorder import RunRecorder

# Maximum number of descriptions that are kept, with meshes. Those of a run can arrive before its
# first poses, and a log can be opened again for drops that were lost.
MAX_KEPT = 20


class SurroundingsRecorder:
    """Subscribes to surroundings/* and writes each description into the log of its run.

    Parameters
    ----------
    logs : the open logs by run id
    reports : publishes the state of the logs
    """

    def __init__(
        self, node: Node, logs: Mapping[str, RunRecorder], reports: RecordedRunsPublisher
    ) -> None:
        self._logs = logs
        self._reports = reports
        self._kept: dict[str, tuple[SurroundingsDescription, bytes]] = {}  # by run id
        self._watch = TopicDiscovery(
            node, SURROUNDINGS, SurroundingsDescription, self._take, raw=True, qos=SURROUNDINGS_QOS
        )

    def write(self, log: RunRecorder) -> None:
        """Write the surroundings of a run into its log, if they have arrived."""
        if log.has_surroundings or (kept := self._kept.get(log.run.run_id)) is None:
            return
        message, data = kept
        if (message.part, message.document) != (log.run.part, log.run.conditions.surroundings_key):
            return
        topic = Topic(
            self._watch.topic(message.part), self._watch.type_name, offered_qos(SURROUNDINGS_QOS)
        )
        log.write_surroundings(topic, data, message, time.time_ns())
        self._reports.written(log)

    def _take(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, SurroundingsDescription)
        check_surroundings(message, part)
        self._kept[message.run_id] = message, data
        while len(self._kept) > MAX_KEPT:
            self._kept.pop(next(iter(self._kept)))
        if (log := self._logs.get(message.run_id)) is not None:
            self.write(log)

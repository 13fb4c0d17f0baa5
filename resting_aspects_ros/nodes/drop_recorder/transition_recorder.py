"""Recording of actions: a log of each run, with its transition matrix."""

import time
from collections.abc import Callable

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import TransitionMatrix

from resting_aspects_ros.logs.topics import Topic
from resting_aspects_ros.nodes.drop_recorder.status_log import StatusLog
from resting_aspects_ros.ros.conversions import nanoseconds, run_from
from resting_aspects_ros.ros.interface import ALL_LATCHED, LATCHED, TRANSITIONS, offered_qos
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.ros.transition_conversions import check_transitions
from resting_aspects_ros.run_logs.recorder import RunRecorder
from resting_aspects_ros.simulation.job import RunDescription


class TransitionRecorder:
    """Subscribes to transitions/*, and writes every matrix to the log of its run.

    Parameters
    ----------
    log_of : returns the log of a run of actions, opened by the first call; None if the run has
        ended
    ended : called when the last matrix of a run was written
    reports : reports errors
    """

    def __init__(
        self,
        node: Node,
        log_of: Callable[[RunDescription], RunRecorder | None],
        ended: Callable[[RunRecorder], None],
        reports: StatusLog,
    ) -> None:
        self._log_of = log_of
        self._ended = ended
        self._reports = reports
        self._discovery = TopicDiscovery(
            node, TRANSITIONS, TransitionMatrix, self._record, raw=True, qos=ALL_LATCHED
        )

    def _record(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, TransitionMatrix)
        check_transitions(message, part)
        if (log := self._log_of(run_from(message.run))) is None:
            return
        topic = Topic(self._discovery.topic(part), self._discovery.type_name, offered_qos(LATCHED))
        log.write(topic, data, time.time_ns(), nanoseconds(message.header.stamp))
        if log.being_written:
            log.drops = sum(message.actions)
        if message.ended:
            self._ended(log)
        self._reports.written(log)

"""Recording of actions: a log of each run, with its transition matrix."""

import time
from collections import deque
from collections.abc import Callable

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import TransitionMatrix

from resting_aspects_ros.logs.topics import Topic
from resting_aspects_ros.nodes.drop_recorder.status_publisher import RecordedRunsPublisher
from resting_aspects_ros.ros.conversions import nanoseconds, run_from
from resting_aspects_ros.ros.interface import ALL_LATCHED, LATCHED, TRANSITIONS, offered_qos
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.ros.transition_conversions import check_transitions
from resting_aspects_ros.run_logs.recorder import RunRecorder
from resting_aspects_ros.simulation.job import RunDescription

# Maximum number of runs that are remembered, because their last matrix is published again.
MAX_ENDED = 10_000


class TransitionRecorder:
    """Subscribes to transitions/*, and writes every matrix to the log of its run.

    Parameters
    ----------
    open_log : returns the log of a run of actions; the first call opens it
    reports : publishes the state of the logs
    abandoned : returns whether the simulator of a run is gone, from the times of the first and
        of the last matrix
    """

    def __init__(
        self,
        node: Node,
        open_log: Callable[[RunDescription], RunRecorder],
        reports: RecordedRunsPublisher,
        abandoned: Callable[[float, float], bool],
    ) -> None:
        self._open_log = open_log
        self._reports = reports
        self._abandoned = abandoned
        # With the times of the first and of the last matrix.
        self._active: dict[str, tuple[RunRecorder, float, float]] = {}
        self._ended: deque[str] = deque(maxlen=MAX_ENDED)
        self._discovery = TopicDiscovery(
            node, TRANSITIONS, TransitionMatrix, self._record, raw=True, qos=ALL_LATCHED
        )

    def end_abandoned(self) -> None:
        """End the logs of runs whose simulator is gone; to be called regularly."""
        for log, began, heard in list(self._active.values()):
            if self._abandoned(began, heard):
                self._end(log, whole=False)

    def _record(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, TransitionMatrix)
        check_transitions(message, part)
        run = run_from(message.run)
        if run.run_id in self._ended:
            return
        log = self._open_log(run)
        topic = Topic(self._discovery.topic(part), self._discovery.type_name, offered_qos(LATCHED))
        log.write(topic, data, time.time_ns(), nanoseconds(message.header.stamp))
        if log.being_written:
            log.drops = sum(message.actions)
        now = time.monotonic()
        _, began, _ = self._active.get(run.run_id, (log, now, now))
        self._active[run.run_id] = log, began, now
        if message.ended:
            self._end(log, whole=True)
        self._reports.written(log, always=message.ended)

    def _end(self, log: RunRecorder, *, whole: bool) -> None:
        del self._active[log.run.run_id]
        self._ended.append(log.run.run_id)
        log.has_distribution = True  # no further message of the run is expected
        log.run_is_over(whole=whole)

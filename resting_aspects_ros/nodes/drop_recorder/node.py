"""The node that writes a log of every run, of drops or of actions, with its part."""

import sys
import time
from collections import deque

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription, RestingPoses

from resting_aspects_ros.logs.topics import POSES_TYPE, Topic
from resting_aspects_ros.nodes.drop_recorder.feeder_recorder import FeederRecorder
from resting_aspects_ros.nodes.drop_recorder.log_folder import (
    FolderLock,
    absolute_folder,
    check_log_folder,
)
from resting_aspects_ros.nodes.drop_recorder.status_publisher import RecordedRunsPublisher
from resting_aspects_ros.nodes.drop_recorder.surroundings_recorder import SurroundingsRecorder
from resting_aspects_ros.nodes.drop_recorder.transition_recorder import TransitionRecorder
from resting_aspects_ros.nodes.run_tracking.health import RunHealth
from resting_aspects_ros.nodes.run_tracking.run_progress import RunProgress
from resting_aspects_ros.nodes.run_tracking.tracker import RunTracker
from resting_aspects_ros.ros.callbacks import guarded, steady_timer, subscribe
from resting_aspects_ros.ros.conversions import check_description, nanoseconds, poses_from
from resting_aspects_ros.ros.diagnostics import Diagnosis, RateCounter, publish_diagnostics
from resting_aspects_ros.ros.formatting import count_text
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    ASPECT_DISTRIBUTIONS,
    DROP_RECORDER,
    LATCHED,
    PARTS,
    POSES,
    RESTING_POSES,
    offered_qos,
)
from resting_aspects_ros.ros.liveliness import DuplicateNodeDetector
from resting_aspects_ros.ros.parameters import Parameter, declare, on_change
from resting_aspects_ros.ros.spin import run_node
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.run_logs.recorder import RunRecorder
from resting_aspects_ros.simulation.job import RunDescription

PARAMETERS = (
    Parameter(
        'log_folder',
        'out/logs',
        'folder of the logs, in which each run has a folder of its own',
        allowed='a folder that exists or can be made',
        changeable=True,
    ),
)
# Maximum number of kept distributions of runs whose log is not open yet.
MAX_EARLY = 100
# Time between two checks for complete logs, which are then closed, s.
CLOSE_PERIOD = 0.2


class DropRecorder(Node):
    """Records resting_poses, parts/*, surroundings/*, aspect_distributions/* and transitions/*.

    Each run of drop_part and of reorient_part has an MCAP log of its own. The topics of a feeder,
    detections, pick_result, feeder_advice/*, observed_counts/* and posterior/*, have others.
    """

    def __init__(self) -> None:
        super().__init__(DROP_RECORDER)
        values = declare(self, PARAMETERS)
        self._lock = FolderLock(self.get_namespace())
        self._set_folder(values['log_folder'])
        on_change(self, 'log_folder', self._check_folder, self._set_folder)
        self._logs: dict[str, RunRecorder] = {}
        self._parts: dict[str, tuple[PartDescription, bytes]] = {}
        # A distribution can arrive before the poses that it counts.
        self._early: deque[tuple[AspectDistribution, bytes]] = deque(maxlen=MAX_EARLY)
        self._drops = RateCounter()
        self._reports = RecordedRunsPublisher(self)
        self._tracker = RunTracker(self, self._end_run, self._is_recorded)
        self._health = RunHealth(self, self._tracker)
        self._part_watch = TopicDiscovery(
            self, PARTS, PartDescription, self._record_part, raw=True
        )
        self._surroundings = SurroundingsRecorder(self, self._logs, self._reports)
        self._distribution_watch = TopicDiscovery(
            self,
            ASPECT_DISTRIBUTIONS,
            AspectDistribution,
            self._record_distribution,
            raw=True,
            qos=ALL_LATCHED,
        )
        self._transitions = TransitionRecorder(
            self,
            lambda run: self._log(run, 'actions'),
            self._reports,
            self._tracker.is_abandoned,
        )
        self._feeder = FeederRecorder(
            self, lambda: self._folder, lambda part: self._parts.get(part, (None, None))[1]
        )
        self._poses = Topic(self.resolve_topic_name(RESTING_POSES), POSES_TYPE, offered_qos(POSES))
        subscribe(self, RestingPoses, RESTING_POSES, self._record_batch, POSES, raw=True)
        close = guarded(self, 'logs are not closed', self._close_finished)
        steady_timer(self, CLOSE_PERIOD, close)
        duplicates = DuplicateNodeDetector(
            self, DROP_RECORDER, harmless_reason='each writes a log of every run'
        )
        publish_diagnostics(self, self._diagnose, duplicates)
        self.get_logger().info(f'ready: logs are written to {self._folder}')

    def close(self) -> None:
        """Close the logs of unfinished runs, so that they are readable."""
        self._tracker.destroy()
        for run_id in list(self._logs):
            self._close(run_id)
        self._feeder.close()
        self._lock.release()

    def _set_folder(self, path: str) -> None:
        """Set the folder of the logs of runs that start from now on."""
        self._folder = absolute_folder(path)
        self._lock.take(self._folder)

    def _check_folder(self, path: str) -> None:
        self._lock.take(check_log_folder(path))

    def _record_batch(self, data: bytes) -> None:
        message = deserialize_message(data, RestingPoses)
        poses_from(message)  # an invalid batch is rejected, and requested again like a lost one
        if (accepted := self._tracker.accept(message)) is None:
            return
        progress, new = accepted
        log = self._log(progress.run)
        if new or not message.poses:
            drops = sum(end - first for first, end in new)
            stamp = nanoseconds(message.header.stamp)
            self._drops.add(log.write_poses(self._poses, data, self._now(), stamp, drops))
            self._reports.written(log, always=message.last)
        self._tracker.settle(progress)

    def _log(self, run: RunDescription, unit: str = 'drops') -> RunRecorder:
        """Return the log of a run; open it for the first message."""
        if run.run_id not in self._logs:
            log = self._logs[run.run_id] = RunRecorder(self._folder, run, unit)
            self._reports.started(log)
            if run.part in self._parts:
                self._write_part(log, *self._parts[run.part])
            self._surroundings.write(log)
            for message, data in self._early:
                self._write_distribution(log, message, data)
        return self._logs[run.run_id]

    def _record_part(self, name: str, data: bytes) -> None:
        message = deserialize_message(data, PartDescription)
        check_description(message, name)
        self._parts[name] = (message, data)
        for log in self._logs.values():
            if log.run.part == name:
                self._write_part(log, *self._parts[name])

    def _write_part(self, log: RunRecorder, part: PartDescription, data: bytes) -> None:
        if log.has_part or part.part_sha256 != log.run.part_sha256:
            return
        topic = Topic(
            self._part_watch.topic(log.run.part), self._part_watch.type_name, offered_qos(LATCHED)
        )
        log.write_part(topic, data, part, self._now())
        self._reports.written(log)

    def _record_distribution(self, _: str, data: bytes) -> None:
        message = deserialize_message(data, AspectDistribution)
        log = self._logs.get(message.run.run_id)
        if log is None:
            self._early.append((message, data))
        else:
            self._write_distribution(log, message, data)
            if log.done:  # closed at once, because a request waits for the log
                self._close(log.run.run_id)

    def _write_distribution(
        self, log: RunRecorder, message: AspectDistribution, data: bytes
    ) -> None:
        if (log.run.run_id, log.run.part) != (message.run.run_id, message.run.part):
            return
        watch = self._distribution_watch
        topic = Topic(watch.topic(log.run.part), watch.type_name, offered_qos(LATCHED))
        log.write(topic, data, self._now(), nanoseconds(message.header.stamp))
        log.has_distribution = log.has_distribution or message.complete
        self._reports.written(log)

    def _is_recorded(self, run: RunDescription) -> bool:
        return self._logs[run.run_id].earlier is not None

    def _end_run(self, progress: RunProgress) -> None:
        self._logs[progress.run.run_id].run_is_over(whole=progress.complete)

    def _close_finished(self) -> None:
        self._transitions.end_abandoned()
        self._feeder.close_idle()
        for run_id in [run_id for run_id, log in self._logs.items() if log.done]:
            self._close(run_id)

    def _close(self, run_id: str) -> None:
        log = self._logs.pop(run_id)
        self._reports.closed(log, log.close())

    def _diagnose(self) -> Diagnosis:
        files = [str(log.folder) for log in self._logs.values() if log.being_written]
        files += [self._feeder.file] if self._feeder.file else []
        values = {
            'drops recorded': self._drops.total,
            'drops per second': self._drops.rate(),
            'messages of the feeder recorded': self._feeder.messages,
            'logs open': len(files),
            'log files': ', '.join(files),
            'log folder': self._folder,
            **self._health.values(),
        }
        state = self._health.state
        if files and not state:
            state = count_text(len(files), 'log open', 'logs open')
        errors = [each for each in (self._reports.error, self._feeder.problem) if each]
        return Diagnosis(state, values, self._health.warnings(), errors)

    def _now(self) -> int:
        return time.time_ns()  # not ROS time, which can be paused


def main() -> int:
    """Run the node alone in this process."""
    return run_node(DropRecorder, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())

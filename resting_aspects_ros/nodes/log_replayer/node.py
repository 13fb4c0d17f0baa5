"""The node that replays a log on the topics of the suite."""

import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.logs.mcap_file import LoggedMessage
from resting_aspects_ros.logs.reader import Recording
from resting_aspects_ros.nodes.log_replayer.player import (
    LogPlayer,
    ReplayPosition,
    replayed_topics,
)
from resting_aspects_ros.ros.callbacks import advertise, steady_timer
from resting_aspects_ros.ros.conversions import time_msg
from resting_aspects_ros.ros.diagnostics import Diagnosis, publish_diagnostics
from resting_aspects_ros.ros.discovery import CLOCK, LivelinessMonitor, announce, clock_conflicts
from resting_aspects_ros.ros.formatting import count_text
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, LOG_REPLAYER, PAUSE, RESUME, SERVICES
from resting_aspects_ros.ros.parameters import Parameter, declare
from resting_aspects_ros.ros.spin import run_node

MIN_RATE, MAX_RATE = 0.001, 1000.0
PARAMETERS = (
    Parameter('log', '', 'log to replay: the folder of a run, or an .mcap file'),
    Parameter('rate', 1.0, 'speed of the replay, relative to the recording', (MIN_RATE, MAX_RATE)),
    Parameter('as_fast_as_possible', False, 'ignore the recorded times; requires rate 1.0'),
    Parameter('loop', False, 'start again one second after the end'),
    Parameter('clock', False, 'publish the recorded time on /clock, for nodes with use_sim_time'),
)
# Maximum time between two calls of ``watch``, ns.
WATCH_PERIOD = 100_000_000


class LogReplayer(Node):
    """Publishes the topics of a log, and /clock on request; serves ~/pause and ~/resume.

    It keeps running after the last message so that late subscribers receive latched topics.

    Parameters
    ----------
    given : values of parameters, which override those of --ros-args
    watch : called regularly with the position
    options : of rclpy.node.Node, such as the namespace and the context
    """

    def __init__(
        self,
        given: Mapping[str, Any] | None = None,
        watch: Callable[[ReplayPosition], object] = lambda _: None,
        **options: Any,
    ) -> None:
        overrides = [RosParameter(name, value=value) for name, value in (given or {}).items()]
        super().__init__(LOG_REPLAYER, parameter_overrides=overrides, **options)
        values = declare(self, PARAMETERS)
        _check_rate(values['rate'], values['as_fast_as_possible'])
        recording = Recording(_log(values['log']))
        self._log = recording.path
        topics, skipped = replayed_topics(recording)
        self._outputs = {
            topic.recorded: advertise(self, topic.message, topic.name, topic.qos, overridable=True)
            for topic in topics
        }
        self._watch = watch
        self._started = time.monotonic()
        self._replay = LogPlayer(
            recording,
            topics,
            self._publish,
            rate=None if values['as_fast_as_possible'] else values['rate'],
            loop=values['loop'],
        )
        self._clock_output = (
            self.create_publisher(Clock, CLOCK, QoSProfile(depth=1)) if values['clock'] else None
        )
        self.create_service(Trigger, PAUSE, self._pause, qos_profile=SERVICES)
        self.create_service(Trigger, RESUME, self._resume, qos_profile=SERVICES)
        self._simulators = LivelinessMonitor(self, DROP_SIMULATOR)
        announce(self, LOG_REPLAYER)
        publish_diagnostics(self, self._diagnose)
        if recording.warning:
            self.get_logger().warning(recording.warning)
        for topic_and_reason in skipped:
            self.get_logger().warning(f'not replayed: {topic_and_reason}')
        self.get_logger().info(
            f'ready: {recording.path}, {count_text(len(topics), "topic", "topics")}, '
            f'{self._replay.position.length:.3f} s'
        )
        self._timer = steady_timer(self, 0.0, self._step)

    def _publish(self, message: LoggedMessage) -> None:
        self._outputs[message.topic].publish(message.data)

    def _step(self) -> None:
        """Publish the messages that are due, and schedule the next step."""
        wait = self._replay.play()
        position = self._replay.position
        self._watch(position)
        if self._clock_output is not None:
            self._clock_output.publish(Clock(clock=time_msg(position.time)))
        if wait is None:
            self._timer.cancel()
        else:
            self._step_after(min(wait, WATCH_PERIOD))
        if position.over:
            self.get_logger().info(
                f'replayed in {time.monotonic() - self._started:.3f} s: '
                f'{count_text(position.messages, "message", "messages")}; '
                'latched topics stay available until Ctrl-C'
            )

    def _step_after(self, wait: int) -> None:
        self._timer.timer_period_ns = wait
        self._timer.reset()

    def _diagnose(self) -> Diagnosis:
        position = self._replay.position
        values = {
            'log': self._log,
            'at': position,
            'messages published': position.messages,
            'round': position.round,
        }
        state = 'over' if position.over else 'paused' if position.paused else 'replaying'
        warnings = []
        if self._simulators.count:
            warnings = [f'a {DROP_SIMULATOR} in this namespace publishes on the same topics']
            self.get_logger().warning(warnings[0], once=True)
        if self._clock_output is not None:
            warnings += clock_conflicts(self)
        return Diagnosis(state, values, warnings)

    def _pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._replay.paused:
            return self._answer(response, 'already paused')
        self._replay.pause()
        return self._answer(response, 'paused', changed=True)

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._replay.paused:
            return self._answer(response, 'not paused')
        self._replay.resume()
        self._step_after(0)
        return self._answer(response, 'resumed', changed=True)

    def _answer(
        self, response: Trigger.Response, state: str, *, changed: bool = False
    ) -> Trigger.Response:
        position = self._replay.position
        self._watch(position)
        response.success = not position.over
        response.message = f'{"over" if position.over else state}, at {position}'
        if changed and not position.over:
            self.get_logger().info(response.message)
        return response


def _log(path: str) -> Path:
    if not path:
        raise InvalidValueError("invalid log '': expected the folder of a run, or an .mcap file")
    return Path(path)


def _check_rate(rate: float, as_fast_as_possible: bool) -> None:
    if as_fast_as_possible and rate != 1.0:
        raise InvalidValueError(f'invalid rate {rate}: expected 1.0 with as_fast_as_possible')


def main() -> int:
    """Run the node alone in this process."""
    return run_node(LogReplayer, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())

"""Example of a feeder controller that publishes the share of the parts that a robot can pick.

It calls no service. The distribution of its part is latched on aspect_distributions/<part>, so it
may start before the suite, after it or in the middle of a run, and receives every change. It needs
only the messages of the suite and resting_aspects_ros.client.
"""

import argparse
import math
import signal
import sys

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from resting_aspects_interfaces.msg import AspectDistribution
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from resting_aspects_ros.client import Interval, InvalidValueError, probability_of

# Name, default and description of each.
PARAMETERS = (
    ('part', 'l_bracket', 'name of the part that is fed'),
    ('pickable', [1], 'ids of the aspects in which the robot can pick it'),
)
EXPECTED_PICK_RATE = 'expected_pick_rate'
# What data[0], data[1] and data[2] are; all are NaN if the part lacks an aspect of `pickable`.
LABEL = 'probability, lower, upper'
# A hint is logged if no distribution has arrived within this time, s.
HINT_DELAY = 5.0
# The newest message, also for late subscribers, which have to request this QoS as well.
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class FeederExample(Node):
    """Subscribes to aspect_distributions/<part>; publishes expected_pick_rate."""

    def __init__(self) -> None:
        super().__init__('feeder_example')
        values = {}
        for name, default, description in PARAMETERS:
            descriptor = ParameterDescriptor(description=description, read_only=True)
            values[name] = self.declare_parameter(name, default, descriptor).value
        self._part, self._pickable = values['part'], sorted(set(values['pickable'] or ()))
        if not self._pickable or self._pickable[0] < 1:
            raise InvalidValueError(f'invalid pickable {self._pickable}: expected ids from 1')
        self._newest: AspectDistribution | None = None
        self._logged: set[object] = set()
        self._rate = self.create_publisher(Float64MultiArray, EXPECTED_PICK_RATE, LATCHED)
        topic = f'aspect_distributions/{self._part}'
        self._input = self.create_subscription(AspectDistribution, topic, self._update, LATCHED)
        # A timer with the node's clock does not run with use_sim_time and without a /clock topic.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._hint_timer = self.create_timer(HINT_DELAY, self._log_hint, clock=steady)
        self.get_logger().info(f'waiting for {self._input.topic_name}')

    def _update(self, message: AspectDistribution) -> None:
        """Publish the probability of the pickable aspects in a distribution."""
        previous = self._newest
        if message.drops == 0 or (previous is not None and _has_fewer_drops(message, previous)):
            return
        known = {aspect.id for aspect in message.aspects}
        missing = [k for k in self._pickable if k not in known]
        try:
            share = probability_of(message, known.intersection(self._pickable))
        except InvalidValueError as error:
            self._warn_once(
                f'a message on {self._input.topic_name} is not used: {error}',
            )
            return
        self._hint_timer.cancel()
        self._newest = message
        self._warn_of_changes(previous or message, message)
        data = [math.nan] * 3 if missing else [share.probability, share.lower, share.upper]
        layout = MultiArrayLayout(dim=[MultiArrayDimension(label=LABEL, size=3, stride=3)])
        self._rate.publish(Float64MultiArray(layout=layout, data=data))
        if missing:
            error_text = (
                f'invalid pickable {self._pickable}: expected ids from 1 to {len(known)}, the '
                f'aspects of {self._part} (part_sha256 {message.run.part_sha256}); '
                f'{EXPECTED_PICK_RATE} is NaN'
            )
            if self._is_new(error_text):
                self.get_logger().error(error_text)
            return
        # During a run the distribution is published five times a second: it is logged only once.
        if self._is_new((message.run.run_id, message.complete)):
            self.get_logger().info(self._summary(message, share))

    def _warn_of_changes(self, previous: AspectDistribution, message: AspectDistribution) -> None:
        """Warn if the part or the conditions changed."""
        old, new = previous.run, message.run
        if old.part_sha256 != new.part_sha256:
            self._warn_once(
                f'{self._part} has changed (part_sha256 {new.part_sha256}): its ids may refer to '
                'other aspects',
            )
        if old.conditions != new.conditions:
            self._warn_once(
                f'the conditions of run {new.run_id} ({_surface(message)}) differ from those of '
                f'the previous run ({_surface(previous)})',
            )

    def _summary(self, message: AspectDistribution, share: Interval) -> str:
        state = '' if message.complete else ' (the run continues)'
        return (
            f'{share.probability:.1%} of {self._part} can be picked ({share.lower:.1%} to '
            f'{share.upper:.1%}): {message.drops} of {message.run.drops} drops on '
            f'{_surface(message)}{state}'
        )

    def _log_hint(self) -> None:
        """Log once why no distribution has arrived, and what to do."""
        self._hint_timer.cancel()
        if self.count_publishers(self._input.topic_name):
            hint = (
                f'there are no drops of {self._part} yet: run "resting_aspects request '
                f'{self._part}"'
            )
        else:
            hint = (
                f'{self._input.topic_name} has no publisher: start the suite with '
                f'"resting_aspects nodes", and check that it has a part {self._part}'
            )
        self.get_logger().warning(hint)

    def _warn_once(self, text: str) -> None:
        if self._is_new(text):
            self.get_logger().warning(text)

    def _is_new(self, fact: object) -> bool:
        """Return whether the fact was not logged before."""
        new = fact not in self._logged
        self._logged.add(fact)
        return new


def _has_fewer_drops(message: AspectDistribution, known: AspectDistribution) -> bool:
    """Return whether ``known`` has more drops of the same part under the same conditions.

    This happens when two runs overlap, or when a new run starts.
    """
    new, old = message.run, known.run
    same = (new.part_sha256, new.conditions) == (old.part_sha256, old.conditions)
    return bool(same and message.drops < known.drops)


def _surface(message: AspectDistribution) -> str:
    return message.run.conditions.surface or 'own conditions'


def main() -> int:
    """Run the node until it is stopped; returns the exit code."""
    lines = [f'  {name:9} {text} (default {default})' for name, default, text in PARAMETERS]
    parser = argparse.ArgumentParser(
        usage='%(prog)s [--ros-args -p name:=value ... -r __ns:=/namespace]',
        description='\n'.join(
            ['Publishes the share of the parts that can be picked.', '', 'parameters:', *lines]
        ),
        epilog='Ctrl-C ends it.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(remove_ros_args(sys.argv)[1:])
    # rclpy handles Ctrl-C. Python would also raise KeyboardInterrupt, in the middle of a callback,
    # where the C++ code of rclpy turns it into other errors.
    signal.signal(signal.SIGINT, lambda *_: None)
    try:
        rclpy.init()
        rclpy.spin(FeederExample())
    except ExternalShutdownException:
        pass  # the normal way to stop a node
    except (InvalidValueError, ParameterException, NameValidationException) as error:
        print('error:', ' '.join(str(error).split()), file=sys.stderr)
        return 2
    except Exception:
        if rclpy.ok():
            raise
        # Otherwise Ctrl-C stopped ROS while a callback was publishing.
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())

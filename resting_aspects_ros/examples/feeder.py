"""Example of a feeder controller that publishes the share of the parts that a robot can pick.

It calls no service. The distribution of its part is latched on aspect_distributions/<part>, so it
may start before the suite, after it or in the middle of a run, and receives every change. It needs
only the messages of the suite and resting_aspects_ros.client.
"""

import argparse
import math
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
PATIENCE = 5.0
# The newest message, also for late subscribers, which have to request this QoS as well.
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class FeederExample(Node):
    """Subscribes to aspect_distributions/<part>; publishes expected_pick_rate."""

    def __init__(self) -> None:
        super().__init__('feeder_example')
        values = {}
        for name, default, words in PARAMETERS:
            descriptor = ParameterDescriptor(description=words, read_only=True)
            values[name] = self.declare_parameter(name, default, descriptor).value
        self._part, self._pickable = values['part'], sorted(set(values['pickable'] or ()))
        if not self._pickable or self._pickable[0] < 1:
            raise InvalidValueError(f'invalid pickable {self._pickable}: expected ids from 1')
        self._newest: AspectDistribution | None = None
        self._said: set[object] = set()
        self._rate = self.create_publisher(Float64MultiArray, EXPECTED_PICK_RATE, LATCHED)
        topic = f'aspect_distributions/{self._part}'
        self._input = self.create_subscription(AspectDistribution, topic, self._take, LATCHED)
        # A timer of the node would stand still where nobody publishes simulated time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._patience = self.create_timer(PATIENCE, self._nothing_yet, clock=steady)
        self.get_logger().info(f'waits for {self._input.topic_name}')

    def _take(self, message: AspectDistribution) -> None:
        """Publish what a distribution says of the pickable aspects."""
        before = self._newest
        if message.drops == 0 or (before is not None and _says_less(message, before)):
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
        self._patience.cancel()
        self._newest = message
        self._compare(before or message, message)
        data = [math.nan] * 3 if missing else [share.probability, share.lower, share.upper]
        layout = MultiArrayLayout(dim=[MultiArrayDimension(label=LABEL, size=3, stride=3)])
        self._rate.publish(Float64MultiArray(layout=layout, data=data))
        if missing:
            words = (
                f'invalid pickable {self._pickable}: expected ids from 1 to {len(known)}, the '
                f'aspects of {self._part} (part_sha256 {message.run.part_sha256}); '
                f'{EXPECTED_PICK_RATE} is NaN'
            )
            if self._is_new(words):
                self.get_logger().error(words)
            return
        # While a run is under way its numbers change five times a second.
        if self._is_new((message.run.run_id, message.complete)):
            self.get_logger().info(self._in_words(message, share))

    def _compare(self, before: AspectDistribution, message: AspectDistribution) -> None:
        """Warn of what changes the meaning of the ids or of the probabilities."""
        old, new = before.run, message.run
        if old.part_sha256 != new.part_sha256:
            self._warn_once(
                f'{self._part} is another version than before (part_sha256 {new.part_sha256}): '
                'its ids may mean other aspects',
            )
        if old.conditions != new.conditions:
            self._warn_once(
                f'run {new.run_id} was dropped under other conditions ({_surface(message)}) than '
                f'the one before ({_surface(before)})',
            )

    def _in_words(self, message: AspectDistribution, share: Interval) -> str:
        state = '' if message.complete else ' so far, more are to come'
        return (
            f'{share.probability:.1%} of {self._part} can be picked ({share.lower:.1%} to '
            f'{share.upper:.1%}): {message.drops} of {message.run.drops} drops on '
            f'{_surface(message)}{state}'
        )

    def _nothing_yet(self) -> None:
        """Say once what is missing, and what to do."""
        self._patience.cancel()
        if self.count_publishers(self._input.topic_name):
            words = f'nobody has dropped {self._part} yet: resting_aspects request {self._part}'
        else:
            words = (
                f'nobody publishes {self._input.topic_name}: start the suite with '
                f'"resting_aspects nodes", and see whether it has a part {self._part}'
            )
        self.get_logger().warning(words)

    def _warn_once(self, words: str) -> None:
        if self._is_new(words):
            self.get_logger().warning(words)

    def _is_new(self, fact: object) -> bool:
        """Return whether it was not logged before."""
        new = fact not in self._said
        self._said.add(fact)
        return new


def _says_less(message: AspectDistribution, known: AspectDistribution) -> bool:
    """Whether more drops of the same are known: of two runs at once, or of one that has begun."""
    new, old = message.run, known.run
    same = (new.part_sha256, new.conditions) == (old.part_sha256, old.conditions)
    return bool(same and message.drops < known.drops)


def _surface(message: AspectDistribution) -> str:
    return message.run.conditions.surface or 'own conditions'


def main() -> int:
    """Run the node until it is told to stop; returns the exit code."""
    lines = [f'  {name:9} {words} (default {default})' for name, default, words in PARAMETERS]
    parser = argparse.ArgumentParser(
        usage='%(prog)s [--ros-args -p name:=value ... -r __ns:=/namespace]',
        description='\n'.join(['Publishes which share can be picked.', '', 'parameters:', *lines]),
        epilog='Ctrl-C ends it.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(remove_ros_args(sys.argv)[1:])
    try:
        rclpy.init()
        rclpy.spin(FeederExample())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass  # that is how a node is stopped
    except (InvalidValueError, ParameterException, NameValidationException) as error:
        print('error:', ' '.join(str(error).split()), file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())

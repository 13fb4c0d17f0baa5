"""An example to copy: a feeder's controller that knows what share of the parts it can pick.

It calls no service. The distribution of its part is latched on aspect_distributions/<part>, so it
may start before the suite, after it or in the middle of a run, and hears of every change.
"""

import sys

from rclpy.node import Node
from resting_aspects_interfaces.msg import AspectDistribution
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.intervals import Interval
from resting_aspects_ros.nodes.callbacks import steady_timer, subscribe
from resting_aspects_ros.nodes.client_requests import check_name
from resting_aspects_ros.nodes.distribution_messages import distribution_from
from resting_aspects_ros.nodes.interface import ASPECT_DISTRIBUTIONS, LATCHED
from resting_aspects_ros.nodes.parameters import Parameter, declare
from resting_aspects_ros.nodes.spin import run_node

PARAMETERS = (
    Parameter('part', 'l_bracket', 'name of the part that is fed'),
    Parameter('pickable', [1], 'ids of the aspects in which the robot can pick it'),
)
EXPECTED_PICK_RATE = 'expected_pick_rate'
# What data[0], data[1] and data[2] are.
LABEL = 'probability, lower, upper'
# Without a distribution for so long it is said what to do, s.
PATIENCE = 5.0


class FeederExample(Node):
    """Subscribes to aspect_distributions/<part>; publishes expected_pick_rate."""

    def __init__(self) -> None:
        super().__init__('feeder_example')
        values = declare(self, PARAMETERS)
        self._part, self._pickable = values['part'], sorted(set(values['pickable'] or ()))
        check_name(self._part)
        if not self._pickable or self._pickable[0] < 1:
            raise InvalidValueError(f'pickable is {self._pickable}, allowed are ids from 1 on')
        self._newest: AspectDistribution | None = None
        self._said: set[str] = set()
        self._rate = self.create_publisher(Float64MultiArray, EXPECTED_PICK_RATE, LATCHED)
        self._input = subscribe(
            self, AspectDistribution, f'{ASPECT_DISTRIBUTIONS}/{self._part}', self._take, LATCHED
        )
        self._patience = steady_timer(self, PATIENCE, self._nothing_yet)
        self.get_logger().info(f'waits for {self._input.topic_name}')

    def _take(self, message: AspectDistribution) -> None:
        """Publish what a distribution says of the pickable aspects."""
        if message.drops == 0:
            return  # canceled before its first drop: it says nothing
        there = {aspect.id for aspect in message.aspects}
        share = distribution_from(message).together(there.intersection(self._pickable))
        self._patience.cancel()
        before, self._newest = self._newest, message
        self._compare(before or message, message)
        layout = MultiArrayLayout(dim=[MultiArrayDimension(label=LABEL, size=3, stride=3)])
        data = [share.probability, share.lower, share.upper]
        self._rate.publish(Float64MultiArray(layout=layout, data=data))
        # While a run is under way its numbers change five times a second.
        if before is None or _run_state(before) != _run_state(message):
            self.get_logger().info(self._in_words(message, share))

    def _compare(self, before: AspectDistribution, message: AspectDistribution) -> None:
        """Warn of what changes the meaning of the ids or of the probabilities."""
        old, new = before.run, message.run
        if old.part_sha256 != new.part_sha256:
            self._warn_once(
                f'{self._part} is another version than before (part_sha256 {new.part_sha256}): '
                'its ids may mean other aspects'
            )
        if old.conditions != new.conditions:
            self._warn_once(
                f'run {new.run_id} was dropped under other conditions ({_surface(message)}) than '
                f'the one before ({_surface(before)})'
            )
        there = [aspect.id for aspect in message.aspects]
        if missing := [k for k in self._pickable if k not in there]:
            self._warn_once(
                f'pickable has {", ".join(map(str, missing))}, {self._part} has the aspects 1 to '
                f'{len(there)} only (part_sha256 {new.part_sha256})'
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
        if words not in self._said:
            self._said.add(words)
            self.get_logger().warning(words)


def _run_state(message: AspectDistribution) -> tuple[str, bool]:
    return message.run.run_id, message.complete


def _surface(message: AspectDistribution) -> str:
    return message.run.conditions.surface or 'own conditions'


def main() -> int:
    """Run the node alone in this process."""
    return run_node(FeederExample, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())

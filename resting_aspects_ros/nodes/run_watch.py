"""How far the run is that will answer a request for a distribution."""

import time
from collections.abc import Callable

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from resting_aspects_interfaces.msg import AspectDistribution, RunDescription
from resting_aspects_interfaces.srv import GetDistribution

from resting_aspects_ros.drops.run import DEFAULT_SEED
from resting_aspects_ros.nodes.distribution_messages import distribution_from
from resting_aspects_ros.nodes.interface import ASPECT_DISTRIBUTIONS, LATCHED


class RunWatch:
    """Listens to aspect_distributions/<part> for the run that a request for drops began or joined.

    last : when it was heard of last, on the monotonic clock, s; 0 if it never was
    state : how far it is, in words; empty if it never was heard of
    ended : when it was heard that it ended before all was done, on the same clock, s; else 0

    Parameters
    ----------
    progress : called with the number of drops done, while that goes up
    """

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        request: GetDistribution.Request,
        progress: Callable[[int], None] | None,
    ) -> None:
        self.last = 0.0
        self.state = ''
        self.ended = 0.0
        self._run_id = ''
        self._node = node
        self._request = request
        self._progress = progress or (lambda _: None)
        self._subscription = node.create_subscription(
            AspectDistribution,
            f'{ASPECT_DISTRIBUTIONS}/{request.part}',
            self._take,
            LATCHED,
            callback_group=group,
        )

    def close(self, response: GetDistribution.Response) -> AspectDistribution:
        """The answer; it ends the progress, if there was any."""
        if self.last:
            self._progress(response.distribution.drops)
        return response.distribution

    def end(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)

    def _take(self, message: AspectDistribution) -> None:
        # A complete one is latched since an earlier run; others may be under way.
        if message.complete:
            if message.run.run_id == self._run_id and not _is_whole(message):
                self.ended = time.monotonic()
                self.state = f'it was ended, canceled perhaps, after {message.drops} drops'
        elif self._is_asked_for(message.run):
            self._run_id, self.ended = message.run.run_id, 0.0
            self.last = time.monotonic()
            self.state = f'{message.drops} drops are done, and the run goes on'
            self._progress(message.drops)

    def _is_asked_for(self, run: RunDescription) -> bool:
        asked = self._request
        seed = asked.seed[0] if asked.seed else DEFAULT_SEED
        if (run.drops, run.precision, run.seed) != (asked.drops, asked.precision, seed):
            return False
        if not asked.conditions:
            # Which surface is the default is the simulator's to say.
            return not asked.surface or bool(run.conditions.surface == asked.surface)
        given = asked.conditions[0]
        physical = set(given.get_fields_and_field_types()) - {'surface'}
        return all(getattr(given, name) == getattr(run.conditions, name) for name in physical)


def _is_whole(message: AspectDistribution) -> bool:
    """Whether a run has ended with all that was asked for."""
    run = message.run
    enough = run.precision > 0 and distribution_from(message).stops(run.precision, run.drops)
    return bool(message.drops >= run.drops or enough)

"""Ask the suite for a distribution, as any ROS client would."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription, Status
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg
from resting_aspects_interfaces.srv import GetDistribution

from resting_aspects_ros.core.errors import InvalidValueError, UnknownPartError
from resting_aspects_ros.core.part import Part, is_valid_name
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.plan import most_drops
from resting_aspects_ros.drops.run import check_drops, check_seed
from resting_aspects_ros.nodes.convert import conditions_from, conditions_msg, part_from
from resting_aspects_ros.nodes.interface import (
    ASPECT_DISTRIBUTIONS,
    DEFAULT_CONDITIONS,
    GET_DISTRIBUTION,
    LATCHED,
    PARTS,
)
from resting_aspects_ros.nodes.requests import NotAvailableError, status_error

# A suite that is just starting needs a few seconds to be found, s.
SERVICE_TIMEOUT = 20.0
PART_TIMEOUT = 5.0
SPIN_PERIOD = 0.1
# Without an answer and without progress the same is asked again after this, s, and then after
# twice as long each time: it is joined.
ASK_PERIOD = 5.0


def distribution_request(
    part: str,
    conditions: DropConditions | None,
    drops: int,
    precision: float,
    seed: int | None,
    *,
    only_known: bool = False,
) -> GetDistribution.Request:
    """The request for a distribution; without a seed any known run will do.

    ``drops`` and ``precision`` as most_drops has them; without conditions the suite's default.
    """
    drops = most_drops(drops, precision)
    check_drops(drops)
    if seed is not None:
        check_seed(seed)
    return GetDistribution.Request(
        part=part,
        surface='' if conditions is None else conditions.surface,
        conditions=[] if conditions is None else [conditions_msg(conditions)],
        drops=drops,
        precision=precision,
        seed=[] if seed is None else [seed],
        only_known=only_known,
    )


def estimate_request(part: str, method: str) -> GetDistribution.Request:
    """The request for what an estimator predicts; it looks at nothing else."""
    if not method:
        raise InvalidValueError("method is '', allowed is drops or the name of an estimator")
    return GetDistribution.Request(part=part, method=method)


@contextmanager
def suite_client(ros_args: Sequence[str] = ()) -> 'Iterator[SuiteClient]':
    """A client in a ROS context of its own. Ctrl-C raises KeyboardInterrupt as usual."""
    rclpy.init(args=list(ros_args), signal_handler_options=SignalHandlerOptions.NO)
    client = SuiteClient()
    try:
        yield client
    finally:
        client.destroy_node()
        rclpy.try_shutdown()


class SuiteClient(Node):
    """Calls get_distribution and follows the run that answers it."""

    def __init__(self) -> None:
        super().__init__('resting_aspects_client')
        self._requests = self.create_client(GetDistribution, GET_DISTRIBUTION)
        self._heard = 0.0  # when there was an answer or progress last
        self._spinner = SingleThreadedExecutor()
        self._spinner.add_node(self)

    def destroy_node(self) -> None:
        """Also ends its executor."""
        self._spinner.shutdown()
        super().destroy_node()

    def get(
        self,
        request: GetDistribution.Request,
        progress: Callable[[int], None],
        check: Callable[[], None] = lambda: None,
    ) -> AspectDistribution:
        """Get the answer.

        ``progress`` is called with the drops done while the part is dropped; ``check`` often, and
        raises if there is no use in waiting any longer. Raises what the suite answers when it
        refuses, as a RestingAspectsError.
        """
        service = self._requests.srv_name
        if not self.wait(self._requests.service_is_ready, SERVICE_TIMEOUT, check):
            raise NotAvailableError(
                f'no aspect_classifier answers on {service}, waited {SERVICE_TIMEOUT:g} s: '
                'start the suite with "resting_aspects nodes"'
            )

        if not is_valid_name(request.part):
            raise UnknownPartError(
                f'part {request.part!r} is not known: names of parts are lower case letters, '
                'digits and _'
            )
        dropping = False

        def follow(message: AspectDistribution) -> None:
            nonlocal dropping
            if not message.complete:  # a complete one is latched since an earlier run
                dropping = True
                self._heard = time.monotonic()
                progress(message.drops)

        topic = f'{ASPECT_DISTRIBUTIONS}/{request.part}'
        subscription = self.create_subscription(AspectDistribution, topic, follow, LATCHED)
        try:
            response = self._ask(request, check)
        finally:
            self.destroy_subscription(subscription)
        if response.status.code != Status.OK:
            raise status_error(response.status)
        if dropping:
            progress(response.distribution.drops)
        return response.distribution

    def _ask(
        self, request: GetDistribution.Request, check: Callable[[], None]
    ) -> GetDistribution.Response:
        """Call the service, and again if nothing happens.

        A classifier that was found and has not yet found this client cannot answer it, nor can one
        that was started again since. Raises NotAvailableError if it is gone.
        """
        answers: list[Future] = []
        period = ASK_PERIOD

        def answered() -> bool:
            return any(answer.done() for answer in answers)

        def silent() -> bool:
            return time.monotonic() - self._heard > period

        while not answered():
            if not self._requests.service_is_ready():
                raise NotAvailableError(
                    f'the classifier went away while {request.part} was asked for'
                )
            answers.append(self._requests.call_async(request))
            self._heard = time.monotonic()
            self.wait(lambda: answered() or silent(), None, check)
            period *= 2
        return next(answer.result() for answer in answers if answer.done())

    def part(self, name: str) -> Part:
        """The part as the simulator describes it."""
        described = Future()
        subscription = self.create_subscription(
            PartDescription, f'{PARTS}/{name}', described.set_result, LATCHED
        )
        if not self.wait(described.done, PART_TIMEOUT):
            raise NotAvailableError(f'no description of {name} came in {PART_TIMEOUT:g} s')
        self.destroy_subscription(subscription)
        return part_from(described.result())

    def default_conditions(self) -> DropConditions:
        """What the simulator means by no surface."""
        said = Future()
        subscription = self.create_subscription(
            DropConditionsMsg, DEFAULT_CONDITIONS, said.set_result, LATCHED
        )
        if not self.wait(said.done, PART_TIMEOUT):
            raise NotAvailableError(
                f'no drop_simulator said in {PART_TIMEOUT:g} s which surface is the default: '
                'name one'
            )
        self.destroy_subscription(subscription)
        return conditions_from(said.result())

    def wait(
        self,
        done: Callable[[], bool],
        seconds: float | None,
        check: Callable[[], None] = lambda: None,
    ) -> bool:
        """Spin until done, at most so long; returns whether it is done."""
        end = math.inf if seconds is None else time.monotonic() + seconds
        while not done() and time.monotonic() < end:
            check()
            self._spinner.spin_once(timeout_sec=SPIN_PERIOD)
        return done()

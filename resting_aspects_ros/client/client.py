"""Ask the suite, from a node of one's own or from a program without one, which waits."""

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription, PartSummary
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg
from resting_aspects_interfaces.srv import ClassifyPose

from resting_aspects_ros.client.async_client import AsyncClient
from resting_aspects_ros.client.pending_request import AnswerTimeoutError
from resting_aspects_ros.client.private_node import ClientUseError, PrivateNode
from resting_aspects_ros.client.request_messages import absent_part, check_name
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.distribution import METHOD
from resting_aspects_ros.ros.conversions import conditions_from, part_from
from resting_aspects_ros.ros.interface import DEFAULT_CONDITIONS, PARTS
from resting_aspects_ros.simulation.conditions import DropConditions

# For what is latched to come, s.
PART_TIMEOUT = 5.0


class RestingAspectsClient(AsyncClient):
    """Asks a running suite about parts: get_distribution, classify_pose and list_parts.

    Without a node it has one of its own and spins it while it waits for an answer::

        with RestingAspectsClient() as client:
            found = client.get_distribution('l_bracket', drops=1000)

    With a node of yours, which you spin, it never spins: every question has a form that ends in
    ``_async`` and returns a rclpy Future at once. Await it in an async callback, or give it to
    ``rclpy.spin_until_future_complete``::

        client = RestingAspectsClient(node)
        found = await client.get_distribution_async('l_bracket', drops=1000)

    A callback that awaits holds up all others of its group, if that is mutually exclusive, as the
    node's own is: give it a ReentrantCallbackGroup, as in docs/how_to/integrate_ros.md.

    Answers are the suite's messages, as they come on its topics, too. To wait no longer cancel the
    future: whoever awaits it gets None. A run that was begun for a request ends with it, after a
    timeout too, unless another client asked for the same; its drops so far are kept.

    Parameters
    ----------
    node : Node, optional
        Whoever has it spins it and destroys it.
    ros_args : sequence of str, optional
        For the node of its own, what could follow --ros-args: ``['-r', '__ns:=/cell_1']``. None:
        what follows it on the command line of the program, as for any node.
    warn : callable, optional
        Called with what a person should know, such as that no classifier is ready yet. None: the
        node logs it.
    check : callable
        For the node of its own: called often while it waits, raises to wait no longer.

    Raises
    ------
    RestingAspectsError
        From every question: InvalidValueError and UnknownPartError before anything is sent if they
        can be seen here; NotAvailableError if it cannot be had now, and of this kind
        AnswerTimeoutError; BusyError, CanceledError and others as the suite answers.
        ClientUseError for a wait that could never end.
    """

    def __init__(
        self,
        node: Node | None = None,
        *,
        ros_args: Sequence[str] | None = None,
        warn: Callable[[str], object] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self._own: PrivateNode | None = None
        if node is None:
            self._own = PrivateNode(ros_args, check)
            node = self._own.node
        super().__init__(node, warn)

    def get_distribution(
        self,
        part: str,
        *,
        drops: int | None = None,
        precision: float = 0.0,
        surface: str = '',
        conditions: DropConditions | None = None,
        seed: int | None = None,
        method: str = METHOD,
        only_known: bool = False,
        timeout: float | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> AspectDistribution:
        """The distribution of a part: a known one at once, else the part is dropped first.

        Parameters
        ----------
        part : str
            Registered name; see list_parts. No name has a NUL: it is refused here, because ROS
            sends what is before it only, so that the suite could not see it.
        drops : int, optional
            At least so many; with a precision at most. None: 1000; with a precision as many as it
            takes; with only_known any number.
        precision : float
            Half width of all intervals to reach, 0.001 to 0.25; 0: none.
        surface : str
            Named conditions, as the suite knows them; empty: the simulator's parameter `surface`.
        conditions : DropConditions, optional
            Instead of a surface.
        seed : int, optional
            None: any known run will do, and a new one gets seed 1.
        method : str
            'drops', or an estimator, such as 'rolling', which looks at the part alone and answers
            at once.
        only_known : bool
            Do not drop: NotAvailableError if nothing fits.
        timeout : float, optional
            How long to wait in all, s. None: as long as it takes; nodes that are not ready are
            waited for 20 s at most.
        progress : callable, optional
            Called with the drops done while the part is dropped; not if nothing is dropped.

        Returns
        -------
        AspectDistribution
            Its fields are described in resting_aspects_interfaces; ``aspects`` is ordered by id,
            and ``run`` says of which part and under which conditions it is.
        """
        return self._wait(
            lambda: self.get_distribution_async(
                part,
                drops=drops,
                precision=precision,
                surface=surface,
                conditions=conditions,
                seed=seed,
                method=method,
                only_known=only_known,
                timeout=timeout,
                progress=progress,
            )
        )

    def classify_pose(
        self,
        part: str,
        orientation: Quaternion | npt.ArrayLike,
        *,
        timeout: float | None = None,
    ) -> ClassifyPose.Response:
        """Which aspect a part is in that was seen in some orientation.

        Parameters
        ----------
        orientation : Quaternion or (4,) float
            Tray from part, xyzw; its norm is 1 within 1e-3.

        Returns
        -------
        ClassifyPose.Response
            ``aspect`` is 0 if the pose is in none; ``angle``, rad, is that to the nearest.
        """
        return self._wait(lambda: self.classify_pose_async(part, orientation, timeout=timeout))

    def list_parts(self, *, timeout: float | None = None) -> list[PartSummary]:
        """Name, part_sha256 and whether a distribution is known of each part, by name."""
        return self._wait(lambda: self.list_parts_async(timeout=timeout))

    def get_part(self, part: str) -> Part:
        """The part itself, mesh and mass properties, as the simulator describes it."""
        check_name(part)
        own = self._waiting_node()
        try:
            return part_from(own.latched(PartDescription, f'{PARTS}/{part}', PART_TIMEOUT))
        except AnswerTimeoutError as error:
            raise absent_part(own.node, part, error) from None

    def default_conditions(self) -> DropConditions:
        """What the simulator means by no surface."""
        own = self._waiting_node()
        try:
            said = own.latched(DropConditionsMsg, DEFAULT_CONDITIONS, PART_TIMEOUT)
        except AnswerTimeoutError as error:
            raise AnswerTimeoutError(
                f'no drop_simulator says which surface is the default, name one, or start '
                f'drop_simulator: {error}'
            ) from None
        return conditions_from(said)

    def close(self) -> None:
        """End all that it made; who awaits an answer gets a ClientUseError."""
        super().close()
        if self._own is not None:
            self._own.close()

    def __enter__(self) -> 'RestingAspectsClient':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _check(self, timeout: float | None) -> None:
        super()._check(timeout)
        if self._own is not None and not self._own.is_spun:
            raise ClientUseError(
                'this client spins only while it waits, so the future would never be done: '
                'allowed is the form without _async, or RestingAspectsClient(node) with a node '
                'that you spin'
            )

    def _wait(self, ask: Callable[[], Future]) -> Any:
        return self._waiting_node().wait(ask, lambda: self._open)

    def _waiting_node(self) -> PrivateNode:
        if self._own is None:
            raise ClientUseError(
                f'the node {self._node.get_name()!r} is spun by somebody else, so that to wait '
                'here could be for ever: allowed is to await the form that ends in _async, or '
                'RestingAspectsClient() without a node'
            )
        return self._own

"""The client of the suite, for programs with a node and for programs without one."""

from collections.abc import Callable

import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    PartDescription,
    PartSummary,
    TransitionMatrix,
)
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg
from resting_aspects_interfaces.srv import ClassifyPose

from resting_aspects_ros.api.plan import DEFAULT_ACTION
from resting_aspects_ros.client.forecast_client import ForecastClient
from resting_aspects_ros.client.pending_request import AnswerTimeoutError
from resting_aspects_ros.client.request_messages import check_name, missing_part_error
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.conversions import conditions_from, part_from
from resting_aspects_ros.ros.interface import DEFAULT_CONDITIONS, PARTS
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import DEFAULT_DROPS, DEFAULT_SEED
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.statistics.distribution import METHOD

# Timeout for a latched message, s.
PART_TIMEOUT = 5.0


class RestingAspectsClient(ForecastClient):
    """Client of a running suite: distributions, transitions, poses, outlines, forecasts, parts.

    Without a node, the client creates a private node and spins it while it waits::

        with RestingAspectsClient() as client:
            distribution = client.get_distribution('l_bracket', drops=1000)

    With a node, which the caller must spin, the client never spins. Each request has a method that
    ends in ``_async`` and returns a rclpy Future at once. Await it in an async callback, or pass
    it to ``rclpy.spin_until_future_complete``::

        client = RestingAspectsClient(node)
        distribution = await client.get_distribution_async('l_bracket', drops=1000)

    A callback that awaits blocks all other callbacks of a mutually exclusive group, such as the
    default group of a node. Use a ReentrantCallbackGroup for it: docs/how_to/integrate_ros.md.

    Results are the messages of the suite, as on its topics. Cancel the future to stop waiting; a
    caller that awaits it then receives None. A run that was started for a request stops when the
    request is canceled or times out, unless another client requested the same run; the drops made
    before are kept.

    Parameters
    ----------
    node : Node, optional
        The caller spins and destroys it. None: the client creates a private node.
    ros_args : sequence of str, optional
        ROS arguments of the private node, such as ``['-r', '__ns:=/cell_1']``. None: those on the
        command line of the program after --ros-args.
    warn : callable, optional
        Called with the text of each warning, for example that no classifier is ready yet. None:
        the node logs warnings.
    check : callable
        Called often while the private node waits; an exception that it raises ends the wait.

    Raises
    ------
    RestingAspectsError
        From every request. InvalidValueError and UnknownPartError are raised before a request is
        sent if the client can detect them. NotAvailableError means that there is no result now;
        AnswerTimeoutError is a subclass of it. BusyError, CanceledError and others report the
        status that the suite returns. ClientUseError means that a wait would never end.
    """

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
        """Return the distribution of a part; if it is not known, the part is dropped first.

        Parameters
        ----------
        part : str
            Registered name; see list_parts. The client rejects a name with a NUL character, since
            ROS would send only the text before it.
        drops : int, optional
            Minimum number of drops; with a precision, the maximum number. None: 1000; with a
            precision as many drops as it needs; with only_known any number.
        precision : float
            Required half width of all intervals, 0.001 to 0.25; 0: no precision.
        surface : str
            Name of a set of conditions of the suite; empty: the simulator parameter `surface`.
        conditions : DropConditions, optional
            Conditions, instead of a surface.
        seed : int, optional
            Seed of the run. None: any known run matches, and a new run uses seed 1.
        method : str
            'drops', or the name of an estimator, such as 'rolling', which uses only the part and
            returns at once.
        only_known : bool
            Do not drop: raise NotAvailableError if no known distribution matches.
        timeout : float, optional
            Maximum total time, s. None: no limit, but at most 20 s for nodes that are not ready.
        progress : callable, optional
            Called with the number of drops done while the part is dropped.

        Returns
        -------
        AspectDistribution
            The distribution; resting_aspects_interfaces describes the fields. ``aspects`` is
            ordered by id, and ``run`` contains the part and the conditions.
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

    def reorient_part(
        self,
        part: str,
        action: str | Action | NamedAction = DEFAULT_ACTION,
        per_aspect: int | None = None,
        *,
        precision: float = 0.0,
        drops: int = DEFAULT_DROPS,
        surface: str = '',
        conditions: DropConditions | None = None,
        seed: int = DEFAULT_SEED,
        timeout: float | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> TransitionMatrix:
        """Simulate an action on a part at rest in each aspect, and return the transitions.

        Parameters
        ----------
        part, surface, conditions, timeout
            As for get_distribution.
        action : str, Kick, Nozzle, Vibration, Step or NamedAction
            The name of an action of the suite, or an action.
        per_aspect : int, optional
            Number of actions from each aspect. None: 400; with a precision as many as it needs.
        precision : float
            Required half width of all intervals of the matrix, 0.001 to 0.25; 0: no precision.
        drops : int
            Number of drops, whose distribution replaces parts that leave the aspects.
        seed : int
            Seed of the drops and of the actions.
        progress : callable, optional
            Called with the number of actions made.

        Returns
        -------
        TransitionMatrix
            The message, as on transitions/<part>; transition_matrix_from returns its arrays.
        """
        return self._wait(
            lambda: self.reorient_part_async(
                part,
                action,
                per_aspect,
                precision=precision,
                drops=drops,
                surface=surface,
                conditions=conditions,
                seed=seed,
                timeout=timeout,
                progress=progress,
            )
        )

    def get_transitions(
        self, part: str, action: str = '', *, timeout: float | None = None
    ) -> TransitionMatrix:
        """Return the newest known transitions of a part; simulates nothing.

        Parameters
        ----------
        action : str
            Name of the action; empty: any.
        """
        return self._wait(lambda: self.get_transitions_async(part, action, timeout=timeout))

    def classify_pose(
        self,
        part: str,
        orientation: Quaternion | npt.ArrayLike,
        *,
        timeout: float | None = None,
    ) -> ClassifyPose.Response:
        """Return the aspect of a part in a given orientation.

        Parameters
        ----------
        orientation : Quaternion or (4,) float
            Orientation tray from part, xyzw; its norm must be 1 within 1e-3.

        Returns
        -------
        ClassifyPose.Response
            ``aspect`` is the id, or 0 if no aspect matches; ``angle``, rad, is the angle to the
            nearest aspect.
        """
        return self._wait(lambda: self.classify_pose_async(part, orientation, timeout=timeout))

    def list_parts(self, *, timeout: float | None = None) -> list[PartSummary]:
        """Return name, part_sha256 and `known` of each offered part, ordered by name."""
        return self._wait(lambda: self.list_parts_async(timeout=timeout))

    def get_part(self, part: str) -> Part:
        """Return a part with its mesh and mass properties, as the simulator describes it."""
        check_name(part)
        own = self._waiting_node()
        try:
            return part_from(own.receive_latched(PartDescription, f'{PARTS}/{part}', PART_TIMEOUT))
        except AnswerTimeoutError as error:
            raise missing_part_error(own.node, part, error) from None

    def default_conditions(self) -> DropConditions:
        """Return the conditions that the simulator uses for a request without a surface."""
        own = self._waiting_node()
        try:
            message = own.receive_latched(DropConditionsMsg, DEFAULT_CONDITIONS, PART_TIMEOUT)
        except AnswerTimeoutError as error:
            raise AnswerTimeoutError(
                f'the default surface is unknown, name a surface or start drop_simulator: {error}'
            ) from None
        return conditions_from(message)

"""The client of the suite, for programs with a node and for programs without one."""

import functools
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Concatenate, ParamSpec

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point, Quaternion
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces import msg, srv
from resting_aspects_interfaces.action import DropPart, ReorientPart

from resting_aspects_ros.api.plan import DEFAULT_ACTION, DEFAULT_PER_ASPECT, named_action
from resting_aspects_ros.client.connection import (
    CLOSED,
    END_TIMEOUT,
    AnswerTimeoutError,
    ClientUseError,
    Connection,
    Request,
)
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part, is_valid_name
from resting_aspects_ros.ros import interface
from resting_aspects_ros.ros.conversions import (
    conditions_from,
    conditions_msg,
    part_from,
    polygon_msgs,
)
from resting_aspects_ros.ros.distribution_conversions import action_msg
from resting_aspects_ros.ros.health import published_parts
from resting_aspects_ros.ros.requests import NotAvailableError, status_error, unknown_part
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS, DEFAULT_SEED, DropConditions
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.statistics.distribution import METHOD
from resting_aspects_ros.vision.identification import Polygonal, observed_polygon

# Timeout for a latched message, s.
PART_TIMEOUT = 5.0
# Time within which all drops of a run must be counted after the result of its goal arrived, s.
COUNT_TIMEOUT = 120.0

P = ParamSpec('P')
Progress = Callable[[int], object]


def _awaitable(
    method: Callable[Concatenate['RestingAspectsClient', P], Any],
) -> Callable[Concatenate['RestingAspectsClient', P], Future]:
    """Return the variant of a method that returns a Future of its result at once."""

    @functools.wraps(method)
    def start(client: 'RestingAspectsClient', *args: P.args, **kwargs: P.kwargs) -> Future:
        return client._start(lambda: method(client, *args, **kwargs))  # noqa: SLF001

    start.__name__ = f'{method.__name__}_async'
    start.__doc__ = f'Return a Future of the result of {method.__name__}.'
    return start


class RestingAspectsClient:
    """Client of a running suite: distributions, transitions, poses, outlines, forecasts, parts.

    Every request waits for its result, and has a variant that ends in ``_async``, which returns a
    rclpy Future at once. Await it in an async callback of a node, or pass it to
    ``rclpy.spin_until_future_complete``::

        client = RestingAspectsClient(node)
        distribution = await client.get_distribution_async('l_bracket', drops=1000)

    A callback that awaits blocks all other callbacks of a mutually exclusive group, such as the
    default group of a node. Use a ReentrantCallbackGroup for it: docs/how_to/integrate_ros.md.

    The client has a node of its own, which a thread spins. It can be used from several threads.
    Results are the messages of the suite, as on its topics. Cancel the future to stop waiting; a
    caller that awaits it then receives None. A run that was started for a request stops when the
    request is canceled, interrupted or times out, unless another client requested the same run;
    the drops made before are kept.

    Parameters
    ----------
    node : Node, optional
        A node of the program, whose namespace, remappings and context the client uses. None: the
        client creates a context of its own, and does not touch signal handlers.
    ros_args : sequence of str, optional
        ROS arguments without a node, such as ``['-r', '__ns:=/cell_1']``. None: those on the
        command line of the program after --ros-args.
    check : callable
        Called often while a request waits; an exception that it raises ends the wait.

    Raises
    ------
    RestingAspectsError
        From every request. InvalidValueError and UnknownPartError name what is wrong with the
        request. NotAvailableError means that there is no result now; AnswerTimeoutError is a
        subclass of it. BusyError, CanceledError and others report the status that the suite
        returns. ClientUseError means that the client was closed.
    """

    def __init__(
        self,
        node: Node | None = None,
        *,
        ros_args: Sequence[str] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self._node = node
        self._connection = Connection(node, ros_args, check)
        self._active = 0
        self._changed = threading.Condition()
        self._thread = threading.local()  # `canceled`, in the thread of a future

    def close(self) -> None:
        """End all requests with a ClientUseError, and destroy the node of the client."""
        self._connection.begin_closing()
        with self._changed:
            self._changed.wait_for(lambda: not self._active, 2 * END_TIMEOUT)
        self._connection.close()

    def __enter__(self) -> 'RestingAspectsClient':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

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
        progress: Progress = lambda _: None,
    ) -> msg.AspectDistribution:
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
        progress : callable
            Called with the number of drops done while the part is dropped, in the thread that
            waits; get_distribution_async waits in a thread of the client.

        Returns
        -------
        AspectDistribution
            The distribution; resting_aspects_interfaces describes the fields. ``aspects`` is
            ordered by id, and ``run`` contains the part and the conditions.
        """
        if drops is None:
            drops = 0 if precision else 1 if only_known else DEFAULT_DROPS
        request = _message(
            srv.GetDistribution.Request,
            part=part,
            method=method,
            **_conditions(surface, conditions),
            drops=drops,
            precision=precision,
            seed=[] if seed is None else [seed],
            only_known=True,
        )
        unknown = (msg.Status.NOT_AVAILABLE, msg.Status.UNKNOWN_PART)
        with self._request(f'the distribution of {part}', timeout) as pending:
            response = pending.call(srv.GetDistribution, interface.GET_DISTRIBUTION, request)
            if only_known or response.status.code not in unknown:
                return _ok(response).distribution
            names = ('part', 'surface', 'conditions', 'drops', 'precision')
            goal = DropPart.Goal(**{name: getattr(request, name) for name in names})
            goal.seed = request.seed[0] if request.seed else DEFAULT_SEED
            result = _ok(pending.simulate(DropPart, interface.DROP_PART, goal, progress))
            progress(result.drops)
            pending.state = f'{result.drops} drops are done and being counted'
            # The batches were sent before the result, but may arrive after it.
            request.seed = [goal.seed]
            end = time.monotonic() + COUNT_TIMEOUT
            while True:
                response = pending.call(srv.GetDistribution, interface.GET_DISTRIBUTION, request)
                if response.status.code not in unknown:
                    return _ok(response).distribution
                if time.monotonic() > end:
                    raise NotAvailableError(
                        f'the {result.drops} drops of run {result.run_id} were not counted within '
                        f'{COUNT_TIMEOUT:g} s: {response.status.message}'
                    )
                pending.pause(interface.GET_DISTRIBUTION)

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
        progress: Progress = lambda _: None,
    ) -> msg.TransitionMatrix:
        """Simulate an action on a part at rest in each aspect, and return the transitions.

        Parameters
        ----------
        part, surface, conditions, timeout
            As for get_distribution.
        action : str, Action or NamedAction
            The name of an action of the suite, or an action.
        per_aspect : int, optional
            Number of actions from each aspect. None: 400; with a precision as many as it needs.
        precision : float
            Required half width of all intervals of the matrix, 0.001 to 0.25; 0: no precision.
        drops : int
            Number of drops, whose distribution replaces parts that leave the aspects.
        seed : int
            Seed of the drops and of the actions.
        progress : callable
            Called with the number of actions made, as for get_distribution.

        Returns
        -------
        TransitionMatrix
            The message, as on transitions/<part>; transition_matrix_from returns its arrays.
        """
        if per_aspect is None:
            per_aspect = 0 if precision else DEFAULT_PER_ASPECT
        if isinstance(action, str):
            requested = _message(msg.FeederAction, name=action)
        else:
            requested = action_msg(named_action(action))
        goal = _message(
            ReorientPart.Goal,
            part=part,
            action=requested,
            **_conditions(surface, conditions),
            per_aspect=per_aspect,
            precision=precision,
            drops=drops,
            seed=seed,
        )
        with self._request(f'the transitions of {part}', timeout) as pending:
            name = interface.REORIENT_PART
            return _ok(pending.simulate(ReorientPart, name, goal, progress)).transitions

    def get_transitions(
        self, part: str, action: str = '', *, timeout: float | None = None
    ) -> msg.TransitionMatrix:
        """Return the newest known transitions of a part; simulates nothing.

        Parameters
        ----------
        action : str
            Name of the action; empty: any.
        """
        request = _message(srv.GetTransitions.Request, part=part, action=action)
        with self._request(f'the known transitions of {part}', timeout) as pending:
            response = pending.call(srv.GetTransitions, interface.GET_TRANSITIONS, request)
            return _ok(response).transitions

    def classify_pose(
        self,
        part: str,
        orientation: Quaternion | npt.ArrayLike,
        *,
        timeout: float | None = None,
    ) -> srv.ClassifyPose.Response:
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
        if not isinstance(orientation, Quaternion):
            orientation = Quaternion(**_coordinates('orientation', orientation, 'xyzw'))
        request = _message(srv.ClassifyPose.Request, part=part, orientation=orientation)
        with self._request(f'the aspect of a pose of {part}', timeout) as pending:
            response = pending.call(srv.ClassifyPose, interface.CLASSIFY_POSE, request)
            # NOT_AVAILABLE with an angle is a result: no aspect matches.
            if response.status.code == msg.Status.NOT_AVAILABLE and not math.isnan(response.angle):
                return response
            return _ok(response)

    def identify_part(
        self,
        polygon: Polygonal,
        parts: str | Iterable[str] = (),
        *,
        noise: float = 0.0,
        camera: npt.ArrayLike | None = None,
        timeout: float | None = None,
    ) -> srv.IdentifyPart.Response:
        """Return which part an observed polygon shows, in which aspects and where.

        Parameters
        ----------
        polygon : shapely.Polygon, (n, 2) array, or mapping with 'outer' and 'holes'
            Tray frame, m; seen from above, x right and y up.
        parts : str or iterable of str
            Names of the parts that may be on the tray. Empty: all that the suite offers.
        noise : float
            Standard deviation of the boundary, m; 0: 0.1 mm.
        camera : (3,) float, optional
            Centre of projection of a pinhole camera in the tray frame, m, to correct the
            magnification of high parts. None: telecentric.

        Returns
        -------
        IdentifyPart.Response
            ``candidates`` by posterior, with 6D poses; ``none_probability`` and
            ``touching_probability``.
        """
        position = [] if camera is None else [Point(**_coordinates('camera', camera, 'xyz'))]
        request = _message(
            srv.IdentifyPart.Request,
            **polygon_msgs(observed_polygon(polygon)),
            parts=parts,
            noise=noise,
            camera=position,
        )
        with self._request('the part of an outline', timeout) as pending:
            return _ok(pending.call(srv.IdentifyPart, interface.IDENTIFY_PART, request))

    def forecast(
        self, part: str, *, timeout: float | None = None, **options: Any
    ) -> srv.FeederForecast.Response:
        """Return the parts per minute of a feeder, from the known drops and transitions of a part.

        Parameters
        ----------
        options
            The other fields of the service FeederForecast, with its defaults: ``aspects`` or
            ``classes`` (in which the robot can pick the part), ``action``, ``use_counts``,
            ``robot_time``, ``vibrate_time``, ``settle_time``, ``image_time``, ``supply_time``,
            ``overlap``, ``place_time`` (s), ``tray``, ``clearance``, ``gripper`` (m),
            ``parts_on_tray``, ``max_picks`` and ``minutes``.
        """
        request = _message(srv.FeederForecast.Request, part=part, **options)
        with self._request(f'the forecast of {part}', timeout) as pending:
            return _ok(pending.call(srv.FeederForecast, interface.FORECAST, request))

    def list_parts(self, *, timeout: float | None = None) -> list[str]:
        """Return the names of the offered parts, sorted, once any is offered.

        They are those of the topics parts/<part>.
        """
        with self._request('the list of parts', timeout) as pending:
            end = time.monotonic() + (PART_TIMEOUT if timeout is None else timeout)
            before: set[str] = set()
            # The topics of a simulator are discovered one after another.
            while not (found := self._offered_parts()) or found != before:
                if time.monotonic() > end:
                    raise AnswerTimeoutError(
                        f'no {interface.DROP_SIMULATOR} offers parts: start the suite with '
                        '"resting_aspects nodes"'
                    )
                before = found
                pending.pause(interface.PARTS)
            return sorted(found)

    def get_part(self, part: str) -> Part:
        """Return a part with its mesh and mass properties, as the simulator describes it."""
        if not is_valid_name(part):
            raise unknown_part(part, self._offered_parts())
        with self._request(f'the description of {part}') as pending:
            topic = f'{interface.PARTS}/{part}'
            try:
                return part_from(pending.latched(msg.PartDescription, topic, PART_TIMEOUT))
            except AnswerTimeoutError as error:
                offered = self._offered_parts()
                if offered and part not in offered:
                    raise unknown_part(part, offered) from None
                raise AnswerTimeoutError(
                    f'no {interface.DROP_SIMULATOR} offers {part}: {error}; start the suite with '
                    '"resting_aspects nodes"'
                ) from None

    def default_conditions(self) -> DropConditions:
        """Return the conditions that the simulator uses for a request without a surface."""
        with self._request('the default conditions') as pending:
            return conditions_from(
                pending.latched(msg.DropConditions, interface.DEFAULT_CONDITIONS, PART_TIMEOUT)
            )

    get_distribution_async = _awaitable(get_distribution)
    reorient_part_async = _awaitable(reorient_part)
    get_transitions_async = _awaitable(get_transitions)
    classify_pose_async = _awaitable(classify_pose)
    identify_part_async = _awaitable(identify_part)
    forecast_async = _awaitable(forecast)
    list_parts_async = _awaitable(list_parts)

    def _offered_parts(self) -> set[str]:
        return published_parts(self._connection.node, interface.PARTS, msg.PartDescription)

    @contextmanager
    def _request(self, description: str, timeout: float | None = None) -> Iterator[Request]:
        """Context manager of a request; raises InvalidValueError for an invalid timeout."""
        if timeout is not None and not 0 < timeout < math.inf:
            raise InvalidValueError(f'invalid timeout {timeout}: expected more than 0 s, or None')
        self._begin()
        canceled = getattr(self._thread, 'canceled', lambda: False)
        try:
            yield Request(self._connection, description, timeout, canceled)
        finally:
            self._end()

    def _start(self, method: Callable[[], Any]) -> Future:
        """Return a Future of the result of a method, which waits in a thread."""
        answer = Future(executor=None if self._node is None else self._node.executor)

        def work() -> None:
            self._thread.canceled = answer.cancelled
            try:
                result = method()
            except Exception as error:  # noqa: BLE001 - the caller must receive every error
                if not answer.cancelled():
                    answer.set_exception(error)
            else:
                if not answer.cancelled():
                    answer.set_result(result)
            # The executor resumes a callback that awaits only when something wakes it.
            if self._node is not None and (executor := self._node.executor) is not None:
                executor.wake()
            self._end()

        self._begin()
        threading.Thread(target=work, name='resting_aspects_request', daemon=True).start()
        return answer

    def _begin(self) -> None:
        with self._changed:
            if not self._connection.is_open:
                raise ClientUseError(CLOSED)
            self._active += 1

    def _end(self) -> None:
        with self._changed:
            self._active -= 1
            self._changed.notify_all()


def _ok(answer: Any) -> Any:
    """Return a response or a result whose status is OK; raises the error that it reports."""
    if answer.status.code != msg.Status.OK:
        raise status_error(answer.status)
    return answer


def _message(kind: Any, **fields: Any) -> Any:
    """Return a message with checked fields; raises InvalidValueError."""
    message = kind(check_fields=True)
    types = message.get_fields_and_field_types()
    for name, value in fields.items():
        if name not in types:
            raise InvalidValueError(
                f'invalid option {shown(name)}: expected one of {", ".join(list(types)[1:])}'
            )
        try:
            setattr(message, name, _plain(value, types[name]))
        except (AssertionError, OverflowError, TypeError):
            expected = types[name].replace('string', 'printable text')
            raise InvalidValueError(
                f'invalid {name} {shown(value)}: expected {expected}'
            ) from None
    return message


def _plain(value: Any, kind: str) -> Any:
    """Return a value as rclpy accepts it for a field: NumPy scalars and integers are converted.

    Raises TypeError for text that ROS would cut at a NUL character or cannot encode.
    """
    if kind.startswith('sequence') or kind.endswith(']'):
        is_single = isinstance(value, str) or not isinstance(value, Iterable)
        values = [value] if is_single else value
        return [_plain(each, 'double' if 'double' in kind else '') for each in values]
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, str) and not value.isprintable():
        raise TypeError(value)
    if kind == 'double' and type(value) is int:
        return float(value)
    return value


def _coordinates(name: str, values: npt.ArrayLike, axes: str) -> dict[str, float]:
    """Return numbers by axis; raises InvalidValueError."""
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape != (len(axes),):
        raise InvalidValueError(
            f'invalid {name} {shown(values)}: expected {len(axes)} numbers {", ".join(axes)}'
        )
    return dict(zip(axes, found.tolist(), strict=True))


def _conditions(surface: str, conditions: DropConditions | None) -> dict[str, Any]:
    """Return the fields for a surface or for conditions; raises InvalidValueError for both."""
    if conditions is None:
        return {'surface': surface}
    if surface:
        raise InvalidValueError(
            f'invalid surface {surface!r}: expected no surface together with conditions'
        )
    return {'surface': conditions.surface, 'conditions': [conditions_msg(conditions)]}

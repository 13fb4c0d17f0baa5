"""What a client asks for, checked before anything is sent."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from rclpy.node import Node
from resting_aspects_interfaces.msg import PartDescription
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution

from resting_aspects_ros.client.pending_request import AnswerTimeoutError
from resting_aspects_ros.core.aspects.pose_query import unit_orientation
from resting_aspects_ros.core.errors import (
    InvalidValueError,
    RestingAspectsError,
    UnknownPartError,
)
from resting_aspects_ros.core.part import MAX_NAME, is_valid_name
from resting_aspects_ros.core.statistics.distribution import METHOD
from resting_aspects_ros.core.statistics.stopping import max_drops
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, PARTS
from resting_aspects_ros.ros.status import requested_estimator, unknown_part
from resting_aspects_ros.ros.topic_discovery import published_parts
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.run_description import (
    DEFAULT_DROPS,
    MAX_DROPS,
    check_drops,
    check_seed,
)


def distribution_request(
    part: str,
    *,
    drops: int | None = None,
    precision: float = 0.0,
    surface: str = '',
    conditions: DropConditions | None = None,
    seed: int | None = None,
    method: str = METHOD,
    only_known: bool = False,
) -> GetDistribution.Request:
    """The request, as RestingAspectsClient.get_distribution has it, checked.

    rclpy does not check fields: what is of another type than they are would end the process.
    """
    check_name(part)
    _check_text('method', method)
    _check_text('surface', surface)
    _check_conditions(conditions)
    drops, precision, seed = _plain(drops), _plain(precision), _plain(seed)
    only_known = _plain(only_known)
    if not isinstance(only_known, bool):
        raise InvalidValueError(f'only_known is {only_known!r}, allowed is True or False')
    if not method:
        raise InvalidValueError(
            f'method is {method!r}, allowed is drops or the name of an estimator'
        )
    if requested_estimator(method) is not None:
        return GetDistribution.Request(part=part, method=method)
    if surface and conditions is not None:
        raise InvalidValueError(
            f'surface is {surface!r} and conditions are given, allowed is one of them'
        )
    drops = _asked_drops(drops, precision, only_known=only_known)
    if seed is not None:
        check_seed(seed)
    return GetDistribution.Request(
        part=part,
        method=method,
        surface=surface if conditions is None else conditions.surface,
        conditions=[] if conditions is None else [conditions_msg(conditions)],
        drops=drops,
        precision=float(precision),
        seed=[] if seed is None else [seed],
        only_known=only_known,
    )


def pose_request(part: str, orientation: Quaternion | npt.ArrayLike) -> ClassifyPose.Request:
    """The request, as RestingAspectsClient.classify_pose has it, checked."""
    check_name(part)
    if isinstance(orientation, Quaternion):
        orientation = [getattr(orientation, axis) for axis in 'xyzw']
    try:
        xyzw = np.asarray(orientation, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(
            f'orientation is {orientation!r}, allowed are 4 numbers: x, y, z, w'
        ) from None
    if xyzw.shape != (4,):
        raise InvalidValueError(
            f'orientation has the shape {xyzw.shape}, allowed is (4,): x, y, z, w'
        )
    fields = dict(zip('xyzw', unit_orientation(xyzw).tolist(), strict=True))
    return ClassifyPose.Request(part=part, orientation=Quaternion(**fields))


def check_name(part: str) -> None:
    """Raises UnknownPartError if no part can have this name; InvalidValueError for no text."""
    if not isinstance(part, str):
        raise InvalidValueError(f'part is {part!r}, allowed is the name of a part')
    if not is_valid_name(part):
        raise UnknownPartError(
            f'part {part[:MAX_NAME]!r} is not known: names of parts are lower case letters, '
            'digits and _, a letter first'
        )


def check_timeout(timeout: float | None) -> None:
    """Raises InvalidValueError if nobody can wait so long, s."""
    if timeout is not None and not (_is_number(_plain(timeout)) and 0 < timeout < math.inf):
        raise InvalidValueError(f'timeout is {timeout!r}, allowed is more than 0 s, or None')


def absent_part(node: Node, part: str, late: AnswerTimeoutError) -> RestingAspectsError:
    """Why the description of a part did not come in time: ``late``, or what is behind that."""
    offered = published_parts(node, PARTS, PartDescription)
    if part in offered:
        return late
    if offered:
        return unknown_part(part, offered)
    return AnswerTimeoutError(
        f'no {DROP_SIMULATOR} is there that offers {part}: {late}; start the suite with '
        '"resting_aspects nodes"'
    )


def check_progress(progress: object) -> None:
    """Raises InvalidValueError if it cannot be called."""
    if progress is not None and not callable(progress):
        raise InvalidValueError(f'progress is {progress!r}, allowed is a function, or None')


def _asked_drops(drops: int | None, precision: float, *, only_known: bool) -> int:
    if not _is_number(precision):
        raise InvalidValueError(f'precision is {precision!r}, allowed is a number')
    if drops is None:
        drops = 0 if precision else 1 if only_known else DEFAULT_DROPS
    if type(drops) is not int or drops > 0:
        check_drops(drops)
    drops = max_drops(drops, precision, MAX_DROPS)
    check_drops(drops)
    return drops


def _check_conditions(conditions: object) -> None:
    if conditions is None:
        return
    if not isinstance(conditions, DropConditions):
        raise InvalidValueError(
            f'conditions is {conditions!r}, allowed is DropConditions, or None'
        )
    _check_text('surface of conditions', conditions.surface)


def _check_text(name: str, text: object) -> None:
    """Not only a text: ROS sends what is before a NUL only, and that may be another name."""
    if not isinstance(text, str) or not text.isprintable():
        raise InvalidValueError(f'{name} is {text!r}, allowed is printable text')


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plain(value: Any) -> Any:
    """A number or truth of numpy as Python's; anything else as it is."""
    return value.item() if isinstance(value, np.generic) else value

"""What a client asks for, checked before anything is sent."""

import math

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from rclpy.node import Node
from resting_aspects_interfaces.msg import PartDescription
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution

from resting_aspects_ros.core.errors import (
    InvalidValueError,
    RestingAspectsError,
    UnknownPartError,
)
from resting_aspects_ros.core.part import MAX_NAME, is_valid_name
from resting_aspects_ros.core.pose_query import unit_orientation
from resting_aspects_ros.drops.ceiling import most_drops
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.run import DEFAULT_DROPS, check_drops, check_seed
from resting_aspects_ros.nodes.convert import conditions_msg
from resting_aspects_ros.nodes.interface import DROP_SIMULATOR, PARTS
from resting_aspects_ros.nodes.question import AnswerTimeoutError
from resting_aspects_ros.nodes.requests import asked_estimator, unknown_part
from resting_aspects_ros.nodes.topic_watch import published_parts


def distribution_request(
    part: str,
    *,
    drops: int | None,
    precision: float,
    surface: str,
    conditions: DropConditions | None,
    seed: int | None,
    method: str,
    only_known: bool,
) -> GetDistribution.Request:
    """The request, as RestingAspectsClient.get_distribution has it, checked."""
    check_name(part)
    if not method:
        raise InvalidValueError(
            f'method is {method!r}, allowed is drops or the name of an estimator'
        )
    if asked_estimator(method) is not None:
        return GetDistribution.Request(part=part, method=method)
    if surface and conditions is not None:
        raise InvalidValueError(
            f'surface is {surface!r} and conditions are given, allowed is one of them'
        )
    if drops is None:
        drops = 0 if precision else 1 if only_known else DEFAULT_DROPS
    drops = most_drops(drops, precision)
    check_drops(drops)
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
    numbers = np.asarray(orientation, dtype=np.float64)
    if numbers.shape != (4,):
        raise InvalidValueError(
            f'orientation has the shape {numbers.shape}, allowed is (4,): x, y, z, w'
        )
    xyzw = dict(zip('xyzw', unit_orientation(numbers).tolist(), strict=True))
    return ClassifyPose.Request(part=part, orientation=Quaternion(**xyzw))


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
    number = isinstance(timeout, int | float) and not isinstance(timeout, bool)
    if timeout is not None and not (number and 0 < timeout < math.inf):
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

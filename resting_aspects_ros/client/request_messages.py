"""Requests of the client, validated before they are sent."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from rclpy.node import Node
from resting_aspects_interfaces.action import ReorientPart
from resting_aspects_interfaces.msg import FeederAction, PartDescription
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution, GetTransitions

from resting_aspects_ros.api.plan import DEFAULT_ACTION, DEFAULT_PER_ASPECT, named_action
from resting_aspects_ros.aspects.aspect_set import unit_orientation
from resting_aspects_ros.client.pending_request import AnswerTimeoutError
from resting_aspects_ros.errors import (
    InvalidValueError,
    RestingAspectsError,
    UnknownPartError,
    shown,
)
from resting_aspects_ros.part.part import MAX_NAME, is_valid_name
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, PARTS
from resting_aspects_ros.ros.status import requested_estimator, unknown_part
from resting_aspects_ros.ros.topic_discovery import published_parts
from resting_aspects_ros.ros.transition_conversions import action_msg
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
    MAX_DROPS,
    check_drops,
    check_seed,
)
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.statistics.distribution import METHOD
from resting_aspects_ros.statistics.intervals import check_precision, max_drops


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
    """Return the validated request for the parameters of RestingAspectsClient.get_distribution.

    rclpy does not check fields: a value of another type would end the process.
    """
    check_name(part)
    _check_text('method', method)
    _check_surface(surface, conditions)
    drops, precision, seed = _plain(drops), _plain(precision), _plain(seed)
    only_known = _plain(only_known)
    if not isinstance(only_known, bool):
        raise InvalidValueError(f'invalid only_known {only_known!r}: expected True or False')
    if not method:
        raise InvalidValueError(
            f'invalid method {method!r}: expected drops or the name of an estimator'
        )
    if requested_estimator(method) is not None:
        return GetDistribution.Request(part=part, method=method)
    drops = _requested_drops(drops, precision, only_known=only_known)
    if seed is not None:
        check_seed(seed)
    return GetDistribution.Request(
        part=part,
        method=method,
        **_surface_fields(surface, conditions),
        drops=drops,
        precision=float(precision),
        seed=[] if seed is None else [seed],
        only_known=only_known,
    )


def reorient_goal(
    part: str,
    action: str | Action | NamedAction = DEFAULT_ACTION,
    per_aspect: int | None = None,
    *,
    precision: float = 0.0,
    drops: int = DEFAULT_DROPS,
    surface: str = '',
    conditions: DropConditions | None = None,
    seed: int = DEFAULT_SEED,
) -> ReorientPart.Goal:
    """Return the validated goal for the parameters of RestingAspectsClient.reorient_part."""
    check_name(part)
    if isinstance(action, str):
        _check_text('action', action)
        requested = FeederAction(name=action)
    else:
        requested = action_msg(named_action(action))
    _check_surface(surface, conditions)
    precision, drops, seed = _plain(precision), _plain(drops), _plain(seed)
    if precision != 0:
        check_precision(precision)
    default = 0 if precision else DEFAULT_PER_ASPECT
    per_aspect = default if per_aspect is None else _plain(per_aspect)
    if type(per_aspect) is not int or not 0 <= per_aspect <= MAX_DROPS:
        raise InvalidValueError(
            f'invalid per_aspect {shown(per_aspect)}: expected an integer from 0 to {MAX_DROPS}'
        )
    check_drops(drops)
    check_seed(seed)
    return ReorientPart.Goal(
        part=part,
        action=requested,
        **_surface_fields(surface, conditions),
        per_aspect=per_aspect,
        precision=float(precision),
        drops=drops,
        seed=seed,
    )


def transitions_request(part: str, action: str = '') -> GetTransitions.Request:
    """Return the validated request for the parameters of RestingAspectsClient.get_transitions."""
    check_name(part)
    _check_text('action', action)
    return GetTransitions.Request(part=part, action=action)


def pose_request(part: str, orientation: Quaternion | npt.ArrayLike) -> ClassifyPose.Request:
    """Return the validated request for the parameters of RestingAspectsClient.classify_pose."""
    check_name(part)
    if isinstance(orientation, Quaternion):
        orientation = [getattr(orientation, axis) for axis in 'xyzw']
    try:
        xyzw = np.asarray(orientation, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(
            f'invalid orientation {orientation!r}: expected 4 numbers x, y, z, w'
        ) from None
    if xyzw.shape != (4,):
        raise InvalidValueError(
            f'invalid orientation of shape {xyzw.shape}: expected (4,), x, y, z, w'
        )
    fields = dict(zip('xyzw', unit_orientation(xyzw).tolist(), strict=True))
    return ClassifyPose.Request(part=part, orientation=Quaternion(**fields))


def check_name(part: str) -> None:
    """Raise UnknownPartError for an invalid part name, and InvalidValueError for a non-string."""
    if not isinstance(part, str):
        raise InvalidValueError(f'invalid part {part!r}: expected the name of a part')
    if not is_valid_name(part):
        raise UnknownPartError(
            f'part {part[:MAX_NAME]!r} is not known: part names consist of lower case letters, '
            'digits and _, and start with a letter'
        )


def check_timeout(timeout: float | None) -> None:
    """Raise InvalidValueError for an invalid timeout."""
    if timeout is not None and not (_is_number(_plain(timeout)) and 0 < timeout < math.inf):
        raise InvalidValueError(f'invalid timeout {timeout!r}: expected more than 0 s, or None')


def missing_part_error(node: Node, part: str, timeout: AnswerTimeoutError) -> RestingAspectsError:
    """Return the error for a missing description of a part: the timeout, or its cause."""
    offered = published_parts(node, PARTS, PartDescription)
    if part in offered:
        return timeout
    if offered:
        return unknown_part(part, offered)
    return AnswerTimeoutError(
        f'no {DROP_SIMULATOR} offers {part}: {timeout}; start the suite with '
        '"resting_aspects nodes"'
    )


def check_progress(progress: object) -> None:
    """Raise InvalidValueError if progress is neither None nor callable."""
    if progress is not None and not callable(progress):
        raise InvalidValueError(f'invalid progress {progress!r}: expected a function, or None')


def _requested_drops(drops: int | None, precision: float, *, only_known: bool) -> int:
    if not _is_number(precision):
        raise InvalidValueError(f'invalid precision {precision!r}: expected a number')
    if drops is None:
        drops = 0 if precision else 1 if only_known else DEFAULT_DROPS
    if type(drops) is not int or drops > 0:
        check_drops(drops)
    drops = max_drops(drops, precision, MAX_DROPS)
    check_drops(drops)
    return drops


def _check_surface(surface: object, conditions: object) -> None:
    """Raise InvalidValueError for an invalid surface or conditions, or if both are given."""
    _check_text('surface', surface)
    if conditions is None:
        return
    if not isinstance(conditions, DropConditions):
        raise InvalidValueError(
            f'invalid conditions {conditions!r}: expected DropConditions, or None'
        )
    _check_text('surface of conditions', conditions.surface)
    if surface:
        raise InvalidValueError(
            f'invalid surface {surface!r}: expected no surface together with conditions'
        )


def _surface_fields(surface: str, conditions: DropConditions | None) -> dict[str, Any]:
    if conditions is None:
        return {'surface': surface}
    return {'surface': conditions.surface, 'conditions': [conditions_msg(conditions)]}


def _check_text(name: str, text: object) -> None:
    """Raise InvalidValueError for unprintable text: ROS would cut it at a NUL character."""
    if not isinstance(text, str) or not text.isprintable():
        raise InvalidValueError(f'invalid {name} {text!r}: expected printable text')


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plain(value: Any) -> Any:
    """Return a NumPy scalar as a Python object, and any other value unchanged."""
    return value.item() if isinstance(value, np.generic) else value

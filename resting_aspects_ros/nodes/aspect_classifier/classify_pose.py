"""The service classify_pose: the aspect of a pose, and the probability of this aspect."""

import math

import numpy as np
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ClassifyPose

from resting_aspects_ros.aspects.aspect_set import (
    POSE_ANGLE,
    AspectSet,
    nearest_aspect,
    unit_orientation,
)
from resting_aspects_ros.ros.conversions import status
from resting_aspects_ros.ros.status import NotAvailableError
from resting_aspects_ros.statistics.distribution import Distribution


def answer_pose(
    request: ClassifyPose.Request,
    response: ClassifyPose.Response,
    aspects: AspectSet,
    newest: Distribution | None,
) -> None:
    """Fill in the response; unknown values stay NaN.

    Parameters
    ----------
    aspects : AspectSet
        Aspects of the requested part.
    newest : Distribution, optional
        Distribution that provides the probability.

    Raises
    ------
    InvalidValueError
        The orientation is not a unit quaternion.
    NotAvailableError
        No aspect matches; the response contains the angle to the nearest aspect.
    """
    quaternion = request.orientation
    orientation = unit_orientation([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
    nearest = nearest_aspect(aspects, orientation)
    if nearest is None:
        response.angle = math.inf
        raise NotAvailableError(f'part {request.part!r} has no aspect')
    response.angle = nearest.angle
    if not nearest.fits:
        raise NotAvailableError(
            f'no aspect of {request.part} matches the orientation: the nearest is aspect '
            f'{nearest.aspect.id} at {np.degrees(nearest.angle):.6g} degrees, expected at most '
            f'{np.degrees(POSE_ANGLE):g}'
        )
    response.aspect = nearest.aspect.id
    response.symmetry_class = nearest.aspect.symmetry_class
    if newest is not None:
        response.probability = newest.intervals()[nearest.aspect.id - 1].probability
    response.status = status(Status.OK)

"""Answers of classify_pose: which aspect a pose is in, and how probable that is."""

import math

import numpy as np
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ClassifyPose

from resting_aspects_ros.core.aspects.aspect_set import POSE_ANGLE, AspectSet
from resting_aspects_ros.core.aspects.pose_query import nearest_aspect, unit_orientation
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.ros.conversions import status
from resting_aspects_ros.ros.status import NotAvailableError


def answer_pose(
    request: ClassifyPose.Request,
    response: ClassifyPose.Response,
    aspects: AspectSet,
    newest: Distribution | None,
) -> None:
    """Fill in the response, in which what is not known is NaN.

    Parameters
    ----------
    aspects : AspectSet
        Of the part that is asked about.
    newest : Distribution, optional
        From which the probability is taken.

    Raises
    ------
    InvalidValueError
        The orientation is no unit quaternion.
    NotAvailableError
        No aspect fits; the response has the angle to the nearest.
    """
    given = request.orientation
    orientation = unit_orientation([given.x, given.y, given.z, given.w])
    nearest = nearest_aspect(aspects, orientation)
    if nearest is None:
        response.angle = math.inf
        raise NotAvailableError(f'part {request.part!r} has no aspect')
    response.angle = nearest.angle
    if not nearest.fits:
        raise NotAvailableError(
            f'orientation is in no aspect of {request.part}: the nearest is {nearest.aspect.id} '
            f'at {np.degrees(nearest.angle):.6g} degrees, allowed is up to '
            f'{np.degrees(POSE_ANGLE):g}'
        )
    response.aspect = nearest.aspect.id
    response.symmetry_class = nearest.aspect.symmetry_class
    if newest is not None:
        response.probability = newest.intervals()[nearest.aspect.id - 1].probability
    response.status = status(Status.OK)

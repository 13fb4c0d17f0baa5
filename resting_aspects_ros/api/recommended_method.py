"""Which method to trust for a part under conditions, and these conditions without dimension."""

from dataclasses import replace

import numpy as np

from resting_aspects_ros.api.surroundings import surroundings_text
from resting_aspects_ros.core.estimators.aspect_features import mean_depth
from resting_aspects_ros.core.estimators.recommendation import Recommendation, recommend
from resting_aspects_ros.core.estimators.release import Release
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.simulation.conditions import DropConditions, HeightOf

# A part counts as thrown if its speed and its spin have more than this share of the energy of the
# height.
THROWN_SHARE = 0.25


def recommended_method(shape: RestingShape, conditions: DropConditions) -> Recommendation:
    """Return the method to trust for a part that is dropped under conditions."""
    part = shape.part
    if conditions.surroundings:
        return Recommendation(
            '',
            'No method is recommended: all of them assume an infinite level plane, and the drops '
            f'were made {surroundings_text(conditions.surroundings)}.',
        )
    speeds = 2 * conditions.speed_horizontal**2 + conditions.speed_vertical**2
    turning = conditions.spin**2 * float(np.trace(part.inertia)) / part.mass
    kinetic = (speeds + turning) / (2 * conditions.gravity)  # as a height, m
    return recommend(
        shape.aspects,
        release_numbers(shape, conditions),
        thrown=kinetic > THROWN_SHARE * conditions.height,
    )


def release_numbers(shape: RestingShape, conditions: DropConditions) -> Release:
    """Return the conditions without dimension, for a level plane.

    Surroundings, friction against spin about the vertical, and the difference of each part from
    the mean height of its lowest point are left out.
    """
    found = without_dimension(conditions, shape.part.hull_radius)
    if conditions.height_of is HeightOf.LOWEST_POINT:
        return found
    return replace(found, height=max(found.height - mean_depth(shape), 0.0))


def without_dimension(conditions: DropConditions, radius: float) -> Release:
    """Return the conditions for a part with the hull radius R, m, in units of R and sqrt(R / g).

    The height is that of the conditions, whether it is of the lowest point or not.
    """
    unit = float(np.sqrt(radius / conditions.gravity))
    return Release(
        height=conditions.height / radius,
        restitution=conditions.restitution,
        friction=conditions.friction,
        rolling_friction=conditions.rolling_friction,
        speed=conditions.speed_horizontal * unit / radius,
        speed_vertical=conditions.speed_vertical * unit / radius,
        spin=conditions.spin * unit,
    )

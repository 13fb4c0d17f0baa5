"""Which analytic method to trust for a part and the conditions of its drops."""

import numpy as np

from resting_aspects_ros.core.estimators.recommendation import Recommendation, recommend
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.simulation.conditions import DropConditions

# A part is thrown if its speed and its spin have more than this share of the height's energy.
THROWN_SHARE = 0.25


def recommended_method(shape: RestingShape, conditions: DropConditions) -> Recommendation:
    """Return the method to trust for a part that is dropped under conditions."""
    part = shape.part
    speeds = 2 * conditions.speed_horizontal**2 + conditions.speed_vertical**2
    turning = conditions.spin**2 * float(np.trace(part.inertia)) / part.mass
    kinetic = (speeds + turning) / (2 * conditions.gravity)  # as a height, m
    return recommend(
        shape.aspects,
        conditions.height / part.hull_radius,
        thrown=kinetic > THROWN_SHARE * conditions.height,
    )

"""The aspect nearest to a single pose, as a vision system requests it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import POSE_ANGLE, Aspect, AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import LENGTH_TOLERANCE, Array, canonical, down_in_part


@dataclass(frozen=True, eq=False)
class NearestAspect:
    """The aspect nearest to a pose, which need not be in it.

    angle : float
        Between the down directions of the pose and of the aspect, rad; 0 anywhere in the sweep of
        a curved aspect.
    """

    aspect: Aspect
    angle: float

    @property
    def fits(self) -> bool:
        """Whether the pose is in the aspect, by the rule that counts drops."""
        return bool(self.angle <= POSE_ANGLE)


def unit_orientation(xyzw: npt.ArrayLike) -> Array:
    """Return the quaternion (4,) scaled to length 1 and with w >= 0, to remove rounding errors.

    Raises InvalidValueError for a norm that is not within LENGTH_TOLERANCE of 1.
    """
    numbers = np.asarray(xyzw, dtype=np.float64)
    with np.errstate(over='ignore', invalid='ignore'):  # an overflow is rejected below
        norm = float(np.linalg.norm(numbers))
    if not abs(norm - 1) <= LENGTH_TOLERANCE:  # also rejects NaN
        shown = ', '.join(f'{number:.6g}' for number in numbers)
        raise InvalidValueError(
            f'invalid orientation ({shown}) of norm {norm:.6g}: expected a quaternion x, y, z, w '
            f'of norm 1 within {LENGTH_TOLERANCE:g}'
        )
    return canonical(numbers)


def nearest_aspect(aspects: AspectSet, orientation: Array) -> NearestAspect | None:
    """Return the aspect nearest to a unit quaternion; None if the part has no aspect."""
    ids, angles = aspects.locate(down_in_part(orientation[None]))
    if not ids[0]:
        return None
    return NearestAspect(aspects.aspects[int(ids[0]) - 1], float(angles[0]))

"""Which aspect one pose is in, and how far it is from it: what a vision system asks."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import POSE_ANGLE, Aspect, AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import LENGTH_TOLERANCE, Array, canonical, down_in_part


@dataclass(frozen=True, eq=False)
class NearestAspect:
    """The aspect that a pose is nearest to, whether it is in it or not.

    angle : float
        Between the pose's and the aspect's down in part, rad; 0 all over what a curved side
        sweeps.
    """

    aspect: Aspect
    angle: float

    @property
    def fits(self) -> bool:
        """Whether the pose is in the aspect, as drops are counted."""
        return bool(self.angle <= POSE_ANGLE)


def unit_orientation(xyzw: npt.ArrayLike) -> Array:
    """(4,) unit quaternion with w >= 0 of one that rounding left a little longer or shorter.

    Raises InvalidValueError for a norm that is not within LENGTH_TOLERANCE of 1.
    """
    numbers = np.asarray(xyzw, dtype=np.float64)
    with np.errstate(over='ignore', invalid='ignore'):  # what is as long as that is refused
        norm = float(np.linalg.norm(numbers))
    if not abs(norm - 1) <= LENGTH_TOLERANCE:  # also what is not a number
        shown = ', '.join(f'{number:.6g}' for number in numbers)
        raise InvalidValueError(
            f'orientation is the quaternion x, y, z, w = {shown} of norm {norm:.6g}, allowed is '
            f'a norm of 1 within {LENGTH_TOLERANCE:g}'
        )
    return canonical(numbers)


def nearest_aspect(aspects: AspectSet, orientation: Array) -> NearestAspect | None:
    """The aspect nearest to a unit quaternion, by the rule that counts drops; None without any."""
    ids, angles = aspects.locate(down_in_part(orientation[None]))
    if not ids[0]:
        return None
    return NearestAspect(aspects.aspects[int(ids[0]) - 1], float(angles[0]))

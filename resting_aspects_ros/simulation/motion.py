"""Motion of the surface as a rigid body, such as that of a vibrating plate."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array


class Motion(Protocol):
    """A motion of the surface that begins and ends at rest, with the surface in the plane z = 0.

    Lengths are in m and times in s. Before it begins and after its end, the frame of the surface
    is the tray frame.
    """

    @property
    def duration(self) -> float:
        """Time from the beginning to the end, s."""

    @property
    def time_step(self) -> float:
        """Maximum time step that resolves the motion, s."""

    def pose(self, time: Array) -> tuple[Array, Array]:
        """Return positions (n, 3) and quaternions xyzw (n, 4), tray from surface, at times."""

    def velocity(self, time: Array) -> tuple[Array, Array]:
        """Return the derivatives: velocity (n, 3), m/s, and angular velocity (n, 3), rad/s.

        The velocity is that of the origin of the surface; both are in tray axes.
        """

    def left(self, position: Array) -> npt.NDArray[np.bool_]:
        """Return which parts (n,) have left the surface.

        ``position`` (n, 3) are their centres of mass in the frame of the surface, m.
        """

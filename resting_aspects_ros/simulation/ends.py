"""How drops have ended, and the resting poses that follow."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.rotations import canonical, rotate, turned_down
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.release import body_from_part, depth_of, part_from_body
from resting_aspects_ros.simulation.scene import depth_along, in_tray_axes
from resting_aspects_ros.statistics.poses import DecidedBy, RestingPoses, RestStatus

# A part touches a half-space if its hull is closer than this, R: Bullet lets it rest at 0.001.
TOUCH = 0.005


@dataclass(frozen=True, eq=False)
class Ends:
    """How n drops have ended, in R and T, in the axes of the surroundings.

    position, orientation : (n, 3) and (n, 4) float
        Of the centre of mass, and xyzw, from body axes.
    status, minimum : (n,) int
        Codes of RestStatus, and the minimum of the landscape that the energy decided, or -1.
    time, growth : (n,) float
        From release to the end, and the largest growth of the energy, m g R.
    """

    position: Array
    orientation: Array
    status: npt.NDArray[np.uint8]
    minimum: npt.NDArray[np.int64]
    time: Array
    growth: Array

    @property
    def decided_by(self) -> npt.NDArray[np.uint8]:
        """(n,) codes of DecidedBy."""
        by_energy = self.minimum >= 0
        return np.where(by_energy, DecidedBy.ENERGY, DecidedBy.STILLNESS).astype(np.uint8)


def resting_poses(job: DropJob, first_drop: int, ends: Ends) -> RestingPoses:
    """Return the poses of drops that have ended, in the tray frame.

    The first has the index ``first_drop``.
    """
    scene = job.scene
    failed, settled = ends.status == RestStatus.FAILED, ends.status == RestStatus.SETTLED
    body = np.where(failed[:, None], [0.0, 0.0, 0.0, 1.0], ends.orientation)
    orientation = canonical(part_from_body(in_tray_axes(scene, body), job.axes))
    # A drop decided by its energy would continue to roll to the minimum. Its yaw and its sliding
    # on the way there are not predicted.
    decided = ends.minimum >= 0
    minima = job.rest.directions[ends.minimum[decided]]
    orientation[decided] = turned_down(orientation[decided], minima)
    # In Bullet, a hull rests a margin (0.001 R) above a plane; the pose has the part on it.
    if scene.level:
        centre = ends.position * job.radius
        depth = depth_of(body_from_part(orientation, job.axes), job.hull) * job.radius
        centre[:, 2] = np.where(settled, depth, centre[:, 2])
    else:
        put_down = np.where(settled[:, None], _put_down(job, ends.position, body), ends.position)
        centre = scene.in_tray(put_down * job.radius)
    return RestingPoses(
        first_drop=first_drop,
        position=np.where(failed[:, None], 0.0, centre - rotate(orientation, job.centre_of_mass)),
        orientation=orientation,
        status=ends.status,
        decided_by=ends.decided_by,
        time_to_rest=ends.time * job.time_unit,
        energy_growth=ends.growth,
    )


def _put_down(job: DropJob, position: Array, orientation: Array) -> Array:
    """Return positions (n, 3), R, at which hulls that rest near half-spaces touch them."""
    position = position.copy()
    planes = [
        (p.normal, p.offset / job.radius, depth_along(orientation, -p.normal, job.hull))
        for p in job.scene.half_spaces
    ]
    gaps = [(position * n).sum(axis=1) - offset - reach for n, offset, reach in planes]
    touching = [np.abs(gap) < TOUCH for gap in gaps]
    for _ in range(50 if len(planes) > 1 else 1):
        for (n, offset, reach), touches in zip(planes, touching, strict=True):
            gap = (position * n).sum(axis=1) - offset - reach
            position -= np.where(touches, gap, 0.0)[:, None] * n
    return position

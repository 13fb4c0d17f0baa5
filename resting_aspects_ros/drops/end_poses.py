"""Where drops ended: from bodies in R and T to parts in m and s."""

import numpy as np

from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import canonical, rotate, turned_down
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.release import body_from_part, depth_of, part_from_body
from resting_aspects_ros.drops.settling import Settling


def resting_poses(job: DropJob, first_drop: int, ends: Settling) -> RestingPoses:
    """The poses of drops that are over, the first of them with the index ``first_drop``."""
    failed = ends.status == RestStatus.FAILED
    body = np.where(failed[:, None], [0.0, 0.0, 0.0, 1.0], ends.orientation)
    orientation = canonical(part_from_body(body, job.axes))
    # What is decided by energy rolls on, to the minimum; how it turns and slides meanwhile is no
    # prediction.
    decided = ends.minimum >= 0
    orientation[decided] = turned_down(
        orientation[decided], job.rest.directions[ends.minimum[decided]]
    )
    centre = ends.position * job.radius
    # A hull rests a margin (0.001 R) above Bullet's plane; a part rests on the surface.
    settled = ends.status == RestStatus.SETTLED
    depth = depth_of(body_from_part(orientation, job.axes), job.hull) * job.radius
    centre[:, 2] = np.where(settled, depth, centre[:, 2])
    position = centre - rotate(orientation, job.centre_of_mass)
    return RestingPoses(
        first_drop=first_drop,
        position=np.where(failed[:, None], 0.0, position),
        orientation=orientation,
        status=ends.status,
        decided_by=ends.decided_by,
        time_to_rest=ends.time * job.time_unit,
        energy_growth=ends.growth,
    )

"""From the image of a camera above the tray to the tray, and from the tray to the robot.

Image coordinates are u to the right and v **down**, px. The tray frame has x and y on the surface
and z up. Seen from above, the second axis of the image is reversed: an angle from u towards v is
clockwise, and the yaw on the tray is the negative of it (plus the rotation of the camera).

A homography maps the image of points on the surface (z = 0) to the tray. It covers the position,
the direction and the focal length of a camera without lens distortion; distortion must be removed
from the image before. Above the surface, the models differ:

* Telecentric: a point at any height appears above its projection. No correction.
* Pinhole: a point at the height h appears where the line from the camera through it meets the
  surface. With the camera at the height H above the point f of the surface, q = f + (p - f) H /
  (H - h), so that the projection is p = f + (q - f) (H - h) / H.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.rotations import Array, canonical
from resting_aspects_ros.core.vision.homography import (
    checked_homography,
    checked_points,
    mapped,
    on_tray,
)
from resting_aspects_ros.core.vision.location import Pose

# Maximum deviation of a rotation matrix from an orthonormal one.
RIGID = 1e-6


@dataclass(frozen=True, eq=False)
class Telecentric:
    """A camera whose rays are vertical: heights have no effect.

    homography : (3, 3) float
        Maps (u, v, 1) px to (x, y, 1) m up to a factor.
    """

    homography: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, 'homography', checked_homography(self.homography))

    def to_tray(self, pixels: npt.ArrayLike) -> Array:
        """Return the points (n, 2) of the surface, m, that are seen at pixels (n, 2).

        Raises InvalidValueError if a pixel is beyond the horizon of the tray.
        """
        return on_tray(self.homography, checked_points('pixels', pixels))

    def to_image(self, points: npt.ArrayLike) -> Array:
        """Return the pixels (n, 2) at which points (n, 2) of the surface, m, are seen."""
        return mapped(np.linalg.inv(self.homography), checked_points('points', points))

    def projected(self, polygon: shapely.Polygon, height: float) -> shapely.Polygon:  # noqa: ARG002
        """Return the outline of a part of a height from its image on the surface."""
        return polygon


@dataclass(frozen=True, eq=False)
class Pinhole(Telecentric):
    """A camera with a centre of projection: high points appear magnified about its foot point.

    homography : (3, 3) float
        Maps (u, v, 1) px to (x, y, 1) m of the surface, up to a factor.
    position : (3,) float
        Centre of projection in the tray frame, m: the foot point x, y and the height H.
    """

    position: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            position = np.asarray(self.position, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            position = np.zeros(0)
        if position.shape != (3,) or not np.isfinite(position).all() or position[2] <= 0:
            given = position.tolist() if position.size else self.position
            raise InvalidValueError(
                f'invalid position of the camera {shown(given)}: expected x, y and a height above '
                '0 m'
            )
        object.__setattr__(self, 'position', position)

    def projected(self, polygon: shapely.Polygon, height: float) -> shapely.Polygon:
        """Return the outline of a part of a height from its image on the surface.

        It is exact if all edges of the silhouette are at ``height``: those of a prism below the
        camera, whose top edge is seen. An edge of the silhouette at another height z is displaced
        radially by at most r (height - z) / H, with its distance r from the foot point; for a
        prism beside the foot point this is r height / H at its near side, where the camera sees
        the bottom edge.

        Parameters
        ----------
        polygon : Polygon
            The image of the part on the surface, m, tray frame.
        height : float
            Height of the edge of the silhouette above the surface, m.

        Raises
        ------
        InvalidValueError
            The height is negative or not below the camera.
        """
        x, y, top = self.position
        if not 0 <= height < top:
            raise InvalidValueError(
                f'invalid height {height:.4g} m: expected 0 or more, and less than the height '
                f'{top:g} m of the camera'
            )
        foot, factor = np.array([x, y]), (top - height) / top
        return shapely.transform(polygon, lambda points: foot + factor * (points - foot))

    def moved(self, foot: npt.ArrayLike) -> 'Pinhole':
        """Return the camera above another point of the surface, m."""
        return Pinhole(self.homography, np.append(foot, self.position[2]))

    def seen(self, points: npt.ArrayLike) -> Array:
        """Return where points (n, 3), m, tray frame, appear on the surface, (n, 2) m."""
        given = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        top = self.position[2]
        if not (given[:, 2] < top).all():
            raise InvalidValueError(
                f'invalid points: expected heights below {top:g} m, the camera'
            )
        foot = self.position[:2]
        return np.asarray(foot + (given[:, :2] - foot) * (top / (top - given[:, 2]))[:, None])


def surface_pinhole(position: npt.ArrayLike) -> Pinhole:
    """Return a pinhole camera at a position (3,), m, whose pixels are points of the surface, m."""
    return Pinhole(np.diag([1.0, -1.0, 1.0]), np.asarray(position, dtype=np.float64))


def transformed_pose(matrix: npt.ArrayLike, pose: Pose) -> Pose:
    """Return a pose in another frame, such as that of the robot.

    Parameters
    ----------
    matrix : (4, 4) float
        Robot from tray: a rotation and a translation, m.
    pose : Pose
        Pose of a part, tray frame.

    Raises
    ------
    InvalidValueError
        The matrix is not that of a rigid motion.
    """
    given = np.asarray(matrix, dtype=np.float64)
    if (
        given.shape != (4, 4)
        or not np.isfinite(given).all()
        or not np.allclose(given[:3, :3] @ given[:3, :3].T, np.eye(3), atol=RIGID)
        or np.linalg.det(given[:3, :3]) < 0
        or not np.allclose(given[3], (0, 0, 0, 1), atol=RIGID)
    ):
        raise InvalidValueError(
            f'invalid transform {shown(given.tolist())}: expected a 4 x 4 matrix of a rotation '
            'and a translation in m, with the last row 0 0 0 1'
        )
    rotation = Rotation.from_matrix(given[:3, :3])
    return Pose(
        pose.aspect,
        given[:3, :3] @ pose.position + given[:3, 3],
        canonical((rotation * Rotation.from_quat(pose.orientation)).as_quat()),
        pose.yaw_known,
    )

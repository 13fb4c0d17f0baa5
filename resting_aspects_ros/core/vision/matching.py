"""How well two outlines match after some rotation and translation."""

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import minimize
from shapely import affinity

from resting_aspects_ros.core.vision.boundary import ROUGH, SAME, turn
from resting_aspects_ros.core.vision.common_area import common_area
from resting_aspects_ros.core.vision.fitting import Fit, Shape, candidate_yaws, fit, shape_of

Array = npt.NDArray[np.float64]
# Yaw, rad, and shift (2,) of the centroid of a model relative to that of the seen outline, m.
Pose = tuple[float, Array]

# If the overlap after the best fit is below ALIKE, the outlines differ. The overlap is then
# computed at YAWS yaws and maximized from the best TRIES of them, in steps of START (rad, and
# radii), with outlines that are simplified to within COARSE, radii. Of overlaps that are equal
# within EQUAL, the one with the closest boundaries counts.
ALIKE, YAWS, TRIES, START, COARSE, EQUAL = 0.9, 36, 4, 0.1, 1e-3, 2e-3


def same_outline(model: shapely.Polygon, seen: shapely.Polygon, play: float = 0.0) -> bool:
    """Return whether two outlines are equal after some rotation and translation.

    Their boundaries are closer than SAME times the larger radius about the centroid, in addition
    to the effect of the tessellation and to ``play``, m.
    """
    one, other = shape_of(model), shape_of(seen)
    a, b = one.boundary, other.boundary
    # Boundaries that are so close enclose areas that differ by at most this times a perimeter.
    reach = SAME * max(a.radius, b.radius) + play + a.skins.max() + b.skins.max()
    if abs(one.area - other.area) > 1.1 * reach * max(one.perimeter, other.perimeter):
        return False
    return any(a.equals(b, *_pose(each, one, other), play) for each in fit(one, other))


def best_overlap(model: shapely.Polygon, seen: shapely.Polygon) -> tuple[float, float]:
    """Return the maximum intersection over union over all yaws and positions, and the distance.

    The distance is the symmetric Hausdorff distance of the boundaries, with their holes, in that
    pose, m.
    """
    one, other = (_simplified(each, ROUGH) for each in (model, seen))
    poses = [_pose(each, one, other) for each in fit(one, other)]
    # Outlines that differ may overlap more if only their centroids coincide.
    yaw = float(candidate_yaws(one, other)[0])
    poses.append((yaw, np.zeros(2)))
    found = [(_overlap(one, other, *pose), pose) for pose in poses]
    highest = max(overlap for overlap, _ in found)
    if highest < ALIKE:
        a, b = (_simplified(each, COARSE) for each in (model, seen))
        yaws = (yaw + 2 * np.pi * np.arange(YAWS) / YAWS).tolist()
        starts = sorted(yaws, key=lambda angle: -_overlap(a, b, angle, np.zeros(2)))[:TRIES]
        # With one outline inside the other, many positions have the same overlap.
        tried = [(angle, np.zeros(2)) for angle in starts]
        tried += [_pose_of_maximum_overlap(a, b, angle) for angle in starts]
        found += [(_overlap(one, other, *pose), pose) for pose in tried]
        highest = max(overlap for overlap, _ in found)
    ends = [row for row in found if row[0] >= highest - EQUAL]
    return highest, min(_distance(one, other, *pose) for _, pose in ends)


def _simplified(polygon: shapely.Polygon, tolerance: float) -> Shape:
    """Return the shape of a polygon without points that move its boundary by less, radii."""
    radius = shape_of(polygon).boundary.radius
    simple = polygon.simplify(tolerance * radius)
    return shape_of(simple if isinstance(simple, shapely.Polygon) else polygon)


def mirrored(polygon: shapely.Polygon) -> shapely.Polygon:
    """Return the mirror image of a polygon: x remains, y changes its sign."""
    return shapely.geometry.polygon.orient(affinity.scale(polygon, 1.0, -1.0, origin=(0, 0)))


def _pose(found: Fit, model: Shape, seen: Shape) -> Pose:
    moved = turn(found.yaw) @ model.boundary.centre - seen.boundary.centre
    return found.yaw, np.array([found.x, found.y]) + moved


def _overlap(model: Shape, seen: Shape, yaw: float, shift: Array) -> float:
    """Return the intersection over union."""
    matrix = turn(yaw)
    move = seen.boundary.centre + shift - matrix @ model.boundary.centre
    moved = shapely.transform(model.polygon, lambda points: points @ matrix.T + move)
    common = common_area(moved, seen.polygon)
    return common / (model.area + seen.area - common)


def _pose_of_maximum_overlap(model: Shape, seen: Shape, yaw: float) -> Pose:
    """Return the pose of the local maximum of the overlap near a yaw."""
    scale = model.boundary.radius

    def loss(step: Array) -> float:
        return -_overlap(model, seen, yaw + step[0], scale * step[1:])

    simplex = START * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    best = minimize(
        loss,
        np.zeros(3),
        method='Nelder-Mead',
        options={'initial_simplex': simplex, 'xatol': 1e-3, 'fatol': 1e-4},
    )
    return yaw + float(best.x[0]), scale * best.x[1:]


def _distance(model: Shape, seen: Shape, yaw: float, shift: Array) -> float:
    """Return the symmetric Hausdorff distance of the boundaries, m."""
    matrix, one, other = turn(yaw), model.boundary, seen.boundary
    there, _ = other.nearest(one.points @ matrix.T + shift)
    back, _ = one.nearest((other.points - shift) @ matrix)
    return float(np.linalg.norm(np.concatenate([there, back]), axis=1).max())

"""The flat facets of a part's convex hull, on which it can rest."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.rotations import Array

# Hull triangles whose normals differ by less belong to one facet: the noise of a mesh's
# triangulation and of its exporter's rounding, far below the angles that a part is built with.
COPLANAR_ANGLE = np.radians(1.0)


@dataclass(frozen=True, eq=False)
class Facet:
    """A facet of the hull, seen from the centre of mass.

    normal : (3,) float
        Outward unit normal, part frame: *down in part* of a part that lies on the facet.
    polygon : (k, 3) float
        Its corners in order, counter-clockwise seen from outside, from the centre of mass, m.
    height : float
        Of the centre of mass above the facet's plane, m.
    margin : float
        Distance from the centre of mass's foot on the plane to the nearest edge, m; negative if it
        is outside.
    solid_angle : float
        Of the facet seen from the centre of mass, sr.
    """

    normal: Array
    polygon: Array
    height: float
    margin: float
    solid_angle: float


def hull_facets(vertices: Array) -> list[Facet]:
    """Merge the coplanar triangles of a convex hull.

    Parameters
    ----------
    vertices : (n, 3) float
        Vertices of the hull from the centre of mass, m.
    """
    hull = ConvexHull(vertices)
    return [_facet(hull, members) for members in _coplanar_groups(hull)]


def _coplanar_groups(hull: ConvexHull) -> list[npt.NDArray[np.int64]]:
    """Triangle indices of each facet.

    Each facet grows from its largest triangle over neighbours that agree with that triangle's
    normal: neighbours compared with each other would make one facet of a finely divided cylinder.
    """
    corners = hull.points[hull.simplices]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    normals = hull.equations[:, :3]
    free = np.ones(len(normals), dtype=bool)
    groups = []
    for seed in np.argsort(-area, kind='stable'):
        if not free[seed]:
            continue
        free[seed] = False
        members = [int(seed)]
        for triangle in members:
            for neighbour in hull.neighbors[triangle]:
                if free[neighbour] and _angle(normals[neighbour], normals[seed]) < COPLANAR_ANGLE:
                    free[neighbour] = False
                    members.append(int(neighbour))
        groups.append(np.array(members))
    return groups


def _angle(a: Array, b: Array) -> float:
    # Exact for small angles, where the cosine is blind.
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _facet(hull: ConvexHull, members: npt.NDArray[np.int64]) -> Facet:
    points = hull.points[np.unique(hull.simplices[members])]
    # Of the triangle on which the centre of mass is lowest: on that one the part rests, if on any.
    normals = hull.equations[members, :3]
    normal = normals[(points @ normals.T).max(axis=0).argmin()]
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    plane = np.stack([across, np.cross(normal, across)])  # right-handed with the normal
    flat = points @ plane.T
    outline = ConvexHull(flat)  # in two dimensions its vertices come counter-clockwise
    edges = -outline.equations  # inward normals and offsets: the foot is the origin
    corners = points[outline.vertices]
    return Facet(
        normal=normal,
        polygon=corners,
        height=float((corners @ normal).max()),
        margin=float(edges[:, 2].min()),
        solid_angle=_solid_angle(hull.points[hull.simplices[members]]),
    )


def _solid_angle(triangles: Array) -> float:
    """Of triangles (k, 3 corners, 3) seen from the origin, sr: Van Oosterom and Strackee 1983.

    Of a facet's own triangles, so that all facets together make 4 pi, however it is bounded.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = (a * np.cross(b, c)).sum(axis=1)
    spread = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.abs(2 * np.arctan2(triple, spread)).sum())

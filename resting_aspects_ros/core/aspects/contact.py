"""The connected regions where the mesh of a part touches the surface in an aspect."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from resting_aspects_ros.core.aspects.aspect_set import Aspect
from resting_aspects_ros.core.geometry.polyhedron import COPLANAR, Indices
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, rotate


@dataclass(frozen=True, eq=False)
class ContactRegion:
    """A connected region of the mesh that touches the surface.

    points : (n, 3) float
        Its vertices relative to the centre of mass, m, part axes.
    outline : (n, 2) float
        The vertices projected onto the surface, m, tray axes.
    area : float
        Area of its triangles on the surface, m^2; 0 for an edge or a corner.
    holes : int
        Number of holes between these triangles.
    beside, sizes : (k, 3) and (k,) float
        Unit normals and areas, m^2, of the triangles adjacent to its edges or its corner.
    """

    points: Array
    outline: Array
    area: float
    holes: int
    beside: Array
    sizes: Array


def contact_regions(part: Part, aspect: Aspect) -> list[ContactRegion]:
    """Return the regions of the mesh that touch the surface in the pose of the aspect."""
    down = aspect.down_in_part
    height = part.vertices @ -down
    near = height - height.min() <= _tolerance(part, aspect)
    faces = part.faces[near[part.faces].any(axis=1)]
    vertices, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    near = near[vertices]
    points = part.vertices[vertices] - part.centre_of_mass
    normals = np.cross(
        points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    )
    double = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(double, np.finfo(float).tiny)[:, None]
    touching = near[faces]
    flat = touching.all(axis=1) & (normals @ down > np.cos(CURVED_STEP))
    label = _labels(faces, touching, len(vertices))
    of_face = label[faces[np.arange(len(faces)), touching.argmax(axis=1)]]
    outline = rotate(aspect.orientation, points)[:, :2]
    regions = []
    used = np.flatnonzero(near)
    for group, here in zip(_grouped(label[used]), _grouped(of_face), strict=True):
        own = used[group]
        on_surface = here[flat[here]]
        joined = touching[here].sum(axis=1) >= min(len(own), 2)
        beside = here[~flat[here] & joined & (double[here] > 0)]
        regions.append(
            ContactRegion(
                points[own],
                outline[own],
                float(double[on_surface].sum() / 2),
                _holes(faces[on_surface]),
                normals[beside],
                double[beside] / 2,
            )
        )
    return regions


def _grouped(labels: Indices) -> list[Indices]:
    """Return the indices of equal labels, in the order of the labels."""
    order = np.argsort(labels, kind='stable')
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _tolerance(part: Part, aspect: Aspect) -> float:
    """Return the maximum height above the surface at which the mesh still touches it, m.

    It includes the corners of the support, even if noise or a simplified hull lifts them.
    """
    corners = rotate(aspect.orientation, part.hull_vertices - part.centre_of_mass)
    height = corners[:, 2] - corners[:, 2].min()
    noise = 2 * COPLANAR * part.hull_radius
    below = [
        height[np.abs(corners[:, :2] - corner).max(axis=1) <= noise].min(initial=np.inf)
        for corner in aspect.support
    ]
    lifted = max((rise for rise in below if rise < np.inf), default=0.0)
    return max(noise, part.hull_error) + float(lifted)


def _labels(faces: Indices, touching: npt.NDArray[np.bool_], count: int) -> Indices:
    """Return the region number (count,) of each vertex, connected by edges that touch."""
    pairs = [
        faces[touching[:, a] & touching[:, b]][:, (a, b)] for a, b in ((0, 1), (1, 2), (2, 0))
    ]
    a, b = np.concatenate(pairs).T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _holes(faces: Indices) -> int:
    """Return the number of holes of a connected region, by Euler's formula."""
    edges = np.sort(faces[:, ((0, 1), (1, 2), (2, 0))].reshape(-1, 2), axis=1)
    return 1 - len(np.unique(faces)) + len(np.unique(edges, axis=0)) - len(faces)

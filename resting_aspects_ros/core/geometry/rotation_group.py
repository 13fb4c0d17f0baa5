"""Candidate symmetry rotations from a surface and from landmarks, and rotation groups."""

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

# Second moments of the surface that differ by less, as a share, may be equal: the tessellation of
# a symmetric solid changes them by this much.
ALIKE = 0.02
# Number of triangles at a time, whose arrays fit into the cache of a processor.
BATCH = 1_000
# Maximum difference of equal angles between landmarks, rad; landmarks have errors of 1e-3.
LANDMARK_ANGLE = 5e-3
# Maximum cosine between two landmarks, so that their errors rotate their frame only slightly.
FAR_FROM_COLLINEAR = 0.99
# Number of directions on a hemisphere: every axis is within 0.03 of one, and the error of a half
# turn is twice that.
DIRECTIONS = 4000
# Rotations of a group that differ by less, rad, are equal. It is more than the error of rotations
# that are found on a mesh, and less than the steps of any polyhedral group.
SAME = 0.1
# The largest group that is neither cyclic nor dihedral: the icosahedron's.
LARGEST = 60


def surface_frame(triangles: Array) -> tuple[Array, Flags]:
    """Return axes (3, 3), one per row, and which of them only a half turn can move.

    They are those of the most significant of three matrices that rotate with the surface: two
    second moments, weighted by 1 and by r^4, and the outer product of the mean of r^2 times the
    position.
    """
    area, second, sixth, mean = 0.0, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    for first in range(0, len(triangles), BATCH):
        points, weights = _quadrature(triangles[first : first + BATCH])
        square = np.einsum('ij,ij->i', points, points)
        area += float(weights.sum())
        second += (weights[:, None] * points).T @ points
        sixth += ((weights * square**2)[:, None] * points).T @ points
        mean += (weights * square) @ points
    moments = [second / area, sixth / area]
    mean /= area
    moments.append(np.outer(mean, mean) / max(float(np.linalg.norm(mean)), ALIKE**2))
    size = float(np.trace(moments[0]))
    found = []
    for moment in moments:
        values, axes = np.linalg.eigh(moment / max(float(np.trace(moment)), size * ALIKE))
        gaps = np.diff(values) > ALIKE
        alone = np.array([gaps[0], gaps.all(), gaps[1]])
        found.append((axes.T, alone))
    return max(found, key=lambda each: each[1].sum())


def _quadrature(triangles: Array) -> tuple[Array, Array]:
    """Return points (n, 3) and weights (n,) that integrate degree 6 over triangles.

    They are Gauss points of a square with one side collapsed to a corner. So the moments of a
    surface do not depend on its division into triangles.
    """
    at, share = np.polynomial.legendre.leggauss(4)
    u, v = (side.ravel() for side in np.meshgrid((at + 1) / 2, (at + 1) / 2))
    weight = np.outer(share, share).ravel() * v
    barycentric = np.stack([1 - v, v * (1 - u), v * u], axis=1)
    corners = np.ascontiguousarray(np.moveaxis(triangles, 1, 0))
    a, b, c = corners
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    points = (barycentric @ corners.reshape(3, -1)).reshape(-1, 3)
    return points, np.outer(weight, area).ravel()


def pair_rotations(landmarks: Array) -> Array:
    """Return rotations (k, 3, 3) from one pair of landmarks to all pairs with the same angle."""
    cosines = np.clip(landmarks @ landmarks.T, -1, 1)
    angles = np.arccos(cosines)
    first, second = np.nonzero(np.abs(cosines) < FAR_FROM_COLLINEAR)
    if not len(first):
        return np.zeros((0, 3, 3))
    of_pairs = angles[first, second]
    ranked = np.sort(of_pairs)
    alike = np.searchsorted(ranked, of_pairs + LANDMARK_ANGLE)
    alike -= np.searchsorted(ranked, of_pairs - LANDMARK_ANGLE)
    rare = np.abs(of_pairs - of_pairs[alike.argmin()]) <= LANDMARK_ANGLE
    frames = _frames(landmarks[first[rare]], landmarks[second[rare]])
    return np.asarray(frames @ frames[0].T)


def _frames(first: Array, second: Array) -> Array:
    """Return right-handed frames (k, 3, 3) of pairs of directions; the first axis is halfway."""
    x, z = first + second, np.cross(first, second)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def sample_rotations() -> Array:
    """Return rotations (k, 3, 3) of orders 2 to 5 about axes on a hemisphere.

    The axes are on a Fibonacci spiral.
    """
    z = (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    azimuth = np.pi * (1 + np.sqrt(5)) * np.arange(DIRECTIONS)
    ring = np.sqrt(1 - z**2)
    axes = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    # Permuted, so that the first few are evenly distributed.
    axes = np.random.default_rng(22).permutation(axes)
    angles = 2 * np.pi / np.array([2.0, 3.0, 4.0, 5.0])
    return np.asarray(
        Rotation.from_rotvec((angles[:, None] * axes[:, None]).reshape(-1, 3)).as_matrix()
    )


def turns(axis: Array, angles: Array) -> Array:
    """Return rotations (k, 3, 3) about a unit vector (3,) by angles (k,), rad."""
    return np.asarray(Rotation.from_rotvec(np.asarray(angles)[:, None] * axis).as_matrix())


def half_turns(axes: Array) -> Array:
    """Return half turns (k, 3, 3) about unit vectors (k, 3)."""
    return 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)


def dihedral(axis: Array, order: int, flip: Array | None) -> Array:
    """Return the cyclic group about an axis, (n, 3, 3), or with a flip (3, 3) the dihedral one."""
    cyclic = turns(axis, 2 * np.pi * np.arange(order) / order)
    cyclic[0] = np.eye(3)
    return cyclic if flip is None else np.concatenate([cyclic, cyclic @ flip])


def contains(group: Array, rotation: Array, within: float = SAME) -> bool:
    """Return whether a rotation is in a group, up to errors, rad."""
    return bool(_angles(group, rotation).min() < within)


def generated(generators: Array) -> Array | None:
    """Return the group (n, 3, 3) that rotations generate, identity first.

    They may have small errors. None if they do not generate a finite group, or if it is larger
    than that of the icosahedron: then one of them is not a symmetry of the solid.
    """
    group = [np.eye(3)]
    for element in group:
        for generator in generators:
            product = element @ generator
            if not contains(np.array(group), product):
                if len(group) == LARGEST:
                    return None
                group.append(product)
    return _closed(np.array(group))


def _closed(group: Array) -> Array | None:
    """Return the group without errors; None if it is not closed.

    Each element is replaced by the mean of g_k g_j^-1 over all pairs whose product is the element.
    A fixed point is closed up to rounding, and each iteration squares the error.
    """
    for _ in range(4):
        products = group[:, None] @ group.transpose(0, 2, 1)
        flat = products.reshape(-1, 3, 3)
        likeness = flat.reshape(-1, 9) @ group.reshape(-1, 9).T
        element = likeness.argmax(axis=1)
        apart = np.linalg.norm(flat - group[element], axis=(1, 2)) / np.sqrt(2)
        if apart.max() > SAME or (np.bincount(element) != len(group)).any():
            return None
        sums = np.zeros_like(group)
        np.add.at(sums, element, flat)
        u, _, v = np.linalg.svd(sums)
        group = u @ v
    group[0] = np.eye(3)
    return group


def _angles(group: Array, rotation: Array) -> Array:
    """Return the angles (n,) of the elements to a rotation, rad, as chords, for small angles."""
    return np.asarray(np.linalg.norm(group - rotation, axis=(1, 2)) / np.sqrt(2))

"""Rotations that a solid without an axis of its own may have: from landmarks, or everywhere."""

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]

# Landmarks are right to 1e-3; so far may angles between them differ, rad.
LANDMARK_ANGLE = 5e-3
# Cosine up to which two landmarks make a frame that their errors turn by little.
FAR_FROM_COLLINEAR = 0.99
# Directions on half a sphere: within 0.03 of any axis, and a half turn moves twice as much.
DIRECTIONS = 4000


def pair_rotations(landmarks: Array) -> Array:
    """Return rotations (k, 3, 3) from one pair of landmarks to all with the same angle."""
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
    """Return right-handed frames (k, 3, 3) of pairs of directions, columns, halfway first."""
    x, z = first + second, np.cross(first, second)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def everywhere() -> Array:
    """Return rotations (k, 3, 3) of orders 2 to 5 about axes in all directions, half of them.

    Directions on a Fibonacci spiral.
    """
    z = (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    azimuth = np.pi * (1 + np.sqrt(5)) * np.arange(DIRECTIONS)
    ring = np.sqrt(1 - z**2)
    axes = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    # In any order, so that the first few are spread.
    axes = np.random.default_rng(22).permutation(axes)
    angles = 2 * np.pi / np.array([2.0, 3.0, 4.0, 5.0])
    return np.asarray(
        Rotation.from_rotvec((angles[:, None] * axes[:, None]).reshape(-1, 3)).as_matrix()
    )

"""Rotations of a part onto itself that an aspect or a turn about the vertical needs."""

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.aspects.symmetry import Symmetry
from resting_aspects_ros.core.rotations import Array, rotation_between

# Maximum angle between equal directions, rad.
SAME_DIRECTION = 0.01


def rotation_to(symmetry: Symmetry | None, one: Array, other: Array) -> Array:
    """Return the rotation (3, 3) of the part onto itself that comes closest to one -> other."""
    if symmetry is None:
        return np.eye(3)
    if symmetry.kind == 'spherical':
        return Rotation.from_quat(rotation_between(one, other)).as_matrix()
    rotations = symmetry.rotations
    if symmetry.axis is not None:
        rotations = np.array([_about(symmetry.axis, r @ one, other) @ r for r in rotations])
    return np.asarray(rotations[(rotations @ one @ other).argmax()])


def _about(axis: Array, one: Array, other: Array) -> Array:
    """Return the rotation (3, 3) about an axis that brings ``one`` closest to ``other``."""
    along = np.cross(axis, one)
    angle = np.arctan2(other @ along, other @ one - (axis @ one) * (axis @ other))
    return Rotation.from_rotvec(angle * axis).as_matrix()


def is_symmetry(symmetry: Symmetry | None, vector: Array, tolerance: float) -> bool:
    """Return whether the turn of a rotation vector (3,) maps the part onto itself."""
    turn = Rotation.from_rotvec(vector).as_matrix()
    if symmetry is None:
        return bool(np.linalg.norm(vector) <= tolerance)
    if symmetry.kind == 'spherical':
        return True
    if symmetry.axis is not None:
        image = turn @ symmetry.axis
        cosines = symmetry.rotations @ symmetry.axis @ image
        return bool(cosines.max() >= np.cos(tolerance))
    traces = np.einsum('kij,ij->k', symmetry.rotations, turn)
    return bool((traces.max() - 1) / 2 >= np.cos(tolerance))


def vertical_order(symmetry: Symmetry | None, down: Array) -> int:
    """Return how many rotations about a direction map the part onto itself; 0 if all do."""
    if symmetry is None:
        return 1
    if all(is_symmetry(symmetry, angle * down, SAME_DIRECTION) for angle in (1.0, 2.2)):
        return 0
    if symmetry.axis is not None:  # of a body of revolution, beside the direction
        return 2 if is_symmetry(symmetry, np.pi * down, SAME_DIRECTION) else 1
    moved = np.linalg.norm(symmetry.rotations @ down - down, axis=1)
    return int((moved < SAME_DIRECTION).sum())

"""Finite groups of rotations, from a few of their elements."""

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]

# Rotations of a group that differ by less, rad, are one: more than the error of what is found on
# a mesh, less than the steps of any polyhedron's group.
SAME = 0.1
# The largest group that is neither cyclic nor dihedral: the icosahedron's.
LARGEST = 60


def turns(axis: Array, angles: Array) -> Array:
    """Return (k, 3, 3) rotations about a unit vector (3,) by angles (k,), rad."""
    return np.asarray(Rotation.from_rotvec(np.asarray(angles)[:, None] * axis).as_matrix())


def half_turns(axes: Array) -> Array:
    """Return (k, 3, 3) half turns about unit vectors (k, 3)."""
    return 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)


def dihedral(axis: Array, order: int, flip: Array | None) -> Array:
    """Return the turns about an axis, (n, 3, 3), and with a half turn (3, 3) across also those."""
    cyclic = turns(axis, 2 * np.pi * np.arange(order) / order)
    cyclic[0] = np.eye(3)
    return cyclic if flip is None else np.concatenate([cyclic, cyclic @ flip])


def contains(group: Array, rotation: Array, within: float = SAME) -> bool:
    """Tell whether a rotation is in a group, but for errors, rad."""
    return bool(_angles(group, rotation).min() < within)


def generated(generators: Array) -> Array | None:
    """Return the group (n, 3, 3) that rotations generate, identity first.

    They may be off a little. None if what they generate is no finite group, or larger than
    the icosahedron's: then one of them is none of the solid.
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
    """Take the errors out of a group: each element is the mean of all ways to multiply to it.

    The mean of g_k g_j^-1 over all pairs whose product is the element: a fixed point is closed to
    rounding, and each round squares the error.
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
    """Return how far the elements are from a rotation, rad (n,), as chords for small ones."""
    return np.asarray(np.linalg.norm(group - rotation, axis=(1, 2)) / np.sqrt(2))

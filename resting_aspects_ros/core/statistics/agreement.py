"""Comparison of two classifications of the same poses: by aspects and by clusters."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.clusters import Clusters

Array = npt.NDArray[np.float64]
Ids = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Agreement:
    """The poses on which the two classifications agree.

    An aspect and a cluster match if each contains more poses of the other than of any third. The
    classifications agree on a pose if it is in an aspect and in the matching cluster. They never
    agree on a pose in no aspect, because every pose is in a cluster.

    aspect : (n,) int
        Id of each pose's aspect; 0 for none.
    cluster : (n,) int
        Label of each pose's cluster.
    cluster_of : (a,) int
        For each aspect, by id from 1, the cluster with most of its poses; 0 if it has no poses.
    shared : (a,) int
        Number of poses of each aspect in that cluster.
    agree : (n,) bool
    """

    aspect: Ids
    cluster: Ids
    cluster_of: Ids
    shared: Ids
    agree: npt.NDArray[np.bool_]


def find_agreement(ids: Ids, aspects: int, clusters: Clusters) -> Agreement:
    """Return the agreement of aspect ids (n,), of ``aspects`` different ones, with clusters."""
    shape = (aspects + 1, len(clusters) + 1)
    cells = np.bincount(ids * shape[1] + clusters.labels, minlength=shape[0] * shape[1])
    table = cells.reshape(shape)
    table[0] = 0  # in no aspect
    cluster_of = table.argmax(axis=1)  # of equal ones the larger cluster and the lower id
    aspect_of = table.argmax(axis=0)
    agree = (ids > 0) & (cluster_of[ids] == clusters.labels) & (aspect_of[clusters.labels] == ids)
    return Agreement(ids, clusters.labels, cluster_of[1:], table.max(axis=1)[1:], agree)


@dataclass(frozen=True, eq=False)
class Differences:
    """The poses on which the two classifications differ, in order; each field is (m,).

    pose : int, index of the pose, from 0.
    nearest, angle : the nearest aspect, 0 if the part has none, and the angle to it, rad.
    aspect, cluster : int, the two classifications; aspect 0 means none.
    """

    pose: Ids
    nearest: Ids
    angle: Array
    aspect: Ids
    cluster: Ids

    def __len__(self) -> int:
        return len(self.pose)


def find_differences(agreement: Agreement, aspects: AspectSet, down: Array) -> Differences:
    """Return the poses without agreement; ``down`` are the down directions (n, 3) of all poses."""
    pose = np.flatnonzero(~agreement.agree)
    nearest, angle = aspects.locate(down[pose])
    return Differences(pose, nearest, angle, agreement.aspect[pose], agreement.cluster[pose])

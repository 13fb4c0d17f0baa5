"""Sort resting poses into clusters, and into the aspects of a part."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.inputs.pose_csv import NOT_AT_REST, PoseTable, read_pose_csv
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.surroundings import on_level_floor
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.clusters import (
    DEFAULT_TOLERANCE_DEGREES,
    Clusters,
    check_tolerance,
    find_clusters,
)
from resting_aspects_ros.core.errors import InvalidValueError, warn
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import LENGTH_TOLERANCE, canonical, down_in_part
from resting_aspects_ros.core.statistics.agreement import (
    Agreement,
    Differences,
    find_agreement,
    find_differences,
)
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.report.cluster_report import agreement_fields, cluster_document
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.simulation.surroundings.description import Surroundings

# A cluster needs two poses that can be alike.
MIN_POSES, MIN_POSES_WITH_PART = 2, 1
INVERSE = np.array([-1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class PartClassification:
    """Poses in the aspects of a part, beside their clusters.

    Attributes
    ----------
    part : Part
    distribution : Distribution
        Over the aspects of the part.
    agreement : Agreement
        For each pose its aspect and its cluster, and whether the two agree.
    differences : Differences
        The poses on which they do not agree.
    """

    part: Part
    distribution: Distribution
    agreement: Agreement
    differences: Differences

    @property
    def aspects(self) -> AspectSet:
        """Return the aspects of the part."""
        return self.distribution.aspects


@dataclass(frozen=True, eq=False)
class ClassificationResult:
    """Poses in clusters, and in the aspects of a part if one was given.

    Attributes
    ----------
    poses : PoseTable
        The n settled poses.
    clusters : Clusters
        Clusters of the poses by their down directions; ``labels`` (n,) from 1.
    tolerance : float
        Of the clusters, rad.
    by_part : PartClassification or None
        None without a part.
    """

    poses: PoseTable
    clusters: Clusters
    tolerance: float
    by_part: PartClassification | None = None

    @property
    def aspect(self) -> npt.NDArray[np.int64]:
        """Return (n,) the id of each pose's aspect, 0 for none; InvalidValueError if no part."""
        if self.by_part is None:
            raise InvalidValueError('no aspects: expected a part to classify the poses with')
        return self.by_part.agreement.aspect

    @property
    def cluster_distribution(self) -> Distribution:
        """Return the shares of the clusters in all poses."""
        poses = self.poses
        return Distribution(
            AspectSet('', ()), self.clusters.counts, 0, poses.unsettled, poses.failed
        )

    def to_json(self) -> str:
        """Return the JSON document that `resting_aspects classify --json` prints."""
        document = cluster_document(self.cluster_distribution, self.clusters, self.tolerance)
        if (found := self.by_part) is not None:
            document |= {'part': found.part.name, 'part_sha256': found.part.part_sha256}
            places = self.poses.index, self.poses.line
            document |= agreement_fields(
                found.distribution, found.agreement, found.differences, places
            )
        return to_json(document)


def classify(
    poses: RestingPoses | npt.ArrayLike | str | Path,
    part: Part | str | Path | None = None,
    *,
    tolerance: float = DEFAULT_TOLERANCE_DEGREES,
    surroundings: str | Path | Surroundings | None = None,
) -> ClassificationResult:
    """Sort resting poses by their orientations; two are the same if they differ by yaw only.

    Parameters
    ----------
    poses : RestingPoses, (n, 4) array, str or Path
        Poses, or unit quaternions xyzw (world from part, z up), or a CSV file with such.
    part : Part, str or Path, optional
        Whose aspects the poses are sorted into: a part, or what `load_part` accepts. Without it
        poses are sorted into clusters only.
    tolerance : float
        Poses whose down directions are at most so far apart are in one cluster, and so on from
        each pose to the next: 1 to 30 degrees.
    surroundings : str, Path or Surroundings, optional
        Where the parts came to rest, as for `drop`; only with a part. Poses are then the same if
        they differ by a turn about the normal of the first body, on which aspects are counted.

    Returns
    -------
    ClassificationResult

    Raises
    ------
    InvalidValueError
        A pose is not a unit quaternion, there are too few of them, or surroundings are given
        without a part.

    Warns
    -----
    RestingAspectsWarning
        Most poses are in no aspect of the part.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> dropped = ra.drop('tetrahedron', drops=100, seed=1)
    >>> result = ra.classify(dropped.poses, 'tetrahedron')
    >>> len(result.clusters), int((result.aspect > 0).sum())
    (4, 100)
    """
    radians = float(np.radians(tolerance))
    check_tolerance(radians)
    loaded = part if isinstance(part, Part) or part is None else load_part(part)
    table = _table(poses, MIN_POSES if loaded is None else MIN_POSES_WITH_PART)
    if surroundings is not None:
        if loaded is None:
            raise InvalidValueError('invalid surroundings: expected only with a part')
        turned = on_level_floor(table.orientation, loaded, surroundings)
        table = dataclasses.replace(table, orientation=turned)
    clusters = find_clusters(down_in_part(table.orientation), radians)
    if loaded is None:
        return ClassificationResult(table, clusters, radians)
    for warning in loaded.warnings:
        warn(warning)
    return ClassificationResult(table, clusters, radians, _by_part(table, clusters, loaded))


def _by_part(poses: PoseTable, clusters: Clusters, part: Part) -> PartClassification:
    aspects = find_aspects(part)
    ids = aspects.classify(poses.orientation)
    agreement = find_agreement(ids, len(aspects), clusters)
    differences = find_differences(agreement, aspects, down_in_part(poses.orientation))
    counts = np.bincount(ids, minlength=len(aspects) + 1)
    distribution = Distribution(
        aspects, counts[1:], int(counts[0]), unsettled=poses.unsettled, failed=poses.failed
    )
    _warn_of_another_part(poses, part, distribution)
    return PartClassification(part, distribution, agreement, differences)


def _table(poses: RestingPoses | npt.ArrayLike | str | Path, min_poses: int) -> PoseTable:
    if isinstance(poses, str | Path):
        return read_pose_csv(Path(poses), min_poses)
    unsettled = failed = 0
    if isinstance(poses, RestingPoses):
        settled = poses.status == RestStatus.SETTLED
        unsettled = int(np.isin(poses.status, NOT_AT_REST).sum())
        failed = int((poses.status == RestStatus.FAILED).sum())
        index, xyzw = np.flatnonzero(settled), poses.orientation[settled]
    else:
        xyzw = np.asarray(poses, dtype=np.float64)
        if xyzw.ndim != 2 or xyzw.shape[1] != 4:
            raise InvalidValueError(
                f'invalid shape {xyzw.shape} of the poses: expected (n, 4), quaternions xyzw'
            )
        index = np.arange(len(xyzw))
    if len(index) < min_poses:
        raise InvalidValueError(
            f'invalid number of settled poses {len(index)}: expected at least {min_poses}'
        )
    length = np.linalg.norm(xyzw, axis=1)
    for k in np.flatnonzero(~(np.abs(length - 1) <= LENGTH_TOLERANCE))[:1]:
        raise InvalidValueError(
            f'invalid orientation {xyzw[k].tolist()} of pose {index[k]}: expected a quaternion of '
            f'length 1 within {LENGTH_TOLERANCE:g}'
        )
    return PoseTable(canonical(xyzw), index, index + 1, unsettled, failed)


def _warn_of_another_part(poses: PoseTable, part: Part, distribution: Distribution) -> None:
    """Warn if most poses are in no aspect, and say what the reason may be."""
    settled, unclassified = len(poses.index), distribution.unclassified
    if unclassified <= settled / 2:
        return
    inverse = distribution.aspects.classify(poses.orientation * INVERSE)
    hint = (
        'the inverse rotations fit, so they may be part from world'
        if np.count_nonzero(inverse) > settled / 2
        else 'is this the pose file of another part, or in another unit or frame?'
    )
    source = f' in {poses.source!r}' if poses.source else ''
    warn(
        f'{unclassified} of {settled} settled poses{source} are in no aspect of {part.name!r}: '
        f'{hint}'
    )

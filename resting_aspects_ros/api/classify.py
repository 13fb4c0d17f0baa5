"""Sort resting poses into clusters, and into the aspects of a part.

A file of poses is a CSV of any program. It needs a line of names with those of the quaternion's
four numbers, in any order and among any other columns. Of a file with a `status` column, as
`resting_aspects drop` writes it, only settled poses are used.
"""

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.result import Result
from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.clusters import (
    DEFAULT_TOLERANCE_DEGREES,
    Agreement,
    Clusters,
    Differences,
    check_tolerance,
    find_agreement,
    find_clusters,
    find_differences,
)
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, warn
from resting_aspects_ros.input_files import CsvTable, open_text
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.comparison import agreement_fields, cluster_document
from resting_aspects_ros.rotations import LENGTH_TOLERANCE, canonical, down_in_part
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# A cluster needs two poses that can be alike.
MIN_POSES, MIN_POSES_WITH_PART = 2, 1
_QUATERNION = re.compile(r'(?:pose)?(?:orientation|rotation|rot|quaternion|quat|q)+([xyzw])')
_AXES = 'xyzw'
# Of the largest run there are 300 MB.
MAX_BYTES = 1 << 29
# Statuses that are counted as unsettled.
NOT_AT_REST = (RestStatus.UNSETTLED, RestStatus.LOST, RestStatus.SLIDING)


@dataclass(frozen=True, eq=False)
class PoseTable:
    """Settled poses, of a file or of arrays.

    orientation : (n, 4) float
        Unit quaternions xyzw, tray from part, w >= 0.
    index : (n,) int
        Index of each among all poses, from 0.
    line : (n,) int
        Its line in the file, from 1; without a file its index plus one.
    unsettled, failed : int
        Number of poses with another status, which are left out. Lost and sliding parts are
        unsettled.
    """

    orientation: Array
    index: Indices
    line: Indices
    unsettled: int
    failed: int

    @property
    def drops(self) -> int:
        """Return the number of all poses, settled or not."""
        return len(self.index) + self.unsettled + self.failed


@dataclass(frozen=True, eq=False)
class PartClassification:
    """Poses in the aspects of a part, beside their clusters.

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


@dataclass(frozen=True, eq=False)
class ClassificationResult(Result):
    """Poses in clusters, and in the aspects of a part if one was given.

    ``clusters`` are those of the n poses by their down directions, with ``labels`` (n,) from 1
    and the ``tolerance``, rad; ``by_part`` is None without a part.
    """

    poses: PoseTable
    clusters: Clusters
    tolerance: float
    by_part: PartClassification | None = None

    @property
    def aspect(self) -> Indices:
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

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects classify --json` prints."""
        document = cluster_document(self.cluster_distribution, self.clusters, self.tolerance)
        if (found := self.by_part) is not None:
            document |= {'part': found.part.name, 'part_sha256': found.part.part_sha256}
            places = self.poses.index, self.poses.line
            document |= agreement_fields(
                found.distribution, found.agreement, found.differences, places
            )
        return document


def classify(
    poses: RestingPoses | npt.ArrayLike | str | Path,
    part: Part | str | Path | None = None,
    *,
    tolerance: float = DEFAULT_TOLERANCE_DEGREES,
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

    Raises
    ------
    InvalidValueError
        A pose is not a unit quaternion, or there are too few of them.

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
    loaded = None if part is None else given_part(part)
    table = _table(poses, MIN_POSES if loaded is None else MIN_POSES_WITH_PART)
    clusters = find_clusters(down_in_part(table.orientation), radians)
    if loaded is None:
        return ClassificationResult(table, clusters, radians)
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
    if distribution.unclassified > len(ids) / 2:
        warn(
            f'{distribution.unclassified} of {len(ids)} settled poses are in no aspect of '
            f'{part.name!r}: are they of another part, in another frame, or part from world?'
        )
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
    unit = _unit(xyzw, min_poses, 'the array', 'pose', index)
    return PoseTable(unit, index, index + 1, unsettled, failed)


def _unit(xyzw: Array, min_poses: int, source: str, what: str, places: Indices) -> Array:
    """Return quaternions (n, 4) with length 1; raises InvalidValueError.

    source, what, places : for messages, such as the file, 'line' and the number (n,) of each line
    """
    if len(xyzw) < min_poses:
        raise InvalidValueError(
            f'invalid number of settled poses {len(xyzw)} in {source}: expected at least '
            f'{min_poses}'
        )
    with np.errstate(over='ignore'):  # what is as long as that is refused
        length = np.linalg.norm(xyzw, axis=1)
    for k in np.flatnonzero(~(np.abs(length - 1) <= LENGTH_TOLERANCE))[:1]:
        raise InvalidValueError(
            f'invalid orientation {", ".join(f"{number:.6g}" for number in xyzw[k])} in {source} '
            f'{what} {places[k]}: expected a quaternion of length 1 within {LENGTH_TOLERANCE:g}, '
            f'and its length is {length[k]:.6g}'
        )
    return canonical(xyzw)


def read_pose_csv(path: Path, min_poses: int) -> PoseTable:
    """Read a CSV with at least ``min_poses`` settled poses.

    Raises InvalidValueError, which names file, line, column, value and what was expected.
    """
    numbers, index, lines = array('d'), array('q'), array('q')
    count = dict.fromkeys(RestStatus, 0)
    with open_text(path, 'pose file', MAX_BYTES) as file:
        table = CsvTable(path, file)
        columns = _quaternion_columns(table)
        status_column = table.names.index('status') if 'status' in table.names else None
        for line, row in table.rows():
            status = _status(table, line, row, status_column)
            if status is RestStatus.SETTLED:  # no others need to have an orientation
                index.append(sum(count.values()))
                lines.append(line)
                numbers.extend(table.number(line, row, k) for k in columns)
            count[status] += 1
    xyzw = np.frombuffer(numbers, dtype=np.float64).reshape(-1, 4)
    places = np.frombuffer(lines, dtype=np.int64)
    return PoseTable(
        _unit(xyzw, min_poses, repr(str(path)), 'line', places),
        np.frombuffer(index, dtype=np.int64),
        places,
        unsettled=sum(count[each] for each in NOT_AT_REST),
        failed=count[RestStatus.FAILED],
    )


def _status(table: CsvTable, line: int, row: Sequence[str], column: int | None) -> RestStatus:
    if column is None:
        return RestStatus.SETTLED
    try:
        return RestStatus[row[column].strip().upper()]
    except KeyError:
        names = 'one of ' + ', '.join(status.name for status in RestStatus)
        raise table.wrong(line, row, column, names) from None


def _quaternion_columns(table: CsvTable) -> list[int]:
    """The columns of x, y, z and w.

    Bare x, y and z are positions where there are better names for the quaternion.
    """
    bare = [re.sub(r'\[.*?\]|\W|_', '', name) for name in table.names]
    matches = [_QUATERNION.fullmatch(name) for name in bare]
    better = [match[1] if match else '' for match in matches]
    names = better if any(better) else bare
    for axis in _AXES:
        if names.count(axis) != 1:
            raise table.wrong_header(
                f'one column for {axis} of the quaternion; these are qx, qy, qz, qw (or q_x, '
                'quat_x, orientation.x, ...) or x, y, z, w, in any order, separated by , or ;'
            )
    return [names.index(axis) for axis in _AXES]

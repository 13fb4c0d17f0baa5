"""A file of resting poses: the orientations that a CSV of any program writes.

It needs a line of names with those of the quaternion's four numbers, in any order and among any
other columns. Of a file with a `status` column, as `resting_aspects drop` writes it, only
settled poses are used.
"""

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.inputs.csv_table import CsvTable, open_text
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.core.rotations import LENGTH_TOLERANCE, canonical

COLUMN_NAMES = (
    'qx, qy, qz, qw (or q_x, quat_x, orientation.x, ...) or x, y, z, w, in any order, in columns '
    'parted by , or ;'
)
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
    source : str
        The file; empty without one.
    """

    orientation: npt.NDArray[np.float64]
    index: npt.NDArray[np.int64]
    line: npt.NDArray[np.int64]
    unsettled: int
    failed: int
    source: str = ''

    @property
    def drops(self) -> int:
        """Return the number of all poses, settled or not."""
        return len(self.index) + self.unsettled + self.failed


def read_pose_csv(path: Path, min_poses: int) -> PoseTable:
    """Read a CSV.

    Parameters
    ----------
    path : Path
    min_poses : int
        Minimum number of settled poses.

    Raises
    ------
    InvalidValueError
        Names file, line, column, value and what was expected.
    """
    numbers, index, lines = array('d'), array('q'), array('q')
    count = dict.fromkeys(RestStatus, 0)
    with open_text(path, 'pose file', MAX_BYTES) as file:
        table = CsvTable(path, file)
        columns = _quaternion_columns(table.where, table.header)
        names = [name.lower() for name in table.header]
        status_column = names.index('status') if 'status' in names else None
        for line, row in table.rows():
            status = _status(table, line, row, status_column)
            if status is RestStatus.SETTLED:  # no others need to have an orientation
                index.append(sum(count.values()))
                lines.append(line)
                numbers.extend(_number(table, line, row, k) for k in columns)
            count[status] += 1
    if len(index) < min_poses:
        settled = ' settled' if sum(count.values()) > len(index) else ''
        raise InvalidValueError(
            f'invalid number of{settled} poses {len(index)} in {str(path)!r}: expected at least '
            f'{min_poses}'
        )
    xyzw = np.frombuffer(numbers, dtype=np.float64).reshape(-1, 4)
    with np.errstate(over='ignore'):  # what is as long as that is refused
        length = np.linalg.norm(xyzw, axis=1)
    wrong = np.flatnonzero(~(np.abs(length - 1) <= LENGTH_TOLERANCE))
    if len(wrong):
        k = int(wrong[0])
        raise InvalidValueError(
            f'invalid {", ".join(table.header[column] for column in columns)} '
            f'{", ".join(f"{number:.6g}" for number in xyzw[k])} in {str(path)!r} line '
            f'{lines[k]}: expected a quaternion of length 1 within {LENGTH_TOLERANCE:g}, and its '
            f'length is {length[k]:.6g}'
        )
    return PoseTable(
        canonical(xyzw),
        np.frombuffer(index, dtype=np.int64),
        np.frombuffer(lines, dtype=np.int64),
        unsettled=sum(count[each] for each in NOT_AT_REST),
        failed=count[RestStatus.FAILED],
        source=str(path),
    )


def _status(table: CsvTable, line: int, row: Sequence[str], column: int | None) -> RestStatus:
    if column is None:
        return RestStatus.SETTLED
    try:
        return RestStatus[row[column].strip().upper()]
    except KeyError:
        names = 'one of ' + ', '.join(status.name for status in RestStatus)
        raise table.wrong(line, row, column, names) from None


def _number(table: CsvTable, line: int, row: Sequence[str], column: int) -> float:
    try:
        number = float(row[column])
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise table.wrong(line, row, column, 'a finite number, such as -0.5')
    return number


def _quaternion_columns(where: str, header: Sequence[str]) -> list[int]:
    """The columns of x, y, z and w.

    Bare x, y and z are positions where there are better names for the quaternion.
    """
    bare = [re.sub(r'\[.*?\]|\W|_', '', name.lower()) for name in header]
    matches = [_QUATERNION.fullmatch(name) for name in bare]
    better = [match[1] if match else '' for match in matches]
    names = better if any(better) else bare
    missing = [axis for axis in _AXES if axis not in names]
    twice = [axis for axis in _AXES if names.count(axis) > 1]
    if missing or twice:
        problem = (
            f'no column is {" or ".join(missing)} of the quaternion'
            if missing
            else f'several columns are {" and ".join(twice)} of the quaternion'
        )
        raise InvalidValueError(
            f'invalid column names {shown(", ".join(header))} in {where}: {problem}; expected '
            f'{COLUMN_NAMES}'
        )
    return [names.index(axis) for axis in _AXES]

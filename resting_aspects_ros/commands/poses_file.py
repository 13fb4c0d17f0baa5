"""A file of resting poses: the orientations that a CSV of any make has.

It needs a line of names with those of the quaternion's four numbers, in any order and among any
other columns. A `status` column, as `resting_aspects drop` writes it, is heeded.
"""

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.commands.csv_file import CsvTable, open_text
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.core.rotations import LENGTH_TOLERANCE, canonical

ALLOWED_NAMES = (
    'qx, qy, qz, qw (or q_x, quat_x, orientation.x, ...) or x, y, z, w, in any order, in columns '
    'parted by , or ;'
)
_QUATERNION = re.compile(r'(?:pose)?(?:orientation|rotation|rot|quaternion|quat|q)+([xyzw])')
_AXES = 'xyzw'
# Of the largest run there are 300 MB.
MAX_BYTES = 1 << 29


@dataclass(frozen=True, eq=False)
class PosesFile:
    """The settled poses in a file.

    orientation : (n, 4) float
        Unit quaternions xyzw, tray from part, w >= 0.
    index : (n,) int
        Of each among all poses in the file, from 0.
    line : (n,) int
        Its line in the file, from 1.
    unsettled, failed : int
        Poses that are not among them, by their status.
    """

    orientation: npt.NDArray[np.float64]
    index: npt.NDArray[np.int64]
    line: npt.NDArray[np.int64]
    unsettled: int
    failed: int

    @property
    def drops(self) -> int:
        """How many poses the file has, settled or not."""
        return len(self.index) + self.unsettled + self.failed


def read_poses_file(path: Path, at_least: int) -> PosesFile:
    """Read a CSV.

    Parameters
    ----------
    path : Path
    at_least : int
        Settled poses that are needed.

    Raises
    ------
    InvalidValueError
        With file, line, column, value and what is allowed.
    """
    with open_text(path, 'pose file', MAX_BYTES) as file:
        table = CsvTable(path, file)
        found = _Poses(path, table)
        for line, row in table.rows():
            found.add(line, row)
    poses = found.poses()
    if len(poses.index) < at_least:
        settled = ' settled' if poses.unsettled or poses.failed else ''
        raise InvalidValueError(
            f'{str(path)!r} has {len(poses.index)}{settled} poses, allowed are {at_least} or more'
        )
    return poses


class _Poses:
    """The poses of the lines that were read so far, in little memory."""

    def __init__(self, path: Path, table: CsvTable) -> None:
        self._path = path
        self._table = table
        self._columns = _quaternion_columns(table.where, table.header)
        self._status = _status_column(table.header)
        self._numbers, self._index, self._line = array('d'), array('q'), array('q')
        self._count = dict.fromkeys(RestStatus, 0)

    def add(self, line: int, row: Sequence[str]) -> None:
        status = self._status_of(line, row)
        if status is RestStatus.SETTLED:  # no others need to have an orientation
            self._index.append(sum(self._count.values()))
            self._line.append(line)
            self._numbers.extend(self._number(line, row, k) for k in self._columns)
        self._count[status] += 1

    def poses(self) -> PosesFile:
        xyzw = np.frombuffer(self._numbers, dtype=np.float64).reshape(-1, 4)
        line = np.frombuffer(self._line, dtype=np.int64)
        with np.errstate(over='ignore'):  # what is as long as that is refused
            length = np.linalg.norm(xyzw, axis=1)
        wrong = np.flatnonzero(~(np.abs(length - 1) <= LENGTH_TOLERANCE))
        if len(wrong):
            self._refuse(int(line[wrong[0]]), xyzw[wrong[0]], float(length[wrong[0]]))
        return PosesFile(
            canonical(xyzw),
            np.frombuffer(self._index, dtype=np.int64),
            line,
            unsettled=self._count[RestStatus.UNSETTLED],
            failed=self._count[RestStatus.FAILED],
        )

    def _status_of(self, line: int, row: Sequence[str]) -> RestStatus:
        if self._status is None:
            return RestStatus.SETTLED
        try:
            return RestStatus[row[self._status].strip().upper()]
        except KeyError:
            names = ', '.join(status.name for status in RestStatus)
            raise self._table.wrong(line, row, self._status, names) from None

    def _number(self, line: int, row: Sequence[str], column: int) -> float:
        try:
            number = float(row[column])
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            raise self._table.wrong(line, row, column, 'a finite number, such as -0.5')
        return number

    def _refuse(self, line: int, xyzw: npt.NDArray[np.float64], length: float) -> None:
        names = ', '.join(self._table.header[k] for k in self._columns)
        numbers = ', '.join(f'{number:.6g}' for number in xyzw)
        raise InvalidValueError(
            f'{str(self._path)!r} line {line}, columns {names} are {numbers}: a quaternion of '
            f'length {length:.6g}, allowed is 1 within {LENGTH_TOLERANCE:g}'
        )


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
            f'{where} should name the columns and is {shown(", ".join(header))}: {problem}, '
            f'allowed are {ALLOWED_NAMES}'
        )
    return [names.index(axis) for axis in _AXES]


def _status_column(header: Sequence[str]) -> int | None:
    names = [name.lower() for name in header]
    return names.index('status') if 'status' in names else None

"""A file of initial states, one in each line, such as recorded tosses or a trajectory's end."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from resting_aspects_ros.api.inputs.csv_table import CsvTable, open_text
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.rotations import LENGTH_TOLERANCE
from resting_aspects_ros.simulation.starts import GivenStates

NEEDED = ('z_com_m', 'qx', 'qy', 'qz', 'qw')
OPTIONAL = ('x_m', 'y_m', 'vx', 'vy', 'vz', 'wx', 'wy', 'wz')
# 100,000 states.
MAX_BYTES = 1 << 25
MAX_STATES = 100_000


def read_state_csv(path: Path) -> GivenStates:
    """Read a CSV with the columns NEEDED, any of OPTIONAL, and others, which are not read.

    Position of the centre of mass in the tray frame, m (x and y are 0 without a column);
    quaternion x y z w, tray from part; velocity vx, vy, vz of the centre of mass in tray axes,
    m/s, and spin wx, wy, wz in part axes, rad/s, both 0 without columns. Raises InvalidValueError,
    which names file, line and column.
    """
    rows: list[list[float]] = []
    with open_text(path, 'file of initial states', MAX_BYTES) as file:
        table = CsvTable(path, file)
        columns = _columns(table)
        for line, row in table.rows():
            if len(rows) == MAX_STATES:
                raise InvalidValueError(
                    f'invalid number of initial states in {str(path)!r}: expected at most '
                    f'{MAX_STATES}'
                )
            rows.append([_number(table, line, row, columns.get(n)) for n in (*NEEDED, *OPTIONAL)])
            length = math.hypot(*rows[-1][1:5])
            if not abs(length - 1) <= LENGTH_TOLERANCE:
                raise table.wrong(
                    line, row, columns['qx'], f'a quaternion of length 1; it is {length:.6g}'
                )
    if not rows:
        raise InvalidValueError(f'invalid initial states {str(path)!r}: expected at least one')
    z, qx, qy, qz, qw, x, y, vx, vy, vz, wx, wy, wz = np.array(rows).T
    return GivenStates(
        position=np.stack([x, y, z], axis=-1),
        orientation=np.stack([qx, qy, qz, qw], axis=-1),
        velocity=np.stack([vx, vy, vz], axis=-1),
        spin=np.stack([wx, wy, wz], axis=-1),
    )


def _columns(table: CsvTable) -> dict[str, int]:
    names = table.header
    missing = [name for name in NEEDED if name not in names]
    twice = [name for name in (*NEEDED, *OPTIONAL) if names.count(name) > 1]
    if missing or twice:
        problem = f'no column {missing[0]}' if missing else f'several columns {twice[0]}'
        raise InvalidValueError(
            f'invalid column names {shown(", ".join(names))} in {table.where}: {problem}; '
            f'expected {", ".join(NEEDED)}, and any of {", ".join(OPTIONAL)}'
        )
    return {name: names.index(name) for name in (*NEEDED, *OPTIONAL) if name in names}


def _number(table: CsvTable, line: int, row: Sequence[str], column: int | None) -> float:
    if column is None:
        return 0.0
    try:
        number = float(row[column])
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise table.wrong(line, row, column, 'a finite number, such as -0.5')
    return number

"""Drops from given initial states, which a file can have, counted by state."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.conditions import scene_of
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import CsvTable, open_text
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import LENGTH_TOLERANCE
from resting_aspects_ros.simulation.conditions import MAX_DROPS, DropConditions, Noise
from resting_aspects_ros.simulation.scene import Scene, depth_along, in_scene_axes
from resting_aspects_ros.simulation.starts import GivenStarts, GivenStates
from resting_aspects_ros.statistics.poses import RestingPoses
from resting_aspects_ros.statistics.transitions import OUTCOMES, columns_of

DEFAULT_REPLICATES = 1
# A part may reach into a plane of surroundings by this, R; the engine moves it out.
MAX_OVERLAP = 0.01
# States that are checked together.
_BLOCK = 1000
# Columns of a file of states.
NEEDED = ('z_com_m', 'qx', 'qy', 'qz', 'qw')
OPTIONAL = ('x_m', 'y_m', 'vx', 'vy', 'vz', 'wx', 'wy', 'wz')
# 100,000 states.
MAX_BYTES = 1 << 25
MAX_STATES = 100_000


@dataclass(frozen=True, eq=False)
class CountsByState:
    """Counts of replicates by initial state; with k aspects.

    counts : (n, k + 4) int
        Replicates of each state that ended in each aspect, by id from 1, and then in each of
        unclassified, unsettled, failed, lost.
    """

    counts: npt.NDArray[np.int64]

    @property
    def columns(self) -> list[int | str]:
        """Ids of the aspects, then the names of the other outcomes."""
        return [*range(1, self.counts.shape[1] - len(OUTCOMES) + 1), *OUTCOMES]

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count a chunk of poses, given the ids of their aspects."""
        aspects = self.counts.shape[1] - len(OUTCOMES)
        column = columns_of(poses, ids, aspects)
        row = np.arange(poses.first_drop, poses.end) % len(self.counts)
        np.add.at(self.counts, (row, column), 1)

    @classmethod
    def none(cls, states: int, aspects: int) -> 'CountsByState':
        """Return counts without drops."""
        return cls(np.zeros((states, aspects + len(OUTCOMES)), dtype=np.int64))


def given_starts(
    part: Part, given: GivenStates, noise: Noise, conditions: DropConditions, replicates: int
) -> tuple[GivenStarts, int]:
    """Return the starts of a run and its number of drops; raises InvalidValueError."""
    limit = MAX_DROPS // len(given)
    if (
        not isinstance(replicates, int)
        or isinstance(replicates, bool)
        or not 1 <= replicates <= limit
    ):
        raise InvalidValueError(
            f'invalid replicates {replicates!r}: expected 1 to {limit} for {len(given)} states'
        )
    scene = scene_of(part, conditions)
    if not scene.level:
        _check_outside(part, scene, given)
    starts = GivenStarts(given, noise, conditions.gravity, part.hull_radius)
    return starts, replicates * len(given)


def _check_outside(part: Part, scene: Scene, given: GivenStates) -> None:
    """Raise InvalidValueError if a part begins inside a half-space of the surroundings."""
    corners = part.hull_vertices - part.centre_of_mass
    for first in range(0, len(given), _BLOCK):
        rows = slice(first, first + _BLOCK)
        position = scene.in_scene(given.position[rows])
        orientation = in_scene_axes(scene, given.orientation[rows])
        for plane in scene.half_spaces:
            reach = depth_along(orientation, -plane.normal, corners)
            gap = (position * plane.normal).sum(axis=1) - plane.offset - reach
            worst = int(gap.argmin())
            if gap[worst] < -MAX_OVERLAP * part.hull_radius:
                raise InvalidValueError(
                    f'invalid initial state {first + worst}: the part is '
                    f'{-1000 * gap[worst]:.4g} mm inside the {plane.name.replace("_", " ")}; '
                    'expected outside of the surroundings'
                )


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
            rows.append(
                [
                    table.number(line, row, columns[name]) if name in columns else 0.0
                    for name in (*NEEDED, *OPTIONAL)
                ]
            )
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

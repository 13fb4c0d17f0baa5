"""The resting poses of drops as a CSV, written while they come."""

import csv
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.commands.outputs import OutputError, whole_file
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus

POSES_HEADER = (
    'drop', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw',
    'status', 'decided_by', 'time_to_rest', 'energy_growth', 'aspect',
)  # fmt: skip


@contextmanager
def poses_file(flag: str, path: Path) -> Iterator[TextIO]:
    """A file for poses with its header, in its place when it is whole; ``flag`` named it."""
    with ExitStack() as stack:
        try:
            part = stack.enter_context(whole_file(path))
            file = stack.enter_context(part.open('w', newline='', encoding='utf-8'))
        except (OSError, OutputError) as error:
            raise InvalidValueError(
                f'{flag} is {str(path)!r}, allowed is a file that can be written: {error}'
            ) from None
        csv.writer(file).writerow(POSES_HEADER)
        yield file


def write_poses(file: TextIO, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
    """Add a line for each drop, with the id of its aspect; 0 if it came to rest in none."""
    csv.writer(file).writerows(_rows(poses, ids.tolist()))
    file.flush()


def _rows(poses: RestingPoses, ids: list[int]) -> Iterator[tuple[Any, ...]]:
    """In full precision: Python prints the shortest text that reads back as the same number."""
    for k in range(len(poses)):
        yield (
            poses.first_drop + k,
            *poses.position[k].tolist(),
            *poses.orientation[k].tolist(),
            RestStatus(poses.status[k]).name,
            DecidedBy(poses.decided_by[k]).name,
            float(poses.time_to_rest[k]),
            float(poses.energy_growth[k]),
            ids[k],
        )

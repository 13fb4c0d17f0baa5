"""Drops of the counted parts at points of the ranges, kept in a file if there is a folder."""

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, StrictStr

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.schema import Count, validated
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.dask_workers import worker_versions
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.points import drop_points, point_key

Counts = npt.NDArray[np.int64]

# Points that are simulated together, and then saved.
BATCH = 8


class _SavedDrops(BaseModel):
    simulated: StrictStr
    counts: dict[StrictStr, list[Count]]


class SimulatedDrops:
    """Simulates drops at points, and remembers their counts by aspect.

    Parameters
    ----------
    workers : Workers
    seed : int
    progress : callable
        Called with the number of all drops made so far.
    file : Path, optional
        Counts are read from this file and saved in it, so that a calibration that was
        interrupted, or one with other counts of the same parts, does not repeat them.
    """

    def __init__(
        self,
        workers: Workers,
        seed: int,
        progress: Callable[[int], None] = lambda _: None,
        file: Path | None = None,
    ) -> None:
        self._workers = workers
        self._seed = seed
        self._progress = progress
        self._file = file
        self._known: dict[str, list[int]] = {}
        versions = ', '.join(f'{name} {each}' for name, each in worker_versions().items())
        self._label = f'{versions}, seed {seed}'
        self.made = 0
        if file is not None:
            self._known = _read(file, self._label)

    def counts(self, part: Part, points: Sequence[DropConditions], drops: int) -> Counts:
        """Return the counts (m, k) by aspect; drops that ended in no aspect are left out."""
        keys = [f'{point_key(part, Setting(point))} {drops}' for point in points]
        missing = [k for k, key in enumerate(keys) if key not in self._known]
        for first in range(0, len(missing), BATCH):
            batch = missing[first : first + BATCH]
            found = drop_points(
                part,
                [points[k] for k in batch],
                drops,
                self._seed,
                workers=self._workers,
                progress=self._more,
            )
            self.made += int(found.drops.sum())
            for k, row in zip(batch, found.counts.tolist(), strict=True):
                self._known[keys[k]] = row
            self._save()
        return np.array([self._known[key] for key in keys], dtype=np.int64)

    def _more(self, done: int) -> None:
        self._progress(self.made + done)

    def _save(self) -> None:
        if self._file is not None:
            document = {'simulated': self._label, 'counts': self._known}
            with whole_file(self._file) as file:
                file.write_text(json.dumps(document), encoding='utf-8')


def _read(file: Path, label: str) -> dict[str, list[int]]:
    """Return the counts in a file; none if it cannot be read or is of other versions or seeds."""
    with suppress(OSError, ValueError, RecursionError, InvalidValueError):
        document = validated(_SavedDrops, json.loads(file.read_text(encoding='utf-8')))
        if document.simulated == label:
            return document.counts
    return {}

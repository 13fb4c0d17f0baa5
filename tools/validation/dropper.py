"""Simulation of the drops for the validation, with the workers of this machine."""

from collections.abc import Iterator
from pathlib import Path

from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.simulation.conditions import Surfaces
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.workers import Workers, submit_drops
from resting_aspects_ros.statistics.poses import RestingPoses

ROOT = Path(__file__).resolve().parents[2]
SEED = 1


class Dropper:
    """The example parts, the shipped surfaces, and workers that simulate drops."""

    def __init__(self, workers: Workers) -> None:
        self.workers = workers
        self.surfaces = Surfaces.read(ROOT / 'config' / 'surfaces.yaml')
        library = PartLibrary(ROOT / 'config' / 'parts')
        self.parts = [library.load(name) for name in library.names()]

    def poses(self, job: DropJob, drops: int) -> Iterator[RestingPoses]:
        """Yield the first drops of a job in chunks."""
        for future in submit_drops(job, 0, drops, self.workers):
            yield future.result()

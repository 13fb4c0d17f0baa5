"""Dice, coins and blocks whose resting aspects were counted by hand or by a machine.

The counts are the files of config/counts, which state their sources. Only proportions are
published; all bodies are taken to be about 20 mm in size.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import KERNEL, DropConditions
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import Workers, submit_drops
from resting_aspects_ros.statistics.distribution import aspect_ids
from resting_aspects_ros.statistics.intervals import Interval, intervals
from resting_aspects_ros.studies.calibration.counts_file import read_surface_counts
from validation.dropper import ROOT, SEED

COUNTS = ROOT / 'config' / 'counts'
# Files of bodies that were rolled by hand or by a machine on a table.
ROLLED = ('steel_cuboids', 'thick_coin', 'near_cubes', 'die_binom3')
# Files whose number of rolls is not published; their sources state what is assumed.
ASSUMED = {'near_cubes'}


@dataclass(frozen=True, eq=False)
class Case:
    """A body, and how many of its rolls ended on some of its sides.

    ids : tuple of int
        Aspects of these sides.
    count, rolls : int
        Rolls that ended on them, and all rolls.
    assumed : bool
        Whether the number of rolls is not published, but assumed.
    """

    name: str
    part: Part
    ids: tuple[int, ...]
    count: int
    rolls: int
    assumed: bool = False

    @property
    def share(self) -> float:
        """Measured share of rolls."""
        return self.count / self.rolls

    @property
    def interval(self) -> Interval:
        """The measured share with its 95 % interval."""
        return intervals([self.count], self.rolls)[0]

    @cached_property
    def landscape(self) -> Landscape:
        """Landscape of the part."""
        return Landscape(self.part)

    @cached_property
    def aspects(self) -> AspectSet:
        """Aspects of the part."""
        return find_aspects(self.part, self.landscape)


def cases(files: Sequence[str] = ROLLED) -> list[Case]:
    """Return the measured cases of some files of config/counts: the first group of each part."""
    return [
        Case(
            part.name if len(part.names) > 2 else f'{part.name}, {_sides(part.names[0])}',
            part.part,
            part.groups[0],
            int(part.counts[0]),
            part.drops,
            name in ASSUMED,
        )
        for name in files
        for part in read_surface_counts(COUNTS / f'{name}.yaml').parts
    ]


def _sides(name: str) -> str:
    named = {'z': 'square faces', 'side': 'on its side', 'end': 'on an end'}
    return named.get(name, f'class {name}')


def simulated(
    known: Sequence[Case],
    conditions: DropConditions,
    drops: int,
    workers: Workers,
    *,
    engine: str = KERNEL,
) -> Array:
    """Return the share of each case in simulated drops.

    All conditions have the same random numbers, so that shares under two of them differ by less
    than two independent runs.
    """
    shares = []
    for case in known:
        job = make_job(case.part, conditions, SEED, landscape=case.landscape, engine=engine)
        hits = 0
        for chunk in submit_drops(job, 0, drops, workers):
            hits += int(np.isin(aspect_ids(case.aspects, chunk.result()), case.ids).sum())
        shares.append(hits / drops)
    return np.array(shares)


def log_odds(share: npt.ArrayLike) -> Array:
    """Return log(p / (1 - p))."""
    p = np.asarray(share, dtype=np.float64)
    return np.asarray(np.log(p / (1 - p)))


def deviance(counts: npt.ArrayLike, rolls: npt.ArrayLike, shares: npt.ArrayLike) -> Array:
    """Return 2 sum O log(O / E) over both outcomes of each case; shares of 0 and 1 are moved."""
    c, n = np.asarray(counts, dtype=np.float64), np.asarray(rolls, dtype=np.float64)
    p = np.clip(shares, 1e-6, 1 - 1e-6)
    terms = [
        np.where(k > 0, k * np.log(np.maximum(k, 1) / (n * q)), 0)
        for k, q in ((c, p), (n - c, 1 - p))
    ]
    return np.asarray(2 * (terms[0] + terms[1]))

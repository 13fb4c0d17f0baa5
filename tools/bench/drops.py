"""Drops per second of the suite: engines and numbers of threads, parts and surfaces."""

import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from numba import cuda
from rich.progress import track
from validation.document import table
from validation.dropper import Dropper

from bench.case import EXAMPLE, example_part, job_of
from resting_aspects_ros.simulation.job import BULLET, CUDA, KERNEL, DropJob
from resting_aspects_ros.simulation.workers import (
    LocalWorkers,
    Workers,
    default_workers,
    submit_drops,
)

# All cases take turns in each round, so that other load on the machine affects all of them.
ROUNDS = 3
# Drops per turn of each engine.
PER_TURN = {CUDA: 1_000_000, KERNEL: 50_000, BULLET: 4000}
# Part, surface, and the aim in drops per second on two cores.
CASES = (
    ('l_bracket', 'rubber_mat', '40000'),
    ('l_bracket', 'steel', ''),
    ('l_bracket', 'thrown', '10000'),
    ('cylinder_d20_h20', 'thrown', '5000'),
    ('washer', 'thrown', '5000'),
    ('hex_nut', 'rubber_mat', ''),
)


@dataclass
class Timed:
    """A job with its workers, and the drops per second of each round."""

    title: str
    workers: Workers
    job: DropJob
    aim: str = ''
    rates: list[float] = field(default_factory=list)

    def make(self, first: int, drops: int) -> None:
        """Simulate drops as the commands do."""
        for future in submit_drops(self.job, first, drops, self.workers):
            future.result()

    def turn(self, number: int) -> None:
        """Time the drops of a round."""
        drops = PER_TURN[self.job.engine]
        started = time.perf_counter()
        self.make(number * drops, drops)
        self.rates.append(drops / (time.perf_counter() - started))


def drops(dropper: Dropper) -> Iterator[str]:
    """Time drops with all workers and with one thread."""
    many, one, count = dropper.workers, LocalWorkers(1), default_workers()
    part = example_part()
    cases = [
        Timed(f'{name}, {surface}', many, job_of(example_part(name), surface), aim)
        for name, surface, aim in CASES
    ]
    cases.append(Timed(f'{EXAMPLE}, rubber_mat, 1 thread', one, job_of(part)))
    bullet = job_of(part, engine=BULLET)
    cases.append(Timed(f'{EXAMPLE}, rubber_mat, Bullet in {count} processes', many, bullet))
    if cuda.is_available():
        cases.append(Timed(f'{EXAMPLE}, rubber_mat, GPU', one, job_of(part, engine=CUDA)))
    try:
        for each in cases:
            each.make(0, 500)
        turns = [(k, each) for k in range(ROUNDS) for each in cases]
        for k, each in track(turns, 'drops', transient=True):
            each.turn(k)
    finally:
        one.stop()
    yield '## Drops per second'
    yield ''
    yield (
        'From the first request to the last pose, with the compiled kernel in '
        f'{count} threads, unless another engine or number of threads is named: the median of '
        f'{ROUNDS} rounds, in each of which all cases take turns. *Lowest*, *highest*: rates of '
        'the rounds. The aims are for two cores.'
    )
    yield ''
    yield from table(
        ['part, surface', 'drops/s', 'lowest', 'highest', 'aim'],
        (
            [
                each.title,
                *(f'{f(each.rates):.0f}' for f in (statistics.median, min, max)),
                each.aim,
            ]
            for each in cases
        ),
        numbers=True,
    )

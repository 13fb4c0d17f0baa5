"""Drops per second: the suite beside other ways to simulate the example part, and other parts."""

import statistics
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numba import cuda
from rich.progress import track
from validation.mujoco_drops import MOTION, mujoco_loop

from bench.case import EXAMPLE, Trial, example_part, job_of, suite
from bench.plain import plain_loop
from bench.report import Section, Table
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.job import BULLET, CUDA
from resting_aspects_ros.simulation.settling import REST_MOTION, REST_WINDOW
from resting_aspects_ros.simulation.workers import LocalWorkers

# All methods take turns in each round, so that other load on the machine affects all of them.
ROUNDS = 3
# Drops per turn of a way that makes about this many per second: 2 to 4 s.
PER_TURN = {'GPU': 1_000_000, 'suite': 50_000, 'Bullet': 4000, 'other': 200}
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
class Method:
    """A way to simulate ``drops`` from the index ``first``, and its trials."""

    title: str
    work: Callable[[int, int], Trial]
    drops: int
    aim: str = ''
    trials: list[Trial] = field(default_factory=list)

    @property
    def rates(self) -> list[float]:
        """Drops per second in each round."""
        return [trial.drops / trial.seconds for trial in self.trials]

    @property
    def rate(self) -> float:
        """Median of the rates."""
        return statistics.median(self.rates)

    @property
    def cells(self) -> list[str]:
        """Median, minimum and maximum of the rates."""
        return [f'{rate:.0f}' for rate in (self.rate, min(self.rates), max(self.rates))]


def ways(count: int) -> Section:
    """Time all ways, with this number of threads and of worker processes."""
    with ExitStack() as stack:
        many, one = LocalWorkers(count), LocalWorkers(1)
        for workers in (many, one):
            stack.callback(workers.stop)
        methods = _methods(many, one)
        skipped = _turns(methods)
        others = [
            Method(
                f'{name}, {surface}',
                partial(suite, many, job_of(example_part(name), surface)),
                PER_TURN['suite'],
                aim,
            )
            for name, surface, aim in CASES
        ]
        _turns(others)
    made = [each for each in methods if each.trials]
    found = {
        EXAMPLE: {each.title: each.rate for each in made},
        'suite_drops_per_s': {each.title: each.rate for each in others},
    }
    of_parts = Table(['part, surface', 'drops/s', 'lowest', 'highest', 'aim'])
    of_parts.rows.extend([[each.title, *each.cells, each.aim] for each in others])
    return Section('Drops per second', _text(made) + skipped, [_table(made), of_parts], found)


def _methods(many: LocalWorkers, one: LocalWorkers) -> list[Method]:
    part, n, other = example_part(), many.count, PER_TURN['other']
    job, bullet = job_of(part), job_of(part, engine=BULLET)
    all_cores, one_thread = partial(suite, many, job), partial(suite, one, job)
    in_bullet, plain = partial(suite, many, bullet), partial(plain_loop, bullet)
    found = [
        Method(f'suite, {n} threads', all_cores, PER_TURN['suite'], '40000/s'),
        Method('suite, 1 thread', one_thread, PER_TURN['suite'] // n),
        Method(f'suite, Bullet in {n} processes', in_bullet, PER_TURN['Bullet']),
        Method('plain PyBullet loop', plain, other, '400 times'),
        Method('MuJoCo, 1 thread', partial(mujoco_loop, 1, bullet), other),
        Method('MuJoCo, 2 threads', partial(mujoco_loop, 2, bullet), 2 * other),
    ]
    if cuda.is_available():
        on_gpu = partial(suite, one, job_of(part, engine=CUDA))
        found.append(Method('suite on a GPU', on_gpu, PER_TURN['GPU']))
    return found


def _turns(methods: list[Method]) -> str:
    """Run all rounds; returns a sentence on the methods whose package is missing."""
    present, text = [], ''
    for each in track(methods, 'first drops', transient=True):
        try:
            each.work(0, min(each.drops, 500))
            present.append(each)
        except ImportError as error:  # of MuJoCo
            text = f' {each.title} and the like were skipped ({error}).'
    turns = [(k, each) for k in range(ROUNDS) for each in present]
    for k, each in track(turns, 'drops', transient=True):
        each.trials.append(each.work(k * each.drops, each.drops))
    return text


def _table(made: list[Method]) -> Table:
    table = Table(
        [
            'method',
            'drops/s',
            'lowest',
            'highest',
            'suite is faster by',
            'aim',
            'drops',
            'in an aspect',
            'distance',
        ]
    )
    ours = _shares(made[0])
    for each in made:
        shares, drops = _shares(each), sum(trial.drops for trial in each.trials)
        ratio = made[0].rate / each.rate
        distance = np.abs(shares - ours).sum() / 2
        table.rows.append(
            [
                each.title,
                *each.cells,
                f'{ratio:.1f}',
                each.aim,
                f'{drops}',
                f'{100 * shares.sum():.1f} %',
                f'{distance:.3f}',
            ]
        )
    return table


def _shares(method: Method) -> Array:
    """Return the shares, (k,), of the drops that ended in each aspect."""
    aspects = find_aspects(example_part())
    ids, _ = aspects.locate(np.vstack([trial.down for trial in method.trials]))
    drops = sum(trial.drops for trial in method.trials)
    return np.bincount(ids, minlength=len(aspects) + 1)[1:] / drops


def _text(made: list[Method]) -> str:
    job = job_of(example_part(), engine=BULLET)
    few = min(sum(trial.drops for trial in each.trials) for each in made)
    return (
        f'The first table: {EXAMPLE} on `rubber_mat`. The rate is the median of {ROUNDS} rounds, '
        'in each of which all methods take turns. *Suite*: from the first request to the last '
        'pose, with the compiled kernel or with Bullet. The other methods simulate each drop from '
        'the full height until it is still, with the same hull, mass and inertia and '
        f'{job.steps_per_t} time steps per T = sqrt(R / g), {1e3 * job.time_unit:.1f} ms, as the '
        'suite does in Bullet. *Plain PyBullet loop*: one body after another in one world, '
        'stepped from Python, with the contact settings of the suite; the pose is read after each '
        f'step, and a drop ends when, for {REST_WINDOW:g} T, no coordinate of it changes by more '
        f'than {REST_MOTION:g} (in R, or of a quaternion). *MuJoCo*: all bodies in the threads of '
        '`mujoco.rollout`; contacts are springs with the same bounce height, with elliptic '
        'friction cones and without rolling friction; a part is still within '
        f'{MOTION:g} between looks at every T/2, because its contacts creep. *Lowest*, *highest*: '
        'rates of the rounds. *In an aspect*: share of drops that came to rest in an aspect. '
        "*Distance*: total variation distance to the suite's distribution; sampling alone causes "
        f'about {0.8 / np.sqrt(few):.2f} for {few} drops. The second table has the suite with all '
        'threads. The aims are for two cores.'
    )

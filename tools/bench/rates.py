"""Drops per second of the suite, for several parts and surfaces."""

import statistics

from rich.progress import track

from bench.case import example_part, job_of, suite
from bench.report import Section, Table
from resting_aspects_ros.simulation.workers import LocalWorkers

# All rows take turns in each round, so that other load on the machine affects all of them.
ROUNDS = 3
DROPS = 50_000  # per turn: about a second
# Part, surface, and the aim in drops per second on two cores.
CASES = (
    ('l_bracket', 'rubber_mat', '40000'),
    ('l_bracket', 'steel', ''),
    ('l_bracket', 'thrown', '10000'),
    ('cylinder_d20_h20', 'thrown', '5000'),
    ('washer', 'thrown', '5000'),
    ('hex_nut', 'rubber_mat', ''),
)
TEXT = (
    f'From the first request to the last pose, with all threads: the median of {ROUNDS} rounds, '
    'in which all rows take turns. *Lowest*, *highest*: rates of the rounds. The aims are for two '
    'cores. [The suite beside other engines](other_engines.md) has Bullet, a plain PyBullet loop '
    'and MuJoCo.'
)


def rates(count: int) -> Section:
    """Time the drops of all cases, with this number of threads."""
    workers = LocalWorkers(count)
    found: dict[str, list[float]] = {f'{part}, {surface}': [] for part, surface, _ in CASES}
    jobs = [job_of(example_part(part), surface) for part, surface, _ in CASES]
    try:
        for job in jobs:
            suite(workers, job, 0, 500)
        turns = [(k, *each) for k in range(ROUNDS) for each in zip(found, jobs, strict=True)]
        for k, title, job in track(turns, 'drops', transient=True):
            found[title].append(DROPS / suite(workers, job, k * DROPS, DROPS))
    finally:
        workers.stop()
    table = Table(['part, surface', 'drops/s', 'lowest', 'highest', 'aim'])
    for (title, values), (_, _, aim) in zip(found.items(), CASES, strict=True):
        shown = (statistics.median(values), min(values), max(values))
        table.rows.append([title, *(f'{value:.0f}' for value in shown), aim])
    medians = {title: statistics.median(values) for title, values in found.items()}
    return Section('Drops per second', TEXT, [table], {'suite_drops_per_s': medians})

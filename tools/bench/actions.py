"""What an action costs in each engine, beside drops."""

import dataclasses

from rich.progress import track
from validation.dropper import SEED

from bench.case import COST_DROPS, cost, example_part
from bench.report import Section, Table
from resting_aspects_ros.api.conditions import shipped_actions, shipped_surfaces
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.job import BULLET, KERNEL, DropJob, make_job
from resting_aspects_ros.simulation.starts import rest_starts

PARTS = ('l_bracket', 'box_10x20x30')


def actions() -> Section:
    """Time drops on two surfaces and each named action, in one thread."""
    columns = ['part', 'simulated', 'time (T)', 'kernel (ms)', 'Bullet (ms)', 'Bullet / kernel']
    table = Table([*columns, 'of a drop'])
    found: dict[str, dict[str, float]] = {}
    for name in track(PARTS, 'actions', transient=True):
        drop = 0.0
        for what, job in _jobs(example_part(name)).items():
            costs = {job.engine: cost(job)}
            if job.engine == KERNEL:
                costs[BULLET] = cost(dataclasses.replace(job, engine=BULLET))
            each = {engine: value.milliseconds for engine, value in costs.items()}
            kernel = each.get(KERNEL, 0.0)
            drop = drop or kernel
            found[f'{name}, {what}'] = each
            table.rows.append(
                [
                    name,
                    what,
                    f'{costs[job.engine].simulated:.1f}',
                    f'{kernel:.3f}' if kernel else '-',
                    f'{each[BULLET]:.2f}',
                    f'{each[BULLET] / kernel:.0f}' if kernel else '-',
                    f'{each[job.engine] / drop:.1f}',
                ]
            )
    return Section('Actions', _text(), [table], {'actions': found})


def _text() -> str:
    return (
        'Processor time of one thread for a drop on the named surface, or an action on '
        f'`rubber_mat`: the mean of {COST_DROPS[KERNEL]} in the kernel and {COST_DROPS[BULLET]} '
        'in Bullet. *Time*: simulated until the rest is decided. Parts that fall from an edge are '
        'simulated only in Bullet. *Of a drop*: the cost in the default engine, as a multiple of '
        'that of a drop on `rubber_mat`.'
    )


def _jobs(part: Part) -> dict[str, DropJob]:
    surfaces, actions = shipped_surfaces(), shipped_actions()
    conditions, aspects = surfaces.get(), find_aspects(part).aspects
    jobs = {f'drop, {s}': make_job(part, surfaces.get(s), SEED) for s in ('rubber_mat', 'thrown')}
    for name in actions.names():
        starts = rest_starts(part, aspects, actions.get(name).action, conditions)
        jobs[name] = make_job(part, conditions, SEED, starts=starts)
    return jobs

"""What an action costs, beside drops of the same simulated time."""

import time

from bench_report import Section, Table
from dropper import ROOT, SEED
from rich.progress import track

from resting_aspects_ros.api.condition_text import shipped_actions
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.simulation.actions import Action
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.part_library import PartLibrary
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.reorientation import action_starts
from resting_aspects_ros.simulation.surfaces import Surfaces

PARTS = ('l_bracket', 'box_10x20x30')
CHUNKS = 4


def actions() -> Section:
    """Time drops on two surfaces and each named action, in one process."""
    surfaces = Surfaces.read(ROOT / 'config' / 'surfaces.yaml')
    library = PartLibrary(ROOT / 'config' / 'parts')
    table = Table(
        [
            'part',
            'simulated',
            'ms',
            'simulated time (T)',
            'steps per T',
            'ms / drop',
            'per T / drop',
        ]
    )
    found: dict[str, dict[str, float]] = {}
    for name in track(PARTS, 'actions', transient=True):
        part = library.load(name)
        jobs = {
            f'drop, {s}': make_job(part, surfaces.get(s), SEED) for s in ('rubber_mat', 'thrown')
        }
        for action in shipped_actions().names():
            jobs[action] = _job(part, shipped_actions().get(action).action, surfaces)
        base: tuple[float, float] | None = None
        for what, job in jobs.items():
            milliseconds, duration = _cost(job)
            if base is None:
                base = milliseconds, duration
            ratio = milliseconds / base[0]
            rate = ratio / (duration / base[1])
            found[f'{name}_{what.replace(", ", "_")}'] = {'ms': milliseconds, 'time_T': duration}
            table.rows.append(
                [
                    name,
                    what,
                    f'{milliseconds:.2f}',
                    f'{duration:.1f}',
                    str(job.steps_per_t),
                    f'{ratio:.1f}',
                    f'{rate:.1f}',
                ]
            )
    note = (
        f'Processor time of one process for each of {CHUNKS * CHUNK} drops or actions on '
        'rubber_mat (and drops on thrown), with the simulated time until the rest is decided. '
        'The last two columns compare with a drop on rubber_mat: the cost of one, and the cost '
        'of the same simulated time.'
    )
    return Section('Actions', note, [table], {'actions': found})


def _job(part: Part, action: Action, surfaces: Surfaces) -> DropJob:
    conditions = surfaces.get()
    starts = action_starts(part, find_aspects(part).aspects, action, conditions.gravity)
    return make_job(part, conditions, SEED, starts=starts)


def _cost(job: DropJob) -> tuple[float, float]:
    """Return processor time, ms, and simulated time, T, of one drop."""
    drop_range(job, 0, 1)
    started = time.process_time()
    poses = [drop_range(job, k * CHUNK, (k + 1) * CHUNK) for k in range(CHUNKS)]
    seconds = time.process_time() - started
    mean = sum(float(each.time_to_rest.mean()) for each in poses) / CHUNKS
    return 1000 * seconds / (CHUNKS * CHUNK), mean / job.time_unit

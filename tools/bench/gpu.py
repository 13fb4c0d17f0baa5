"""The kernel on a GPU beside the processor: the same drops, and how many end otherwise."""

import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from validation.document import table
from validation.dropper import Dropper
from validation.paired import class_indices, ends

from bench.case import example_part, job_of
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.conditions import CUDA, KERNEL
from resting_aspects_ros.simulation.workers import drop_range

# Part, surface and number of drops.
CASES = (
    ('l_bracket', 'rubber_mat', 2_000_000),
    ('l_bracket', 'thrown', 1_000_000),
    ('cylinder_d20_h20', 'thrown', 200_000),
    ('washer', 'rubber_mat', 1_000_000),
)


def gpu(dropper: Dropper) -> Iterator[str]:
    """Time drops on the processor and on the GPU."""
    yield '## GPU'
    yield ''
    yield (
        'The same drops in all threads of the processor and on the GPU, after the kernel was '
        'compiled for both. *Other end*: share of the drops that end in another aspect, or '
        'otherwise, on the GPU.'
    )
    yield ''
    rows = []
    for name, surface, n in CASES:
        found: list[npt.NDArray[np.int64]] = []
        rates: list[float] = []
        part = example_part(name)
        aspects = find_aspects(part)
        for engine in (KERNEL, CUDA):
            job = job_of(part, surface, engine)
            drop_range(job, 0, 64)  # compiles
            started = time.perf_counter()
            found.append(ends(dropper, job, aspects, class_indices(aspects), n))
            rates.append(n / (time.perf_counter() - started))
        other = np.mean(found[0] != found[1])
        cells = (f'{n}', *(f'{rate:.0f}' for rate in rates), f'{other:.4%}')
        rows.append([f'{name}, {surface}', *cells])
    yield from table(
        ['part, surface', 'n', 'processor, drops/s', 'GPU, drops/s', 'other end'],
        rows,
        numbers=True,
    )

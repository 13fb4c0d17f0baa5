"""The kernel on a GPU: numba-cuda compiles the functions of kernel.py; each drop has a thread."""

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import cuda

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.simulation import kernel, kernel_data

# Threads of a block, and memory of the arrays of all threads, bytes.
BLOCK, MEMORY = 64, 2**31


def check_device() -> None:
    """Raise EngineError if there is no GPU that can be used."""
    if not cuda.is_available():
        raise EngineError('device cuda was not found: expected an NVIDIA GPU and its driver')


def simulate(
    body: kernel_data.Body,
    ground: kernel_data.Ground,
    numerics: kernel_data.Numerics,
    limit: Array,
    states: kernel_data.States,
    ends: Array,
    codes: npt.NDArray[np.int64],
) -> None:
    """Simulate drops on the GPU; see kernel.simulate."""
    one = kernel_data.work_of(body, ground)
    size = max(1, min(len(limit), MEMORY // sum(each.nbytes for each in one)))
    work = kernel_data.Work(
        *(cuda.to_device(np.broadcast_to(each, (size, *each.shape)).copy()) for each in one)
    )
    part = kernel_data.Body(*(cuda.to_device(each) for each in body))
    there: list[Any] = [
        cuda.to_device(each) if isinstance(each, np.ndarray) else each for each in ground
    ]
    places = kernel_data.Ground(*there)
    for first in range(0, len(limit), size):
        rows = slice(first, first + size)
        given = [cuda.to_device(each[rows]) for each in (limit, *states)]
        found = [cuda.to_device(each[rows]) for each in (ends, codes)]
        blocks = -(-len(limit[rows]) // BLOCK)
        _drops[blocks, BLOCK](part, places, numerics, work, *given, *found)
        for each, device in zip((ends, codes), found, strict=True):
            each[rows] = device.copy_to_host()


@cuda.jit(fastmath=False)
def _drops(
    body, ground, numerics, work, limit, position, velocity, spin, orientation, ends, codes
):
    i = cuda.grid(1)
    if i < len(position):
        own = kernel_data.Work(
            work.planes[i],
            work.axes[i],
            work.found[i],
            work.values[i],
            work.touching[i],
            work.lowest[i],
            work.mark[i],
            work.picked[i],
            work.con[i],
            work.corner[i],
            work.plane[i],
            work.roll[i],
            work.old[i],
            work.old_corner[i],
            work.old_roll[i],
            work.track[i],
            work.counts[i],
        )
        kernel.simulate_one(
            body,
            ground,
            numerics,
            own,
            limit,
            position,
            velocity,
            spin,
            orientation,
            ends,
            codes,
            i,
        )

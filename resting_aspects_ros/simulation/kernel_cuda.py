"""The kernel on a GPU: numba-cuda compiles the functions of kernel.py; each drop has a thread."""

import sys
import threading
import warnings
from functools import cache
from typing import Any

import numpy as np
from numba import cuda, float64, int64

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.simulation import kernel, kernel_data

# Threads of a block, maximum number of blocks, and maximum memory of the arrays of corners, bytes.
# A GPU makes as many blocks at once as it can; those that begin late find no drop left.
BLOCK, BLOCKS, MEMORY = 32, 2048, 2**30
# Maximum number of planes, their contacts, and the columns of both.
PLANES = 8
CONTACTS = PLANES * kernel_data.CONTACTS
PICKED, COLUMNS, WIDTH = kernel_data.CONTACTS, kernel_data.COLUMNS, kernel_data.PLANE
# One range of drops at a time is on the GPU, while other threads prepare theirs.
_lock = threading.Lock()
# Few drops cannot occupy a GPU, which Numba would report for each number of them.
warnings.filterwarnings('ignore', '.*Grid size .* low occupancy')


def simulate(
    body: kernel_data.Body,
    ground: kernel_data.Ground,
    numerics: kernel_data.Numerics,
    limit: Array,
    states: kernel_data.States,
    ends: Array,
    codes: Indices,
) -> None:
    """Simulate drops on the GPU; see kernel.simulate. Raises EngineError if there is none."""
    corners, planes = body.points.shape[1], len(ground.planes)
    if planes > PLANES:
        raise EngineError(f'invalid surroundings: {planes} planes; expected at most {PLANES}')
    size = 8 * corners * (5 * planes + 1)
    blocks = -(-min(len(limit), BLOCKS * BLOCK, max(BLOCK, MEMORY // size)) // BLOCK)

    def array(*shape: int, dtype: type = np.int64) -> Any:
        # The same element of neighbouring threads is at neighbouring addresses.
        return cuda.device_array((*shape, blocks * BLOCK), dtype)

    with _lock:
        _check_device()
        found = cuda.device_array(ends.shape), cuda.device_array(codes.shape, codes.dtype)
        _drops[blocks, BLOCK](
            kernel_data.Body(*map(_there, body)),
            kernel_data.Ground(*map(_there, ground)),
            numerics,
            (array(planes, corners), array(planes, corners + 1), array(corners)),
            array(planes, 3, corners, dtype=np.float64),
            _there(limit),
            tuple(map(_there, states)),
            *found,
            _there(np.zeros(1, np.int64)),
        )
        for each, device in zip((ends, codes), found, strict=True):
            device.copy_to_host(each)


@cache
def _check_device() -> None:
    """Announce the compilation; raises EngineError if there is no GPU that can be used."""
    if not cuda.is_available():
        raise EngineError('device cuda was not found: expected an NVIDIA GPU and its driver')
    print('compiling the simulation for the GPU: about 40 s ...', file=sys.stderr, flush=True)


def _there(value: Any) -> Any:
    return cuda.to_device(value) if isinstance(value, np.ndarray) else value


@cuda.jit(device=True)
def _take(taken, i, ended):
    """See kernel; the threads of a block, one warp, make each step together."""
    cuda.syncthreads()
    return cuda.atomic.add(taken, 0, 1) if ended else i


@cuda.jit(fastmath=False)
def _drops(body, ground, numerics, corners, values, limit, states, ends, codes, taken):
    i, n = cuda.grid(1), len(ground.planes)
    few = n * PICKED
    found, touching, mark = corners
    work = kernel_data.Work(
        planes=cuda.local.array((PLANES, WIDTH), float64)[:n],
        axes=cuda.local.array((PLANES, 9), float64)[:n],
        found=found[..., i],
        values=values[..., i],
        touching=touching[..., i],
        lowest=cuda.local.array(PLANES, int64)[:n],
        mark=mark[..., i],
        picked=cuda.local.array(PICKED, int64),
        con=cuda.local.array((CONTACTS, COLUMNS), float64)[:few],
        corner=cuda.local.array(CONTACTS, int64)[:few],
        plane=cuda.local.array(CONTACTS, int64)[:few],
        roll=cuda.local.array((PLANES, 6), float64)[:n],
        old=cuda.local.array((CONTACTS, 3), float64)[:few],
        old_corner=cuda.local.array((CONTACTS, 2), int64)[:few],
        old_roll=cuda.local.array((PLANES, 6), float64)[:n],
        track=cuda.local.array(15, float64),
        counts=cuda.local.array(3, int64),
    )
    # As work_of sets them.
    for k in range(body.points.shape[1]):
        work.mark[k] = 0
        for plane in range(n):
            work.found[plane, k] = k
    for k in range(len(work.counts)):
        work.counts[k] = 0
    kernel.simulate_taken(body, ground, numerics, work, limit, states, ends, codes, taken, _take)

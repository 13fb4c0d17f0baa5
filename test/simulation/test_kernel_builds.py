"""The kernel in processes of its own: from the file of its machine code, and for a GPU."""

import os
import subprocess
import sys

import pytest

from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import drop_range


def output(program, **environment):
    """Return what a Python program prints."""
    run = subprocess.run(
        [sys.executable, '-c', program],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


# Keeps all free addresses near the libraries from memory of more than 64 KiB, as the driver of a
# GPU can do, so that the parts of the machine code are far apart.
FAR_APART = """
import ctypes, mmap
from resting_aspects_ros import drop, load_part
import resting_aspects_ros.api.drop
import resting_aspects_ros.simulation.kernel_engine
of_process = ctypes.CDLL(None).mmap
of_process.restype = ctypes.c_void_p
of_process.argtypes = [
    ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long
]
UNUSED = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x4000  # MAP_NORESERVE
def taken(size):
    return of_process(None, size, 0, UNUSED, -1, 0)
far = taken(1 << 40)
for power in range(38, 15, -1):
    while far < taken(1 << power) < 1 << 63:
        pass
print(drop(load_part('l_bracket'), drops=100).run.drops)
"""


@pytest.mark.skipif(sys.platform != 'linux', reason='needs the flags of Linux')
def test_parts_of_the_machine_code_can_be_far_apart():
    assert output(FAR_APART) == '100\n'


# In the simulator of Numba, because no GPU is there when tests run. Both kernels as Python: the
# simulator cannot call compiled functions.
ON_A_GPU = """
import numpy as np
from resting_aspects_ros import load_part
from resting_aspects_ros.api.conditions import with_surroundings
from resting_aspects_ros.simulation import kernel, kernel_cuda, kernel_data
from resting_aspects_ros.simulation.release import initial_states
from resting_aspects_ros.simulation.kernel_engine import body_of, ground_of
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.conditions import all_surfaces
kernel_cuda.BLOCK, kernel_cuda.BLOCKS = 2, 1  # so that threads make several drops
for name, surroundings in (('cylinder_d20_h20', None), ('hex_nut', 'tray')):
    given = with_surroundings(all_surfaces().get('rubber_mat'), surroundings)
    job = make_job(load_part(name), given, 1)
    body, ground = body_of(job), ground_of(job)
    start = initial_states(job, 0, 3)
    states = start.position, start.velocity, start.spin, start.orientation
    one, other = [(np.zeros((3, 15)), np.zeros((3, 2), np.int64)) for _ in range(2)]
    given, limits = (body, ground, kernel_data.Numerics()), np.full(3, 500.0)
    kernel.simulate(*given, kernel_data.work_of(body, ground), limits, states, *one)
    kernel_cuda.simulate(*given, limits, states, *other)
    for a, b in zip(one, other):
        np.testing.assert_array_equal(a, b)
print('equal')
"""


@pytest.mark.slow
def test_threads_of_a_gpu_make_the_same_drops():
    assert output(ON_A_GPU, NUMBA_ENABLE_CUDASIM='1', NUMBA_DISABLE_JIT='1') == 'equal\n'


def test_a_missing_gpu_is_an_error(part, surfaces):
    cuda = pytest.importorskip('numba.cuda')
    if cuda.is_available():
        pytest.skip('there is a GPU')
    job = make_job(part('l_bracket'), surfaces.get(), 1, engine='cuda')
    with pytest.raises(EngineError, match='cuda'):
        drop_range(job, 0, 1)

"""The kernel for a GPU: in the simulator of Numba, because no GPU is there when tests run."""

import os
import subprocess
import sys

import pytest

from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import drop_range

# Both as Python: the simulator cannot call compiled functions.
PROGRAM = """
import numpy as np
from resting_aspects_ros import load_part
from resting_aspects_ros.api.conditions import with_surroundings
from resting_aspects_ros.simulation import kernel, kernel_cuda, kernel_data
from resting_aspects_ros.simulation.release import initial_states
from resting_aspects_ros.simulation.kernel_engine import body_of, ground_of
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.conditions import all_surfaces
kernel_cuda.BLOCK, kernel_cuda.BLOCKS = 2, 1  # so that threads make several drops
for name, surroundings in (('l_bracket', None), ('cylinder_d20_h20', None), ('hex_nut', 'tray')):
    given = with_surroundings(all_surfaces().get('rubber_mat'), surroundings)
    job = make_job(load_part(name), given, 1)
    body, ground = body_of(job), ground_of(job)
    start = initial_states(job, 0, 4)
    states = start.position, start.velocity, start.spin, start.orientation
    one, other = [(np.zeros((4, 15)), np.zeros((4, 2), np.int64)) for _ in range(2)]
    given, limits = (body, ground, kernel_data.Numerics()), np.full(4, 500.0)
    kernel.simulate(*given, kernel_data.work_of(body, ground), limits, states, *one)
    kernel_cuda.simulate(*given, limits, states, *other)
    for a, b in zip(one, other):
        np.testing.assert_array_equal(a, b)
print('equal')
"""


@pytest.mark.slow
def test_threads_of_a_gpu_make_the_same_drops():
    simulated = {'NUMBA_ENABLE_CUDASIM': '1', 'NUMBA_DISABLE_JIT': '1'}
    run = subprocess.run(
        [sys.executable, '-c', PROGRAM],
        env=os.environ | simulated,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.stdout == 'equal\n', run.stderr


def test_a_missing_gpu_is_an_error(part, surfaces):
    cuda = pytest.importorskip('numba.cuda')
    if cuda.is_available():
        pytest.skip('there is a GPU')
    job = make_job(part('l_bracket'), surfaces.get(), 1, engine='cuda')
    with pytest.raises(EngineError, match='cuda'):
        drop_range(job, 0, 1)

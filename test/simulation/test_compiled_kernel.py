"""The machine code of the kernel, loaded from its file."""

import subprocess
import sys

import pytest

# Keeps all free addresses near the libraries from memory of more than 64 KiB, as the driver of a
# GPU can do, so that the parts of the machine code are far apart.
PROGRAM = """
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
    run = subprocess.run(
        [sys.executable, '-c', PROGRAM], capture_output=True, text=True, check=False
    )
    assert run.stdout == '100\n', run.stderr

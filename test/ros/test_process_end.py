"""A process ends although native code holds the lock of the interpreter."""

import subprocess
import sys

import pytest

PROGRAM = """
import ctypes
from resting_aspects_ros.ros.program import at_most
# Unlike CDLL, PyDLL keeps the lock of the interpreter.
sleep = ctypes.PyDLL(None).sleep
with at_most(1, 3):
    pass
sleep(2)
print('goes on', flush=True)
with at_most(1, 2):
    sleep(600)
print('sleeps no longer')
"""


@pytest.mark.slow
def test_process_ends_while_native_code_waits():
    command = [sys.executable, '-c', PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ('goes on\n', '', 2)

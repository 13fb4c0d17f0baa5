"""A process ends although native code holds the lock of the interpreter."""

import subprocess
import sys

import pytest

PROGRAM = """
import ctypes
from resting_aspects_ros.ros.process_end import end_process_after
print('begins', flush=True)
end_process_after(1, {code})
# Unlike CDLL, PyDLL keeps the lock of the interpreter.
ctypes.PyDLL(None).sleep(600)
print('sleeps no longer')
"""


@pytest.mark.parametrize('code', [0, 2])
def test_process_ends_while_native_code_waits(code):
    command = [sys.executable, '-c', PROGRAM.format(code=code)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ('begins\n', '', code)

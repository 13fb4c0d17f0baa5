"""A signal while a program is still imported: it ends at once, and says nothing."""

import ast
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# After the program heeds signals, s. It imports for 0.3 to 2 s.
MOMENTS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.2, 2.0)
FEW = (0.0, 0.1, 0.2, 0.35, 0.5)
DEADLINE = 20.0
# Far less than the rest of the imports, and enough for a library that is being loaded, s.
AT_ONCE = 1.5
# A command that takes no longer to its answer was at its end when it was told to, s.
DONE = 0.1
NODES = ('drop_simulator', 'aspect_classifier', 'drop_recorder', 'feeder_example', 'log_replayer')


def entry_points():
    """The programs that setup.py declares, by name: module and function."""
    script = "import setuptools; setuptools.setup = lambda **given: print(given['entry_points'])"
    printed = subprocess.run(
        [sys.executable, '-c', f'{script}\nimport runpy\nrunpy.run_path("setup.py")'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    lines = ast.literal_eval(printed)['console_scripts']
    return dict(re.fullmatch(r'(\w+) = (\S+)', line).groups() for line in lines)


PROGRAMS = entry_points()


@pytest.fixture
def begin(tmp_path):
    """Begin a program as the script that pip installs for it does."""
    begun = []

    def begin(name, *words):
        module, _, function = PROGRAMS[name].partition(':')
        script = tmp_path / name
        # Workers read it, too.
        script.write_text(
            f'import sys\nfrom {module} import {function}\n'
            f'if __name__ == "__main__":\n    sys.exit({function}())\n'
        )
        process = subprocess.Popen(
            [sys.executable, script, *words],
            cwd=tmp_path,
            env={
                **os.environ,
                'PYTHONPATH': str(ROOT),
                'ROS_LOG_DIR': str(tmp_path / 'ros'),
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        begun.append(process)
        return process

    yield begin
    for process in begun:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def heeds(process, number):
    """Whether a process handles a signal; until then Python is started, not yet the program."""
    status = Path(f'/proc/{process.pid}/status').read_text()
    return bool(int(re.search(r'^SigCgt:\s*(\w+)', status, re.M)[1], 16) >> (number - 1) & 1)


def wait_until_it_heeds(process):
    end = time.monotonic() + DEADLINE
    # SIGINT is handled by Python itself, too.
    while not heeds(process, signal.SIGTERM):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < end, 'it does not handle SIGTERM'
        time.sleep(0.001)


def ended(process, number):
    """The exit code and what it said, when it was told to end."""
    sent = time.monotonic()
    process.send_signal(number)
    printed, errors = process.communicate(timeout=DEADLINE)
    return process.returncode, printed, errors, time.monotonic() - sent


def assert_no_trace(errors):
    assert 'Traceback' not in errors
    assert 'KeyboardInterrupt' not in errors


BOTH = pytest.mark.parametrize(
    'number', [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name
)


@BOTH
@pytest.mark.parametrize(
    ('name', 'moments'), [('drop_simulator', MOMENTS), *((name, FEW) for name in NODES[1:])]
)
def test_a_node_that_is_told_to_end_before_it_is_there(begin, name, moments, number):
    quiet = 0
    for moment in moments:
        process = begin(name)
        wait_until_it_heeds(process)
        time.sleep(moment)
        if process.poll() is not None:
            break  # the replayer: it has no log
        code, _, errors, took = ended(process, number)
        assert_no_trace(errors)
        if code == 128 + number:
            assert (errors, took < AT_ONCE) == ('', True), (moment, took)
            quiet += 1
        else:  # it was there
            assert code == (2 if name == 'log_replayer' else 0), (moment, errors)
    assert quiet >= 2


@BOTH
@pytest.mark.parametrize(
    ('words', 'moments', 'codes'),
    [
        (('nodes',), MOMENTS, (0, 130)),
        (('estimate', 'l_bracket'), MOMENTS, (130,)),
        (('recover', 'no_log'), FEW, (130,)),
        (('drop', 'l_bracket', '--drops', '2000000'), FEW, (130,)),
    ],
    ids=('nodes', 'estimate', 'recover', 'drop'),
)
def test_a_command_that_is_told_to_end_before_it_begins(begin, words, moments, codes, number):
    for moment in moments:
        process = begin('resting_aspects', *words)
        wait_until_it_heeds(process)
        time.sleep(moment)
        if process.poll() is not None:
            break
        code, printed, errors, took = ended(process, number)
        if words[0] == 'estimate' and printed and took < DONE:
            break  # Python gives up its handlers as it ends
        assert_no_trace(errors)
        assert code in (128 + number, *codes), (moment, errors)
        if code == 128 + number != 130:
            assert (printed, errors) == ('', ''), moment


@BOTH
def test_a_simulator_that_reads_many_meshes_ends_before_it_has_read_them(begin, tmp_path, number):
    parts = tmp_path / 'parts'
    parts.mkdir()
    for k in range(400):  # seconds
        shutil.copy(ROOT / 'config/parts/t_prism.stl', parts / f'part_{k}.stl')
    process = begin('drop_simulator', '--ros-args', '-p', f'parts_folder:={parts}')
    children = Path(f'/proc/{process.pid}/task/{process.pid}/children')
    end = time.monotonic() + DEADLINE
    while not children.read_text():  # its workers are begun before the meshes are read
        assert time.monotonic() < end, 'no workers'
        time.sleep(0.01)
    time.sleep(0.5)
    code, _, errors, _ = ended(process, number)
    assert (code, errors) == (0, '')

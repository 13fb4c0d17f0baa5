"""The command without ROS, and without what only Linux and macOS have."""

import json
import subprocess
import sys

import openpyxl
import pytest

from resting_aspects_ros.cli.verbs import GROUPS, ROS

# Hides ROS, and what Windows does not have: modules, functions and signals. Then runs commands.
CODE = """
import contextlib, io, json, os, signal, sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0].endswith(('rclpy', '_interfaces', '_msgs', '_srvs')):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)

sys.meta_path.insert(0, Hidden())
sys.modules['fcntl'] = sys.modules['resource'] = None
del os.nice, os.sched_getaffinity, signal.SIGHUP, signal.pthread_sigmask
from resting_aspects_ros.cli.main import main
ended = []
for words in json.loads(sys.argv[1]):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        with contextlib.redirect_stderr(io.StringIO()) as err:
            code = main(words)
    ended.append((code, out.getvalue(), err.getvalue()))
print(json.dumps(ended))
"""
RUN = [
    'drop hex_nut --drops 300 --report --out nut --table nut.xlsx',
    'aspects l_bracket',
    'reorient tetrahedron --per-aspect 5 --drops 20',
]
NEED_ROS = [
    f'{name} x' if name in ('info', 'replay', 'recover', 'request') else name
    for name in GROUPS[ROS]
]
REFUSED = [*NEED_ROS, 'drop tetrahedron --drops 10 --log logs']


@pytest.fixture(scope='module')
def ended(tmp_path_factory, environment):
    """Run all commands in one process; returns the folder, and code and output by command."""
    folder = tmp_path_factory.mktemp('hidden')
    commands = [*RUN, *REFUSED]
    words = json.dumps([command.split() for command in commands])
    process = subprocess.run(
        [sys.executable, '-c', CODE, words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    return folder, dict(zip(commands, json.loads(process.stdout), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize('command', RUN)
def test_commands_without_ros_run(ended, command):
    code, _, errors = ended[1][command]
    assert code == 0, errors


@pytest.mark.slow
def test_drops_have_the_same_answer(ended, run):
    folder, found = ended
    here = run('drop', 'hex_nut', '--drops', '300').stdout.splitlines()[:8]
    assert found[RUN[0]][1].splitlines()[:8] == here
    names = {path.name for path in (folder / 'nut').iterdir()}
    assert names >= {'report.html', 'distribution.json', 'poses.csv'}
    (sheet,) = openpyxl.load_workbook(folder / 'nut.xlsx')
    assert sheet['H4'].value == 300


@pytest.mark.parametrize('command', REFUSED)
def test_commands_of_ros_state_what_is_missing(ended, command):
    code, _, errors = ended[1][command]
    assert (code, len(errors.splitlines())) == (1, 1)
    assert 'rclpy' in errors or 'builtin_interfaces' in errors

"""The command without ROS, and without what only Linux and macOS have."""

import subprocess
import sys

import openpyxl
import pytest

from resting_aspects_ros.cli.verbs import GROUPS, ROS

# Hides ROS, and what Windows does not have: modules, functions and signals.
CODE = """
import os, signal, sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0].endswith(('rclpy', '_interfaces', '_msgs', '_srvs')):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)

sys.meta_path.insert(0, Hidden())
sys.modules['fcntl'] = sys.modules['resource'] = None
del os.nice, os.sched_getaffinity, signal.SIGHUP, signal.pthread_sigmask
from resting_aspects_ros.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def run_hidden(tmp_path, environment):
    def run_hidden(*words):
        return subprocess.run(
            [sys.executable, '-c', CODE, *map(str, words)],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )

    return run_hidden


def test_drops_have_the_same_answer(run_hidden, run, tmp_path):
    words = ('drop', 'hex_nut', '--drops', '300')
    hidden = run_hidden(*words, '--report', '--out', 'nut', '--table', 'nut.xlsx')
    assert hidden.returncode == 0, hidden.stderr
    assert run(*words).stdout.splitlines()[:8] == hidden.stdout.splitlines()[:8]
    assert {path.name for path in (tmp_path / 'nut').iterdir()} >= {
        'report.html',
        'distribution.json',
        'poses.csv',
    }
    (sheet,) = openpyxl.load_workbook(tmp_path / 'nut.xlsx')
    assert sheet['F4'].value == 300


@pytest.mark.parametrize(
    'words',
    [('aspects', 'l_bracket'), ('reorient', 'tetrahedron', '--per-aspect', '5', '--drops', '20')],
    ids=lambda words: words[0],
)
def test_other_commands_run(run_hidden, words):
    ended = run_hidden(*words)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize('command', GROUPS[ROS])
def test_commands_of_ros_state_what_is_missing(run_hidden, command):
    with_argument = command in ('info', 'replay', 'recover', 'request')
    ended = run_hidden(command, *['x'][: int(with_argument)])
    assert (ended.returncode, len(ended.stderr.splitlines())) == (1, 1)
    assert 'rclpy' in ended.stderr or 'builtin_interfaces' in ended.stderr


def test_a_log_states_what_is_missing(run_hidden):
    ended = run_hidden('drop', 'tetrahedron', '--drops', '10', '--log', 'logs')
    assert (ended.returncode, len(ended.stderr.splitlines())) == (1, 1)
    assert 'rclpy' in ended.stderr

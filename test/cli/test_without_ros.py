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
    'reorient tetrahedron --per-aspect 5 --drops 20',
]
NEED_ROS = [
    f'{name} x' if name in ('info', 'replay', 'recover', 'request') else name
    for name in GROUPS[ROS]
]
REFUSED = [*NEED_ROS, 'drop tetrahedron --drops 10 --log logs']


@pytest.mark.slow
def test_commands_run_without_ros_or_name_what_is_missing(run, environment, tmp_path):
    commands = [*RUN, *REFUSED]
    words = json.dumps([command.split() for command in commands])
    process = subprocess.run(
        [sys.executable, '-c', CODE, words],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    ended = dict(zip(commands, json.loads(process.stdout), strict=True))
    assert [ended[command][0] for command in RUN] == [0, 0]
    here = run('drop', 'hex_nut', '--drops', '300').stdout.splitlines()[:8]
    assert ended[RUN[0]][1].splitlines()[:8] == here
    names = {path.name for path in (tmp_path / 'nut').iterdir()}
    assert names >= {'report.html', 'distribution.json', 'poses.csv'}
    (sheet,) = openpyxl.load_workbook(tmp_path / 'nut.xlsx')
    assert sheet['H4'].value == 300
    for command in REFUSED:
        code, _, errors = ended[command]
        assert (code, len(errors.splitlines())) == (1, 1)
        assert 'ROS 2 Jazzy' in errors

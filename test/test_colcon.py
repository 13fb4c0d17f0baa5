"""`colcon build` of the files in git, with the ROS wheels of .venv as the ROS installation."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent

# The set-up has built all types with the same CMakeLists.txt: here a message is enough, whose code
# is compiled in half a minute.
BUILT = '  msg/Status.msg\n'

IMPORTS = """
import resting_aspects_interfaces.msg, resting_aspects_ros
from resting_aspects_ros.simulation.conditions import config_folder
from rclpy.serialization import serialize_message
print(resting_aspects_interfaces.msg.__file__, resting_aspects_ros.__file__, config_folder())
assert serialize_message(resting_aspects_interfaces.msg.Status())
"""


def run(workspace, *command):
    """Run a command with nothing of this process's environment, and return what it printed."""
    venv = workspace / '.venv'
    ended = subprocess.run(
        command,
        cwd=workspace,
        env={
            'PATH': f'{venv}/bin:/usr/local/bin:/usr/bin:/bin',
            'HOME': str(workspace),
            'LANG': 'C.UTF-8',
            'AMENT_PREFIX_PATH': str(venv),
            'CMAKE_PREFIX_PATH': str(venv),
        },
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout
    return ended.stdout


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """Build a copy of the tracked files, as they are now, and return its folder."""
    folder = tmp_path_factory.mktemp('workspace')
    tracked = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(None, tracked.stdout.split('\0')):
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    cmake = folder / 'resting_aspects_interfaces' / 'CMakeLists.txt'
    lines = cmake.read_text().splitlines(keepends=True)
    types = re.compile(r'  (action|msg|srv)/\w+\.\w+\n')
    kept = [each for each in lines if each == BUILT or not types.match(each)]
    cmake.write_text(''.join(kept))
    # Not where it is: colcon fails on a Python with a space in its path, and this one may have it.
    (folder / '.venv').symlink_to(sys.prefix)
    build = 'python -m colcon build --base-paths . resting_aspects_interfaces'
    quick = '--cmake-args -G Ninja -DBUILD_TESTING=OFF'
    run(folder, *build.split(), *quick.split())
    return folder


def run_sourced(workspace, command):
    """Run a shell command with the workspace sourced, from a folder that holds no package."""
    return run(workspace, 'sh', '-c', f'cd / && . {workspace}/install/local_setup.sh && {command}')


def test_modules_types_and_config_come_from_the_install(workspace):
    printed = run_sourced(workspace, f"python -c '{IMPORTS}'").split()
    install = workspace / 'install'
    names = [Path(path).relative_to(install).parts[0] for path in printed]
    assert names == ['resting_aspects_interfaces', 'resting_aspects_ros', 'resting_aspects_ros']
    assert printed[2].endswith('share/resting_aspects_ros/config')


def test_executables_are_where_ros2_run_looks(workspace):
    folder = workspace / 'install' / 'resting_aspects_ros' / 'lib' / 'resting_aspects_ros'
    names = {path.name for path in folder.iterdir()}
    assert names == {
        'resting_aspects', 'drop_simulator', 'aspect_classifier', 'drop_recorder',
        'feeder_controller', 'log_replayer', 'camera_simulator', 'vision_example'
    }  # fmt: skip
    assert 'usage: resting_aspects' in run_sourced(workspace, f'{folder}/resting_aspects --help')

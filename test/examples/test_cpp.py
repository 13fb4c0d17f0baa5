"""The C++ example: code that does not need rclcpp, which is not on PyPI, is compiled and run."""

import os
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from doc_pages import code
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import Aspect, AspectDistribution
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from resting_aspects_ros.api.identify import known_part, locate_part
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    CELL,
    FEEDER_ADVICE,
    GET_DISTRIBUTION,
    IDENTIFY_PART,
    PICK_RESULT,
    SERVICES,
)
from resting_aspects_ros.vision.camera import transformed_pose

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'cpp'
PREFIX = Path(sys.prefix)
COUNTS = [8, 4, 2, 1, 0]
DROPS = 16


pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def compile_cpp():
    """Run the compiler with strict warnings and the headers that the set-up installed."""
    named = [os.environ.get('CXX', ''), 'c++', 'g++', 'clang++']
    compiler = next(filter(None, map(shutil.which, filter(None, named))))
    folders = [PREFIX / 'include', *sorted((PREFIX / 'include').iterdir())]
    generated = [word for folder in folders for word in ('-isystem', folder)]
    strict = ('-std=c++17', '-Wall', '-Wextra', '-Wpedantic', '-Wconversion', '-Werror')

    def compile_cpp(*words):
        return subprocess.run(
            [compiler, *strict, *generated, f'-I{EXAMPLE / "src"}', *words],
            capture_output=True,
            text=True,
            env={**os.environ, 'LC_ALL': 'C'},
            check=False,
        )

    return compile_cpp


@pytest.fixture(scope='module')
def share_of(compile_cpp, tmp_path_factory):
    """Run a program that applies the header to a message that rclpy serialised."""
    folder = tmp_path_factory.mktemp('cpp')
    library = PREFIX / 'lib'
    done = compile_cpp(
        *(Path(__file__).with_name('share_of.cpp'), '-o', folder / 'share_of', f'-L{library}'),
        *('-lresting_aspects_interfaces__rosidl_typesupport_fastrtps_cpp', '-lfastcdr'),
        f'-Wl,--disable-new-dtags,-rpath,{library}',  # also for their dependencies
    )
    assert done.returncode == 0, done.stderr

    def share_of(message, *ids):
        (folder / 'message.cdr').write_bytes(serialize_message(message))
        ended = subprocess.run(
            [folder / 'share_of', folder / 'message.cdr', *map(str, ids)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert ended.stderr == ''
        return ended.returncode, ended.stdout.strip()

    return share_of


@pytest.fixture
def distribution(filled):
    """A distribution in which all other fields differ from the defaults."""
    message = filled(AspectDistribution, random.Random(3))
    message.aspects = [filled(Aspect, random.Random(k)) for k in range(len(COUNTS))]
    for number, (aspect, count) in enumerate(zip(message.aspects, COUNTS, strict=True), start=1):
        aspect.id, aspect.count = number, count
    message.drops = DROPS
    return message


def numbers_of(printed):
    return [float(number) for number in printed.split()]


def test_share_and_wilson_interval_of_any_set_of_aspects(share_of, distribution):
    for ids in ((), (1,), (5,), (2, 5), (1, 2, 3, 4, 5)):
        code, printed = share_of(distribution, *ids)
        found = binomtest(sum(COUNTS[k - 1] for k in ids), DROPS)
        interval = found.proportion_ci(method='wilson')
        expected = [found.statistic, interval.low, interval.high]
        assert code == 0
        assert numbers_of(printed) == pytest.approx(expected, abs=1e-12), ids
    # A duplicate counts once.
    assert numbers_of(share_of(distribution, 2, 1, 2)[1])[0] == 0.75


def test_unknown_ids_and_no_drops(share_of, distribution):
    for unknown in (0, 6, 2**32 + 1):
        message = f'invalid aspect {unknown}: expected 1 to 5'
        assert share_of(distribution, 1, unknown) == (2, message)
    for aspect in distribution.aspects:
        aspect.count = 0
    distribution.drops = 0
    code, printed = share_of(distribution, 1)
    assert (code, printed.replace('-nan', 'nan')) == (0, 'nan 0 1')


def output_of(compile_cpp, source, program):
    """Compile a program without ROS libraries, and return what it prints."""
    done = compile_cpp(source, '-o', program)
    assert done.returncode == 0, done.stderr
    return subprocess.run([program], capture_output=True, text=True, check=True).stdout


def test_feeder_example_follows_only_current_advice(compile_cpp, tmp_path):
    source = Path(__file__).with_name('follow_feeder.cpp')
    printed = output_of(compile_cpp, source, tmp_path / 'follow_feeder')
    # An advice of epoch 7 is current after two results since epoch 5, but not after three. A
    # controller that was started again begins with epoch 0, and is followed; so is one that has
    # not received the last result, after some seconds.
    assert printed == '3 0.04 nut 111 pick|pick||pick||pick||pick|\n'


def test_the_tutorial_computes_the_poses_of_the_suite(compile_cpp, tmp_path):
    """The C++ of the tutorial and the Python interface give the same pose in the robot's frame."""
    (block,) = code('docs/tutorials/camera_to_robot.md', 'cpp')
    known = known_part('l_bracket')
    aspect = known.aspects[2]
    x, y, yaw = 0.012, 0.004, 0.7
    pose = locate_part(known, aspect.id, x, y, yaw)[0]
    # The same pose at (0, 0, 0) has R_a and h; the robot is turned by a quarter and moved.
    start = locate_part(known, aspect.id, 0.0, 0.0, 0.0)[0]
    matrix = np.eye(4)
    matrix[:2, :2] = [[0, -1], [1, 0]]
    matrix[:3, 3] = [0.4, 0.1, 0.05]
    expected = transformed_pose(matrix, pose)
    centre = known.part.centre_of_mass
    height = (
        start.position[2]
        + Rotation.from_quat(np.array(start.orientation)).apply(np.array(centre))[2]
    )
    numbers = [', '.join(map(repr, each.tolist())) for each in (start.orientation, centre)]
    main = f"""
#include <cstdio>
int main() {{
  const Quaternion R_a = {{{numbers[0]}}};
  const Pose part = tray_from_part({x}, {y}, {yaw}, R_a, {float(height)!r}, {{{numbers[1]}}});
  const Pose robot{{{{0.4, 0.1, 0.05}}, {{0, 0, std::sqrt(0.5), std::sqrt(0.5)}}}};
  const Pose found = multiply(robot, part);
  for (const double value : found.position) std::printf("%.12g ", value);
  for (const double value : found.orientation) std::printf("%.12g ", value);
}}
"""
    source = tmp_path / 'pose.cpp'
    source.write_text(block + main, encoding='utf-8')
    found = np.array(numbers_of(output_of(compile_cpp, source, tmp_path / 'pose')))
    assert found[:3] == pytest.approx(expected.position, abs=1e-9)
    assert abs(found[3:] @ expected.orientation) == pytest.approx(1, abs=1e-9)


DEPTH = f'rclcpp::ServicesQoS().keep_last({SERVICES.depth})'
LATCHED = 'rclcpp::QoS(1).reliable().transient_local()'
NODES = {
    'pickable_share': [f'"{ASPECT_DISTRIBUTIONS}/" + part', LATCHED],
    'ask_distribution': [f'"{GET_DISTRIBUTION}", {DEPTH}'],
    'follow_feeder': [
        f'"{IDENTIFY_PART}", {DEPTH}',
        f'"{FEEDER_ADVICE}/" + part, {LATCHED}',
        f'<PickResult>("{PICK_RESULT}", rclcpp::QoS({CELL.depth}))',
    ],
}


@pytest.mark.parametrize('name', NODES)
def test_node_compiles_and_has_names_and_qos_of_the_suite(compile_cpp, name):
    """With rclcpp the whole node compiles; without it, only rclcpp is missing."""
    path = EXAMPLE / 'src' / f'{name}.cpp'
    done = compile_cpp('-fsyntax-only', path)
    errors = [line for line in done.stderr.splitlines() if 'error' in line]
    missing = re.compile(rf'.*{name}\.cpp:\d+:\d+: fatal error: .*rclcpp/rclcpp\.hpp.*')
    assert done.returncode == 0 or (len(errors) == 1 and missing.fullmatch(errors[0])), done.stderr
    source = path.read_text(encoding='utf-8')
    assert [each for each in NODES[name] if each not in source] == []

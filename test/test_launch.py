"""The launch file, executed by ROS 2's launch where that is installed, and what it names."""

import ast
import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy

from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.ros.program import declare

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / 'launch' / 'resting_aspects.launch.py'
DEFAULTS = ROOT / 'config' / 'resting_aspects.yaml'
SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
FEEDER = ('feeder_controller', 'vision_example', 'camera_simulator')
PARAMETERS = {
    name: importlib.import_module(f'resting_aspects_ros.nodes.{name}.node').PARAMETERS
    for name in (*SUITE, 'log_replayer', *FEEDER)
}
# The programs that rviz:=true adds, and their packages.
RVIZ = {'rviz2': 'rviz2', 'static_transform_publisher': 'tf2_ros'}
# Writes its arguments to a file named like itself, in place of the program, and ends once all
# programs have done so, because the end of one ends the others.
PROBE = """#!/bin/sh
cd "$(dirname "$0")/../.."
printf "%s\\n" "$@" > "$(basename "$0").part"
mv "$(basename "$0").part" "started/$(basename "$0")"
while [ "$(ls started | wc -l)" -lt "$PROGRAMS" ]; do sleep 0.02; done
"""

needs_launch = pytest.mark.stated_requirement


def constant(name):
    """The value of a constant of the launch file, which cannot be imported without launch."""
    for each in ast.parse(FILE.read_text(encoding='utf-8')).body:
        if isinstance(each, ast.Assign) and each.targets[0].id == name:
            return each.value
    raise AssertionError(name)


def test_launch_arguments_reach_the_matching_nodes():
    nodes = ast.literal_eval(constant('NODES'))
    types = {
        key.value: kind.id
        for key, kind in zip(constant('TYPES').keys, constant('TYPES').values, strict=True)
    }
    for name, parameters in PARAMETERS.items():
        shared = {p.name: type(p.default).__name__ for p in parameters if p.name in types}
        assert set(nodes[name]) == set(shared), name
        assert shared.items() <= types.items(), name
    assert set(nodes) == set(PARAMETERS)
    assert set(types) == set().union(*nodes.values())


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """Install packages whose programs write down their arguments; returns the function."""
    pytest.importorskip('launch_ros', reason='launch_ros is not installed')
    (tmp_path / 'started').mkdir()
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))

    def install(package, *programs):
        index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
        index.mkdir(parents=True, exist_ok=True)
        (index / package).touch()
        folder = tmp_path / 'lib' / package
        folder.mkdir(parents=True, exist_ok=True)
        for program in programs:
            (folder / program).write_text(PROBE)
            (folder / program).chmod(0o755)

    install('resting_aspects_ros', *PARAMETERS)
    share = tmp_path / 'share' / 'resting_aspects_ros'
    share.mkdir()
    for folder in ('config', 'rviz'):
        (share / folder).symlink_to(ROOT / folder)
    return install


@pytest.fixture
def launch(prefix, tmp_path, capfd, monkeypatch):
    """Execute the launch file until all programs have ended, as `ros2 launch` does.

    The function returns the exit code, the output, and the arguments of each program.
    """
    from launch import LaunchDescription, LaunchService
    from launch.actions import IncludeLaunchDescription
    from launch.launch_description_sources import PythonLaunchDescriptionSource

    monkeypatch.setattr(sys, 'dont_write_bytecode', True)

    def launch(*programs, **arguments):
        monkeypatch.setenv('PROGRAMS', str(len(programs)))
        source = PythonLaunchDescriptionSource(str(FILE))
        include = IncludeLaunchDescription(source, launch_arguments=arguments.items())
        service = LaunchService(noninteractive=True)
        service.include_launch_description(LaunchDescription([include]))
        capfd.readouterr()
        code = service.run()
        captured = capfd.readouterr()
        started = {
            file.name: file.read_text().splitlines() for file in (tmp_path / 'started').iterdir()
        }
        return SimpleNamespace(code=code, output=captured.out + captured.err, started=started)

    return launch


@pytest.fixture
def parameters_of():
    """The full name and the parameters that a node has when it is started with arguments."""
    context = rclpy.Context()
    rclpy.init(context=context)

    def parameters_of(name, arguments):
        node = rclpy.create_node(name, context=context, cli_args=arguments)
        try:
            return node.get_fully_qualified_name(), declare(node, PARAMETERS[name])
        finally:
            node.destroy_node()

    yield parameters_of
    rclpy.try_shutdown(context=context)


@needs_launch
@pytest.mark.parametrize(
    ('arguments', 'programs'),
    [
        ({}, SUITE),
        ({'log_folder': '2025', 'parts_folder': '/tmp/my parts'}, SUITE),
        ({'namespace': 'cell_1', 'surface': 'steel', 'workers': '0'}, SUITE),
        ({'feeder': 'controller'}, (*SUITE, 'feeder_controller')),
        ({'feeder': 'simulated', 'part': 'hex_nut'}, (*SUITE, *FEEDER)),
        ({'log': 'out/logs/run'}, ('aspect_classifier', 'log_replayer')),
    ],
    ids=str,
)
def test_arguments_reach_the_nodes_in_the_declared_types(
    launch, parameters_of, arguments, programs
):
    launched = launch(*programs, **arguments)
    assert launched.code == 0, launched.output
    assert set(launched.started) == set(programs)
    expected = {**arguments, 'workers': 0} if 'workers' in arguments else arguments
    for name in programs:
        declared = PARAMETERS[name]
        full_name, values = parameters_of(name, launched.started[name])
        namespace = arguments.get('namespace', '')
        assert full_name == f'/{namespace}/{name}'.replace('//', '/')
        defaults = dict(parameters_of(name, ['--ros-args', '--params-file', str(DEFAULTS)])[1])
        given = {key: value for key, value in expected.items() if key in defaults}
        assert values == defaults | given
        assert {type(values[p.name]) for p in declared} == {type(p.default) for p in declared}
        # With a simulated camera, the others use its time.
        files = [Path(w) for w in launched.started[name] if w.startswith('/tmp/launch_params')]
        with_time = any('use_sim_time: true' in file.read_text() for file in files)
        assert with_time == (arguments.get('feeder') == 'simulated' and name in FEEDER[:2])


@needs_launch
@pytest.mark.parametrize('key', ['/**', '/*/drop_simulator'])
def test_an_argument_overrides_the_params_file(launch, parameters_of, tmp_path, key):
    path = tmp_path / 'my parameters.yaml'
    path.write_text(f'{key}:\n  ros__parameters:\n    workers: 7\n    surface: steel\n')
    launched = launch(*SUITE, namespace='cell', params_file=str(path), workers='3')
    _, values = parameters_of('drop_simulator', launched.started['drop_simulator'])
    assert (values['workers'], values['surface']) == (3, 'steel')


@needs_launch
def test_rviz_is_started_in_the_namespace_with_its_frame(prefix, launch):
    launched = launch(rviz='true')
    assert (launched.code, launched.started) == (1, {})
    assert 'expected package rviz2 to be installed' in launched.output
    for program, package in RVIZ.items():
        prefix(package, program)
    launched = launch(*SUITE, *RVIZ, rviz='true', namespace='cell')
    assert launched.code == 0, launched.output
    assert set(launched.started) == {*SUITE, *RVIZ}
    for program in RVIZ:
        assert '__ns:=/cell' in launched.started[program]
    assert Path(launched.started['rviz2'][1]).name == 'resting_aspects.rviz'
    words = launched.started['static_transform_publisher']
    given = dict(zip(words[:4:2], words[1:4:2], strict=True))
    # Below the tray, so that the transform that places the tray stays the user's.
    assert given['--frame-id'] == FRAME != given['--child-frame-id']


@needs_launch
def test_end_of_a_node_ends_all_others(prefix, launch, tmp_path):
    waiting = '#!/bin/sh\ntouch "$(dirname "$0")/../../started/$(basename "$0")"\nexec sleep 600\n'
    for program in ('aspect_classifier', 'drop_recorder'):
        (tmp_path / 'lib' / 'resting_aspects_ros' / program).write_text(waiting)
    launched = launch(*SUITE)  # returns, although two of them would run for 600 s
    assert set(launched.started) == set(SUITE)


@needs_launch
@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ({'workers': 'two'}, "invalid workers 'two': expected int"),
        ({'params_file': '/no/such.yaml'}, "invalid params_file '/no/such.yaml': expected a file"),
        ({'feeder': 'all'}, 'feeder'),
    ],
    ids=str,
)
def test_invalid_argument_starts_nothing(launch, arguments, words):
    launched = launch(**arguments)
    assert (launched.code, launched.started) == (1, {})
    assert words in launched.output

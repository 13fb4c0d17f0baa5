"""What the launch file names is declared. ROS's launch is not on PyPI, so it is read, not run."""

import ast
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from resting_aspects_ros.nodes import aspect_classifier, drop_recorder, drop_simulator
from resting_aspects_ros.nodes.interface import FRAME

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / 'launch' / 'resting_aspects.launch.py'
TREE = ast.parse(FILE.read_text(encoding='utf-8'))
DECLARED = {
    module.__name__.rsplit('.', 1)[-1]: {parameter.name for parameter in module.PARAMETERS}
    for module in (drop_simulator, aspect_classifier, drop_recorder)
}


def calls(name, tree=TREE):
    """All calls of a function or class of that name."""
    return [
        each
        for each in ast.walk(tree)
        if isinstance(each, ast.Call) and getattr(each.func, 'id', '') == name
    ]


def keywords(call):
    return {keyword.arg: keyword.value for keyword in call.keywords}


def texts(call):
    """The arguments that are texts."""
    return [each.value for each in call.args if isinstance(each, ast.Constant)]


def arguments():
    """The launch arguments, with all that is said of each."""
    return {texts(call)[0]: keywords(call) for call in calls('DeclareLaunchArgument')}


def started():
    """The parameters that are given from launch arguments, by the node that is started."""
    return {texts(call)[0]: set(texts(call)[1:]) for call in calls('node')}


def installed():
    """Where setup.py puts what, and the programs that it makes."""
    script = """
import runpy, setuptools
setuptools.setup = lambda **given: print((given['data_files'], given['entry_points']))
runpy.run_path('setup.py')
"""
    printed = subprocess.run(
        [sys.executable, '-c', script], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    files, entry_points = ast.literal_eval(printed)
    scripts = [line.split(' = ')[0] for line in entry_points['console_scripts']]
    return {file: target for target, names in files for file in names}, scripts


def test_the_arguments_are_these_and_each_is_described():
    given = arguments()
    assert set(given) == {
        'namespace', 'params_file', 'log_folder', 'parts_folder', 'surface', 'workers', 'rviz'
    }  # fmt: skip
    assert all({'default_value', 'description'} <= set(said) for said in given.values())
    choices = ast.literal_eval(given['rviz']['choices'])
    assert choices == ['true', 'false']
    assert given['rviz']['default_value'].value == 'false'


def test_docs_ros_names_them_all():
    text = (ROOT / 'docs' / 'ros.md').read_text(encoding='utf-8')
    sentence = text.split('The launch file takes ')[1].split('installed')[0]
    assert re.findall(r'`(\w+):=', sentence) == list(arguments())


def test_every_argument_is_used_and_none_that_is_not_declared():
    named = {name for call in calls('LaunchConfiguration') for name in texts(call)}
    given = {name for parameters in started().values() for name in parameters}
    assert named | given == set(arguments())


def test_the_nodes_and_their_parameters_are_declared():
    nodes = started()
    assert set(nodes) == set(DECLARED)
    for name, parameters in nodes.items():
        assert parameters <= DECLARED[name], name
    _, scripts = installed()
    assert set(nodes) <= set(scripts)


def test_an_argument_is_given_to_every_node_that_has_it():
    nodes = started()
    for argument in ('log_folder', 'parts_folder', 'surface', 'workers'):
        having = {name for name, parameters in DECLARED.items() if argument in parameters}
        assert having == {name for name, given in nodes.items() if argument in given} != set()


def test_the_programs_are_of_this_package_and_rviz():
    (own,) = [node for node in calls('Node') if isinstance(keywords(node)['package'], ast.Name)]
    assert keywords(own)['package'].id == 'PACKAGE'
    (package,) = [
        each.value.value
        for each in TREE.body
        if isinstance(each, ast.Assign) and each.targets[0].id == 'PACKAGE'
    ]
    assert package == 'resting_aspects_ros'
    rviz, frame = [node for node in calls('Node') if node is not own]
    assert [keywords(rviz)[name].value for name in ('package', 'executable')] == ['rviz2'] * 2
    assert [keywords(frame)[name].value for name in ('package', 'executable')] == [
        'tf2_ros', 'static_transform_publisher'
    ]  # fmt: skip
    for node in (rviz, frame):
        (condition,) = calls('IfCondition', keywords(node)['condition'])
        assert [texts(call) for call in calls('LaunchConfiguration', condition)] == [['rviz']]
    for node in (own, rviz, frame):
        assert texts(keywords(node)['namespace']) == ['namespace']


def test_rviz_finds_the_frame_of_the_markers_and_nobody_is_in_its_way():
    (frame,) = [
        node
        for node in calls('Node')
        if getattr(keywords(node)['package'], 'value', '') == 'tf2_ros'
    ]
    words = ast.literal_eval(keywords(frame)['arguments'])
    given = dict(zip(words[::2], words[1::2], strict=True))
    assert given['--frame-id'] == FRAME != given['--child-frame-id']


def test_a_number_is_given_as_one():
    (typed,) = calls('ParameterValue')
    kind = keywords(typed)['value_type']
    assert ast.unparse(kind) == "int if name == 'workers' else str"
    of_launch = {name for given in started().values() for name in given}
    numbers = {
        parameter.name
        for module in (drop_simulator, aspect_classifier, drop_recorder)
        for parameter in module.PARAMETERS
        if isinstance(parameter.default, int)
    }
    assert numbers & of_launch == {'workers'}


def test_the_files_are_there_and_installed():
    targets, _ = installed()
    paths = {
        '/'.join(each.value for each in call.args[0].elts if isinstance(each, ast.Constant))
        for call in calls('PathJoinSubstitution')
    }
    assert paths == {'config/resting_aspects.yaml', 'rviz/resting_aspects.rviz'}
    for path in {*paths, 'launch/resting_aspects.launch.py'}:
        assert (ROOT / path).is_file()
        folder = Path(path).parent
        assert targets[path] == f'share/resting_aspects_ros/{folder}'


# Not a skip, which is a failure in CI: with the ROS of PyPI it can never run.
if importlib.util.find_spec('launch_ros'):

    @pytest.fixture
    def launch_file(monkeypatch):
        monkeypatch.setattr(sys, 'dont_write_bytecode', True)
        spec = importlib.util.spec_from_file_location('launch_file', FILE)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def test_launch_takes_it(launch_file):
        from launch import LaunchContext

        description = launch_file.generate_launch_description()
        assert {each.name for each in description.get_launch_arguments()} == set(arguments())
        context = LaunchContext()
        context.launch_configurations.update(dict.fromkeys(arguments(), '1'))
        nodes = launch_file.suite(context)
        assert {node.node_executable for node in nodes} == set(DECLARED)
        assert {node.node_package for node in nodes} == {'resting_aspects_ros'}

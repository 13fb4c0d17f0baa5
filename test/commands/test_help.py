"""Help is instant and its examples are right."""

import re
import subprocess
import sys

import pytest

from resting_aspects_ros import __version__
from resting_aspects_ros.cli import make_parser
from resting_aspects_ros.commands import (
    aspects,
    classify,
    compare,
    demo,
    drop,
    merge,
    nodes,
    replay,
    request,
)
from resting_aspects_ros.core.clusters import (
    DEFAULT_TOLERANCE_DEGREES,
    MAX_TOLERANCE_DEGREES,
    MIN_TOLERANCE_DEGREES,
)
from resting_aspects_ros.drops.conditions import QUANTITIES
from resting_aspects_ros.nodes import (
    aspect_classifier,
    drop_recorder,
    drop_simulator,
    feeder_example,
    log_replayer,
)
from resting_aspects_ros.nodes.log_replayer import LEAST_RATE, MOST_RATE

COMMANDS = {
    'drop': drop,
    'aspects': aspects,
    'classify': classify,
    'compare': compare,
    'merge': merge,
    'request': request,
    'nodes': nodes,
    'replay': replay,
    'demo': demo,
}
HEAVY = (
    'numpy', 'scipy', 'trimesh', 'pybullet', 'rclpy', 'matplotlib', 'mcap', 'rich', 'distributed'
)  # fmt: skip


@pytest.fixture
def shown(run):
    def text(*words):
        ended = run(*words, '--help')
        assert ended.returncode == 0
        assert ended.stderr == ''
        assert max(map(len, ended.stdout.splitlines())) <= 80
        return ' '.join(ended.stdout.split())

    return text


def test_help_lists_commands_and_exit_codes(shown):
    text = shown()
    for word in (*COMMANDS, 'exit codes', '0 done', '1 something', '2 wrong', '130 interrupted'):
        assert word in text


@pytest.mark.parametrize('name', COMMANDS)
def test_each_command_has_examples_that_are_understood(shown, name):
    text = shown(name)
    lines = [
        line.partition('(')[0].partition('>')[0].split()
        for line in COMMANDS[name].EXAMPLES.splitlines()[1:]
    ]
    assert len(lines) >= 2
    assert name in {line[1] for line in lines}
    for line in lines:
        assert ' '.join(line) in text
        assert line[0] == 'resting_aspects'
        assert callable(make_parser().parse_args(line[1:]).run)


@pytest.mark.parametrize('words', [[], *([name] for name in COMMANDS)], ids=' '.join)
def test_help_loads_nothing_heavy(words):
    code = (
        'import sys\n'
        'from resting_aspects_ros.cli import main\n'
        'try:\n'
        f'    main({[*words, "--help"]!r})\n'
        'except SystemExit:\n'
        f'    print("loaded:", *(name for name in {HEAVY!r} if name in sys.modules))\n'
    )
    ended = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True
    )
    assert ended.stdout.splitlines()[-1] == 'loaded:'


@pytest.mark.parametrize('command', ['drop', 'request'])
def test_every_condition_has_one_flag_whose_help_tells_the_bounds(shown, command):
    text = shown(command).partition('examples:')[0]
    for name, quantity in QUANTITIES.items():
        flag = '--' + name.replace('_', '-')
        told = f'{quantity.text}: {quantity.allowed()}'
        assert told in text
        # Once in the synopsis, once with what it means.
        assert text.count(f'{flag} ') == 2
    assert '{LOWEST_POINT,CENTRE_OF_MASS}' in text


@pytest.mark.parametrize('command', ['drop', 'request'])
def test_the_surfaces_are_named(shown, command, surfaces):
    *names, last = surfaces.names()
    assert f'named conditions: {", ".join(names)} or {last} (' in shown(command)


@pytest.mark.parametrize(
    'node',
    [drop_simulator, aspect_classifier, drop_recorder, log_replayer, feeder_example],
    ids=lambda node: node.__name__.rpartition('.')[2],
)
def test_the_program_of_a_node_says_what_it_does_and_its_parameters(node):
    ended = subprocess.run(
        [sys.executable, '-m', node.__name__, '--help'],
        capture_output=True,
        text=True,
        check=True,
    )
    usage, _, does, *others = ended.stdout.splitlines()
    assert usage.startswith('usage: ')
    assert re.match('Publishes|Serves|Subscribes', does)
    assert '----' not in ended.stdout
    begin = others.index('parameters:') + 1
    listed = [line.split()[0] for line in others[begin : begin + len(node.PARAMETERS)]]
    # The example's are as ROS has them: name, default, description.
    assert listed == [p[0] if isinstance(p, tuple) else p.name for p in node.PARAMETERS]


def test_the_tolerance_of_classify_is_told_with_its_bounds(shown):
    told = f'({DEFAULT_TOLERANCE_DEGREES:g}): {MIN_TOLERANCE_DEGREES:g} to '
    assert f'{told}{MAX_TOLERANCE_DEGREES:g} degrees' in shown('classify')


def test_the_rate_of_replay_is_told_with_its_bounds(shown):
    assert f': {LEAST_RATE:g} to {MOST_RATE:g} (1)' in shown('replay')


def test_version(run):
    ended = run('--version')
    assert (ended.returncode, ended.stdout) == (0, f'resting_aspects {__version__}\n')


def test_the_script_is_the_same_command(environment):
    script = f'{sys.prefix}/bin/resting_aspects'
    ended = subprocess.run(
        [script, '--version'], capture_output=True, text=True, check=True, env=environment
    )
    assert ended.stdout == f'resting_aspects {__version__}\n'

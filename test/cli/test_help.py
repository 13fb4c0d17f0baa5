"""Help imports nothing heavy, and its examples are valid."""

import subprocess
import sys
from importlib import import_module

import pytest

from resting_aspects_ros import __version__
from resting_aspects_ros.cli import main, verbs

HEAVY = {'numpy', 'scipy', 'trimesh', 'pybullet', 'rclpy', 'matplotlib', 'mcap', 'distributed'}


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
    for word in (*verbs.COMMANDS.values(), '0 done', '2 wrong input', '130 interrupted'):
        assert word in text


@pytest.mark.parametrize('name', verbs.COMMANDS)
def test_examples_of_each_command_are_parsed(shown, name):
    text = shown(name)
    module = import_module(f'resting_aspects_ros.cli.verbs.{name}')
    lines = [
        line.partition('(')[0].partition('>')[0].split()
        for line in module.EXAMPLES.splitlines()[1:]
    ]
    assert len(lines) >= 2
    assert name in {line[1] for line in lines}
    for line in lines:
        assert ' '.join(line) in text
        assert line[0] == 'resting_aspects'
        assert callable(main.make_parser(line[1:]).parse_args(line[1:]).run)


def loaded_by(*words):
    """Return the heavy modules and the subcommand modules that a command loads."""
    code = f"""
import sys
from resting_aspects_ros.cli.main import main
try:
    main({list(words)!r})
finally:
    print("\\nloaded:", *sys.modules)
"""
    ended = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )
    modules = ended.stdout.splitlines()[-1].split()
    prefix = 'resting_aspects_ros.cli.verbs.'
    loaded = {name.removeprefix(prefix) for name in modules if name.startswith(prefix)}
    return HEAVY & set(modules), loaded & set(verbs.COMMANDS)


@pytest.mark.parametrize(('words', 'expected'), [([], set()), (['drop'], {'drop'})])
def test_only_the_requested_subcommand_is_loaded(words, expected):
    assert loaded_by(*words, '--help') == (set(), expected)


@pytest.mark.parametrize('name', ['drop_simulator', 'log_replayer', 'feeder_controller'])
def test_node_help_lists_the_parameters(name, monkeypatch, capsys):
    node = import_module(f'resting_aspects_ros.nodes.{name}.node')
    monkeypatch.setattr(sys, 'argv', ['node', '--help'])
    with pytest.raises(SystemExit) as ended:
        node.main()
    assert ended.value.code == 0
    listed = capsys.readouterr().out.partition('parameters:\n')[2].splitlines()
    assert [line.split()[0] for line in listed[: len(node.PARAMETERS)]] == [
        parameter.name for parameter in node.PARAMETERS
    ]


def test_the_script_is_the_same_command():
    words = [f'{sys.prefix}/bin/resting_aspects', '--version']
    ended = subprocess.run(words, capture_output=True, text=True, check=True)
    assert ended.stdout == f'resting_aspects {__version__}\n'

"""What the README shows is run, and what it lists is what there is."""

import ast
import json
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from resting_aspects_ros.core.part_loading import load_part
from resting_aspects_ros.simulation.part_library import read_part_yaml

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
FEW_DROPS = ['--drops', '50']


def blocks(language):
    return re.findall(rf'^```{language}\n(.*?)^```', README, re.MULTILINE | re.DOTALL)


def commands(language='bash'):
    return [line for block in blocks(language) for line in block.splitlines()]


def run_program(command, **options):
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=False, **options
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def words_of(line):
    """The words behind the command's name."""
    program, *arguments = shlex.split(line)
    assert program == '.venv/bin/resting_aspects'
    return arguments


def here(line):
    """The command as it is here: in the .venv that runs this test."""
    return [str(Path(sys.executable).parent / 'resting_aspects'), *words_of(line)]


@pytest.fixture(scope='session')
def printed(run_in):
    """Run the command in this process; returns what it printed."""

    def run(folder, *words):
        ended = run_in(folder, *words)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    return run


def test_every_command_is_known_to_the_tests_below():
    known = ['make demo', 'make test', '.venv/bin/resting_aspects ']
    assert all(line.startswith(tuple(known)) for line in commands())
    assert {line.split()[1] for line in commands()} == {
        'demo', 'test', 'drop', 'aspects', 'estimate', 'compare', 'nodes', 'request', 'info',
        'recover'
    }  # fmt: skip


DROPS = [line for line in commands() if ' drop ' in line and '--from-log' not in line]


@pytest.mark.parametrize('line', [line for line in DROPS if '--out' not in line])
def test_drop(line, printed):
    few = [] if '--precision' in line else FEW_DROPS
    table = printed(ROOT, *words_of(line), *few)
    assert few == [] or '50' in table


@pytest.fixture(scope='module')
def nut(printed, tmp_path_factory):
    """Give a folder in which the part that the README drops with --out was dropped."""
    folder = tmp_path_factory.mktemp('nut')
    (line,) = (line for line in DROPS if '--out' in line)
    mesh = str(ROOT / 'config' / 'parts' / 'hex_nut.stl')
    printed(folder, *(mesh if word.endswith('.stl') else word for word in words_of(line)))
    return folder


def test_drop_with_files(nut):
    files = {path.name for path in (nut / 'out' / 'nut').iterdir()}
    assert {'distribution.json', 'distribution.png', 'poses.csv', 'report.html'} <= files


def test_aspects(printed):
    (line,) = [line for line in commands() if ' aspects ' in line]
    assert 'Symmetry: 12 rotations' in printed(ROOT, *words_of(line))


def test_estimate(printed):
    (line,) = [line for line in commands() if ' estimate ' in line]
    assert 'probability by method' in printed(ROOT, *words_of(line))


def test_compare(printed, nut):
    (line,) = [line for line in commands() if ' compare ' in line]
    _, simulated, counted = words_of(line)
    document = json.loads((nut / simulated).read_text())
    rows = [f'{aspect["id"]},{aspect["count"]}' for aspect in document['aspects']]
    (nut / counted).write_text('\n'.join(['aspect,count', *rows]))
    assert re.search(r'total variation +0 %', printed(nut, *words_of(line)))


def test_nodes_request_and_the_python_client(printed, tmp_path):
    (nodes,) = [line for line in commands() if ' nodes' in line]
    (request,) = [line for line in commands() if ' request ' in line]
    (client,) = blocks('python')
    suite = subprocess.Popen(here(nodes), cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    try:
        table = run_program([*here(request), *FEW_DROPS], cwd=tmp_path)
        assert 'drops in total' in table
        few = client.replace('drops=1000', 'drops=50')
        rows = ast.literal_eval(run_program([sys.executable, '-c', few], cwd=tmp_path))
        assert [row[0] for row in rows] == [1, 2, 3, 4, 5]
        assert all(0 <= lower <= p <= upper <= 1 for _, p, lower, upper in rows)
        assert sum(row[1] for row in rows) == pytest.approx(1, abs=0.05)
    finally:
        suite.send_signal(signal.SIGINT)
        _, complaints = suite.communicate(timeout=60)
    assert suite.returncode == 0, complaints
    (log,) = (tmp_path / 'out' / 'logs').glob('l_bracket_*')

    def of_log(line):
        return [*words_of(line)[:-1], os.fspath(log)]

    (info,) = [line for line in commands() if ' info ' in line]
    assert 'closed, ' in printed(tmp_path, *of_log(info))
    (recover,) = [line for line in commands() if ' recover ' in line]
    assert printed(tmp_path, *of_log(recover)).startswith(f'{log}: is closed already, ')
    (again,) = [line for line in commands() if '--from-log' in line]
    assert 'drops in total' in printed(tmp_path, *of_log(again))


def test_make_demo_and_make_test_are_targets_and_ci_runs_the_tests():
    assert {'make demo', 'make test'} <= set(commands())
    for target in ('demo', 'test'):
        run_program(['make', '--dry-run', target], cwd=ROOT)
    assert 'make test' in (ROOT / '.ci' / 'run').read_text().splitlines()


def test_the_colcon_build_is_the_one_that_is_tested():
    (block,) = blocks('sh')
    (build,) = [line for line in block.splitlines() if line.startswith('colcon')]
    assert f'python -m {build}' in (ROOT / 'test' / 'test_colcon.py').read_text()


def test_the_part_file_can_be_used(tmp_path):
    (text,) = blocks('yaml')
    path = tmp_path / 'my_part.yaml'
    path.write_text(text)
    values = read_part_yaml(path)
    assert set(values) == set(yaml.safe_load(text))
    assert load_part(ROOT / 'config' / 'parts' / 'l_bracket.stl', **values).unit == 'mm'


def test_the_interface_that_is_listed_is_in_docs_ros_too():
    listed = re.findall(r'^\| `([\w/<>]+)` \| (?:service|topic|action) \S+', README, re.MULTILINE)
    assert len(listed) == 5
    rows = (ROOT / 'docs' / 'ros.md').read_text(encoding='utf-8')
    assert all(f'\n| `{name}` | ' in rows for name in listed)


@pytest.mark.parametrize('name', ['README.md', 'docs/ros.md', 'docs/explanation/design.md'])
def test_files_that_are_linked_are_there(name):
    path = ROOT / name
    links = re.findall(r'\]\(([^)#]+)#?[^)]*\)', path.read_text(encoding='utf-8'))
    assert links
    assert [link for link in links if not (path.parent / link).exists()] == []

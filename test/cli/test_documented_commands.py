"""The commands in README.md and the pages of docs are run."""

import ast
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from doc_pages import PAGES, ROOT, code, code_blocks

from resting_aspects_ros.cli import main
from resting_aspects_ros.part.library import read_part_yaml
from resting_aspects_ros.part.loading import load_part

PARTS = ROOT / 'config' / 'parts'
FEW_DROPS = ['--drops', '50']
# What makes the commands quick whose output is not compared.
FEW = {
    'calibrate': ['--points', '8', '--drops', '10'],
    'drift': FEW_DROPS,
    'optimise': ['--budget', '3840'],
    'forecast': [
        *('--action', 'tap', '--per-aspect', '10', '--minutes', '0.5', '--tray', '100x100mm'),
        *FEW_DROPS,
    ],
    'drop': FEW_DROPS,
    'study': ['--points', '2', '--drops', '20'],
    'reorient': ['--per-aspect', '10', *FEW_DROPS],
    'retention': ['--per-height', '10'],
}
OTHER_NUMBERS = {'--precision', '--from-log', '--initial-states', '--expected'}
# They do not print how many drops and actions they made.
WITHOUT_NUMBERS = {'calibrate', 'forecast', 'optimise', 'study'}
PROGRAM = '.venv/bin/resting_aspects'
LOG = 'out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50'
# With a file that each of them makes.
TUTORIALS = {
    'docs/tutorials/first_part.md': 'out/bracket/report.html',
    'docs/tutorials/reorientation.md': 'out/actions/transitions_tap.png',
    'docs/tutorials/from_part_to_bowl.md': 'out/bowl/track.html',
}
REORIENT = 'docs/how_to/reorient_parts.md'
# They run nodes. Other tests cover them.
NODE_VERBS = {'nodes', 'request', 'replay', 'feeder_demo'}
SLOW = pytest.mark.slow


def lines_of(page):
    return [line for text in code(page, 'bash') for line in text.splitlines()]


def arguments_of(line):
    """Return the arguments of a line that runs the command; None for another program."""
    program, *arguments = shlex.split(line)
    return arguments if program == PROGRAM else None


COMMANDS = {
    (page, line): arguments
    for page in PAGES
    for line in lines_of(page)
    if (arguments := arguments_of(line))
}


def with_new_flags():
    """Yield the commands that are run: each verb and each flag is in one of them."""
    known = set()
    for place, arguments in sorted(COMMANDS.items(), key=lambda each: -len(each[1])):
        words = {arguments[0], *(word for word in arguments if word.startswith('--'))}
        if arguments[0] not in NODE_VERBS and place[0] not in TUTORIALS and words - known:
            known |= words
            yield place


RUN_HERE = [
    pytest.param(
        COMMANDS[page, line],
        id=f'{Path(page).stem}: {line.removeprefix(PROGRAM).strip()}',
        marks=[] if page == 'README.md' and COMMANDS[page, line][0] != 'outlines' else SLOW,
    )
    for page, line in with_new_flags()
]


@pytest.fixture(scope='session')
def printed(run_in):
    """Run the command in this process; returns what it printed."""

    def run(folder, *words):
        ended = run_in(folder, *words)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    return run


@pytest.fixture(scope='module')
def folder(printed, tmp_path_factory):
    """Return a folder with the files that the pages use: meshes, results, counts and a log."""
    folder = tmp_path_factory.mktemp('pages')
    (folder / 'config').symlink_to(ROOT / 'config')
    (folder / 'FOLDER').mkdir()
    for name in ('bracket.stl', 'my_part.stl', 'FOLDER/my_part.stl'):
        shutil.copy(PARTS / 'l_bracket.stl', folder / name)
    printed(folder, 'drop', 'hex_nut', *FEW_DROPS, '--out', 'out/nut')
    document = json.loads((folder / 'out/nut/distribution.json').read_text())
    rows = [f'{aspect["id"]},{aspect["count"]}' for aspect in document['aspects']]
    (folder / 'manual.csv').write_text('\n'.join(['aspect,count', *rows]))
    printed(folder, 'drop', 'l_bracket', *FEW_DROPS, '--log', 'out/logs')
    (actions,), (tosses,) = code(REORIENT, 'yaml'), code(REORIENT, 'csv')
    (folder / 'my_actions.yaml').write_text(actions)
    (folder / 'counted.csv').write_text(code('docs/how_to/watch_for_drift.md', 'csv')[0])
    (folder / 'tosses.csv').write_text(tosses)
    printed(folder, 'drop', 'l_bracket', '--initial-states', 'tosses.csv', '--out', 'out/tosses')
    printed(folder, 'reorient', 'l_bracket', *FEW['reorient'], '--out', 'out/tap')
    printed(folder, *arguments_of(lines_of('docs/how_to/study.md')[0]), *FEW['study'])
    for text in code(REORIENT, 'python'):
        run_program([sys.executable, '-c', text], cwd=folder)
    return folder


def with_files(folder, arguments):
    """Return the arguments with the name of the existing log and with expanded patterns."""
    log = min(folder.glob('out/logs/l_bracket_*'))
    for word in arguments:
        if word == LOG:
            yield str(log)
        elif '*' in word:
            yield from sorted(map(str, folder.glob(word)))
        else:
            yield word


@pytest.mark.parametrize(('page', 'line'), COMMANDS)
def test_documented_commands_are_parsed(page, line):
    arguments = COMMANDS[page, line]
    assert callable(main.make_parser(arguments).parse_args(arguments).run)


@pytest.mark.slow
@pytest.mark.parametrize('arguments', RUN_HERE)
def test_command(arguments, printed, folder):
    few = [] if OTHER_NUMBERS & {*arguments} else FEW.get(arguments[0], [])
    table = printed(folder, *with_files(folder, arguments), *few)
    assert arguments[0] in WITHOUT_NUMBERS or few == [] or few[1] in table


def assert_shown(shown, printed):
    """Check that lines were printed as a page shows them; `...` stands for any lines."""
    rows = [line.rstrip() for line in printed.strip().splitlines()]
    pieces = [piece.strip('\n') for piece in re.split(r'^\.\.\.$', shown, flags=re.MULTILINE)]
    pattern = '(?s:.*)'.join(re.escape(piece) for piece in pieces)
    assert re.fullmatch(rf'\n*{pattern}\n*', '\n'.join(rows)), '\n'.join(rows)


def test_the_table_of_the_readme_is_what_is_printed(folder, printed):
    (shown,) = code('README.md', 'text')
    assert_shown(f'{shown}...\n', printed(folder, 'drop', 'l_bracket'))


@pytest.mark.slow
@pytest.mark.parametrize('page', TUTORIALS)
def test_the_tutorial_prints_what_it_shows(page, printed, tmp_path):
    shutil.copy(PARTS / 'l_bracket.stl', tmp_path / 'bracket.stl')
    out = ''
    for language, text in code_blocks(page, 'bash', 'text', 'csv'):
        if language == 'csv':
            (tmp_path / 'counted.csv').write_text(text)
        elif language == 'text':
            assert_shown(text, out)
        else:
            for line in text.splitlines():
                arguments = arguments_of(line)
                out = printed(tmp_path, *arguments) if arguments else out
    assert (tmp_path / TUTORIALS[page]).is_file()


def test_the_part_file_can_be_used(tmp_path):
    (text,) = code('docs/how_to/add_a_part.md', 'yaml')
    path = tmp_path / 'my_part.yaml'
    path.write_text(text)
    values = read_part_yaml(path, path.with_suffix('.stl'))
    assert set(values) == set(yaml.safe_load(text))
    assert load_part(PARTS / 'l_bracket.stl', **values).unit == 'mm'

"""The commands in README.md and the pages of docs are run."""

import json
import re
import shlex
import shutil

import pytest
from doc_pages import PAGES, ROOT, code, code_blocks

from resting_aspects_ros.cli import main
from resting_aspects_ros.part.library import read_part_yaml
from resting_aspects_ros.part.loading import load_part

PARTS = ROOT / 'config' / 'parts'
FEW_DROPS = ['--drops', '50']
# What makes the commands quick whose output is not compared.
FEW = {
    'optimise': ['--budget', '3840'],
    'forecast': [
        *('--action', 'tap', '--per-aspect', '10', '--minutes', '0.5', '--tray', '100x100mm'),
        *FEW_DROPS,
    ],
    'study': ['--points', '2', '--drops', '20'],
    'reorient': ['--per-aspect', '10', *FEW_DROPS],
    'retention': ['--per-height', '10'],
    'track': FEW_DROPS,
}
PROGRAM = '.venv/bin/resting_aspects'
LOG = 'out/logs/l_bracket_20250131T120000Z_4f1c2d3e4f50'
TUTORIALS = [
    f'docs/tutorials/{name}.md' for name in ('first_part', 'reorientation', 'from_part_to_bowl')
]
REORIENT = 'docs/how_to/reorient_parts.md'
# They run nodes, or take long. Other tests cover them.
ELSEWHERE = {'nodes', 'request', 'replay', 'feeder_demo', 'calibrate'}


def arguments_of(line):
    """Return the arguments of a line that runs the command; None for another program."""
    program, *arguments = shlex.split(line)
    return arguments if program == PROGRAM else None


COMMANDS = {
    (page, line): arguments
    for page in PAGES
    for text in code(page, 'bash')
    for line in text.splitlines()
    if (arguments := arguments_of(line))
}
# The longest documented command of each verb.
LONGEST = {
    arguments[0]: arguments
    for (page, line), arguments in sorted(COMMANDS.items(), key=lambda each: len(each[0][1]))
    if arguments[0] not in ELSEWHERE and page not in TUTORIALS
}


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
    """Return a folder with the files that the pages use: a mesh, results, counts and a log."""
    folder = tmp_path_factory.mktemp('pages')
    (folder / 'config').symlink_to(ROOT / 'config')
    shutil.copy(PARTS / 'l_bracket.stl', folder / 'bracket.stl')
    printed(folder, 'drop', 'hex_nut', *FEW_DROPS, '--out', 'out/nut')
    document = json.loads((folder / 'out/nut/distribution.json').read_text())
    rows = [f'{aspect["id"]},{aspect["count"]}' for aspect in document['aspects']]
    (folder / 'manual.csv').write_text('\n'.join(['aspect,count', *rows]))
    printed(folder, 'drop', 'l_bracket', *FEW_DROPS, '--log', 'out/logs')
    (log,) = (folder / 'out/logs').iterdir()
    log.rename(folder / LOG)
    (actions,), (tosses,) = code(REORIENT, 'yaml'), code(REORIENT, 'csv')
    (folder / 'my_actions.yaml').write_text(actions)
    (folder / 'counted.csv').write_text(code('docs/how_to/watch_for_drift.md', 'csv')[0])
    (folder / 'tosses.csv').write_text(tosses)
    return folder


@pytest.mark.parametrize(('page', 'line'), COMMANDS)
def test_documented_commands_are_parsed(page, line):
    arguments = COMMANDS[page, line]
    assert callable(main.make_parser(arguments).parse_args(arguments).run)


@pytest.mark.slow
@pytest.mark.parametrize('verb', LONGEST)
def test_the_longest_command_of_each_verb_runs(verb, printed, folder):
    arguments = [LOG if '*' in word else word for word in LONGEST[verb]]
    printed(folder, *arguments, *FEW.get(verb, []))


def assert_shown(shown, printed):
    """Check that lines were printed as a page shows them; `...` stands for any lines."""
    rows = [line.rstrip() for line in printed.strip().splitlines()]
    pieces = [piece.strip('\n') for piece in re.split(r'^\.\.\.$', shown, flags=re.MULTILINE)]
    pattern = '(?s:.*)'.join(re.escape(piece) for piece in pieces)
    assert re.fullmatch(rf'\n*{pattern}\n*', '\n'.join(rows)), '\n'.join(rows)


def test_the_table_of_the_readme_is_what_is_printed(printed, tmp_path):
    (shown,) = code('README.md', 'text')
    assert_shown(f'{shown}...\n', printed(tmp_path, 'drop', 'l_bracket'))


@pytest.mark.slow
@pytest.mark.parametrize('page', TUTORIALS)
def test_the_tutorial_prints_what_it_shows(page, printed, tmp_path):
    """What follows the last output that is shown is only parsed, above."""
    shutil.copy(PARTS / 'l_bracket.stl', tmp_path / 'bracket.stl')
    commands, out = [], []
    for language, text in code_blocks(page, 'bash', 'text'):
        if language == 'bash':
            commands += filter(None, map(arguments_of, text.splitlines()))
        else:
            out = [printed(tmp_path, *arguments) for arguments in commands] or out
            assert_shown(text, out[-1])
            commands = []


def test_the_part_file_can_be_used(tmp_path):
    path = tmp_path / 'my_part.yaml'
    path.write_text(code('docs/how_to/add_a_part.md', 'yaml')[0])
    values = read_part_yaml(path, path.with_suffix('.stl'))
    assert load_part(PARTS / 'l_bracket.stl', **values).unit == 'mm'

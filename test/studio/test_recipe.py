"""The command line and the Python that the page shows give the numbers of the page."""

import contextlib
import io
import json
import shlex
from pathlib import Path

import pytest

from resting_aspects_ros.cli import main
from resting_aspects_ros.studio.export import FILES, drop_recipe, recipes
from resting_aspects_ros.studio.rows import Source

OTHERS = [
    ('Reorientation', {'condition.height': '90', 'action.speed': '0.4'}),
    ('Forecast', {'cell.parts_on_tray': '7', 'cell.width': '150', 'cell.robot': '2.5'}),
    (
        'Track',
        {'rail.want': '3', 'rail.width': '60', 'rail.roll': '8', 'rail.wall_friction': '0.3'}
        | {'trap.add': 'wiper', 'trap.1.height': '24.5'},
    ),
]


def documents(recipe):
    """Return the JSON that the command and the Python of a recipe print."""
    words = [*shlex.split(recipe.line)[1:], '--json']
    found = []
    for task in (lambda: main.main(words), lambda: exec(recipe.python, {})):
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            task()
        found.append(json.loads(output.getvalue()))
    return found


@pytest.mark.slow
def test_drops_of_command_and_python_are_those_of_the_page(bracket):
    changes = {'surface': 'steel', 'condition.friction': '0.31', 'precision': '0.02'}
    changes |= {'surroundings': 'slope', 'dimension.angle': '12', 'condition.height': '77'}
    for name, value in changes.items():
        bracket.change(name, value)
    work = bracket.work()
    recipe = recipes(work.opened, work.settings)['Aspects']
    counts = work.drops().distribution.counts.tolist()
    for document in documents(recipe):
        assert [aspect['count'] for aspect in document['aspects']] == counts


@pytest.mark.slow
@pytest.mark.parametrize(('verb', 'changes'), OTHERS)
def test_other_recipes_agree(bracket, verb, changes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bracket.change('drops', 100)
    bracket.change('pickable.1', True)
    for name, value in changes.items():
        bracket.change(name, value)
    work = bracket.work()
    (tmp_path / 'surfaces.yaml').write_bytes(FILES['surfaces.yaml'].make(work))
    one, other = documents(recipes(work.opened, work.settings)[verb])
    for document in (one, other):
        for name in ('run_id', 'started', 'conditions'):
            document.pop(name, None)
    assert one == other


def test_file_name_is_quoted(bracket):
    work = bracket.work()
    for name in ('my part.stl', "a'; rm -rf ~ #.stl", '$(reboot).stl', '--help.stl'):
        recipe = drop_recipe(Source(name, Path('x')), work.settings)
        words = shlex.split(recipe.line)
        assert words[:2] == ['resting_aspects', 'drop']
        assert words[2] == (name if name[0] != '-' else f'./{name}')
        compile(recipe.python, 'recipe', 'exec')
        assert repr(name) in recipe.python


@pytest.mark.slow
def test_each_file_can_be_made(room, shown):
    room.change('drops', 400)
    room.open(Source('tetrahedron'))
    shown.wait('bars', lambda message: message.get('caption'))
    room.change('count.1', '3')
    starts = {'pdf': b'%PDF', 'zip': b'PK', 'xlsx': b'PK', 'png': b'\x89PNG', 'html': b'<!DOCTYPE'}
    for name, file in FILES.items():
        data = file.make(room.work())
        assert data.startswith(starts.get(name.rpartition('.')[2], data[:1])), name
        assert len(data) > 20, name
    assert not any(room.folder.iterdir())  # the files were sent

"""The reference pages of commands and files agree with the code."""

import dataclasses
import json
import re
import runpy

import pytest
from doc_pages import ROOT, code, first_cells, section

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.api.plan import COLUMNS
from resting_aspects_ros.api.result import POSES_HEADER
from resting_aspects_ros.cli import life_cycle
from resting_aspects_ros.part.library import EXPECTED
from resting_aspects_ros.simulation.actions import KINDS
from resting_aspects_ros.simulation.conditions import quantities_of
from resting_aspects_ros.simulation.surroundings import (
    BODY_VALUES,
    RELEASE_VALUES,
    surroundings_names,
)
from resting_aspects_ros.simulation.surroundings_kinds import KINDS as SURROUNDINGS
from resting_aspects_ros.tracks.description import Track, Wall
from resting_aspects_ros.tracks.traps import KINDS as TRAPS
from resting_aspects_ros.tracks.traps import Surface

COMMANDS = 'docs/reference/commands.md'
FILES = 'docs/reference/files.md'


def keys(page, heading, part=0):
    """The names in the first column of a table below a heading: of its tables the one asked."""
    tables = [text for text in section(page, heading).split('\n\n') if text.startswith('|')]
    cells = first_cells(tables[part])
    return [name for cell in cells for name in re.findall(r'`([^`]+)`', cell)]


def test_generated_texts_are_current():
    contents = runpy.run_path(str(ROOT / 'tools' / 'setup' / 'reference.py'))['contents']()
    stale = [path for path, text in contents.items() if path.read_text(encoding='utf-8') != text]
    assert stale == [], 'make reference'


def test_every_name_is_listed(surfaces):
    def listed(page, heading):
        return [cell.strip('`') for cell in first_cells(section(f'docs/{page}.md', heading))]

    shipped = listed('how_to/choose_conditions', '## Use a shipped surface')
    assert sorted(shipped) == sorted(surfaces.names())
    shipped = listed('how_to/reorient_parts', '## Use a shipped action')
    assert shipped == list(shipped_actions().names())
    shipped = listed('how_to/surroundings', '## Use shipped surroundings')
    assert shipped == list(surroundings_names())
    codes = listed('reference/commands', '## Exit codes and output')
    named = life_cycle.DONE, life_cycle.FAILED, life_cycle.WRONG_INPUT, life_cycle.INTERRUPTED
    assert [int(code) for code in codes] == sorted(named)
    for heading, known in (('## Actions', KINDS), ('## Surroundings', SURROUNDINGS)):
        (kinds,) = re.findall(r'^\| `kind` \| (.*?) \|', section(FILES, heading), re.MULTILINE)
        assert kinds.split(', ') == list(known)
    assert keys(FILES, '## Part description') == list(EXPECTED)
    assert sorted(keys(FILES, '## Initial states')) == sorted(COLUMNS)
    assert keys(FILES, '## Poses') == list(POSES_HEADER)
    assert keys(FILES, '## Surroundings', 1) == list(BODY_VALUES)
    assert keys(FILES, '## Surroundings', 2) == list(RELEASE_VALUES)


@pytest.mark.parametrize('kind', SURROUNDINGS)
def test_every_dimension_of_surroundings_is_listed(kind):
    _, found, text = section(FILES, '## Surroundings').partition(f'\n`{kind}`: ')
    assert found
    line, _, text = text.partition('\n\n')
    bodies = line.partition(' Its bodies: ')[2]
    assert tuple(re.findall(r'`(\w+)`', bodies)) == SURROUNDINGS[kind].body_names
    table = text.partition('\n\n')[0] if text.startswith('|') else ''
    rows = re.findall(r'^\| `(\w+)` \| (.*?) \| (.*?) \|', table, re.MULTILINE)
    declared = {each.name: each for each in dataclasses.fields(SURROUNDINGS[kind]) if each.repr}
    assert {name for name, *_ in rows} == set(declared)
    for name, allowed, default in rows:
        if (quantity := quantities_of(SURROUNDINGS[kind]).get(name)) is not None:
            assert allowed == quantity.allowed()
            value = declared[name].default
            assert default == ('required' if value is dataclasses.MISSING else f'{value:.6g}')


def test_every_key_of_a_track_is_listed_with_its_bounds():
    text = section(FILES, '## Track')
    declared = [Surface, Track, Wall]
    expected = [(n, q.allowed()) for each in declared for n, q in quantities_of(each).items()]
    rows = re.findall(r'^\| `(\w+)` \| ([^|]*?) \| [^|]*? \| [^|]*? \|$', text, re.MULTILINE)
    assert [row for row in rows if row[0] not in ('wall', 'traps', 'source')] == expected
    traps = re.findall(r'^\| `(\w+)` \| `(\w+)` \| ([^|]*?) \|', text, re.MULTILINE)
    assert traps == [
        (kind, n, q.allowed()) for kind in TRAPS for n, q in quantities_of(TRAPS[kind]).items()
    ]


def test_every_key_of_a_result_is_listed(run):
    few = ['--drops', '20', '--json', '--check-convergence']
    ended = run('drop', 'tetrahedron', *few, '--surroundings', 'wall')
    document = json.loads(ended.stdout)
    assert keys(FILES, '## Result', 2) == list(document['contacts'][0])
    assert set(keys(FILES, '## Result')) == {*document, 'convex_pieces'}
    (row,) = re.findall(r'^\| `schema_version` \|.*$', section(FILES, '## Result'), re.MULTILINE)
    assert row.endswith(f': {document["schema_version"]} |')
    assert keys(FILES, '## Result', 1) == list(document['aspects'][0])
    (row,) = re.findall(r'^\| `classes` \|.*$', section(FILES, '## Result'), re.MULTILINE)
    assert re.findall(r'`(\w+)`', row)[1:] == list(document['classes'][0])


@pytest.mark.slow
def test_every_key_of_transitions_is_listed(run):
    few = ['--action', 'step_down', '--per-aspect', '5', '--drops', '10', '--check-convergence']
    ended = run('reorient', 'tetrahedron', '--wanted', '1', *few, '--json')
    assert set(keys(FILES, '## Transitions')) == {*json.loads(ended.stdout), 'sliding'}


def test_every_key_of_retention_is_listed(run):
    ended = run('retention', 'tetrahedron', '--per-height', '2', '--json')
    document = json.loads(ended.stdout)
    assert set(keys(FILES, '## Retention')) == set(document)
    assert keys(FILES, '## Retention', 1) == list(document['curves'][0])


def test_manual_counts_can_be_read(tmp_path):
    path = tmp_path / 'counts.csv'
    path.write_text(code(FILES, 'csv')[0])
    counts = read_counts(path)
    assert (counts.ids, counts.drops) == ((1, 2, 3, 4, 5), 1000)


@pytest.mark.slow
def test_every_key_of_the_result_of_a_track_is_listed(run):
    words = ('--trap', 'wiper:height=12mm', '--drops', '20', '--json')
    document = json.loads(run('track', 'hex_nut', *words).stdout)
    page = section(FILES, '## Track result')
    listed = {name for cell in first_cells(page) for name in re.findall(r'`(\w+)`', cell)}
    of_a_run = set(keys(FILES, '## Result'))
    assert set(document) - of_a_run <= listed
    assert set(document['orientations'][0]) <= listed
    assert set(document['traps'][0]['results'][0]) <= listed

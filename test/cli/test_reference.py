"""The reference pages of commands and files agree with the code."""

import json
import re
import runpy

import pytest
from doc_pages import ROOT, code, first_cells, section

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.api.plan import COLUMNS
from resting_aspects_ros.api.result import POSES_HEADER
from resting_aspects_ros.part.library import EXPECTED
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
    assert keys(FILES, '## Part description') == list(EXPECTED)
    assert sorted(keys(FILES, '## Initial states')) == sorted(COLUMNS)
    assert keys(FILES, '## Poses') == list(POSES_HEADER)
    assert keys(FILES, '## Surroundings', 1) == list(BODY_VALUES)
    assert keys(FILES, '## Surroundings', 2) == list(RELEASE_VALUES)


def test_every_dimension_is_listed_with_its_bounds():
    text = section(FILES, '## Surroundings') + section(FILES, '## Track')
    for kind, declared in SURROUNDINGS.items():
        of_kind = text.partition(f'\n`{kind}`: ')[2]
        bodies = of_kind.partition(' Its bodies: ')[2].partition('\n')[0]
        assert tuple(re.findall(r'`(\w+)`', bodies)) == declared.body_names
        for name, quantity in quantities_of(declared).items():
            assert f'| `{name}` | {quantity.allowed()} | ' in of_kind.partition('\n`')[0]
    for kind, declared in TRAPS.items():
        for name, quantity in quantities_of(declared).items():
            assert f'| `{kind}` | `{name}` | {quantity.allowed()} | ' in text
    for declared in (Surface, Track, Wall):
        for name, quantity in quantities_of(declared).items():
            assert f'\n| `{name}` | {quantity.allowed()} | ' in text


FEW = '--drops 20 --json'
# A command for each kind of document, and the lists in it whose items have keys.
DOCUMENTS = {
    'Result': (
        f'drop tetrahedron {FEW} --check-convergence --surroundings wall',
        ['aspects', 'classes', 'contacts'],
    ),
    'Transitions': (
        f'reorient tetrahedron --wanted 1 --per-aspect 5 {FEW} --check-convergence',
        [],
    ),
    'Retention': ('retention tetrahedron --per-height 2 --json', ['curves']),
    'Track result': (f'track hex_nut --trap wiper:height=12mm {FEW}', ['orientations']),
}


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('heading', DOCUMENTS)
def test_every_key_of_a_document_is_listed(run, heading):
    words, lists = DOCUMENTS[heading]
    document = json.loads(run(*words.split()).stdout)
    page = section(FILES, f'## {heading}')
    if heading == 'Track result':
        page += section(FILES, '## Result')  # of its drops
    keys = set(document).union(*(document[name][0] for name in lists))
    assert keys <= set(re.findall(r'`(\w+)`', page))
    if heading == 'Result':
        (row,) = re.findall(r'^\| `schema_version` \|.*$', page, re.MULTILINE)
        assert row.endswith(f': {document["schema_version"]} |')


def test_manual_counts_can_be_read(tmp_path):
    path = tmp_path / 'counts.csv'
    path.write_text(code(FILES, 'csv')[0])
    counts = read_counts(path)
    assert (counts.ids, counts.drops) == ((1, 2, 3, 4, 5), 1000)

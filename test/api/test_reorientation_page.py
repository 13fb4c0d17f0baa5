"""A page on transitions and retention has their numbers; read back from the file."""

import dataclasses
import html.parser
import re
import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from PIL import Image

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.reorient_result import PlanResult, ReorientResult
from resting_aspects_ros.api.reorientation_files import (
    PAGE,
    RETENTION_PAGE,
    reorientation_file_names,
    reorientation_page,
    retention_page,
)
from resting_aspects_ros.api.retention import RetentionResult
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.transitions import matrix_fields, retention_fields
from resting_aspects_ros.simulation.actions import Kick, NamedAction
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.markov import Plan
from resting_aspects_ros.statistics.transitions import RetentionCurve, TransitionMatrix

VOID = {'meta', 'link', 'br', 'img', 'path', 'use', 'rect', 'image'}


class Reader(html.parser.HTMLParser):
    """Elements of a page with their text, and its tables; fails where they are not well nested."""

    def __init__(self, text):
        super().__init__()
        self.open, self.found, self.tables = [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        element = {'tag': tag, 'text': '', **dict(attrs)}
        self.found.append(element)
        if tag == 'table':
            self.tables.append([])
        if tag == 'tr':
            self.tables[-1].append([])
        if tag in ('td', 'th'):
            self.tables[-1][-1].append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop()['tag'] == tag

    def handle_data(self, data):
        for element in self.open:
            element['text'] += f' {data}' if element['tag'] in ('td', 'th') else data

    def all(self, tag):
        return [each for each in self.found if each['tag'] == tag]

    def words(self, tag):
        return [' '.join(each['text'].split()) for each in self.all(tag)]

    def rows(self, *first):
        """The rows below the headings of each table whose first headings are these."""
        texts = [[[' '.join(c['text'].split()) for c in row] for row in t] for t in self.tables]
        return [t[1:] for t in texts if t[0][: len(first)] == list(first)]


SHA256 = 64 * 'a'
RUN = RunDescription(
    '0' * 16, 'box', SHA256, shipped_surfaces().get(''), 1, 0, 400, 0.0, 'kernel', '1',
    '0', 1e-4, 0,
)  # fmt: skip
LIFT = np.array([0.001, 0.002, 0.005, 0.02])


def result_of(matrix, part, name, drops, **more):
    action = NamedAction(name, Kick(speed=0.3), source='Assumed <script>.')
    drop = Distribution(matrix.aspects, np.array(drops), 0, 0, 0)
    return ReorientResult(matrix, action, RUN, part, drop, complete=True, **more)


@pytest.fixture(scope='module')
def results(part):
    """Two actions on a box, the second without long-run shares."""
    aspects = find_aspects(part('box_10x20x30'))
    generator = np.random.default_rng(7)
    counts = generator.multinomial(400, generator.dirichlet(np.full(10, 0.5), 6))
    counts[:, 6:9] = 0
    matrix = TransitionMatrix(aspects, counts)
    few = np.zeros_like(counts)
    few[0, 0] = 5
    box = dataclasses.replace(part('box_10x20x30'), warnings=('the mesh is <odd>',))
    drops = [40, 40, 8, 7, 3, 2]
    return [
        result_of(matrix, box, 'tap', drops),
        result_of(TransitionMatrix(aspects, few), box, 'toss', drops),
    ]


@pytest.fixture(scope='module')
def folder(results, tmp_path_factory):
    folder = tmp_path_factory.mktemp('page')
    plan = Plan(np.array([-1, -1, 0, 1, 0, -1]), np.array([0, 0, 1.25, 2.5, 8, np.inf]))
    page = reorientation_page(
        results,
        wanted=(2, 1),
        plan=PlanResult(('tap', 'toss'), (1, 2), plan),
    )
    for name, data in page.files():
        (folder / name).write_bytes(data)
    return folder


@pytest.fixture(scope='module')
def text(folder):
    return (folder / PAGE).read_text(encoding='utf-8')


@pytest.fixture(scope='module')
def page(text):
    return Reader(text)


def retention_of(part, aspects, left=(0, 3, 50, 90)):
    curves = tuple(
        RetentionCurve(a.id, a.min_barrier, LIFT, np.array(left), np.full(4, 100), 0.95)
        for a in aspects.aspects
    )
    return RetentionResult(curves, aspects, RUN, part, complete=True)


def numbers(cell):
    """The numbers in a cell, each with half a unit of its last digit."""
    found = re.findall(r'\d+(?:\.\d+)?', cell)
    return [(float(n), 0.5001 / 10 ** len(n.partition('.')[2])) for n in found]


def assert_shown(cell, *values):
    shown = numbers(cell)
    assert len(shown) == len(values), cell
    for (number, half), value in zip(shown, values, strict=True):
        assert number == pytest.approx(value, abs=half), cell


def test_page_needs_no_network(page, text):
    for element in page.found:
        for name in ('src', 'href', 'xlink:href', 'action', 'data'):
            if value := element.get(name):
                assert value.startswith(('data:', '#')), value
    assert not re.findall(r'url\((?!#)', text)
    assert '@import' not in text
    assert not page.all('script')
    assert len(text) < 1_500_000


def test_links_lead_to_elements_of_the_page(page):
    ids = [each['id'] for each in page.found if each.get('id')]
    assert len(ids) == len(set(ids))
    links = [each['href'] for each in page.all('a')]
    assert links == ['#action-1', '#action-2', '#plan', '#conditions']
    labels = [each['aria-labelledby'] for each in page.all('section')]
    for target in [*(link[1:] for link in links), *labels]:
        assert target in ids


def test_figures_are_written_as_png_and_svg(folder):
    names = {file.name for file in folder.iterdir()}
    assert names == set(reorientation_file_names(['tap', 'toss']))
    for path in folder.glob('*.png'):
        with Image.open(path) as image:
            assert image.width >= 700
    for path in folder.glob('*.svg'):
        words = ''.join(ET.parse(path).getroot().itertext())
        assert 'box, t' in words


def test_figures_in_the_page_have_selectable_text(page, text):
    svgs = [each for each in page.all('svg') if each.get('role') == 'img']
    assert len(svgs) == 2
    # The explanation is text of the page, in which lines fit the screen.
    assert not any(each.startswith('Probability in %') for each in page.words('text'))
    captions = page.words('figcaption')
    assert sum('Probability in % that one action' in each for each in captions) == 2
    # The colours are those of the page, which is dark or light.
    assert '#222226' not in text[text.index('<main>') :]


@pytest.mark.parametrize('by_class', [True, False])
def test_matrix_cells_match_the_document(page, results, by_class):
    document = matrix_fields(results[0].matrix)
    fields = document['classes'] if by_class else document
    first = 'to 1 and 2 (%)' if by_class else 'to 1 (%)'
    rows, none = page.rows('from', first)
    assert len(rows) == len(none) == len(fields['counts'])
    k = len(rows)
    columns = [*range(k), k + 3]  # no drop is unclassified, unsettled or failed
    for i, (_, *cells, actions) in enumerate(rows):
        assert int(actions) == fields['actions'][i]
        for cell, j in zip(cells, columns, strict=True):
            values = [100 * fields[name][i][j] for name in ('probability', 'lower', 'upper')]
            assert_shown(cell, *values)
    assert [row[1] for row in none[1:]] == ['-'] * (k - 1)  # the second action: no simulation


def test_long_run_shares_are_beside_those_of_a_drop(page, results):
    for rows, found in zip(
        [*page.rows('aspects', 'in the long run'), *page.rows('aspect', 'in the long run')],
        [results[0].by_class(), results[0]],
        strict=True,
    ):
        columns = (found.long_run.shares, *found.long_run_bounds, found.drop_shares)
        values = 100 * np.array(columns).T
        for (_, share, interval, drop), expected in zip(rows, values.tolist(), strict=True):
            assert_shown(f'{share} {interval} {drop}', *expected)


def test_page_has_the_way_and_the_plan(page, results):
    (rows,) = page.rows('from', 'reaches a wanted aspect')
    assert [row[1:] for row in rows[:2]] == 2 * [['wanted', '0']]
    probability, actions = results[0].reach((1, 2))
    for (_, *cells), p, n in zip(rows[2:], probability[2:], actions[2:], strict=True):
        assert_shown(cells[0], 100 * p)
        assert_shown(cells[1], n)
    assert 'The way to aspects 1 and 2' in page.words('h3')
    (rows,) = page.rows('aspect', 'best action')
    assert [row[1:] for row in rows] == [
        ['wanted', '0'],
        ['wanted', '0'],
        ['tap', '1.25'],
        ['toss', '2.50'],
        ['tap', '8.00'],
        ['-', 'never'],
    ]


def test_retention_matches_the_document(part, results):
    box = part('box_10x20x30')
    result = retention_of(box, results[0].matrix.aspects)
    files = dict(retention_page(result).files())
    assert list(files) == ['retention.png', 'retention.svg', RETENTION_PAGE]
    page = Reader(files[RETENTION_PAGE].decode())
    assert page.words('h2') == ['Retention', 'Part and conditions', 'How to read this report']
    assert page.words('title') == ['box: retention']
    assert 'lift height (mm)' in page.words('text')
    (levels,) = page.rows('aspect', 'barrier (mm)')
    (counts,) = page.rows('aspect', 'lift height (mm)')
    for k, curve in enumerate(result.curves):
        fields = retention_fields(curve)
        assert int(levels[k][0]) == curve.aspect
        assert float(levels[k][1]) == pytest.approx(1000 * fields['barrier'], rel=0.005)
        for cell, each in zip(levels[k][3:], fields['levels'], strict=True):
            assert numbers(cell)[0][0] == pytest.approx(1000 * each['lift'], rel=0.005)
        for i, row in enumerate(counts[4 * k : 4 * k + 4]):
            assert row[0] == str(curve.aspect)
            values = [100 * fields[name][i] for name in ('probability', 'lower', 'upper')]
            assert row[2:4] == [str(fields['parts'][i]), str(fields['left'][i])]
            assert_shown(' '.join(row[4:]), *values)


def test_input_texts_are_escaped(page):
    notes = [each['text'] for each in page.all('p') if 'note' in each.get('class', '').split()]
    assert notes == ['The mesh is <odd>.']
    assert 'Source of these values: Assumed <script>.' in page.words('p')
    assert SHA256 in page.words('code')


def test_heading_levels_are_consecutive(page):
    levels = [int(each['tag'][1]) for each in page.found if re.fullmatch('h[1-6]', each['tag'])]
    assert levels[0] == 1
    assert all(b - a <= 1 for a, b in pairwise(levels))


def test_unknown_long_run_is_stated(page):
    assert sum('shares in the long run are not known' in each for each in page.words('p')) == 1


@pytest.mark.filterwarnings('error')
def test_part_of_one_aspect(solid):
    ball = solid(trimesh.creation.icosphere(subdivisions=2, radius=10))
    aspects = find_aspects(ball)
    assert len(aspects) == 1
    matrix = TransitionMatrix(aspects, np.array([[90, 0, 10, 0, 0]]))
    files = dict(reorientation_page([result_of(matrix, ball, 'tap', [50])]).files())
    assert list(files) == ['transitions.png', 'transitions.svg', PAGE]
    page = Reader(files[PAGE].decode())
    ((row,),) = page.rows('from', 'to 1 (%)')
    assert_shown(row[1], 90, *(100 * bound[0, 0] for bound in matrix.bounds()))
    ((row,),) = page.rows('aspect', 'in the long run')
    assert row[1] == '100 %'
    assert 'by aspect' not in page.words('summary')
    assert not page.all('nav')
    curve = RetentionCurve(
        1, np.inf, np.array([0.001, 0.01]), np.array([0, 1]), np.array([50, 50]), 0.95
    )
    result = RetentionResult((curve,), aspects, RUN, ball, complete=True)
    assert 'not reached' in retention_page(result).html()

"""What a page says is what is known; read back from the file by other readers."""

import base64
import html.parser
import io
import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh
from PIL import Image

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report import picture
from resting_aspects_ros.report.drop_page import FIGURES, PIXELS, drop_page
from resting_aspects_ros.report.format import aspect_colour
from resting_aspects_ros.report.page import ENDINGS
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.statistics.distribution import Distribution

VOID = {'meta', 'link', 'br', 'img', 'path', 'use', 'rect', 'input', 'hr', 'image'}


class Reader(html.parser.HTMLParser):
    """Elements of a page with their text; fails where they are not well nested."""

    def __init__(self, text):
        super().__init__()
        self.open, self.found = [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        element = {'tag': tag, 'text': '', **dict(attrs)}
        self.found.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_startendtag(self, tag, attrs):
        self.found.append({'tag': tag, 'text': '', **dict(attrs)})

    def handle_endtag(self, tag):
        if tag in VOID:
            return
        assert self.open.pop()['tag'] == tag

    def handle_data(self, data):
        for element in self.open:
            element['text'] += data

    def all(self, tag, **having):
        found = [each for each in self.found if each['tag'] == tag]
        for name, value in having.items():
            found = [each for each in found if value in (each.get(name) or '')]
        return found


def words(element):
    return ' '.join(element['text'].split())


@pytest.fixture(scope='module')
def bracket(part, make_report):
    return make_report(
        part('l_bracket'),
        unseen=[5],
        measured=True,
        notes=('Only <b>half</b> of it & more.',),
        facts={'Conditions': [('height', '0.2 m <script>'), ('part sha256', 64 * 'a')]},
        estimates={'rolling': np.array([0.3, 0.3, 0.2, 0.15, 0.05])},
        not_defined={'csa': 'csa is not defined for it'},
    )


@pytest.fixture(scope='module')
def files(bracket):
    return dict(bracket.page.files())


@pytest.fixture(scope='module')
def page(files):
    return Reader(files['report.html'].decode())


def test_page_needs_no_network(page, files):
    text = files['report.html'].decode()
    assert len(text) < 3_000_000
    for element in page.found:
        for name in ('src', 'href', 'xlink:href', 'action', 'data'):
            if value := element.get(name):
                assert value.startswith(('data:', '#')), value
    assert not re.findall(r'url\((?!#)', text)
    assert '@import' not in text


def test_figures_are_written_as_png_and_svg(files):
    names = {f'{name}.{ending}' for name in FIGURES for ending in ENDINGS}
    assert set(files) == {*names, 'report.html'}
    for name in FIGURES:
        with Image.open(io.BytesIO(files[f'{name}.png'])) as image:
            assert image.width >= 700
        root = ET.fromstring(files[f'{name}.svg'])
        # Words are words: they can be found, and read out.
        assert ''.join(root.itertext()).strip()


def test_numbers_match_the_distribution(page, bracket):
    rows = [each for each in page.all('li') if 'data-row' in each]
    found = bracket.distribution
    for row, aspect, count, interval in zip(
        rows, found.aspects, found.counts, found.intervals(), strict=False
    ):
        said = words(row)
        bounds = map(float, re.search(r'([\d.]+) to ([\d.]+) %', said).groups())
        assert list(bounds) == pytest.approx(
            [100 * interval.lower, 100 * interval.upper], abs=0.06
        )
        share = float(re.search(r'([\d.]+) %', said)[1]) if count else 0.0
        assert share == pytest.approx(count / 10, abs=0.06) or 'never seen' in said
        height = float(re.search(r'centre of mass ?([\d.]+) mm', said)[1])
        assert height == pytest.approx(1000 * aspect.com_height, abs=0.006)
        rise, to = re.search(r'minimum barrier ?([\d.]+) mm, to aspect\s(\d+)', said).groups()
        assert float(rise) == pytest.approx(1000 * aspect.min_barrier, rel=0.006)
        assert int(to) == aspect.neighbour


def test_bars_and_whiskers_have_the_right_lengths(page, bracket):
    intervals = bracket.distribution.intervals()
    longest = max(each.upper for each in intervals) / 100
    fills, whiskers = (
        [list(map(float, re.findall(r'[\d.]+', each['style']))) for each in page.all('i', **name)]
        for name in ({'class': 'fill'}, {'class': 'whisker'})
    )
    for fill, whisker, each in zip(fills[-7:], whiskers[-7:], intervals, strict=False):
        assert fill == pytest.approx([each.probability / longest], abs=0.01)
        ends = [each.lower / longest, (each.upper - each.lower) / longest]
        assert whisker == pytest.approx(ends, abs=0.02)


def test_input_texts_are_escaped(page):
    assert [words(each) for each in page.all('p', **{'class': 'note'})] == [
        'Only <b>half</b> of it & more.'
    ]
    assert any(words(each) == '0.2 m <script>' for each in page.all('dd'))


def test_page_without_part_and_drops_has_no_pictures(part):
    aspects = find_aspects(part('tetrahedron'))
    none = Distribution(aspects, np.zeros(4, dtype=np.int64), 0, 0, 0)
    page = Reader(drop_page(none, None, 'none', '').html())
    assert len(page.all('h2')) == 3
    assert not page.all('img')
    assert not page.all('script', type='module')
    assert any('no drops' in words(each) for each in page.all('li'))


def test_pictures_have_the_colour_of_the_aspect(page, bracket):
    shown, *others = [each for each in page.all('img') if each['src']]
    images = [each for each in others if each['alt']]
    assert shown['src'] == images[0]['src']  # in place of the view until there is one
    assert ['from above' in each['alt'] for each in images] == [False, True] * 5
    for each, aspect in zip(images, np.repeat(bracket.distribution.aspects, 2), strict=True):
        data = base64.b64decode(each['src'].removeprefix('data:image/png;base64,'))
        pixels = np.asarray(Image.open(io.BytesIO(data)))
        assert pixels.shape == (PIXELS, PIXELS, 4)
        inside = pixels[pixels[..., 3] == 255][:, :3].astype(float)
        bright = inside[inside.max(axis=1) > 100]
        colour = aspect_colour(aspect)
        target = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
        shade = bright / bright.max(axis=1, keepdims=True)
        assert (np.abs(shade - target / target.max()).max(axis=1) < 0.03).mean() > 0.9


def test_scene_poses_match_the_aspects(page, bracket):
    (script,) = page.all('script', id='scene')
    scene = json.loads(script['text'])
    part = bracket.part
    points = np.frombuffer(base64.b64decode(scene['points']), '<f4').reshape(-1, 3)
    faces = np.frombuffer(base64.b64decode(scene['faces']), '<u4').reshape(-1, 3)
    np.testing.assert_allclose(
        points * part.hull_radius + part.centre_of_mass, part.vertices, atol=1e-8
    )
    np.testing.assert_array_equal(faces, part.faces)
    for row, aspect in zip(scene['rows'], bracket.distribution.aspects, strict=True):
        lying = rotate(np.array(row['quaternion']), points)
        assert lying[:, 2].min() + row['height'] == pytest.approx(0, abs=1e-6)
        assert row['height'] * part.hull_radius == pytest.approx(aspect.com_height, rel=1e-6)
        assert row['colour'] == aspect_colour(aspect)


def test_pictures_of_a_large_mesh_show_a_simplified_one(solid, make_report, monkeypatch):
    monkeypatch.setattr(picture, 'MAX_PICTURE_TRIANGLES', 300)
    box = trimesh.creation.box((10, 20, 30)).subdivide().subdivide().subdivide()
    page = Reader(make_report(solid(box), history=None).page.html())
    assert len([each for each in page.all('li') if 'data-row' in each]) == 3 + 2
    said = next(w for w in map(words, page.all('span')) if 'simplified mesh' in w)
    shown, whole = map(int, re.findall(r'\d{3,}', said))
    assert whole == len(box.faces) == 768
    assert shown <= 300

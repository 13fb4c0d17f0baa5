"""The page in headless Chromium: an aspect is chosen, the view changes, and nothing is wrong."""

import base64
import io
import json
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from resting_aspects_ros.aspects.find import find_aspects

JS = Path(__file__).parents[1] / 'js'
DESK, TELEPHONE = 1200, 390

pytestmark = [pytest.mark.stated_requirement, pytest.mark.timeout(600)]


@pytest.fixture(scope='session')
def look():
    """Open a page in a browser and use it; returns what was seen."""
    chromium = shutil.which('chromium') or shutil.which('chromium-browser')
    if not (shutil.which('node') and chromium):
        pytest.skip('node or chromium is not installed')
    if not (JS / 'node_modules' / '.package-lock.json').exists():  # npm's last file
        pytest.skip(f'the packages in {JS / "package.json"} are not installed: make dev does it')

    def look(path, width=DESK, scheme='light', webgl='with'):
        command = ['node', JS / 'look.js', chromium, path, str(width), scheme]
        ended = subprocess.run(
            [*command, webgl], capture_output=True, text=True, check=False, timeout=600
        )
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return look


def pixels(picture):
    with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
        return np.asarray(image.convert('RGB')).astype(int)


def differ(a, b):
    """Share of the pixels that are clearly another colour."""
    return (np.abs(pixels(a) - pixels(b)).max(axis=2) > 30).mean()


def assert_sides_are_seen(picture):
    """A part, and not only a tray: the sides that are seen have different shades."""
    _, counts = np.unique(pixels(picture).reshape(-1, 3) // 8, axis=0, return_counts=True)
    assert (counts > 0.01 * counts.sum()).sum() >= 4


def assert_readable(seen):
    """Nothing is wrong with the page, and all words of its figures can be read."""
    assert seen['said'] == []
    assert seen['overflow'] <= 0
    assert seen['broken'] == 0
    assert seen['figures']
    for figure in seen['figures']:
        assert figure['words'] > 0
        assert figure['outside'] == [], figure['name']
        assert figure['on_another'] == [], figure['name']
        assert figure['smallest'] > 8, figure['name']


@pytest.fixture(scope='session')
def written(tmp_path_factory):
    """Write the page of a report; returns its path."""

    def write(report):
        path = tmp_path_factory.mktemp('report') / 'report.html'
        path.write_text(report.page.html(), encoding='utf-8')
        return path

    return write


@pytest.fixture(scope='module')
def bracket(part, make_report, written):
    estimates = {'rolling': np.array([0.3, 0.3, 0.2, 0.15, 0.05])}
    report = make_report(part('l_bracket'), unseen=[5], measured=True, estimates=estimates)
    return written(report)


@pytest.mark.slow
def test_selected_aspect_is_shown_in_the_view(look, bracket):
    seen = look(bracket, TELEPHONE, 'dark')
    assert_readable(seen)
    assert len(seen['figures']) == 3
    assert seen['asked'] == [f'file://{bracket}']
    assert seen['buttons'] == 5
    assert len(seen['ids']) == len(set(seen['ids']))
    views = seen['views']
    assert [view['name'] for view in views] == [f'aspect {k}' for k in range(1, 6)]
    assert [view['chosen'] for view in views] == [view['name'] for view in views]
    assert {view['pressed'] for view in views} == {1}
    assert views[4]['share'] == 'never seen'
    for a, b in pairwise(views):
        assert differ(a['picture'], b['picture']) > 0.02
    for view in views:
        assert_sides_are_seen(view['picture'])
    assert differ(views[-1]['picture'], seen['turned']) > 0.02
    # Chosen from the last row on, the view is in sight; also while other text is marked.
    assert seen['in_sight'] == [True, True]
    assert seen['marked'] == 'aspect 1'
    paper, ink = seen['colours']
    assert ink > paper + 100


@pytest.mark.slow
def test_page_without_scripts_or_webgl_lacks_only_the_view(look, bracket):
    seen = look(bracket, webgl='scriptless')
    assert seen['said'] == []
    assert len(seen['rows']) == len(seen['numbers']) == 5 + 2
    assert seen['hint'] == ''  # nothing can be turned
    assert_sides_are_seen(seen['picture'])
    seen = look(bracket, webgl='without')
    assert (seen['said'], seen['turned'], seen['broken']) == ([], None, 0)
    assert len(seen['views']) == 5
    for a, b in pairwise(seen['views']):
        assert differ(a['picture'], b['picture']) > 0.02


@pytest.mark.slow
@pytest.mark.parametrize('many', [True, False])
def test_pages_of_other_parts_are_readable(look, solid, many_sided, make_report, written, many):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=10)
    part = many_sided if many else solid(ball)
    aspects = len(find_aspects(part))
    estimates = {name: np.full(aspects, 1 / aspects) for name in ('solid_angle', 'stability')}
    report = make_report(part, measured=True, estimates=estimates)
    seen = look(written(report), TELEPHONE if many else DESK)
    assert_readable(seen)
    assert len(seen['rows']) == len(report.distribution.aspects.classes()) + 2

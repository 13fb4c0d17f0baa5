"""The pages of `reorient --report` and `retention --report`."""

import json
import re
import signal

import pytest

from resting_aspects_ros.report.page import Page

QUICK = ('--workers', 2)
REORIENT = ('reorient', 'tetrahedron', *QUICK, '--per-aspect', 5, '--drops', 20)


def page_of(ended, folder):
    """Return path and text of the page that a command reports."""
    assert ended.returncode == 0, ended.stderr
    path = folder / re.search(r'^Report: (.+)$', ended.stdout, re.MULTILINE)[1]
    return path, path.read_text(encoding='utf-8')


@pytest.fixture(scope='module')
def compared(run_in, tmp_path_factory):
    """Compare two actions with a report; returns path and text of the page."""
    folder = tmp_path_factory.mktemp('compared')
    words = (*REORIENT, '--action', 'tap,toss', '--wanted', '1', '--report')
    return page_of(run_in(folder, *words), folder)


def test_default_folder_has_page_figures_and_documents(compared):
    path, _ = compared
    assert path.parts[-3:] == ('out', 'tetrahedron', 'reorientation.html')
    figures = [f'transitions_{action}' for action in ('tap', 'toss')]
    expected = [f'{name}.{ending}' for name in figures for ending in ('png', 'svg')]
    expected += ['reorientation.html', 'transitions.json', 'roadmap.json']
    assert {file.name for file in path.parent.iterdir()} == set(expected)


def test_retention_writes_a_page(run, tmp_path):
    words = ('retention', 'tetrahedron', *QUICK, '--per-height', 4, '--out', 'o', '--report')
    path, page = page_of(run(*words), tmp_path)
    written = ('retention.html', 'retention.json', 'retention.png', 'retention.svg')
    assert {file.name for file in path.parent.iterdir()} == set(written)
    curve = json.loads((tmp_path / 'o' / 'retention.json').read_text())['curves'][0]
    for lift, left in zip(curve['lift'], curve['left'], strict=True):
        assert f'<td>{1000 * lift:#.3g}</td><td>4</td><td>{left}</td>' in page
    assert '<dt>friction</dt>' in page
    assert '<dt>height</dt>' not in page  # of a release, which there is not


@pytest.mark.parametrize(
    ('words', 'kept'),
    [
        (REORIENT, {'transitions.json', 'roadmap.json'}),
        (('retention', 'tetrahedron', *QUICK, '--per-height', 2), {'retention.json'}),
    ],
)
def test_ctrl_c_ends_the_page_when_the_rest_is_saved(run, monkeypatch, tmp_path, words, kept):
    draw = Page.files

    def interrupted(page):
        signal.raise_signal(signal.SIGINT)
        yield from draw(page)

    monkeypatch.setattr(Page, 'files', interrupted)
    found = run(*words, '--report', '--out', 'o')
    assert (found.returncode, found.stderr.splitlines()[-1]) == (130, 'interrupted')
    assert found.stdout.splitlines()[-1].startswith('Written: ')
    assert {file.name for file in (tmp_path / 'o').iterdir()} == kept

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


@pytest.mark.parametrize(
    'text',
    [
        'Action tap',
        'Action toss',
        'Best plan',
        'The way to aspect 1',
        'kick: 20 actions, 5 from each aspect',
        '<dt>speed</dt><dd>0.3 m/s</dd>',
        '<dt>time from one action to the next</dt><dd>0.5 s</dd>',
        '<dt>friction</dt><dd>0.25</dd>',
        '<dt>seed</dt><dd>1</dd>',
        '<dd>kernel ',
    ],
)
def test_page_states_what_was_simulated(compared, text):
    assert text in compared[1]


def test_page_has_the_runs_of_the_document(compared):
    path, page = compared
    document = json.loads((path.parent / 'transitions.json').read_text())
    for result in document['results']:
        assert result['run_id'] in page
        assert result['mesh_sha256'] in page


@pytest.mark.slow
def test_page_compares_with_measured_trials(compared, run, tmp_path):
    roadmap = json.loads((compared[0].parent / 'roadmap.json').read_text())
    tap = next(each for each in roadmap['transitions'] if each['action']['name'] == 'tap')
    # All outcomes of the row are known: those of its other pairs, or else none but one.
    row = [
        each
        for each in roadmap['transitions']
        if each['action']['name'] == 'tap' and each['from_pose'] == tap['from_pose']
    ]
    other = next((each for each in row if each is not tap), None)
    if other is None:
        other = dict(tap, id='tap:other', to_pose=tap['to_pose'] % 4 + 1)
        roadmap['transitions'].append(other)
    tap['experimental'] = {'status': 'tested', 'trials': 60, 'successes': 45}
    other['experimental'] = {'status': 'tested', 'trials': 60, 'successes': 15}
    (tmp_path / 'm.json').write_text(json.dumps(roadmap))
    words = ('--measured', 'm.json', '--check-convergence', '--report', '--out', 'p')
    _, page = page_of(run(*REORIENT, *words), tmp_path)
    assert '<td>45 of 60, 75 %<small>63 to 84 %</small></td>' in page
    aspect = tap['from_pose']
    assert f'The transitions from aspect {aspect} are measured trials instead of' in page
    assert 'With 1/2 of the time step' in page
    assert '<dd>20 of 20</dd>' in page  # the actions that were simulated


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

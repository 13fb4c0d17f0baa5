"""The commands `reorient` and `retention`, and `drop` with initial states."""

import csv
import json
import signal

import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api import reorient
from resting_aspects_ros.api.runner import Runner
from resting_aspects_ros.errors import EngineError

WORDS = ('reorient', 'tetrahedron', '--per-aspect', 10, '--drops', 20, '--workers', 2)


def test_several_actions_are_compared(run_in, tmp_path):
    few = (*WORDS[:2], '--per-aspect', 3, '--drops', 10, '--workers', 2)
    words = (*few, '--action', 'tap,toss', '--wanted-classes', '1', '--json')
    document = json.loads(run_in(tmp_path, *words).stdout)
    assert [each['action']['name'] for each in document['results']] == ['tap', 'toss']
    assert document['plan'] == {
        'wanted': [1, 2, 3, 4],
        'action': [None] * 4,
        'expected_time': [0.0] * 4,
    }


@pytest.mark.slow
def test_error_in_the_second_action_keeps_the_results(run_in, tmp_path, monkeypatch):
    count = Runner.count

    def dies_in_toss(self, *others, label='', **options):
        if 'toss' in label:
            raise EngineError('the workers died')
        count(self, *others, label=label, **options)

    monkeypatch.setattr(Runner, 'count', dies_in_toss)
    ended = run_in(tmp_path, *WORDS, '--action', 'tap,toss', '--json', '--out', 'o')
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1] == 'error: the workers died; the result has 40 actions'
    assert (tmp_path / 'o' / 'transitions.json').read_text() == ended.stdout
    results = json.loads(ended.stdout)['results']
    assert [(each['complete'], sum(each['actions'])) for each in results] == [
        (True, 40),
        (False, 0),
    ]


def test_ctrl_c_in_the_check_keeps_the_result(run_in, tmp_path, monkeypatch):
    check = reorient.repeat_actions_in_finer_steps

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        return check(*arguments)

    monkeypatch.setattr(reorient, 'repeat_actions_in_finer_steps', interrupted)
    ended = run_in(tmp_path, *WORDS, '--check-convergence', '--json')
    assert ended.returncode == 130
    assert ended.stderr.splitlines()[-1] == 'interrupted; convergence was not checked'
    document = json.loads(ended.stdout)
    assert (document['complete'], sum(document['actions'])) == (True, 40)
    assert 'convergence' not in document


def test_actions_of_a_file_are_simulated(run_in, tmp_path):
    (tmp_path / 'mine.yaml').write_text('nudge: {kind: kick, speed: 0.01, time: 2}\n')
    ended = run_in(tmp_path, *WORDS, '--actions', 'mine.yaml', '--json')
    assert json.loads(ended.stdout)['action']['time'] == 2


@pytest.mark.slow
def test_report_has_page_figures_and_documents(run_in, tmp_path):
    words = ('--action', 'tap,toss', '--wanted', '1', '--report')
    ended = run_in(tmp_path, *WORDS, *words)
    assert 'Report: out/tetrahedron/reorientation.html' in ended.stdout
    figures = [f'transitions_{action}' for action in ('tap', 'toss')]
    expected = [f'{name}.{ending}' for name in figures for ending in ('png', 'svg')]
    expected += ['reorientation.html', 'transitions.json', 'roadmap.json']
    assert {file.name for file in (tmp_path / 'out/tetrahedron').iterdir()} == set(expected)


@pytest.mark.slow
def test_page_of_retention_has_the_counts(run_in, tmp_path):
    words = ('retention', 'tetrahedron', '--per-height', 4, '--out', 'o', '--report')
    assert run_in(tmp_path, *words).returncode == 0
    page = (tmp_path / 'o' / 'retention.html').read_text(encoding='utf-8')
    curve = json.loads((tmp_path / 'o' / 'retention.json').read_text())['curves'][0]
    for lift, left in zip(curve['lift'], curve['left'], strict=True):
        assert f'<td>{1000 * lift:#.3g}</td><td>4</td><td>{left}</td>' in page
    assert '<dt>friction</dt>' in page
    assert '<dt>height</dt>' not in page  # of a release, which there is not


# -- Initial states -------------------------------------------------------------------------------


def write_states(path, rows, header='z_com_m,qx,qy,qz,qw,vx'):
    path.write_text('\n'.join([header, *rows]) + '\n')


@pytest.mark.slow
def test_drops_start_from_the_states_of_a_file(run_in, tmp_path):
    """At rest on two different sides, so the parts stay there."""
    aspects = ra.find_aspects(ra.load_part('tetrahedron')).aspects
    rows = [','.join(map(str, [a.com_height, *a.orientation.tolist(), 0.0])) for a in aspects[:2]]
    write_states(tmp_path / 's.csv', rows)
    words = ('drop', 'tetrahedron', '--initial-states', 's.csv', '--replicates', 3)
    ended = run_in(tmp_path, *words, '--workers', 1, '--json', '--poses', 'p.csv')
    document = json.loads(ended.stdout)
    assert document['drops'] == 6
    assert [row[:4] for row in document['initial_states']['counts']] == [
        [3, 0, 0, 0],
        [0, 3, 0, 0],
    ]
    with (tmp_path / 'p.csv').open() as file:
        assert [row['aspect'] for row in csv.DictReader(file)] == ['1', '2'] * 3

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


@pytest.fixture(scope='module')
def saved(run_in, tmp_path_factory):
    """Run with all files; returns the folder and the ended process."""
    folder = tmp_path_factory.mktemp('reorient')
    ended = run_in(folder, *WORDS, '--action', 'tap', '--wanted', '1', '--out', 'o')
    assert ended.returncode == 0, ended.stderr
    return folder / 'o', ended


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


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('--action', 'jolt'), "invalid action 'jolt'"),
        (('--action', 'tap,tap'), 'expected different names'),
        (('--action', 'tap,toss', '--speed', '1'), 'expected a single action'),
        (('--speed', '-1'), 'invalid speed'),
        (('--speed', '1 furlong'), 'invalid --speed'),
        (('--wanted', '9'), 'invalid wanted aspect 9: expected 1 to 4'),
        (('--wanted', 'x'), "invalid --wanted 'x'"),
        (('--wanted-classes', '2'), 'invalid wanted symmetry class 2: expected 1 to 1'),
        (('--precision', '7'), 'invalid --precision'),
        (('--per-aspect', '0'), 'invalid number of actions per aspect 0'),
        (('--actions', 'none.yaml'), 'does not exist'),
        (('--action', 'nozzle'), 'missing impulse of a nozzle'),
        (('--time', '0'), 'invalid time'),
    ],
)
def test_wrong_requests_are_refused(run_in, tmp_path, words, message):
    ended = run_in(tmp_path, 'reorient', 'tetrahedron', *words)
    assert ended.returncode == 2
    assert message in ended.stderr
    assert ended.stderr.count('\n') == 1


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'expected a mapping'),
        ('tap: 3', 'expected a mapping with the key kind'),
        ('tap: {kind: jump}', "invalid kind of action 'jump'"),
        ('tap: {kind: kick, speed: fast}', "invalid speed 'fast'"),
        ('tap: {kind: kick, sped: 1}', "invalid value 'sped'"),
        ('tap: {kind: kick, time: -1}', 'invalid time'),
        ('1: {kind: kick}', 'invalid name'),
        ('tap: {kind: kick, source: 3}', 'invalid source'),
        ('tap: [', 'not valid YAML'),
    ],
)
def test_damaged_actions_file_is_refused(run_in, tmp_path, text, message):
    (tmp_path / 'a.yaml').write_text(text)
    ended = run_in(tmp_path, 'reorient', 'tetrahedron', '--actions', 'a.yaml')
    assert ended.returncode == 2
    assert message in ended.stderr


# -- Initial states -------------------------------------------------------------------------------


def write_states(path, rows, header='z_com_m,qx,qy,qz,qw,vx'):
    path.write_text('\n'.join([header, *rows]) + '\n')


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


@pytest.mark.parametrize(
    ('rows', 'header', 'message'),
    [
        ([], 'z_com_m,qx,qy,qz,qw', 'expected at least one'),
        (['0.1,0,0,0,1'], 'z,qx,qy,qz,qw', 'no column z_com_m'),
        (['0.1,0,0,0,2'], 'z_com_m,qx,qy,qz,qw', 'a quaternion of length 1'),
        (['a,0,0,0,1'], 'z_com_m,qx,qy,qz,qw', "invalid z_com_m 'a'"),
        (['nan,0,0,0,1'], 'z_com_m,qx,qy,qz,qw', 'a finite number'),
        (['0.1,0,0,1'], 'z_com_m,qx,qy,qz,qw', 'invalid number of columns 4'),
        (['0.1,0,0,0,1,1'], 'z_com_m,qx,qy,qz,qw,qw', 'several columns qw'),
        (['0.1,0,0,0,1,1e9'], 'z_com_m,qx,qy,qz,qw,vx', 'invalid impact speed'),
    ],
)
def test_damaged_states_are_refused(run_in, tmp_path, rows, header, message):
    write_states(tmp_path / 's.csv', rows, header)
    ended = run_in(tmp_path, 'drop', 'tetrahedron', '--initial-states', 's.csv')
    assert ended.returncode == 2
    assert message in ended.stderr


@pytest.mark.parametrize(
    'words',
    [
        ('--drops', 5),
        ('--precision', 0.1),
        ('--log', 'logs'),
        ('--from-log', 'log'),
        ('--replicates', 0),
        ('--noise-spin', '-1'),
    ],
)
def test_flags_that_contradict_states_are_refused(run_in, tmp_path, words):
    write_states(tmp_path / 's.csv', ['0.1,0,0,0,1,0'])
    part = () if words[0] == '--from-log' else ('tetrahedron',)
    ended = run_in(tmp_path, 'drop', *part, '--initial-states', 's.csv', *words)
    assert ended.returncode == 2
    assert ended.stderr.startswith('error: invalid ')


@pytest.mark.parametrize('words', [('--replicates', 2), ('--noise-velocity', 0.1)])
def test_flags_that_need_states_are_refused(run_in, tmp_path, words):
    ended = run_in(tmp_path, 'drop', 'tetrahedron', *words)
    assert ended.returncode == 2
    assert 'expected only with --initial-states' in ended.stderr

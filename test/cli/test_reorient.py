"""The command `reorient`."""

import json
import signal

import pytest

from resting_aspects_ros.api import reorient
from resting_aspects_ros.api.runner import Runner
from resting_aspects_ros.errors import EngineError

WORDS = ('reorient', 'tetrahedron', '--per-aspect', 10, '--drops', 20, '--workers', 2)


@pytest.mark.slow
def test_error_in_the_second_action_keeps_the_results(run, tmp_path, monkeypatch):
    count = Runner.count

    def dies_in_toss(self, *others, label='', **options):
        if 'toss' in label:
            raise EngineError('the workers died')
        count(self, *others, label=label, **options)

    monkeypatch.setattr(Runner, 'count', dies_in_toss)
    ended = run(*WORDS, '--action', 'tap,toss', '--json', '--out', 'o')
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1] == 'error: the workers died; the result has 40 actions'
    assert (tmp_path / 'o' / 'transitions.json').read_text() == ended.stdout
    results = json.loads(ended.stdout)['results']
    found = [(each['complete'], sum(each['actions'])) for each in results]
    assert found == [(True, 40), (False, 0)]


def test_ctrl_c_in_the_check_keeps_the_result(run, tmp_path, monkeypatch):
    check = reorient.repeat_actions_in_finer_steps

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        return check(*arguments)

    monkeypatch.setattr(reorient, 'repeat_actions_in_finer_steps', interrupted)
    (tmp_path / 'mine.yaml').write_text('nudge: {kind: kick, speed: 0.01, time: 2}\n')
    words = ('--actions', 'mine.yaml', '--action', 'nudge', '--speed', 0.02)
    ended = run(*WORDS, *words, '--check-convergence', '--json')
    assert ended.returncode == 130
    assert ended.stderr.splitlines()[-1] == 'interrupted; the result has 40 actions'
    document = json.loads(ended.stdout)
    assert (document['action']['speed'], document['action']['time']) == (0.02, 2)
    assert (document['complete'], sum(document['actions'])) == (True, 40)
    assert 'convergence' not in document

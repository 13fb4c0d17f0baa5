"""`drop --scheduler`: the same drops on a Dask cluster, with an orderly end."""

import csv
import os
import re
import signal

import pytest

OUTPUTS = ('--json', '--poses', 'p.csv', '--out', 'o')


@pytest.mark.slow
def test_killed_worker_loses_no_drop(cluster, begin, wait, tmp_path):
    # Bullet, so that there is time to kill a worker.
    words = ('drop', 'tetrahedron', '--drops', 400, '--engine', 'bullet', '--poses', 'p.csv')
    process = begin(*words, '--scheduler', cluster.scheduler_address)
    # It has written the first poses to its temporary file.
    wait(lambda: any(len(p.read_bytes()) > 1000 for p in tmp_path.glob('p.*.part.csv')), 'poses')
    (killed, *_) = [nanny.pid for nanny in cluster.workers.values()]
    os.kill(killed, signal.SIGKILL)
    printed, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    # The scheduler repeats the drops without a message.
    assert {line for line in errors.splitlines() if not line.startswith('tetrahedron: ')} == set()
    assert printed.splitlines()[1].strip() == '400 drops on rubber_mat, seed 1'
    with (tmp_path / 'p.csv').open(newline='') as file:
        assert [int(row['drop']) for row in csv.DictReader(file)] == list(range(400))


@pytest.mark.slow
def test_ctrl_c_saves_results_and_keeps_the_cluster(cluster, begin, ended, read_until, wait):
    words = ('drop', 'tetrahedron', '--drops', 2_000_000)
    process = begin(*words, '--scheduler', cluster.scheduler_address, *OUTPUTS)
    read_until(process.stderr, lambda line: re.match(r'tetrahedron: [1-9]\d* of \d+ drops', line))
    assert cluster.scheduler.tasks
    os.killpg(process.pid, signal.SIGINT)  # like a terminal
    document, lines = ended(process, 130)
    assert document['drops'] > 0
    assert lines[-1] == f'interrupted; the result has {document["drops"]} of 2000000 drops'
    wait(lambda: not cluster.scheduler.tasks, 'the end of the tasks')
    assert len(cluster.scheduler.workers) == 2

"""`drop --scheduler`: the same drops on a Dask cluster, with an orderly end."""

import os
import re
import signal

import pytest

# Bullet, so that there is time to kill a worker.
WORDS = ('drop', 'tetrahedron', '--drops', 750, '--engine', 'bullet')
MANY = ('drop', 'tetrahedron', '--drops', 2_000_000)
OUTPUTS = ('--json', '--poses', 'p.csv', '--out', 'o')


def some_done(line):
    return re.match(r'tetrahedron: [1-9]\d* of \d+ drops  [\d.]+ drops/s$', line)


@pytest.fixture(scope='module')
def undisturbed(run_in, tmp_path_factory):
    """Return the table and the poses of a run on this machine."""
    folder = tmp_path_factory.mktemp('undisturbed')
    ended = run_in(folder, *WORDS, '--poses', 'p.csv')
    assert ended.returncode == 0, ended.stderr
    return ended.stdout, (folder / 'p.csv').read_bytes()


@pytest.mark.slow
def test_killed_worker_loses_no_drop(cluster, begin, wait_for_poses, undisturbed, tmp_path):
    process = begin(*WORDS, '--scheduler', cluster.scheduler_address, '--poses', 'p.csv')
    wait_for_poses('p')
    (killed, *_) = [nanny.pid for nanny in cluster.workers.values()]
    os.kill(killed, signal.SIGKILL)
    printed, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    # The scheduler repeats the drops without a message.
    assert {line for line in errors.splitlines() if not line.startswith('tetrahedron: ')} == set()
    assert (printed, (tmp_path / 'p.csv').read_bytes()) == undisturbed


@pytest.mark.slow
def test_ctrl_c_saves_results_and_keeps_the_cluster(cluster, begin, ended, read_until, wait_until):
    process = begin(*MANY, '--scheduler', cluster.scheduler_address, *OUTPUTS)
    read_until(process.stderr, some_done)
    assert cluster.scheduler.tasks
    os.killpg(process.pid, signal.SIGINT)  # like a terminal
    document, lines = ended(process, 130)
    assert document['drops'] > 0
    assert lines[-1] == f'interrupted; the result has {document["drops"]} of 2000000 drops'
    wait_until(lambda: not cluster.scheduler.tasks)
    assert len(cluster.scheduler.workers) == 2


@pytest.mark.slow
def test_unreachable_scheduler_is_refused_with_one_line(make_cluster, refused):
    line = refused(*WORDS, '--scheduler', 'tcp://127.0.0.1:1', '--out', 'o')
    assert line.startswith(
        "error: invalid scheduler 'tcp://127.0.0.1:1': expected the address of a Dask scheduler; "
    )


@pytest.mark.slow
def test_missing_dask_error_names_the_package(run_process, tmp_path):
    # Python searches the working folder before the installed packages.
    (tmp_path / 'distributed.py').write_text('raise ImportError\n', encoding='utf-8')
    ended = run_process(*WORDS, '--scheduler', 'tcp://127.0.0.1:1')
    words = (
        "error: scheduler 'tcp://127.0.0.1:1' needs Dask, which is not installed: "
        'pip install distributed\n'
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, '', words)

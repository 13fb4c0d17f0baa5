"""`drop --scheduler`: the same drops on a Dask cluster, and in the same order to their end."""

import os
import re
import signal

import pytest

WORDS = ('drop', 'tetrahedron', '--drops', 1500)
MANY = ('drop', 'tetrahedron', '--drops', 200_000)
OUTPUTS = ('--json', '--poses', 'p.csv', '--out', 'o')


def some_done(line):
    return re.match(r'tetrahedron: [1-9]\d* of \d+ drops  \d+ drops/s$', line)


@pytest.fixture(scope='module')
def undisturbed(run_in, tmp_path_factory):
    """The table and the poses as this machine makes them."""
    folder = tmp_path_factory.mktemp('undisturbed')
    ended = run_in(folder, *WORDS, '--poses', 'p.csv')
    assert ended.returncode == 0, ended.stderr
    return ended.stdout, (folder / 'p.csv').read_bytes()


def test_a_worker_that_is_killed_in_the_middle_costs_no_drop(
    cluster, begin, wait_for_poses, undisturbed, tmp_path
):
    process = begin(*WORDS, '--scheduler', cluster.scheduler_address, '--poses', 'p.csv')
    wait_for_poses('p')
    (killed, *_) = [nanny.pid for nanny in cluster.workers.values()]
    os.kill(killed, signal.SIGKILL)
    printed, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    # The scheduler sees to it: there is nothing to tell.
    assert {line for line in errors.splitlines() if not line.startswith('tetrahedron: ')} == set()
    assert (printed, (tmp_path / 'p.csv').read_bytes()) == undisturbed


@pytest.mark.parametrize('to', ['group', pytest.param('command', marks=pytest.mark.slow)])
def test_ctrl_c_saves_what_was_done_and_leaves_the_cluster_as_it_was(
    cluster, begin, ended, read_until, wait_until, to
):
    process = begin(*MANY, '--scheduler', cluster.scheduler_address, *OUTPUTS)
    read_until(process.stderr, some_done)
    assert cluster.scheduler.tasks
    if to == 'group':  # as a terminal does
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGTERM)
    document, lines = ended(process, 130)
    assert document['drops'] > 0
    assert lines[-1] == f'interrupted; the result has {document["drops"]} of 200000 drops'
    wait_until(lambda: not cluster.scheduler.tasks)
    assert len(cluster.scheduler.workers) == 2


@pytest.mark.slow  # test/simulation has it without the command
def test_a_cluster_that_goes_away_ends_it_in_words(make_cluster, begin, ended, read_until):
    with make_cluster(1) as cluster:
        process = begin(*MANY, '--scheduler', cluster.scheduler_address, *OUTPUTS)
        read_until(process.stderr, some_done)
    document, lines = ended(process, 1)
    done = document['drops']
    assert done > 0
    assert lines[-1] == (
        f'error: the workers became unavailable near drop {done} of tetrahedron; the result '
        f'has {done} of 200000 drops'
    )


def test_a_scheduler_that_is_not_there_is_refused_in_a_line(make_cluster, refused):
    line = refused(*WORDS, '--scheduler', 'tcp://127.0.0.1:1', '--out', 'o')
    assert line.startswith(
        "error: invalid scheduler 'tcp://127.0.0.1:1': expected the address of a Dask scheduler; "
    )


def test_workers_of_this_machine_and_of_a_cluster_are_not_both_to_be_had(refused):
    line = refused(*WORDS, '--workers', 2, '--scheduler', 'tcp://127.0.0.1:1')
    words = 'error: argument --scheduler: not allowed with argument --workers'
    assert line == f'{words} (see resting_aspects drop --help)'


def test_without_dask_it_says_what_to_install(run_process, tmp_path):
    # The folder in which the command is run is looked at before what is installed.
    (tmp_path / 'distributed.py').write_text('raise ImportError\n', encoding='utf-8')
    ended = run_process(*WORDS, '--scheduler', 'tcp://127.0.0.1:1')
    words = (
        "error: scheduler 'tcp://127.0.0.1:1' needs Dask, which is not installed: "
        'pip install distributed\n'
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, '', words)

"""A recorder that is killed at any moment: what it has written survives it, to the batch."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from resting_aspects_interfaces.msg import RestingPoses
from rosbags.highlevel import AnyReader

from resting_aspects_ros.logs.recovery import recover_log
from resting_aspects_ros.ros.interface import POSES, RESTING_POSES

# Number of batches, and of drops in each.
BATCHES, BATCH = 200, 250
# The recorder is killed after it reports at most this many batches: long before it is done.
LATEST = 100

# Imports once what takes seconds; starts a recorder at each line of input, one after the other.
RECORDERS = """
import os, sys
from resting_aspects_ros.nodes.drop_recorder import node as drop_recorder
for line in sys.stdin:
    output, *words = line.split()
    pid = os.fork()
    if not pid:
        for stream in (1, 2):
            os.dup2(os.open(output, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
        sys.argv[1:] = words
        sys.exit(drop_recorder.main())
    print(pid, flush=True)
    os.waitpid(pid, 0)
"""


@pytest.fixture
def start_recorder(tmp_path):
    """Start a recorder that reports what it has written; return its pid and its output file."""
    with subprocess.Popen(
        [sys.executable, '-c', RECORDERS],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:

        def start_recorder(namespace, number):
            output = tmp_path / f'output_{number}.txt'
            name = f'{namespace[1:]}.drop_recorder'
            arguments = f'-r __ns:={namespace} -p log_folder:={tmp_path} --log-level {name}:=debug'
            print(f'{output} --ros-args {arguments}', file=process.stdin, flush=True)
            return int(process.stdout.readline()), output

        yield start_recorder
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def reported_drops(output):
    """Return how many drops a recorder reports as written."""
    found = re.findall(r' (\d+) drops are in .*\n', output.read_text())
    return max(map(int, found), default=0)


def batches_in(log, topic):
    """Return the batches of poses in a log, in CDR."""
    with AnyReader([log]) as reader:
        connections = [each for each in reader.connections if each.topic == topic]
        return [bytes(data) for *_, data in reader.messages(connections)] if connections else []


@pytest.mark.parametrize('kills', [2, pytest.param(20, marks=pytest.mark.slow)])
def test_killed_recorder_loses_no_reported_drops(
    kills, connect, start_recorder, namespace, batches, wait, tmp_path
):
    client = connect(namespace)
    published = list(batches(BATCHES, 'killed'))
    publisher = client.node.create_publisher(RestingPoses, RESTING_POSES, POSES)
    for data in published:
        publisher.publish(data)  # it has them still for each recorder, which writes its own log
    rng = random.Random(7)
    kept = []
    for number in range(1, kills + 1):
        pid, output = start_recorder(namespace, number)
        end = f'killed_{number}' if number > 1 else 'killed'
        min_drops = BATCH * rng.randint(1, LATEST)
        wait(
            lambda output=output, min_drops=min_drops: (
                output.exists() and reported_drops(output) >= min_drops
            ),
            'batches',
            step=lambda: time.sleep(0.001),
        )
        time.sleep(rng.uniform(0, 0.01))  # the moment itself, not something that is waited for
        os.kill(pid, signal.SIGKILL)
        # Its output is complete once the process has ended.
        client.wait(lambda pid=pid: not Path(f'/proc/{pid}').exists(), 'its end')
        reported = reported_drops(output)
        (log,) = tmp_path.glob(f'*_{end}')
        recover_log(log)
        recovered = batches_in(log, f'{namespace}/{RESTING_POSES}')
        assert recovered == published[: len(recovered)]
        # A batch may be written but not reported yet.
        assert len(recovered) - 1 <= reported / BATCH <= len(recovered)
        kept.append(len(recovered))
    # All but perhaps a few, on a busy machine, were in the middle of writing, and nowhere else.
    assert sum(0 < number < BATCHES for number in kept) >= kills - 2, kept
    assert len(set(kept)) > kills / 2, kept

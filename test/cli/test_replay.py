"""`resting_aspects replay`: its progress and its end."""

import os
import re
import signal
from contextlib import closing

import pytest
from rclpy.serialization import serialize_message

from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.conversions import poses_msgs, time_msg
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range

DROPS, BATCH = 100, 20


@pytest.fixture
def log(tmp_path, part, surfaces):
    """Write a log with five batches, half a second apart."""
    job, run = plan_run(
        part('tetrahedron'), surfaces.get(), seed=1, drops=DROPS, run_id='run', started=10**18
    )
    poses = drop_range(job, 0, DROPS)
    topic = Topic('/resting_poses', 'resting_aspects_interfaces/msg/RestingPoses', Qos(2000))
    with closing(RunLog(tmp_path, 'log')) as log:
        for first in range(0, DROPS, BATCH):
            (batch,) = poses_msgs(
                poses.between(first, first + BATCH), run, time_msg(1), last=False
            )
            log.write(topic, serialize_message(batch), first * 5 * 10**8 // BATCH)
    return 'log'


ROS = ('--ros-args', '-r', f'__ns:=/replay_{os.getpid()}')


@pytest.mark.slow
def test_a_terminal_gets_a_bar_with_the_position(begin, terminal, log, wait_until):
    with terminal() as (theirs, shown):
        process = begin('replay', log, '--rate', 2, *ROS, stderr=theirs)
        os.close(theirs)
        wait_until(lambda: b'replayed in' in shown)
        process.send_signal(signal.SIGTERM)
        printed, _ = process.communicate(timeout=600)
    assert (process.returncode, printed) == (0, '')
    text = re.sub(r'\x1b\[[\d;?]*[A-Za-z]', '', shown.decode())
    positions = re.findall(r'replay (?:━|╸|╺)+ +(\d\.\d{3}) s of 2\.000 s, message (\d+)', text)
    assert positions[0] == ('0.000', '0')
    assert positions[-1] == ('2.000', '5')
    seconds = [float(each) for each, _ in positions]
    assert seconds == sorted(seconds)
    assert len({messages for _, messages in positions}) >= 3  # the number increases
    assert 'Traceback' not in text

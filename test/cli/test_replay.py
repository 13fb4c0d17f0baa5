"""`resting_aspects replay`: wrong input, progress and end of the command."""

import os
import pty
import re
import signal
import threading

import pytest
from rclpy.serialization import serialize_message

from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.conversions import poses_msg, time_msg
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range

DROPS, BATCH = 100, 20
# A log line of the node.
SAID = re.compile(r'(\x1b\[\d*m)?\[(INFO|WARN)\] \[\d+\.\d+\] \[replay_\d+\.log_replayer\]: .*')


@pytest.fixture
def log(tmp_path, part, surfaces):
    """Write a log with five batches, half a second apart."""
    job, run = plan_run(
        part('tetrahedron'), surfaces.get(), seed=1, drops=DROPS, run_id='run', started=10**18
    )
    poses = drop_range(job, 0, DROPS)
    topic = Topic('/resting_poses', 'resting_aspects_interfaces/msg/RestingPoses', Qos(2000))
    with RunLog(tmp_path, 'log') as log:
        for first in range(0, DROPS, BATCH):
            batch = poses_msg(poses.between(first, first + BATCH), run, time_msg(1), last=False)
            log.write(topic, serialize_message(batch), first * 5 * 10**8 // BATCH)
    return 'log'


ROS = ('--ros-args', '-r', f'__ns:=/replay_{os.getpid()}')


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        (['nowhere.mcap'], "log 'nowhere.mcap' cannot be read: No such file or directory"),
        (['folder'], "folder 'folder' is not a log: it has no .mcap file"),
        (['text.mcap'], "log 'text.mcap' is damaged, or not an MCAP file"),
        (['log', '--rate', '0'], "invalid --rate '0': expected 0.001 to 1000"),
        (['log', '--rate', '1001'], "invalid --rate '1001': expected 0.001 to 1000"),
        (['log', '--rate', '-1'], "invalid --rate '-1': expected 0.001 to 1000"),
        (['log', '--rate', 'fast'], "invalid --rate 'fast': expected a number"),
        (['log', '--rate', '2', '--as-fast-as-possible'], 'not allowed with argument --rate'),
        (['log', '--ros-args', '--bogus'], '--bogus'),
        ([], 'LOG'),
    ],
    ids=str,
)
def test_wrong_input_is_refused_in_one_line(refused, log, tmp_path, words, says):
    (tmp_path / 'text.mcap').write_text('aspect,count\n')
    (tmp_path / 'folder').mkdir()
    assert says in refused('replay', *words)


@pytest.mark.slow
def test_replay_without_terminal_prints_only_node_logs(begin, log, read_until):
    process = begin('replay', log, '--as-fast-as-possible', *ROS)
    heard = []
    end = read_until(process.stderr, lambda line: heard.append(line) or 'replayed in' in line)
    assert ': 5 messages; latched topics stay available until Ctrl-C' in end
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    printed, rest = process.communicate(timeout=600)
    assert (process.returncode, printed, rest) == (0, '', '')
    assert [line for line in heard if not SAID.fullmatch(line.strip())] == []
    assert len(heard) == 2  # start and end of the replay


def test_a_terminal_gets_a_bar_with_the_position(begin, log, wait_until):
    ours, theirs = pty.openpty()
    shown = bytearray()

    def read():
        while True:
            try:
                shown.extend(os.read(ours, 4096))
            except OSError:  # the other end is closed
                return

    reader = threading.Thread(target=read)
    reader.start()
    process = begin('replay', log, '--rate', 2, *ROS, stderr=theirs)
    os.close(theirs)
    wait_until(lambda: b'replayed in' in shown)
    process.send_signal(signal.SIGTERM)
    printed, _ = process.communicate(timeout=600)
    reader.join()
    os.close(ours)
    assert (process.returncode, printed) == (0, '')
    text = re.sub(r'\x1b\[[\d;?]*[A-Za-z]', '', shown.decode())
    positions = re.findall(r'replay (?:━|╸|╺)+ +(\d\.\d{3}) s of 2\.000 s, message (\d+)', text)
    assert positions[0] == ('0.000', '0')
    assert positions[-1] == ('2.000', '5')
    seconds = [float(each) for each, _ in positions]
    assert seconds == sorted(seconds)
    assert len({messages for _, messages in positions}) >= 3  # the number increases
    assert 'Traceback' not in text

"""`resting_aspects replay`: its progress and its end."""

import os
import re
import signal
from contextlib import closing

import pytest

from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.logs.writer import RunLog


@pytest.mark.slow
def test_a_terminal_gets_a_bar_with_the_position(begin, terminal, wait_until, tmp_path):
    topic = Topic('/chatter', 'std_msgs/msg/String', Qos(10))
    with closing(RunLog(tmp_path, 'log')) as log:
        for k in range(5):
            log.write(topic, b'\0\1\0\0\5\0\0\0four\0', k * 5 * 10**8)
    namespace = f'__ns:=/replay_{os.getpid()}'
    with terminal() as (theirs, shown):
        words = ('replay', 'log', '--rate', 2, '--ros-args', '-r', namespace)
        process = begin(*words, stderr=theirs)
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

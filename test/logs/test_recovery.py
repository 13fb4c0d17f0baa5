"""Recovery of logs that were not closed, verified with rosbags, an independent reader."""

import random
import signal
import subprocess
import sys
import time

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from wire import bag_messages

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.bag import recorded_outcome
from resting_aspects_ros.logs.topics import PART_TYPE, POSES_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog, recover_log

POSES = Topic('/cell/resting_poses', POSES_TYPE, Qos(2000, durability='transient_local'))
PART = Topic('/cell/parts/nut', PART_TYPE, Qos(1, durability='transient_local'))
MESH = random.Random(3).randbytes(3000)
NOTE = {'run_id': '4f1c', 'note': 'café: "yes"\nno'}
OUTCOME = {'outcome': {'whole': 'false', 'drops': '7'}}


def data(k):
    return random.Random(k).randbytes(200 + k)


def write(folder):
    """A log as the recorder writes it, and the size of the file after each batch."""
    log = RunLog(folder, 'run')
    log.add_metadata('run', NOTE)
    log.write(PART, b'\0\1\0\0part', 50)
    log.attach('nut.stl', 'model/stl', MESH, 51)
    log.flush()
    ends = []
    for k in range(8):
        log.write(POSES, data(k), 100 + k, 90 + k)
        log.flush()
        ends.append(log.path.stat().st_size)
    return log, ends


def cut(folder, content):
    """The folder of a log that was cut off."""
    folder.mkdir(parents=True)
    (folder / 'run_0.mcap').write_bytes(content)
    return folder


def expected(batches):
    poses = [(POSES.name, 100 + k, data(k)) for k in range(batches)]
    return [(PART.name, 50, b'\0\1\0\0part'), *poses]


def names_in(folder):
    return sorted(file.name for file in folder.iterdir())


@pytest.mark.slow
def test_truncated_log_keeps_all_flushed_messages(tmp_path):
    log, ends = write(tmp_path / 'made')
    log.close()
    content = log.path.read_bytes()
    # Around the ends of some chunks, and anywhere.
    cuts = {end + near for end in ends[::4] for near in (-1, 0, 1)}
    cuts |= set(range(ends[0], len(content), 3001))
    for size in sorted(cuts):
        folder = cut(tmp_path / f'cut_{size}', content[:size])
        assert not recover_log(folder, OUTCOME).closed
        found = bag_messages(folder)
        flushed = sum(end <= size for end in ends)
        # A chunk is whole a few bytes before its index is.
        assert found in (expected(flushed), expected(flushed + 1))
        with (folder / 'run_0.mcap').open('rb') as file:
            reader = make_reader(file, validate_crcs=True)
            (mesh,) = reader.iter_attachments()
            assert (mesh.name, mesh.media_type, mesh.data) == ('nut.stl', 'model/stl', MESH)
            notes = {each.name: each.metadata for each in reader.iter_metadata()}
            assert (notes['run'], notes['outcome']) == (NOTE, OUTCOME['outcome'])
            published = [m.publish_time for _, _, m in reader.iter_messages([POSES.name])]
            assert published == [90 + k for k in range(len(published))]
        assert recorded_outcome(folder).drops == 7
        again = recover_log(folder)
        assert (again.closed, again.messages) == (True, len(found))


def test_a_bare_file_gets_no_metadata_yaml(tmp_path):
    log, ends = write(tmp_path)
    file = tmp_path / 'other.mcap'
    file.write_bytes(log.path.read_bytes()[: ends[2]])
    log.close()
    (tmp_path / 'other.mcap.1f.recovering').touch()  # of one that was killed
    assert recover_log(file).messages == 4
    assert names_in(tmp_path) == ['other.mcap', 'run']


def test_log_of_a_living_writer_is_not_recovered(tmp_path):
    log, _ = write(tmp_path)
    before = log.path.read_bytes()
    assert recover_log(log.path.parent).being_written
    assert log.path.read_bytes() == before
    log.close()


def test_logs_of_any_topics_can_be_recovered(tmp_path):
    log = RunLog(tmp_path, 'run')
    text = Topic('/chatter', 'std_msgs/msg/String', Qos(7, 'best_effort'))
    log.write(text, b'\0\1\0\0\5\0\0\0four\0', 5)
    log.flush()
    folder = cut(tmp_path / 'talk', log.path.read_bytes())
    log.close()
    recover_log(folder)
    with Reader(folder) as reader:
        (connection,) = reader.connections
        assert connection.msgtype == 'std_msgs/msg/String'
        (qos,) = connection.ext.offered_qos_profiles
        assert (qos.depth, qos.reliability.name) == (7, 'BEST_EFFORT')


def test_full_disk_leaves_the_log_unchanged(tmp_path, no_space_after):
    log, ends = write(tmp_path / 'made')
    log.close()
    before = log.path.read_bytes()[: ends[-1]]
    folder = cut(tmp_path / 'run', before)
    with no_space_after(1000), pytest.raises(LogError, match='cannot be written: File too large'):
        recover_log(folder)
    assert (folder / 'run_0.mcap').read_bytes() == before
    assert names_in(folder) == ['run_0.mcap']


WRITE_UNTIL_KILLED = """
import sys
from pathlib import Path
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.logs.topics import POSES_TYPE, Qos, Topic
log = RunLog(Path(sys.argv[1]), 'run')
for i in range(10**9):
    log.write(Topic('/resting_poses', POSES_TYPE, Qos(1)), i.to_bytes(8, 'little') * 2000, i)
    log.flush()
    print(i, flush=True)
"""


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('moment', range(3))
def test_kill_loses_at_most_one_batch(tmp_path, moment):
    rest = random.Random(moment).uniform(0, 0.2)
    command = [sys.executable, '-c', WRITE_UNTIL_KILLED, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()
        time.sleep(rest)  # the moment itself, not something that is waited for
        process.send_signal(signal.SIGKILL)
        flushed = 1 + len([line for line in process.stdout if line.endswith('\n')])
    recover_log(tmp_path / 'run')
    found = [raw for _, _, raw in bag_messages(tmp_path / 'run')]
    assert flushed <= len(found) <= flushed + 1
    assert found == [i.to_bytes(8, 'little') * 2000 for i in range(len(found))]

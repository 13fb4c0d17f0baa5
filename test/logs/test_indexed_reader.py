"""Reading of a closed log by its index, and detection of a log without one."""

import os

import pytest

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.indexed_reader import IndexedLog, NoIndexError
from resting_aspects_ros.logs.run_writer import RunLog
from resting_aspects_ros.logs.topic_metadata import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    Qos,
    Topic,
)

POSES = Topic('/resting_poses', POSES_TYPE, Qos(2000))
NUT = Topic('/aspect_distributions/nut', DISTRIBUTION_TYPE, Qos(1))
CUBE = Topic('/aspect_distributions/cube', DISTRIBUTION_TYPE, Qos(1))


@pytest.fixture
def log(tmp_path):
    log = RunLog(tmp_path, 'run')
    log.add_metadata('run', {'note': 'café'})
    for k in range(5):
        log.write(POSES, bytes([k]) * 40, 10 * k)
        log.write(CUBE if k == 1 else NUT, bytes([100 + k]) * 40, 10 * k + 1)
        log.flush()
    return log


def test_first_last_counts_and_metadata(log):
    log.close()
    for place in (log.path, log.path.parent):
        with IndexedLog(place) as found:
            assert found.first(POSES_TYPE) == bytes(40)
            assert found.last(POSES_TYPE) == b'\4' * 40
            assert found.first(DISTRIBUTION_TYPE) == bytes([100]) * 40
            assert found.last(DISTRIBUTION_TYPE) == bytes([104]) * 40
            assert found.last(PART_TYPE) is None
            assert found.message_count == 10
            assert found.read_metadata()['run'] == {'note': 'café'}


def test_only_requested_chunks_are_read(log):
    log.close()
    content = bytearray(log.path.read_bytes())
    at = content.index(b'zstd') + 30  # poses, at the beginning
    content[at : at + 4] = bytes(4)
    log.path.write_bytes(content)
    with IndexedLog(log.path) as found:
        assert found.last(DISTRIBUTION_TYPE) == bytes([104]) * 40
        with pytest.raises(LogError, match='is damaged: '):
            found.first(POSES_TYPE)


def test_log_that_was_not_closed_has_no_index(log, tmp_path):
    expected = 'has no index: it was not closed, or is being written'
    with pytest.raises(NoIndexError, match=expected):
        IndexedLog(log.path)
    log.close()
    content = log.path.read_bytes()
    cut = tmp_path / 'cut.mcap'
    for size in [0, 3, 8, *range(9, len(content) - 1, 29)]:
        cut.write_bytes(content[:size])
        with pytest.raises(NoIndexError, match=expected):
            IndexedLog(cut)


def test_wrong_byte_in_the_index_is_damage(log):
    log.close()
    content = log.path.read_bytes()
    start = int.from_bytes(content[-28:-20], 'little')
    for at in range(start, len(content) - 8, 53):
        damaged = bytearray(content)
        damaged[at] ^= 0x10
        log.path.write_bytes(damaged)
        with pytest.raises(LogError, match=r'is damaged: found .*"mcap recover"'):
            IndexedLog(log.path)


def test_pipe_is_rejected_without_waiting(tmp_path):
    os.mkfifo(tmp_path / 'a.mcap')
    with pytest.raises(LogError, match=r'it has no \.mcap file'):
        IndexedLog(tmp_path)
    with pytest.raises(LogError, match='is neither a file nor a folder'):
        IndexedLog(tmp_path / 'a.mcap')


def test_missing_log_is_rejected(tmp_path):
    with pytest.raises(LogError, match='cannot be read: No such file'):
        IndexedLog(tmp_path / 'a.mcap')
    with pytest.raises(LogError, match=r'it has no \.mcap file'):
        IndexedLog(tmp_path)

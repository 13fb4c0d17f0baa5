"""Damaged logs: every reader returns what was written, or rejects the log in one line."""

import random
import struct
import tracemalloc
from contextlib import closing
from itertools import count

import lz4.frame
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from wire import bag_messages

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.reader import Recording, messages
from resting_aspects_ros.logs.topics import PART_TYPE, POSES_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog, recover_log

START = 1_700_000_000_123_456_789  # ns
PART_TIME = START - 50
POSES = Topic('/resting_poses', POSES_TYPE, Qos(2000))
PART = Topic('/parts/nut', PART_TYPE, Qos(1))
HEADER, SCHEMA, MESSAGE, CHUNK, ATTACHMENT = 1, 3, 5, 6, 9
MAGIC = b'\x89MCAP0\r\n'


def chunk_ends(content):
    """Where the records of chunks end in a file."""
    at = 8
    while at < len(content) - 8:
        opcode, at = content[at], at + 9 + int.from_bytes(content[at + 1 : at + 9], 'little')
        if opcode == CHUNK:
            yield at


class Sample:
    """A log with a message in each chunk, and copies of it to be damaged."""

    def __init__(self, folder):
        self._folder = folder
        self._numbers = count()
        with closing(RunLog(folder, 'run')) as log:
            log.add_metadata('run', {'note': 'café'})
            log.add_metadata('outcome', {'whole': 'true', 'drops': '6'})
            log.write(PART, b'\0\1\0\0part', PART_TIME)
            log.attach('nut.stl', 'model/stl', random.Random(3).randbytes(2000), START)
            log.flush()
            for k in range(6):
                log.write(POSES, random.Random(k).randbytes(200 + k), START + k)
                log.flush()
            self.unfinished = log.path.read_bytes()
        self.content = log.path.read_bytes()
        self.metadata = (log.path.parent / 'metadata.yaml').read_text()
        self.messages = bag_messages(log.path.parent)

    def copy(self, content, metadata=None):
        folder = self._folder / str(next(self._numbers)) / 'run'
        folder.mkdir(parents=True)
        (folder / 'run_0.mcap').write_bytes(content)
        if metadata is not None:
            (folder / 'metadata.yaml').write_text(metadata)
        return folder


@pytest.fixture(scope='module')
def sample(tmp_path_factory):
    return Sample(tmp_path_factory.mktemp('logs'))


def recovered(folder):
    """What rosbags reads of a log after it was recovered."""
    found = recover_log(folder)
    assert found.messages == len(bag_messages(folder))
    assert recover_log(folder).closed
    return bag_messages(folder)


def replayed(folder):
    try:
        recording = Recording(folder)
    except LogError as error:
        if 'at least one message' in str(error):
            return []
        raise
    return [(each.topic, each.time, each.data) for each in recording.messages(recording.topics)]


def in_order(folder):
    found = {name: list(messages(folder, name)) for name in (PART_TYPE, POSES_TYPE)}
    return [
        *((PART.name, PART_TIME + k, data) for k, data in enumerate(found[PART_TYPE])),
        *((POSES.name, START + k, data) for k, data in enumerate(found[POSES_TYPE])),
    ]


READERS = (in_order, replayed, recovered)


def check_all(sample, content):
    """Read a damaged copy of a sample with every reader; it may have lost messages at its end."""
    whole = sample.messages
    for read in READERS:
        folder = sample.copy(content, sample.metadata)
        try:
            found = read(folder)
        except LogError:
            assert (folder / 'run_0.mcap').read_bytes() == content
            continue
        assert found == whole[: len(found)]
        assert len(found) == len(whole) or not content.endswith(MAGIC)


# -- what is damaged before its end --------------------------------------------------------------


def damaged(content, kind, at, bit, length):
    """Flip a bit, cut, take out, put in, or set to zero."""
    content, at = bytearray(content), at % len(content)
    if kind == 'flip':
        content[at] ^= 1 << bit
    elif kind == 'cut':
        del content[at:]
    elif kind == 'take out':
        del content[at : at + length]
    elif kind == 'put in':
        content[at:at] = random.Random(at).randbytes(length)
    else:
        content[at : at + length] = bytes(len(content[at : at + length]))
    return bytes(content)


@pytest.mark.slow
@given(
    closed=st.booleans(),
    kind=st.sampled_from(['flip', 'cut', 'take out', 'put in', 'zeros']),
    at=st.integers(0, 2**16),
    bit=st.integers(0, 7),
    length=st.sampled_from([1, 30, 1000]),
)
def test_damaged_logs_are_read_correctly_or_rejected(sample, closed, kind, at, bit, length):
    content = sample.content if closed else sample.unfinished
    check_all(sample, damaged(content, kind, at, bit, length))


@pytest.mark.slow
def test_log_with_any_flipped_byte_is_rejected(sample):
    """Checksums cover all before the index, which no reader of the suite uses."""
    for at in range(8, int.from_bytes(sample.content[-28:-20], 'little') - 13, 293):
        content = damaged(sample.content, 'flip', at, at % 8, 1)
        with pytest.raises(LogError, match='is damaged: found'):
            in_order(sample.copy(content))


def test_log_that_is_truncated_anywhere_is_read_up_to_its_end(sample):
    """Each message is in a chunk of its own."""
    ends = list(chunk_ends(sample.content))
    assert len(ends) == len(sample.messages)
    near_ends = {end + near for end in ends for near in (-1, 0, 1)}
    for size in sorted(near_ends | set(range(0, len(sample.content), 293))):
        found = replayed(sample.copy(sample.content[:size]))
        assert found == sample.messages[: sum(end <= size for end in ends)]


# -- what contradicts itself ---------------------------------------------------------------------


def record_of(opcode, content, size=None):
    """A record whose length may be another one than that of its content."""
    return struct.pack('<BQ', opcode, len(content) if size is None else size) + content


def chunk_of(compression, data, unpacked, size=None):
    """A chunk with a declared size unpacked, whose size may be another one than that of data."""
    head = struct.pack('<QQQII', 0, 0, unpacked, 0, len(compression)) + compression.encode()
    return record_of(CHUNK, head + struct.pack('<Q', len(data) if size is None else size) + data)


START_OF_FILE = MAGIC + record_of(HEADER, bytes(8))


ZEROS = bytes(1 << 26)
FORGED = {
    'chunk with a wrong size': chunk_of('', b'x' * 100, 50),
    'zstd chunk of something else': chunk_of('zstd', b'x' * 100, 50),
    'lz4 chunk of something else': chunk_of('lz4', b'x' * 100, 50),
    'lz4 chunk that is cut': chunk_of('lz4', lz4.frame.compress(bytes(50))[:10], 50),
    'chunk of unknown compression': chunk_of('x' * 10**6, b'x' * 100, 50),
    'message of an unknown channel': record_of(MESSAGE, struct.pack('<HIQQ', 7, 0, 1, 1)),
    'zstd chunk of zeros': chunk_of('zstd', zstandard.compress(ZEROS), 1000),
    'lz4 chunk of zeros': chunk_of('lz4', lz4.frame.compress(ZEROS), 1000),
    'record': record_of(CHUNK, b'x', 2**60),
    'data of a chunk': chunk_of('', b'', 9, 2**56 - 1),
    'unpacked chunk': chunk_of('zstd', b'x', 2**60),
    'data of an attachment': record_of(ATTACHMENT, struct.pack('<QQIIQI', 0, 0, 0, 0, 2**60, 0)),
    'name of a schema': record_of(SCHEMA, struct.pack('<HI', 1, 2**32 - 1) + b'x'),
}


@pytest.mark.parametrize('forged', FORGED)
@pytest.mark.parametrize('end', [b'', MAGIC])
def test_forged_record_is_refused_with_little_memory(tmp_path, forged, end):
    file = tmp_path / 'forged.mcap'
    file.write_bytes(START_OF_FILE + FORGED[forged] + end)
    tracemalloc.start()
    try:
        # Other records may also be truncated ones, so that there is no message.
        reason = 'is damaged: found' if 'chunk' in forged else 'forged'
        with pytest.raises(LogError, match=reason) as caught:
            Recording(file)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 10**7
    assert len(str(caught.value)) < 700
    assert 'Error' not in str(caught.value)  # no name of a class

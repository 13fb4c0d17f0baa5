"""Damaged logs: every reader returns what was written, or rejects the log in one line."""

import random
import struct
import subprocess
import sys
import tracemalloc
import zlib
from contextlib import closing
from itertools import count

import lz4.frame
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Footer, Statistics
from mcap.writer import Writer
from rosbags.rosbag2 import Reader

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.mcap_file import MAX_RECORD
from resting_aspects_ros.logs.reader import Recording, messages, open_log
from resting_aspects_ros.logs.recovery import recover_log
from resting_aspects_ros.logs.topics import PART_TYPE, POSES_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog

START = 1_700_000_000_123_456_789  # ns
PART_TIME = START - 50
POSES = Topic('/resting_poses', POSES_TYPE, Qos(2000))
PART = Topic('/parts/nut', PART_TYPE, Qos(1))
CHATTER = Topic('/chatter', 'std_msgs/msg/String', Qos(1))
MESH = random.Random(3).randbytes(2000)
MESSAGE, CHUNK, CHUNK_INDEX, ATTACHMENT = 5, 6, 8, 9
STATISTICS, METADATA, DATA_END = 11, 12, 15
MAGIC = b'\x89MCAP0\r\n'


def messages_of(folder):
    """What rosbags reads through metadata.yaml: topic, log time and bytes."""
    with Reader(folder) as reader:
        return [(each.topic, at, bytes(raw)) for each, at, raw in reader.messages()]


def records_of(content):
    """Opcode, start and end of each record."""
    at, found = 8, []
    while at < len(content) - 8:
        end = at + 9 + int.from_bytes(content[at + 1 : at + 9], 'little')
        found.append((content[at], at, end))
        at = end
    return found


def record(content, opcode, number=0):
    return [(start, end) for kind, start, end in records_of(content) if kind == opcode][number]


class Sample:
    """A log with a message in each chunk, and copies of it to be damaged."""

    def __init__(self, folder):
        self._folder = folder
        self._numbers = count()
        with closing(RunLog(folder, 'run')) as log:
            log.add_metadata('run', {'note': 'café'})
            log.add_metadata('outcome', {'whole': 'true', 'drops': '6'})
            log.write(PART, b'\0\1\0\0part', PART_TIME)
            log.attach('nut.stl', 'model/stl', MESH, START)
            log.flush()
            for k in range(6):
                log.write(POSES, random.Random(k).randbytes(200 + k), START + k)
                log.flush()
            self.unfinished = log.path.read_bytes()
        self.content = log.path.read_bytes()
        self.metadata = (log.path.parent / 'metadata.yaml').read_text()
        self.messages = messages_of(log.path.parent)
        self.by_index = by_index(log.path.parent)

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
    assert found.messages == len(messages_of(folder))
    assert recover_log(folder).closed
    return messages_of(folder)


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


def by_index(folder):
    """First and last of each type, and their number; all messages of a log without an index."""
    with open_log(folder) as log:
        if not log.has_index:
            return in_order(folder)
        ends = [[log.first(name), log.last(name)] for name in (PART_TYPE, POSES_TYPE)]
        return [ends, log.message_count, log.outcome]


READERS = {'messages': in_order, 'replay': replayed, 'index': by_index, 'recover': recovered}


def check_all(sample, content):
    """Read a damaged copy of a sample with every reader; it may have lost messages at its end."""
    whole = sample.messages
    for name, read in READERS.items():
        folder = sample.copy(content, sample.metadata)
        try:
            found = read(folder)
        except LogError:
            assert (folder / 'run_0.mcap').read_bytes() == content
            continue
        # Metadata has no checksum of its own: an outcome that is not readable is unknown.
        if name == 'index' and found in (sample.by_index, [*sample.by_index[:2], None]):
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
    """Checksums cover all but the magic bytes; a reader of the index may not read the place."""
    for at in range(0, len(sample.content), 293):
        content = damaged(sample.content, 'flip', at, at % 8, 1)
        check_all(sample, content)
        if content.startswith(MAGIC) and content.endswith(MAGIC):
            with pytest.raises(LogError, match='is damaged: found'):
                in_order(sample.copy(content))


def test_log_that_is_truncated_anywhere_is_read_up_to_its_end(tmp_path):
    with closing(RunLog(tmp_path, 'run')) as log:
        for k in range(3):
            log.write(CHATTER, bytes([0, 1, 0, 0, k]) * 9, START + k)
            log.flush()
    content = log.path.read_bytes()
    whole = replayed(log.path)
    assert len(whole) == 3
    ends = [end for kind, _, end in records_of(content) if kind == CHUNK]
    near_ends = {end + near for end in ends for near in (-1, 0, 1)}
    for size in sorted(near_ends | set(range(0, len(content), 29))):
        log.path.write_bytes(content[:size])
        complete = sum(end <= size for end in ends)
        assert replayed(log.path) == whole[:complete]
        assert list(messages(log.path, CHATTER.type)) == [data for *_, data in whole[:complete]]


# -- what contradicts itself ---------------------------------------------------------------------


def rebuilt(content, change):
    """A log whose summary was changed, with checksums that fit."""
    start = int.from_bytes(content[-28:-20], 'little')
    footer = len(content) - 8 - 29
    summary = change(bytearray(content[start:footer]))
    builder = RecordBuilder()
    Footer(start, 0, 0).write(builder)
    head = builder.end()[:-4]
    crc = zlib.crc32(bytes(summary) + head)
    return content[:start] + bytes(summary) + head + struct.pack('<I', crc) + MAGIC


def without(opcode):
    def change(summary):
        found, at = bytearray(), 0
        while at < len(summary):
            end = at + 9 + int.from_bytes(summary[at + 1 : at + 9], 'little')
            if summary[at] != opcode:
                found += summary[at:end]
            at = end
        return found

    return change


def with_statistics(channels):
    def change(summary):
        builder = RecordBuilder()
        Statistics(1, 2, channels, 7, 7, 105, 50, 2, 2).write(builder)
        return without(STATISTICS)(summary) + builder.end()

    return change


SUMMARIES = {
    'statistics of an unknown channel': with_statistics({0: 1, 2: 6}),
    'no channels': without(4),
    'no schemas': without(3),
    'a channel of an unknown schema': lambda summary: summary.replace(
        b'\2\0\2\0' + struct.pack('<I', 14) + b'/resting_poses',
        b'\2\0\7\0' + struct.pack('<I', 14) + b'/resting_poses',
    ),
}


@pytest.mark.parametrize('summary', SUMMARIES)
def test_inconsistent_summary_is_not_used(sample, summary):
    content = rebuilt(sample.content, SUMMARIES[summary])
    assert content != sample.content
    with pytest.raises(LogError, match='is damaged: found'):
        by_index(sample.copy(content, sample.metadata))
    check_all(sample, content)


def test_message_of_unknown_channel_is_rejected(tmp_path):
    file = tmp_path / 'other.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start('ros2')
        channel = writer.register_channel('/chatter', 'cdr', 0)
        writer.add_message(channel, 1, b'\0\1\0\0', 1)
        writer.finish()
    content = bytearray(file.read_bytes())
    start, _ = record(content, MESSAGE)
    content[start + 9] = 7
    content[-16:-8] = bytes(8)
    file.write_bytes(content)
    for read in (replayed, recover_log):
        with pytest.raises(LogError, match='found a message of the unknown channel 7'):
            read(file)


# -- chunks that unpack to more than a log needs -------------------------------------------------


def mcap_of(chunk):
    """A file with one chunk, without an end."""
    builder = RecordBuilder()
    builder.start_record(1)
    builder.write_prefixed_string('ros2')
    builder.write_prefixed_string('')
    builder.finish_record()
    chunk.write(builder)
    return MAGIC + builder.end()


def zeros_zstd(size):
    packer = zstandard.ZstdCompressor().compressobj()  # without the size in its header
    block = bytes(1 << 20)
    return b''.join([packer.compress(block) for _ in range(size >> 20)]) + packer.flush()


def zeros_lz4(size):
    packer = lz4.frame.LZ4FrameCompressor()
    block = bytes(1 << 20)
    return (
        packer.begin() + b''.join(packer.compress(block) for _ in range(size >> 20))
    ) + packer.flush()


READ_WITHIN = """
import sys
from pathlib import Path
from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.reader import Recording, messages
from resting_aspects_ros.logs.recovery import recover_log
from resting_aspects_ros.logs.topics import POSES_TYPE
for read in (Recording, recover_log, lambda log: list(messages(log, POSES_TYPE))):
    try:
        read(Path(sys.argv[1]))
    except LogError as error:
        print(error)
# Its own peak; ru_maxrss begins with that of the process that started this one.
status = Path('/proc/self/status').read_text()
print(status.split('VmHWM:')[1].split()[0])
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ('packed', 'declared'), [(zeros_zstd, None), (zeros_zstd, 1000), (zeros_lz4, MAX_RECORD)]
)
def test_chunk_of_gigabytes_needs_little_memory(tmp_path, packed, declared):
    """The declared size of the chunk does not matter."""
    size = 1 << 30
    data = packed(size)
    name = packed.__name__.removeprefix('zeros_')
    file = tmp_path / 'bomb.mcap'
    file.write_bytes(mcap_of(Chunk(name, data, 1, 0, 0, declared or size)))
    command = [sys.executable, '-c', READ_WITHIN, file]
    *lines, most = subprocess.check_output(command, text=True).splitlines()
    assert len(lines) == 3
    for line in lines:
        assert f"log '{file}' is damaged: found a chunk " in line
    assert int(most) * 1024 < 3 * MAX_RECORD  # with the interpreter and what it imports


@pytest.mark.parametrize('compression', ['', 'zstd', 'lz4', 'x' * 10**6])
def test_chunk_with_wrong_header_is_rejected(tmp_path, compression):
    file = tmp_path / 'odd.mcap'
    for data in (b'x', b'x' * 100):
        file.write_bytes(mcap_of(Chunk(compression, data, 1, 0, 0, 50)))
        with pytest.raises(LogError, match='is damaged: found') as caught:
            Recording(file)
        assert len(str(caught.value)) < 700
        assert 'Error' not in str(caught.value)  # no name of a class


def record_of(opcode, content, size=None):
    """A record whose length may be another one than that of its content."""
    return bytes([opcode]) + struct.pack('<Q', len(content) if size is None else size) + content


FORGED = {
    'record': record_of(CHUNK, b'x', 2**60),
    'record in a closed file': record_of(METADATA, b'x', 2**40),
    'data of a chunk': record_of(CHUNK, struct.pack('<QQQII', 0, 0, 9, 0, 0) + bytes([255] * 7)),
    'unpacked chunk': record_of(
        CHUNK, struct.pack('<QQQII', 0, 0, 2**60, 0, 4) + b'zstd' + struct.pack('<Q', 1) + b'x'
    ),
    'data of an attachment': record_of(ATTACHMENT, struct.pack('<QQIIQI', 0, 0, 0, 0, 2**60, 0)),
    'name of a schema': record_of(3, struct.pack('<HI', 1, 2**32 - 1) + b'x'),
    'metadata of a channel': record_of(4, struct.pack('<HHIII', 1, 0, 0, 0, 2**32 - 1)),
}


@pytest.mark.parametrize('forged', FORGED)
@pytest.mark.parametrize('end', [b'', MAGIC])
def test_forged_size_needs_little_memory(tmp_path, forged, end):
    file = tmp_path / 'forged.mcap'
    file.write_bytes(MAGIC + record_of(1, struct.pack('<II', 0, 0)) + FORGED[forged] + end)
    tracemalloc.start()
    try:
        with pytest.raises(LogError, match=r'forged\.mcap'):
            Recording(file)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 10**7


# -- metadata.yaml -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'damage',
    [
        lambda text: '',
        lambda text: text[:300],
        lambda text: text.replace('message_count: 6', 'message_count: 5'),
        lambda text: '- 1',
        lambda text: 'rosbag2_bagfile_information: null',
        lambda text: 'x' * (2 << 20),
    ],
)
def test_wrong_metadata_yaml_is_replaced(sample, damage):
    folder = sample.copy(sample.content, damage(sample.metadata))
    found = recover_log(folder)
    assert (found.closed, found.messages) == (False, 7)
    assert (folder / 'metadata.yaml').read_text() == sample.metadata
    assert (folder / 'run_0.mcap').read_bytes() == sample.content
    assert recover_log(folder).closed

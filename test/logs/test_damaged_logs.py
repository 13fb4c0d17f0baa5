"""Logs that are damaged anywhere: what can be had is recovered, and nothing is lost in silence."""

import os
import random
from collections import Counter
from itertools import count

import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from rosbags.rosbag2 import Reader

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.logs import damaged_file, recovery
from resting_aspects_ros.logs.recovery import BrokenLog
from resting_aspects_ros.logs.run_log import RunLog
from resting_aspects_ros.logs.topics import PART_TYPE, POSES_TYPE, Qos, Topic

POSES = Topic('/resting_poses', POSES_TYPE, Qos(2000))
PART = Topic('/parts/nut', PART_TYPE, Qos(1))
MESH = random.Random(3).randbytes(2000)
MESSAGE, CHUNK, CHUNK_INDEX, ATTACHMENT = 5, 6, 8, 9
STATISTICS, METADATA, DATA_END = 11, 12, 15


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
        with RunLog(folder, 'run') as log:
            log.add_metadata('run', {'note': 'café'})
            log.write(PART, b'\0\1\0\0part', 50)
            log.attach('nut.stl', 'model/stl', MESH, 51)
            log.flush()
            for k in range(6):
                log.write(POSES, random.Random(k).randbytes(200 + k), 100 + k)
                log.flush()
            self.unfinished = log.path.read_bytes()
        self.content = log.path.read_bytes()
        self.metadata = (log.path.parent / 'metadata.yaml').read_text()
        self.messages = messages_of(log.path.parent)
        chunks = [(start, end) for kind, start, end in records_of(self.content) if kind == CHUNK]
        self.chunks = dict(zip(self.messages, chunks, strict=True))

    def copy(self, content, metadata=None):
        folder = self._folder / str(next(self._numbers)) / 'run'
        folder.mkdir(parents=True)
        (folder / 'run_0.mcap').write_bytes(content)
        if metadata is not None:
            (folder / 'metadata.yaml').write_text(metadata)
        return folder

    def flipped(self, at, mask=1):
        content = bytearray(self.content)
        content[at] ^= mask
        return self.copy(content, self.metadata)


@pytest.fixture(scope='module')
def sample(tmp_path_factory):
    return Sample(tmp_path_factory.mktemp('logs'))


def test_a_log_that_nobody_harmed_is_closed(sample):
    log = BrokenLog(sample.copy(sample.content, sample.metadata))
    assert log.closed
    assert not log.extent.damaged
    assert log.extent.losses() == []


@pytest.mark.parametrize('which', [0, 3, 6])
def test_a_bit_of_a_chunks_head_costs_that_chunk_and_the_old_file_is_kept(sample, which):
    message = sample.messages[which]
    start, _ = sample.chunks[message]
    others = [each for each in sample.messages if each != message]
    for bit in range(0, 72, 1 if which == 3 else 9):
        folder = sample.flipped(start + bit // 8, 1 << bit % 8)
        before = (folder / 'run_0.mcap').read_bytes()
        broken = BrokenLog(folder)
        assert not broken.closed
        kept = broken.recover({})
        assert kept == folder / 'run_0.mcap.damaged'
        assert kept.read_bytes() == before
        assert messages_of(folder) == others, bit
        assert broken.extent.messages == len(others)
        assert BrokenLog(folder).closed


def test_the_same_without_the_end_of_the_log(sample):
    start, _ = sample.chunks[sample.messages[3]]
    for at in (start, start + 2, start + 6):
        content = bytearray(sample.unfinished)
        content[at] ^= 0x40
        folder = sample.copy(content)
        assert BrokenLog(folder).recover({}).read_bytes() == content
        assert messages_of(folder) == sample.messages[:3] + sample.messages[4:]


def test_messages_whose_topic_is_lost_are_told_and_the_old_file_is_kept(sample):
    start, end = sample.chunks[sample.messages[1]]  # with the definition of all poses
    content = bytearray(sample.unfinished)
    content[end - 20] ^= 1
    broken = BrokenLog(sample.copy(content))
    assert (broken.extent.messages, broken.extent.lost_messages) == (1, 5)
    assert broken.recover({}) is not None
    assert broken.extent.losses() == ['1 chunk', '5 messages of unknown topics']
    # At the end of a log that was finished the definition is repeated.
    folder = sample.flipped((start + end) // 2)
    assert BrokenLog(folder).recover({}) is not None
    assert len(messages_of(folder)) == 6


# Where a byte of the log is another one, and whether the old file is kept: where all that is
# lost is made again it is not.
PLACES = {
    'header': (lambda content: 20, True),
    'chunk': (lambda content: record(content, CHUNK, 3)[1] - 30, True),
    'times of a chunk': (lambda content: record(content, CHUNK, 3)[0] + 10, True),
    'attachment': (lambda content: sum(record(content, ATTACHMENT)) // 2, True),
    'metadata': (lambda content: record(content, METADATA)[1] - 1, True),
    'end of the data': (lambda content: record(content, DATA_END)[0] + 10, True),
    'chunk index': (lambda content: record(content, CHUNK_INDEX, 2)[0] + 25, False),
    'statistics': (lambda content: record(content, STATISTICS)[0] + 9, False),
    'footer': (lambda content: len(content) - 25, False),
    'last byte': (lambda content: len(content) - 1, False),
}


@pytest.mark.parametrize('place', PLACES)
def test_a_log_with_a_wrong_byte_is_not_closed_until_it_is_recovered(sample, place):
    at, kept = PLACES[place]
    folder = sample.flipped(at(sample.content))
    broken = BrokenLog(folder)
    assert not broken.closed
    assert (broken.recover({}) is not None) == kept
    assert BrokenLog(folder).closed
    lost = sample.messages[3:4] if place == 'chunk' else []
    assert messages_of(folder) == [each for each in sample.messages if each not in lost]


@pytest.mark.parametrize(
    'damage',
    [
        lambda text: '',
        lambda text: text[:300],
        lambda text: text.replace('message_count: 6', 'message_count: 5'),
        lambda text: text.replace('café', 'cafe').replace('caf\\xE9', 'cafe'),
        lambda text: text + 'a: [',
        lambda text: '- 1',
        lambda text: 'rosbag2_bagfile_information: null',
    ],
)
def test_a_log_with_another_metadata_yaml_is_not_closed_until_it_is_recovered(sample, damage):
    folder = sample.copy(sample.content, damage(sample.metadata))
    broken = BrokenLog(folder)
    assert not broken.closed
    assert broken.recover({}) is None
    assert (folder / 'metadata.yaml').read_text() == sample.metadata
    assert BrokenLog(folder).closed


@pytest.mark.parametrize('with_metadata', [True, False])
def test_a_rotten_mesh_is_not_passed_on_as_good(sample, with_metadata):
    start, end = record(sample.content, ATTACHMENT)
    content = bytearray(sample.content)
    content[(start + end) // 2] ^= 1
    folder = sample.copy(content, sample.metadata if with_metadata else None)
    broken = BrokenLog(folder)
    assert broken.extent.losses() == ["attachment 'nut.stl'"]
    kept = broken.recover({})
    assert kept.read_bytes() == content
    with (folder / 'run_0.mcap').open('rb') as file:
        assert list(make_reader(file).iter_attachments()) == []
    assert messages_of(folder) == sample.messages


@pytest.mark.parametrize('crcs', [True, False])
def test_a_log_of_another_writer_is_held_to_its_index(tmp_path, crcs):
    """One that has no checksum over all of its data, or none at all."""
    file = tmp_path / 'other.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream, enable_crcs=crcs)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel('/chatter', 'cdr', schema)
        for k in range(3):
            writer.add_message(channel, k, b'\0\1\0\0\5\0\0\0four\0', k)
            writer.flush()
        writer.finish()
    content = file.read_bytes()
    assert BrokenLog(file).closed
    for at in (
        record(content, STATISTICS)[0] + 9,
        record(content, CHUNK_INDEX, 1)[0] + 9 + 16,
        record(content, CHUNK, 1)[0],
    ):
        damaged = bytearray(content)
        damaged[at] ^= 0x80
        file.write_bytes(damaged)
        assert not BrokenLog(file).closed, at


@pytest.fixture
def unchunked(tmp_path):
    """Write a file with five messages outside of chunks; its bytes, and theirs."""
    file = tmp_path / 'other.mcap'
    texts = [b'\0\1\0\0\5\0\0\0num%d\0' % k for k in range(5)]
    with file.open('wb') as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel('/chatter', 'cdr', schema)
        for k, text in enumerate(texts):
            writer.add_message(channel, k, text, k)
        writer.finish()
    return file, bytearray(file.read_bytes()), texts


def test_what_looks_like_messages_in_a_mesh_is_not_taken_for_some(tmp_path):
    like_one = bytes([MESSAGE, 30]) + bytes(7) + b'\1' + bytes(29)
    with RunLog(tmp_path, 'run') as log:
        log.attach('nut.stl', 'model/stl', 9 * like_one, 1)
        log.write(PART, b'\0\1\0\0part', 50)
    content = bytearray(log.path.read_bytes())
    content[record(content, ATTACHMENT)[0]] ^= 0x80
    log.path.write_bytes(content)
    extent = BrokenLog(log.path).extent
    assert (extent.messages, extent.lost_messages) == (1, 0)
    assert extent.lost_bytes > 9 * len(like_one)


def texts_in(file):
    with file.open('rb') as stream:
        return [message.data for _, _, message in make_reader(stream).iter_messages()]


def test_messages_outside_of_chunks_are_recovered_around_the_damage(unchunked):
    file, content, texts = unchunked
    content[record(content, MESSAGE, 2)[0] + 1] ^= 4  # the length of the third
    file.write_bytes(content)
    assert BrokenLog(file).recover({}) is not None
    assert texts_in(file) == [*texts[:2], *texts[3:]]


def test_messages_outside_of_chunks_are_recovered_up_to_where_the_file_is_cut(unchunked):
    file, content, texts = unchunked
    start, end = record(content, MESSAGE, 4)
    for size in (start, start + 1, start + 8, start + 9, start + 20, end - 1, end):
        file.write_bytes(content[:size])
        assert BrokenLog(file).recover({}) is None
        assert texts_in(file) == texts[: 4 + (size == end)]


def test_a_log_can_be_damaged_more_than_once(sample, monkeypatch):
    folder = sample.flipped(sample.chunks[sample.messages[5]][0])
    first = (folder / 'run_0.mcap').read_bytes()
    names = ['run_0.mcap.damaged', 'run_0.mcap.damaged_2', 'run_0.mcap.damaged_3']
    assert BrokenLog(folder).recover({}).name == names[0]
    for name, links in zip(names[1:], (True, False), strict=True):
        content = bytearray((folder / 'run_0.mcap').read_bytes())
        content[record(content, DATA_END)[0] + 10] ^= 1
        (folder / 'run_0.mcap').write_bytes(content)
        if not links:

            def no_links(*_):
                raise PermissionError(1, 'Operation not permitted')

            monkeypatch.setattr(damaged_file.os, 'link', no_links)
        kept = BrokenLog(folder).recover({})
        assert (kept.name, kept.read_bytes()) == (name, content)
    assert (folder / names[0]).read_bytes() == first


def test_of_two_that_recover_a_log_at_once_one_is_refused(sample, monkeypatch):
    folder = sample.copy(sample.unfinished)
    finish, refused = recovery.finish_file, []

    def meanwhile(*arguments):
        with pytest.raises(LogError, match=r'is being written, allowed is one that is not$'):
            refused.append(BrokenLog(folder).recover({}))
        refused.append(True)
        finish(*arguments)

    late = BrokenLog(folder)
    monkeypatch.setattr(recovery, 'finish_file', meanwhile)
    BrokenLog(folder).recover({})
    assert refused == [True]
    monkeypatch.undo()
    # Found broken before the first was done, recovered after it.
    with pytest.raises(LogError, match=r'was written meanwhile, it is left as it is$'):
        late.recover({})
    assert messages_of(folder) == sample.messages
    assert sorted(file.name for file in folder.iterdir()) == ['metadata.yaml', 'run_0.mcap']


def test_a_file_that_grows_where_there_are_no_locks_is_left_alone(sample, monkeypatch):
    folder = sample.copy(sample.unfinished[:-100])
    finish = recovery.finish_file

    def meanwhile(*arguments):
        finish(*arguments)
        (folder / 'run_0.mcap').write_bytes(sample.unfinished)

    monkeypatch.setattr(recovery, 'finish_file', meanwhile)
    monkeypatch.setattr(recovery, 'lock_file', lambda _: True)
    with pytest.raises(LogError, match='was written meanwhile'):
        BrokenLog(folder).recover({})
    assert [file.name for file in folder.iterdir()] == ['run_0.mcap']
    assert (folder / 'run_0.mcap').read_bytes() == sample.unfinished


def test_where_metadata_yaml_cannot_be_written_recovering_again_does_the_rest(sample):
    folder = sample.copy(sample.unfinished)
    (folder / 'metadata.yaml').mkdir()
    with pytest.raises(LogError, match='cannot be written: Is a directory'):
        BrokenLog(folder).recover({})
    broken = BrokenLog(folder)
    assert (broken.extent.finished, broken.closed) == (True, False)
    (folder / 'metadata.yaml').rmdir()
    broken.recover({})
    assert messages_of(folder) == sample.messages


def test_a_pipe_is_not_waited_for(sample):
    folder = sample.copy(sample.content)
    os.mkfifo(folder / 'metadata.yaml')
    assert not BrokenLog(folder).closed
    os.mkfifo(folder / 'a.mcap')
    assert BrokenLog(folder).extent.finished  # the file beside it
    with pytest.raises(LogError, match='is neither a file nor a folder'):
        BrokenLog(folder / 'a.mcap')
    (folder / 'run_0.mcap').unlink()
    with pytest.raises(LogError, match=r'no \.mcap file is in it'):
        BrokenLog(folder)


def read_from_the_start(path):
    """What another reader has of a log until it meets damage."""
    topics, found = {}, []
    try:
        with path.open('rb') as file:
            for outer in StreamReader(file, emit_chunks=True, record_size_limit=10**7).records:
                inner = breakup_chunk(outer, True) if isinstance(outer, Chunk) else []
                for each in inner:
                    if isinstance(each, Channel):
                        topics[each.id] = each.topic
                    elif isinstance(each, Message):
                        found.append((topics[each.channel_id], each.log_time, bytes(each.data)))
    except Exception:  # noqa: BLE001 - whatever it makes of it
        pass
    return found


def harm(content, rng):
    """Flip a bit, cut, take out, put in, or set to zero."""
    at = rng.randrange(9, len(content))
    length = rng.choice([1, 30, 1000])
    kind = rng.choice(['flip', 'flip', 'flip', 'cut', 'less', 'more', 'zeros'])
    if kind == 'flip':
        content[at] ^= 1 << rng.randrange(8)
    elif kind == 'cut':
        del content[at:]
    elif kind == 'less':
        del content[at : at + length]
    elif kind == 'more':
        content[at:at] = rng.randbytes(length)
    else:
        content[at : at + length] = bytes(len(content[at : at + length]))


@pytest.mark.parametrize('seed', range(60))
def test_nothing_that_can_be_read_is_lost_whatever_happens_to_a_log(sample, seed):
    rng = random.Random(seed)
    content = bytearray(rng.choice([sample.content, sample.unfinished]))
    for _ in range(rng.choice([1, 1, 2])):
        harm(content, rng)
    folder = sample.copy(content, sample.metadata)
    readable = read_from_the_start(folder / 'run_0.mcap')
    there = [each for each, (a, b) in sample.chunks.items() if sample.content[a:b] in content]
    broken = BrokenLog(folder)
    kept = broken.recover({})
    found = messages_of(folder)
    assert Counter(found) <= Counter(sample.messages)  # and nothing is made up
    assert broken.extent.messages == len(found)
    if kept is None:
        assert Counter(readable) <= Counter(found)
        assert Counter(there) <= Counter(found)
    else:
        assert kept.read_bytes() == content
    assert BrokenLog(folder).closed

"""Split and compressed bags, as `ros2 bag` records them, are read like a log of one file."""

import shutil
from itertools import pairwise

import pytest
import yaml
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

import resting_aspects_ros as ra
from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.reader import Recording
from resting_aspects_ros.logs.writer import recover_log

INFORMATION = 'rosbag2_bagfile_information'
DROPS = 300


@pytest.fixture(scope='module')
def log(run_in, tmp_path_factory):
    """The log of a run that the suite has written."""
    folder = tmp_path_factory.mktemp('logs')
    ended = run_in(folder, 'drop', 'tetrahedron', '--drops', DROPS, '--seed', 4, '--log', folder)
    assert ended.returncode == 0
    (path,) = folder.glob('*/metadata.yaml')
    return path.parent


def read(folder):
    """Return connection, time and bytes of each message, as rosbags reads them."""
    with Reader(folder) as reader:
        return [(each, time, bytes(data)) for each, time, data in reader.messages()]


def write(folder, messages, mode=CompressionMode.NONE):
    """Write messages to a bag of one file with rosbags."""
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        known = {}
        for each, time, data in messages:
            if each.topic not in known:
                known[each.topic] = writer.add_connection(
                    each.topic,
                    each.msgtype,
                    msgdef=each.msgdef.data,
                    rihs01=each.digest,
                    offered_qos_profiles=each.ext.offered_qos_profiles,
                )
            writer.write(known[each.topic], time, data)
    return folder


@pytest.fixture
def split(log, tmp_path):
    """Distribute the messages of the log over the files of a bag."""

    def split(groups, mode=CompressionMode.NONE):
        folder, listed, information = tmp_path / 'bag', [], None
        folder.mkdir()
        for k, messages in enumerate(groups):
            part = write(tmp_path / f'bag_{k}', messages, mode)
            information = yaml.safe_load((part / 'metadata.yaml').read_text())[INFORMATION]
            (name,) = information['relative_file_paths']
            shutil.move(part / name, folder / name)
            listed.append(name)
        information['relative_file_paths'] = listed
        document = yaml.safe_dump({INFORMATION: information})
        (folder / 'metadata.yaml').write_text(document)
        return folder

    return split


def thirds(messages):
    ends = [0, len(messages) // 3, 2 * len(messages) // 3, len(messages)]
    return [messages[a:b] for a, b in pairwise(ends)]


def replayed(path):
    recording = Recording(path)
    return [(each.topic, each.time, each.data) for each in recording.messages(recording.topics)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ('mode', 'name'), [(CompressionMode.NONE, ''), (CompressionMode.FILE, 'metadata.yaml')]
)
def test_split_bag_is_read_as_one_log(log, split, mode, name):
    messages = read(log)
    path = split(thirds(messages), mode) / name
    assert replayed(path) == [(each.topic, time, data) for each, time, data in messages]
    assert ra.read_log(path).distribution.drops == DROPS
    assert Recording(path).warning == ''


def test_messages_of_files_that_overlap_are_in_time_order(log, split):
    # As of a recorder that writes topics at different times; the files are not listed in order.
    messages = read(log)
    found = replayed(split([messages[1::2], messages[::2]]))
    assert [time for _, time, _ in found] == [time for _, time, _ in messages]
    assert sorted(found) == sorted((e.topic, time, data) for e, time, data in messages)


def test_bag_that_cannot_be_read_is_refused(log, split, tmp_path):
    messages = read(log)
    folder = split(thirds(messages))
    (folder / 'bag_1.mcap').unlink()
    one_by_one = write(tmp_path / 'one_by_one', messages, CompressionMode.MESSAGE)
    for reader in (Recording, ra.read_log):
        with pytest.raises(LogError, match=r'bag_1\.mcap$'):
            reader(folder)
        with pytest.raises(LogError, match=r'expected a bag .* --compression-mode file'):
            reader(one_by_one)


@pytest.fixture
def original(log):
    (path,) = log.glob('*.mcap')
    return path


def test_compressed_file_is_read(original, tmp_path, run):
    packed = tmp_path / 'run.mcap.zst'
    compress = zstandard.ZstdCompressor().compress
    content = original.read_bytes()
    # Two frames, as of files that were compressed in blocks.
    packed.write_bytes(compress(content[:5000]) + compress(content[5000:]))
    assert replayed(packed) == replayed(original)
    assert f'{DROPS} of {DROPS}' in run('info', packed).stdout
    with pytest.raises(LogError, match='expected one file that is not compressed'):
        recover_log(packed)


def test_damaged_compressed_file_is_refused_in_words(original, tmp_path, run):
    compressor = zstandard.ZstdCompressor(write_checksum=True)
    content = bytearray(compressor.compress(original.read_bytes()))
    content[len(content) // 2] ^= 0xFF
    packed = tmp_path / 'run.mcap.zstd'
    packed.write_bytes(content)
    ended = run('info', packed)
    assert ended.returncode != 0
    (line,) = ended.stderr.splitlines()
    assert 'run.mcap.zstd' in line
    assert 'Error' not in line


def test_truncated_compressed_file_is_read_to_its_end(log, original, tmp_path):
    packed = tmp_path / 'run.mcap.zstd'
    compressor = zstandard.ZstdCompressor(level=-5).compressobj()
    content = compressor.compress(original.read_bytes()[: original.stat().st_size // 2])
    packed.write_bytes(content + compressor.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK))
    found = replayed(packed)
    assert 0 < len(found) < len(read(log))
    assert found == replayed(original)[: len(found)]
    assert 'not closed' in Recording(packed).warning

"""What every MCAP file of the suite has: its profile, its channels, its end, and its lock.

Who writes or recovers a log holds an advisory lock on its file, at most until the process ends.
"""

import fcntl
import os
from typing import IO, BinaryIO

from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from resting_aspects_ros import __version__
from resting_aspects_ros.logs.bag_metadata import BagMetadata, TopicCount
from resting_aspects_ros.logs.topic_metadata import yaml_text

MAGIC = b'\x89MCAP0\r\n'
# The last record, before the magic bytes at the end.
FOOTER_SIZE = 29
# The record in which rosbag2 keeps a bag's metadata.yaml.
ROSBAG2 = 'rosbag2'


def start_file(stream: BinaryIO) -> Writer:
    """Begin a file; OSError if it cannot be written."""
    # With checksums over all of it, a flipped bit anywhere is found.
    writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
    library = f'resting_aspects_ros {__version__}; {LIBRARY_IDENTIFIER}'
    writer.start(profile='ros2', library=library)
    writer.flush()
    return writer


def register_channel(writer: Writer, schema_id: int, topic: TopicCount) -> int:
    """The channel of a topic, which says what metadata.yaml says, in the same words."""
    metadata = {
        'offered_qos_profiles': yaml_text(topic.qos),
        'topic_type_hash': topic.type_hash,
    }
    return int(writer.register_channel(topic.name, 'cdr', schema_id, metadata))


def finish_file(writer: Writer, stream: BinaryIO, metadata: BagMetadata) -> None:
    """Write index and summary, and bring the file to the disk; OSError if that cannot be."""
    # What rosbag2 shows of a file without its folder comes from this record.
    information = yaml_text(metadata.information())
    writer.add_metadata(ROSBAG2, {'serialized_metadata': information})
    writer.finish()
    stream.flush()
    os.fsync(stream.fileno())
    stream.close()


def lock_file(file: IO[bytes]) -> bool:
    """Lock a file; False if another has. Where the file system has no locks none is taken."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def is_locked(file: IO[bytes]) -> bool:
    """Whether another process, or another stream of this one, is writing the file."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return False

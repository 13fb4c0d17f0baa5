"""Common properties of the suite's MCAP files: profile, channels, end of file and lock.

An advisory lock is held on the file while a log is written or recovered. It is released at the
latest when the process ends.
"""

import fcntl
import os
from typing import IO, BinaryIO

from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from resting_aspects_ros import __version__
from resting_aspects_ros.logs.bag_metadata import BagMetadata, TopicCount
from resting_aspects_ros.logs.topic_metadata import yaml_text

MAGIC = b'\x89MCAP0\r\n'
# Size of the footer record, which precedes the magic bytes at the end.
FOOTER_SIZE = 29
# Name of the metadata record in which rosbag2 stores a bag's metadata.yaml.
ROSBAG2 = 'rosbag2'


def start_file(stream: BinaryIO) -> Writer:
    """Write the start of a file; raises OSError if it cannot be written."""
    # Checksums cover the whole file, so that every flipped bit is detected.
    writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
    library = f'resting_aspects_ros {__version__}; {LIBRARY_IDENTIFIER}'
    writer.start(profile='ros2', library=library)
    writer.flush()
    return writer


def register_channel(writer: Writer, schema_id: int, topic: TopicCount) -> int:
    """Add a channel for a topic, with the same metadata as in metadata.yaml; returns its id."""
    metadata = {
        'offered_qos_profiles': yaml_text(topic.qos),
        'topic_type_hash': topic.type_hash,
    }
    return int(writer.register_channel(topic.name, 'cdr', schema_id, metadata))


def finish_file(writer: Writer, stream: BinaryIO, metadata: BagMetadata) -> None:
    """Write index and summary, and sync the file to disk; raises OSError if this fails."""
    # rosbag2 reads this record when it opens the file without its folder.
    information = yaml_text(metadata.information())
    writer.add_metadata(ROSBAG2, {'serialized_metadata': information})
    writer.finish()
    stream.flush()
    os.fsync(stream.fileno())
    stream.close()


def lock_file(file: IO[bytes]) -> bool:
    """Lock a file; returns False if it is locked already.

    Returns True without a lock if the file system does not support locks.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def is_locked(file: IO[bytes]) -> bool:
    """Return whether another process, or another stream of this process, holds the lock."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return False

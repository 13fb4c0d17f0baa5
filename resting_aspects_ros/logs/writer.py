"""Writing of the log of one run: a folder with an MCAP file and metadata.yaml, as in rosbag2.

The file is self-contained: it has the definitions of the types, the QoS of the topics, and
attachments. Messages are passed as CDR bytes, so this module does not depend on ROS.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, BinaryIO, final

from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from resting_aspects_ros import __version__
from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import yaml_text
from resting_aspects_ros.logs.bag import BagMetadata, write_metadata
from resting_aspects_ros.logs.topics import (
    Topic,
    load_schema,
    qos_profiles,
)
from resting_aspects_ros.system import lock_file

# Name of the metadata record in which rosbag2 stores a bag's metadata.yaml.
ROSBAG2 = 'rosbag2'


def run_folder_name(part: str, started: datetime, run_id: str) -> str:
    """Return the name of a run's folder, such as `l_bracket_20250131T235959Z_4f1c`.

    started : datetime
        With a time zone; the name has it in UTC, in whole seconds.
    """
    utc = started.astimezone(timezone.utc)
    return f'{part}_{utc:%Y%m%dT%H%M%SZ}_{run_id}'


@final
class RunLog:
    """The log of one run while it is being written; to be used by one thread.

    Flushed data are not lost: if the process is killed, a reader that does not need the index at
    the end of the file can read them. After an error, every further write raises the same
    LogError; `close` then keeps the content of the file and raises nothing.

    folder : Path
        Folder of the logs; created if it does not exist.
    name : str
        Name of this log, see `run_folder_name`. Creates folder/name/name_0.mcap.

    Raises LogError if a log with this name exists or it cannot be written. `path` is the path of
    the MCAP file.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._folder = Path(folder) / name
        # rosbag2 numbers the files of a bag.
        self.path = self._folder / f'{name}_0.mcap'
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, tuple[int, str]] = {}
        self._metadata = BagMetadata(self.path.name)
        self._ended = ''  # why nothing can be written any more
        with self._guard():
            self._stream, self._writer = self._start()

    def write(
        self, topic: Topic, data: bytes, log_time: int, publish_time: int | None = None
    ) -> None:
        """Add a message.

        topic : Topic
            Its definition is written to the file with its first message.
        data : bytes
            The message as CDR, with the four bytes of its encapsulation header.
        log_time : int
            Time of reception, ns since 1970. If it is before the log time of the last message,
            that time is stored instead, because times in a log do not decrease.
        publish_time : int
            Time of publication, ns since 1970; None if unknown, log_time is used then.
        """
        publish_time = log_time if publish_time is None else publish_time
        with self._guard():
            channel = self._channel(topic)
            stored = max(log_time, self._metadata.end or 0)
            sequence = self._metadata.topics[topic.name]['message_count']
            self._writer.add_message(channel, stored, data, publish_time, sequence)
            self._metadata.count(topic.name, stored)

    def attach(self, name: str, media_type: str, data: bytes, log_time: int) -> None:
        """Add a file, such as the part's mesh, as an attachment; the time is in ns since 1970."""
        with self._guard():
            # 0: the creation time of the attachment is unknown.
            self._writer.add_attachment(0, log_time, name, media_type, data)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Add a metadata record, which metadata.yaml repeats as `name.key` in custom_data."""
        with self._guard():
            self._writer.add_metadata(name, values)
            self._metadata.add_record(name, values)

    def flush(self) -> None:
        """Write buffered data to the file, so that they survive the death of this process.

        Only `close` protects them against a power failure. Each call ends a chunk, the unit of
        compression, so call it once per batch.
        """
        with self._guard():
            self._writer.flush()

    def close(self) -> Path:
        """Finish the file and write metadata.yaml; a second call does nothing.

        Returns the run's folder. After an error, the folder has no metadata.yaml and the file has
        no index, as after a crash. Raises LogError if a log without errors cannot be finished.
        """
        try:
            if not self._ended:
                with self._guard():
                    finish_file(self._writer, self._stream, self._metadata)
                    write_metadata(self._folder, self._metadata)
        finally:
            self._ended = self._ended or f'log {self.path} is closed'
            _release(self._stream)
        return self._folder

    def _start(self) -> tuple[BinaryIO, Writer]:
        """Create folder and file; raises LogError if they exist, OSError if that fails."""
        try:
            self._folder.mkdir(parents=True)
        except FileExistsError:
            raise LogError(f'log {self._folder} exists already and is not overwritten') from None
        with ExitStack() as cleanup:
            cleanup.callback(self._folder.rmdir)
            stream = self.path.open('xb')
            cleanup.callback(self.path.unlink)  # nothing was written, and the file is not a log
            cleanup.callback(_release, stream)
            lock_file(stream)  # so that no other process recovers it meanwhile
            writer = start_file(stream)
            cleanup.pop_all()
        return stream, writer

    def _channel(self, topic: Topic) -> int:
        if topic.name not in self._channels:
            if topic.type not in self._schemas:
                text, type_hash = load_schema(topic.type)
                schema_id = self._writer.register_schema(topic.type, 'ros2msg', text.encode())
                self._schemas[topic.type] = schema_id, type_hash
            schema_id, type_hash = self._schemas[topic.type]
            metadata = self._metadata.add_topic(
                topic.name, topic.type, qos_profiles(topic.qos), type_hash
            )
            self._channels[topic.name] = register_channel(self._writer, schema_id, metadata)
        return self._channels[topic.name]

    @contextmanager
    def _guard(self) -> Iterator[None]:
        """Raise LogError if the log is closed or has failed, and store the first failure."""
        if self._ended:
            raise LogError(self._ended)
        try:
            yield
        except LogError:
            raise  # raised before anything was written
        except OSError as error:
            self._ended = f'log {self.path} cannot be written: {error.strerror or error}'
            raise LogError(self._ended) from error
        except BaseException as error:
            # The file may end with a partial record, after which no record could be read.
            self._ended = f'log {self.path} was interrupted: {error!r}'
            raise


def _release(stream: BinaryIO) -> None:
    """Close a file; this tries to write the buffer again, as space may have become free."""
    with suppress(OSError):
        stream.close()


# -- MCAP file ------------------------------------------------------------------------------------


def start_file(stream: BinaryIO) -> Writer:
    """Write the start of a file; raises OSError if it cannot be written."""
    # Checksums cover the whole file, so that every flipped bit is detected.
    writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
    library = f'resting_aspects_ros {__version__}; {LIBRARY_IDENTIFIER}'
    writer.start(profile='ros2', library=library)
    writer.flush()
    return writer


def register_channel(writer: Writer, schema_id: int, topic: Mapping[str, Any]) -> int:
    """Add a channel for a topic, with its `topic_metadata`; returns the id of the channel."""
    metadata = {
        'offered_qos_profiles': yaml_text(topic['offered_qos_profiles']),
        'topic_type_hash': topic['type_description_hash'],
    }
    return int(writer.register_channel(topic['name'], 'cdr', schema_id, metadata))


def finish_file(writer: Writer, stream: BinaryIO, metadata: BagMetadata) -> None:
    """Write index and summary, and sync the file to disk; raises OSError if this fails."""
    # rosbag2 reads this record when it opens the file without its folder.
    information = yaml_text(metadata.information())
    writer.add_metadata(ROSBAG2, {'serialized_metadata': information})
    writer.finish()
    stream.flush()
    os.fsync(stream.fileno())
    stream.close()

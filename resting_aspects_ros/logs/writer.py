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
from resting_aspects_ros.logs.bag import write_metadata
from resting_aspects_ros.logs.topics import (
    Topic,
    load_schema,
    qos_profiles,
)
from resting_aspects_ros.system import lock_file

# Name of the metadata record in which rosbag2 stores a bag's metadata.yaml.
ROSBAG2 = 'rosbag2'
# Starting time that rosbag2 writes for an empty bag.
NO_START = 2**63 - 1


def run_folder_name(part: str, started: datetime, run_id: str) -> str:
    """Return the name of a run's folder, such as `l_bracket_20250131T235959Z_4f1c`.

    started : datetime
        With a time zone; the name has it in UTC, in whole seconds.
    """
    utc = started.astimezone(timezone.utc)
    return f'{part}_{utc:%Y%m%dT%H%M%SZ}_{run_id}'


class BagWriter:
    """Writes an MCAP file, and counts its messages for the metadata.yaml of the bag.

    Every method raises OSError if the file cannot be written.

    mcap : mcap.writer.Writer
        Writes what is not in metadata.yaml: schemas and attachments.
    """

    def __init__(self, stream: BinaryIO, file_name: str) -> None:
        self._end = 0
        self._start: int | None = None
        self._stream = stream
        self._file_name = file_name
        self._topics: dict[str, dict[str, Any]] = {}  # those of metadata.yaml by name
        self._custom: dict[str, str] = {}
        # Checksums cover the whole file, so that every flipped bit is detected.
        self.mcap = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        library = f'resting_aspects_ros {__version__}; {LIBRARY_IDENTIFIER}'
        self.mcap.start(profile='ros2', library=library)
        self.mcap.flush()

    def add_channel(
        self, topic: str, type_name: str, schema: int, qos: list[dict[str, Any]], type_hash: str
    ) -> int:
        """Add a channel of a topic; returns its id.

        schema : id of the definition
        qos : the `offered_qos_profiles`, see `qos_profiles`
        """
        described = {
            'name': topic,
            'type': type_name,
            'serialization_format': 'cdr',
            'offered_qos_profiles': qos,
            'type_description_hash': type_hash,
        }
        self._topics.setdefault(topic, {'topic_metadata': described, 'message_count': 0})
        metadata = {'offered_qos_profiles': yaml_text(qos), 'topic_type_hash': type_hash}
        return int(self.mcap.register_channel(topic, 'cdr', schema, metadata))

    def add_message(
        self,
        topic: str,
        channel: int,
        data: bytes,
        log_time: int,
        publish_time: int,
        sequence: int | None = None,
    ) -> None:
        """Add a message; times are in ns since 1970.

        A log time before that of the last message is replaced by it, because times in a log do not
        decrease. Without a sequence, messages of the topic are numbered from 0.
        """
        counted = self._topics[topic]
        self._end = max(log_time, self._end)
        self._start = self._end if self._start is None else self._start
        number = counted['message_count'] if sequence is None else sequence
        self.mcap.add_message(channel, self._end, data, publish_time, number)
        counted['message_count'] += 1

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record, which metadata.yaml repeats as `name.key` in custom_data."""
        self.mcap.add_metadata(name, dict(values))
        self._custom.update({f'{name}.{key}': value for key, value in values.items()})

    def finish(self) -> dict[str, Any]:
        """Write index and summary, sync the file to disk and close it.

        Returns the values under `rosbag2_bagfile_information` of metadata.yaml.
        """
        information = self._information()
        # rosbag2 reads this record when it opens the file without its folder.
        self.mcap.add_metadata(ROSBAG2, {'serialized_metadata': yaml_text(information)})
        self.mcap.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()
        return information

    def _information(self) -> dict[str, Any]:
        start = NO_START if self._start is None else self._start
        extent = {
            'duration': {'nanoseconds': max(0, self._end - start)},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': sum(each['message_count'] for each in self._topics.values()),
        }
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **extent,
            'topics_with_message_count': list(self._topics.values()),
            # Compression of whole files or messages by rosbag2, which is not used. The chunks in
            # the file state their own compression.
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self._file_name],
            'files': [{'path': self._file_name, **extent}],
            'custom_data': self._custom,
            'ros_distro': 'jazzy',
        }


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
            self._writer.add_message(topic.name, channel, data, log_time, publish_time)

    def attach(self, name: str, media_type: str, data: bytes, log_time: int) -> None:
        """Add a file, such as the part's mesh, as an attachment; the time is in ns since 1970."""
        with self._guard():
            # 0: the creation time of the attachment is unknown.
            self._writer.mcap.add_attachment(0, log_time, name, media_type, data)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Add a metadata record, which metadata.yaml repeats as `name.key` in custom_data."""
        with self._guard():
            self._writer.add_metadata(name, values)

    def flush(self) -> None:
        """Write buffered data to the file, so that they survive the death of this process.

        Only `close` protects them against a power failure. Each call ends a chunk, the unit of
        compression, so call it once per batch.
        """
        with self._guard():
            self._writer.mcap.flush()

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        After an error, the folder has no metadata.yaml and the file has no index, as after a
        crash. Raises LogError if a log without errors cannot be finished.
        """
        try:
            if not self._ended:
                with self._guard():
                    write_metadata(self._folder, self._writer.finish())
        finally:
            self._ended = self._ended or f'log {self.path} is closed'
            _release(self._stream)

    def _start(self) -> tuple[BinaryIO, BagWriter]:
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
            writer = BagWriter(stream, self.path.name)
            cleanup.pop_all()
        return stream, writer

    def _channel(self, topic: Topic) -> int:
        if topic.name not in self._channels:
            if topic.type not in self._schemas:
                text, type_hash = load_schema(topic.type)
                schema = self._writer.mcap.register_schema(topic.type, 'ros2msg', text.encode())
                self._schemas[topic.type] = schema, type_hash
            schema, type_hash = self._schemas[topic.type]
            self._channels[topic.name] = self._writer.add_channel(
                topic.name, topic.type, schema, qos_profiles(topic.qos), type_hash
            )
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

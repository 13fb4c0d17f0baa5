"""Writing of the log of one run: a folder with an MCAP file and metadata.yaml, as in rosbag2.

The file is self-contained: it has the definitions of the types, the QoS of the topics, and
attachments. Messages are passed as CDR bytes, so this module does not depend on ROS. The recovery
of a log that was not closed copies its messages one by one without decoding them, so any log of
ROS 2 can be recovered.
"""

from __future__ import annotations

import glob
import os
import struct
import uuid
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, BinaryIO, final

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from resting_aspects_ros import __version__
from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import named, parse_yaml, printable, yaml_text
from resting_aspects_ros.logs.bag import FILE_NAME, is_compressed, log_files, write_metadata
from resting_aspects_ros.logs.reader import MAGIC, McapFile
from resting_aspects_ros.logs.topics import Qos, Topic, load_schema, qos_profiles
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


# -- recovery -------------------------------------------------------------------------------------


# QoS of a channel that does not record one, as rosbag2 assumes it.
_DEFAULT_QOS = Qos(10)
_Records = Mapping[str, dict[str, str]]


@dataclass(frozen=True)
class RecoveryResult:
    """Result of the recovery of a log.

    messages : int
        Number of messages in the log.
    being_written, closed : bool
        Whether a process is writing the log, or whether it was complete already. In both cases
        it was not changed.
    """

    messages: int
    being_written: bool = False
    closed: bool = False


def recover_log(log: Path, records: _Records | None = None) -> RecoveryResult:
    """Rewrite a log without its end, and write metadata.yaml if it is a folder.

    So is a log whose index at its end is damaged, which other programs need. The new file replaces
    the old one after it was synced to disk.

    log : Path
        The folder of a run, or its MCAP file.
    records : mapping
        Metadata records by name, which are added and replace those with the same name.

    Raises LogError if it is not a log, is damaged before its end, or cannot be written. The log
    is unchanged then. If only metadata.yaml cannot be written, a second recovery writes it.
    """
    path, *others = log_files(log)
    if others or is_compressed(path):
        raise LogError(
            f'{named("log", log)} cannot be recovered: expected one file that is not compressed'
        )
    if printable(path.name) != path.name:
        raise LogError(
            f'{named("log", path)} cannot be recovered: expected a file name in UTF-8, because '
            'the metadata contain it'
        )
    folder = log if log.is_dir() else None
    with ExitStack() as stack:
        file = McapFile(path, stack)
        # The lock is held during the recovery, so that no other process writes the log.
        if lock_file(file.stream) is False:
            return RecoveryResult(0, being_written=True)
        if (
            file.closed
            and _index_is_whole(file.stream)
            and (folder is None or (folder / FILE_NAME).is_file())
        ):
            return RecoveryResult(sum(1 for _ in file.messages()), closed=True)
        try:
            information = _replace_by_copy(file, records or {})
            if folder is not None:
                write_metadata(folder, information)
        except OSError as error:
            raise LogError(
                f'{named("log", path)} cannot be written: {error.strerror or error}'
            ) from error
        return RecoveryResult(file.message_count)


def _index_is_whole(stream: BinaryIO) -> bool:
    """Return whether the index of a closed file has its checksum, which the footer may omit."""
    footer = struct.Struct('<BQQQI')  # opcode, length, where the index and its offsets begin, CRC
    end = stream.seek(0, os.SEEK_END) - len(MAGIC)
    if end < footer.size:
        return False
    stream.seek(end - footer.size)
    opcode, _, start, _, crc = footer.unpack(stream.read(footer.size))
    if opcode != Opcode.FOOTER or start > end:
        return False
    stream.seek(start or end - footer.size)
    return crc in (0, zlib.crc32(stream.read(end - 4 - stream.tell())))


def _replace_by_copy(file: McapFile, records: _Records) -> dict[str, Any]:
    """Replace the file by a complete copy; returns the content of metadata.yaml.

    Raises OSError if this fails.
    """
    path = file.path
    for abandoned in path.parent.glob(f'{glob.escape(path.name)}.*.recovering'):
        abandoned.unlink()  # left by a recovery that was killed
    new = path.with_name(f'{path.name}.{uuid.uuid4().hex}.recovering')
    try:
        with new.open('xb') as stream:
            writer = BagWriter(stream, path.name)
            _copy(file, writer)
            for name, values in {**file.metadata, **records}.items():
                if name != ROSBAG2:
                    writer.add_metadata(name, values)
            information = writer.finish()
        new.replace(path)
    finally:
        with suppress(OSError):
            new.unlink()
    return information


def _copy(file: McapFile, writer: BagWriter) -> None:
    channels: dict[int, int] = {}
    schemas: dict[int, int] = {0: 0}  # 0: a channel without a schema
    for each in file.records():
        if isinstance(each, Attachment):
            writer.mcap.add_attachment(
                each.create_time, each.log_time, each.name, each.media_type, each.data
            )
            continue
        schema, channel, message = each
        if channel.id not in channels:
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.mcap.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            channels[channel.id] = writer.add_channel(
                channel.topic,
                each.type,
                schemas[channel.schema_id],
                _offered(channel),
                each.type_hash or '',
            )
        writer.add_message(
            channel.topic,
            channels[channel.id],
            message.data,
            message.log_time,
            message.publish_time,
            message.sequence,
        )


def _offered(channel: Channel) -> list[dict[str, Any]]:
    """Return the QoS profiles in the channel's metadata, or the default."""
    text = channel.metadata.get('offered_qos_profiles', '')
    try:
        offered = parse_yaml(text, 'QoS', LogError)
    except LogError:
        offered = None
    return offered if isinstance(offered, list) and offered else qos_profiles(_DEFAULT_QOS)

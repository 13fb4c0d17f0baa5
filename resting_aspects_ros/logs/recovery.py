"""Recovery of a log that was not closed: writes index, summary and metadata.yaml in one pass.

Messages are copied one by one without being decoded, so any log of ROS 2 can be recovered.
"""

import glob
import uuid
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Message, Metadata
from mcap.writer import Writer

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import is_printable, named, parse_yaml
from resting_aspects_ros.logs.bag_files import is_compressed, log_files
from resting_aspects_ros.logs.bag_metadata import (
    BagMetadata,
    TopicCount,
    read_information,
    write_metadata,
)
from resting_aspects_ros.logs.mcap_format import (
    ROSBAG2,
    finish_file,
    lock_file,
    register_channel,
    start_file,
)
from resting_aspects_ros.logs.message_reader import check_definition, written_hash
from resting_aspects_ros.logs.record_reader import LogFile
from resting_aspects_ros.logs.topic_metadata import Qos, qos_profiles

# QoS of a channel that does not record one, as rosbag2 assumes it.
_DEFAULT_QOS = Qos(10)


@dataclass
class RecoveryCounter:
    """Counts the messages of a log while it is recovered.

    add : called with type and CDR of each message of the types
    metadata : called after the last message; returns metadata records by name, which replace
        records with the same name
    error : str
        Reason why the messages cannot be counted: ``add`` raised a LogError, or the log was
        written with definitions that differ from the installed ones. The log is still recovered.
    """

    types: Collection[str]
    add: Callable[[str, bytes], None]
    metadata: Callable[[], Mapping[str, dict[str, str]]]
    error: str = ''

    def check(self, path: Path, type_name: str, type_hash: str | None) -> None:
        """Set the error if the messages of a channel cannot be counted."""
        if type_name in self.types:
            try:
                check_definition(path, type_name, type_hash)
            except LogError as error:
                self.error = self.error or str(error)

    def count(self, type_name: str, data: bytes) -> None:
        """Count a message."""
        if type_name in self.types and not self.error:
            try:
                self.add(type_name, data)
            except LogError as error:
                self.error = str(error)

    def result(self) -> Mapping[str, dict[str, str]]:
        """Return the metadata records to be written."""
        try:
            return {} if self.error else self.metadata()
        except LogError as error:
            self.error = str(error)
            return {}


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


def recover_log(log: Path, counter: RecoveryCounter | None = None) -> RecoveryResult:
    """Rewrite a log that was not closed with its end, and with metadata.yaml if it is a folder.

    The new file replaces the old one after it was synced to disk. For a closed log, only
    metadata.yaml is written, and only if it does not match the log.

    log : Path
        The folder of a run, or its MCAP file.

    Raises LogError if it is not a log, is damaged before its end, or cannot be written. The log
    is unchanged then. If only metadata.yaml cannot be written, a second recovery writes it.
    """
    path, *others = log_files(log)
    if others or is_compressed(path):
        raise LogError(
            f'{named("log", log)} cannot be recovered: expected one file that is not compressed'
        )
    with LogFile(path) as file:
        if not is_printable(file.path.name):
            raise LogError(
                f'{named("log", file.path)} cannot be recovered: expected a file name in UTF-8, '
                'because the metadata contain it'
            )
        # The lock is held during the recovery, so that no other process writes the log.
        if not lock_file(file.stream):
            return RecoveryResult(0, being_written=True)
        try:
            return _Recovery(file, log if log.is_dir() else None, counter).run()
        except OSError as error:
            raise LogError(
                f'{named("log", file.path)} cannot be written: {error.strerror or error}'
            ) from error


class _Recovery:
    def __init__(
        self, file: LogFile, folder: Path | None, counter: RecoveryCounter | None
    ) -> None:
        self._file = file
        self._folder = folder
        self._counter = counter or RecoveryCounter((), lambda *_: None, dict)
        self._metadata = BagMetadata(file.path.name)
        self._topics: dict[int, TopicCount] = {}  # by channel

    def run(self) -> RecoveryResult:
        closed = self._file.summary() is not None
        if closed:
            for _ in self._contents():
                pass
            self._add_records(self._file.metadata)
        else:
            self._copy()
        folder = self._folder
        if folder is not None and read_information(folder) != self._metadata.information():
            closed = False
            write_metadata(folder, self._metadata)
        return RecoveryResult(self._file.messages, closed=closed)

    def _contents(self) -> Iterator[Message | Attachment]:
        """Yield messages and attachments in file order, and count the messages."""
        for record in self._file.records():
            if isinstance(record, Metadata):
                continue  # metadata records are written at the end
            if isinstance(record, Message):
                topic = self._topic(record.channel_id)
                record.log_time = max(record.log_time, self._metadata.end or 0)
                self._metadata.count(topic.name, record.log_time)
                self._counter.count(topic.type, record.data)
            yield record

    def _topic(self, channel_id: int) -> TopicCount:
        """Return the topic of a channel."""
        if channel_id not in self._topics:
            channel = self._file.channels[channel_id]
            type_name, type_hash = self._file.type_of(channel_id), written_hash(channel)
            topic = TopicCount(channel.topic, type_name, _offered(channel), type_hash or '')
            self._topics[channel_id] = self._metadata.topics.setdefault(topic.name, topic)
            self._counter.check(self._file.path, type_name, type_hash)
        return self._topics[channel_id]

    def _add_records(
        self, records: Mapping[str, dict[str, str]]
    ) -> list[tuple[str, dict[str, str]]]:
        """Copy metadata records to metadata.yaml; returns them without that of rosbag2."""
        own = [(name, values) for name, values in records.items() if name != ROSBAG2]
        for name, values in own:
            self._metadata.add_record(name, values)
        return own

    def _copy(self) -> None:
        """Replace the file by a complete copy; raises OSError if this fails."""
        path = self._file.path
        for abandoned in path.parent.glob(f'{glob.escape(path.name)}.*.recovering'):
            abandoned.unlink()  # left by a recovery that was killed
        new = path.with_name(f'{path.name}.{uuid.uuid4().hex}.recovering')
        try:
            with new.open('xb') as stream:
                writer = start_file(stream)
                self._write(writer)
                records = {**self._file.metadata, **self._counter.result()}
                for name, values in self._add_records(records):
                    writer.add_metadata(name, values)
                finish_file(writer, stream, self._metadata)
            new.replace(path)
        finally:
            with suppress(OSError):
                new.unlink()

    def _write(self, writer: Writer) -> None:
        """Copy the messages and attachments."""
        channels: dict[int, int] = {}
        schemas: dict[int, int] = {0: 0}  # 0: a channel without a schema
        for record in self._contents():
            if isinstance(record, Attachment):
                writer.add_attachment(
                    record.create_time,
                    record.log_time,
                    record.name,
                    record.media_type,
                    record.data,
                )
                continue
            key = record.channel_id
            if key not in channels:
                schema_id = self._file.channels[key].schema_id
                if schema_id not in schemas:
                    schema = self._file.schemas[schema_id]
                    schemas[schema_id] = writer.register_schema(
                        schema.name, schema.encoding, schema.data
                    )
                channels[key] = register_channel(writer, schemas[schema_id], self._topic(key))
            writer.add_message(
                channels[key], record.log_time, record.data, record.publish_time, record.sequence
            )


def _offered(channel: Channel) -> list[dict[str, Any]]:
    """Return the QoS profiles in the channel's metadata, or the default."""
    text = channel.metadata.get('offered_qos_profiles', '')
    try:
        offered = parse_yaml(text, 'QoS', LogError)
    except LogError:
        offered = None
    return offered if isinstance(offered, list) and offered else qos_profiles(_DEFAULT_QOS)

"""Close a log that was broken off: index, summary and metadata.yaml, in one pass over it.

What is read is copied message by message; nothing is decoded, so any log of ROS 2 will do.
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

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.core.input_file import is_printable, named
from resting_aspects_ros.core.yaml_file import parse_yaml
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
from resting_aspects_ros.logs.message_reader import check_definition, one_file, written_hash
from resting_aspects_ros.logs.record_reader import LogFile
from resting_aspects_ros.logs.topic_metadata import Qos, qos_profiles

# Of a channel that does not say what was offered: what rosbag2 takes for it.
_DEFAULT_QOS = Qos(10)


@dataclass
class RecoveryCounter:
    """Counts what is in a log while it is recovered.

    take : called with type and CDR of each message of the types
    notes : called after the last message; gives records of free text by name, which are written
        instead of those of the same name
    error : str
        Why the messages cannot be counted, if take raised a LogError, or they were written with
        other definitions than the installed ones. The log is recovered nevertheless.
    """

    types: Collection[str]
    take: Callable[[str, bytes], None]
    notes: Callable[[], Mapping[str, dict[str, str]]]
    error: str = ''

    def check(self, path: Path, type_name: str, type_hash: str | None) -> None:
        """Note if the messages of a channel cannot be counted."""
        if type_name in self.types:
            try:
                check_definition(path, type_name, type_hash)
            except LogError as error:
                self.error = self.error or str(error)

    def count(self, type_name: str, data: bytes) -> None:
        """Count a message."""
        if type_name in self.types and not self.error:
            try:
                self.take(type_name, data)
            except LogError as error:
                self.error = str(error)

    def result(self) -> Mapping[str, dict[str, str]]:
        """Return the records to be written."""
        try:
            return {} if self.error else self.notes()
        except LogError as error:
            self.error = str(error)
            return {}


@dataclass(frozen=True)
class RecoveryResult:
    """What became of a log.

    messages : int
        That are in it.
    being_written, closed : bool
        A process is writing it, or nothing was missing: it was left as it is.
    """

    messages: int
    being_written: bool = False
    closed: bool = False


def recover_log(log: Path, account: RecoveryCounter | None = None) -> RecoveryResult:
    """Write a log that was broken off anew, with its end, and metadata.yaml if it is a folder.

    The new file takes the place of the old one when it is on the disk. Of a log that has its end
    only metadata.yaml is written, if it is not what belongs to the log.

    log : Path
        The folder of a run, or its MCAP file.

    Raises LogError if it is no log, is damaged before its end, or cannot be written; then it is as
    it was. If metadata.yaml alone cannot be written, recovering it again does the rest.
    """
    with LogFile(one_file(log)) as file:
        if not is_printable(file.path.name):
            raise LogError(
                f'{named("log", file.path)} cannot be recovered: expected a file name in UTF-8, '
                'because the metadata contain it'
            )
        # Kept while it is recovered, so that nobody else writes it.
        if not lock_file(file.stream):
            return RecoveryResult(0, being_written=True)
        try:
            return _Recovery(file, log if log.is_dir() else None, account).run()
        except OSError as error:
            raise LogError(
                f'{named("log", file.path)} cannot be written: {error.strerror or error}'
            ) from error


class _Recovery:
    def __init__(
        self, file: LogFile, folder: Path | None, account: RecoveryCounter | None
    ) -> None:
        self._file = file
        self._folder = folder
        self._account = account or RecoveryCounter((), lambda *_: None, dict)
        self._metadata = BagMetadata(file.path.name)
        self._topics: dict[int, TopicCount] = {}  # by channel

    def run(self) -> RecoveryResult:
        closed = self._file.summary() is not None
        if closed:
            for _ in self._contents():
                pass
            self._note(self._file.texts)
        else:
            self._copy()
        folder = self._folder
        if folder is not None and read_information(folder) != self._metadata.information():
            closed = False
            write_metadata(folder, self._metadata)
        return RecoveryResult(self._file.messages, closed=closed)

    def _contents(self) -> Iterator[Message | Attachment]:
        """Read messages and attachments in their order; count the messages, keep the notes."""
        for record in self._file.records():
            if isinstance(record, Metadata):
                continue  # it comes last, in what is written
            if isinstance(record, Message):
                topic = self._topic(record.channel_id)
                record.log_time = max(record.log_time, self._metadata.end or 0)
                self._metadata.count(topic.name, record.log_time)
                self._account.count(topic.type, record.data)
            yield record

    def _topic(self, channel_id: int) -> TopicCount:
        """Describe the topic of a channel."""
        if channel_id not in self._topics:
            channel = self._file.channels[channel_id]
            type_name, type_hash = self._file.type_of(channel_id), written_hash(channel)
            topic = TopicCount(channel.topic, type_name, _offered(channel), type_hash or '')
            self._topics[channel_id] = self._metadata.topics.setdefault(topic.name, topic)
            self._account.check(self._file.path, type_name, type_hash)
        return self._topics[channel_id]

    def _note(self, texts: Mapping[str, dict[str, str]]) -> list[tuple[str, dict[str, str]]]:
        """Repeat records of free text in the metadata; returns them."""
        own = [(name, values) for name, values in texts.items() if name != ROSBAG2]
        for name, values in own:
            self._metadata.note(name, values)
        return own

    def _copy(self) -> None:
        """Write the file anew in the place of the old one; OSError if that cannot be."""
        path = self._file.path
        for left in path.parent.glob(f'{glob.escape(path.name)}.*.recovering'):
            left.unlink()  # of one that was killed
        new = path.with_name(f'{path.name}.{uuid.uuid4().hex}.recovering')
        try:
            with new.open('xb') as stream:
                writer = start_file(stream)
                self._write(writer)
                for name, values in self._note({**self._file.texts, **self._account.result()}):
                    writer.add_metadata(name, values)
                finish_file(writer, stream, self._metadata)
            new.replace(path)
        finally:
            with suppress(OSError):
                new.unlink()

    def _write(self, writer: Writer) -> None:
        """Copy the messages and attachments."""
        channels: dict[int, int] = {}
        schemas: dict[int, int] = {0: 0}  # of a channel without one
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
    """The QoS that the channel's metadata has as text."""
    text = channel.metadata.get('offered_qos_profiles', '')
    try:
        offered = parse_yaml(text, 'QoS', LogError)
    except LogError:
        offered = None
    return offered if isinstance(offered, list) and offered else qos_profiles(_DEFAULT_QOS)

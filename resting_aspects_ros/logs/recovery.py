"""Close a log that was broken off: index, summary and metadata.yaml.

What is read is copied message by message; nothing is decoded, so any log of ROS 2 will do.
"""

import glob
import uuid
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import yaml
from mcap.exceptions import InvalidMagic
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import Writer

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.core.file_names import is_printable
from resting_aspects_ros.logs.bag_metadata import (
    BagMetadata,
    TopicCount,
    read_information,
    write_metadata,
)
from resting_aspects_ros.logs.damaged_file import keep_damaged
from resting_aspects_ros.logs.file_lock import lock_file
from resting_aspects_ros.logs.log_reader import (
    check_definition,
    is_being_written,
    one_file,
    written_hash,
)
from resting_aspects_ros.logs.mcap_file import ROSBAG2, finish_file, register_channel, start_file
from resting_aspects_ros.logs.record_scan import scan
from resting_aspects_ros.logs.survey import Extent, Survey
from resting_aspects_ros.logs.topics import Qos, qos_profiles

# Of a channel that does not say what was offered: what rosbag2 takes for it.
_DEFAULT_QOS = Qos(10)


class BrokenLog:
    """A log that may have been broken off, and all that can be read of it.

    log : Path
        The folder of a run, or its MCAP file.

    Raises LogError if it is no log.
    """

    def __init__(self, log: Path) -> None:
        self.path = one_file(log)
        self._folder = log if log.is_dir() else None
        with self._reading() as file:
            self._state = _state(self.path)
            try:
                self._survey = Survey(file)
            except InvalidMagic:
                raise LogError(f'{str(self.path)!r} is no MCAP file') from None

    @property
    def extent(self) -> Extent:
        """How much of it can be read."""
        return self._survey.extent

    @property
    def closed(self) -> bool:
        """Nothing is missing or wrong, neither in the file nor beside it; all of it is read."""
        if not self.extent.finished or self.extent.damaged:
            return False
        if self._folder is None:
            return True
        metadata = BagMetadata(self.path.name)
        for _ in self._contents(metadata, {}):
            pass
        return read_information(self._folder) == metadata.information()

    @property
    def being_written(self) -> bool:
        """Whether a process is writing it now."""
        return is_being_written(self.path)

    def messages(self, types: Collection[str]) -> Iterator[tuple[str, bytes]]:
        """Type and CDR of each message of these types, in the order of the file.

        Raises LogError if one was written with another definition than the installed one.
        """
        for channel in self._survey.channels.values():
            schema = self._survey.schemas.get(channel.schema_id)
            if schema is not None and schema.name in types:
                check_definition(self.path, schema.name, written_hash(channel))
        for record in self._records():
            if isinstance(record, Message) and self._survey.is_known(record.channel_id):
                name = self._schema(record.channel_id).name
                if name in types:
                    yield name, record.data

    def recover(self, notes: Mapping[str, dict[str, str]]) -> Path | None:
        """Write the file anew, with its end, and metadata.yaml if the log is a folder.

        The new file takes the place of the old one when it is on the disk. The old one is kept
        if more of it is damaged than the end that was broken off.

        notes : mapping
            Records of free text by name, written instead of those of the same name.

        Returns where the old file is kept; None if it is not. Raises LogError if the file cannot
        be written, or a process is writing it; then it is as it was. If metadata.yaml alone cannot
        be written, the file is the new one, and recovering it again does the rest.
        """
        if not is_printable(self.path.name):
            raise LogError(
                f'log {str(self.path)!r} cannot be recovered: allowed is a file with a name in '
                'UTF-8, which its metadata repeat'
            )
        new = self.path.with_name(f'{self.path.name}.{uuid.uuid4().hex}.recovering')
        try:
            with self._locked():
                self._check_unchanged()
                for left in self.path.parent.glob(f'{glob.escape(self.path.name)}.*.recovering'):
                    left.unlink()  # of one that was killed
                with new.open('xb') as stream:
                    metadata = self._copy(stream, notes)
                self._check_unchanged()  # where the file system has no locks
                kept = keep_damaged(self.path) if self.extent.damaged else None
                new.replace(self.path)
                if self._folder is not None:
                    write_metadata(self._folder, metadata)
        except OSError as error:
            raise LogError(
                f'log {str(self.path)!r} cannot be written: {error.strerror or error}'
            ) from error
        finally:
            with suppress(OSError):
                new.unlink()
        return kept

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Keep all others from writing or recovering the file; LogError if one does."""
        with self.path.open('rb') as file:
            if not lock_file(file):
                raise LogError(
                    f'log {str(self.path)!r} is being written, allowed is one that is not'
                )
            yield

    def _check_unchanged(self) -> None:
        if _state(self.path) != self._state:
            raise LogError(f'log {str(self.path)!r} was written meanwhile, it is left as it is')

    @contextmanager
    def _reading(self) -> Iterator[BinaryIO]:
        try:
            with self.path.open('rb') as file:
                yield file
        except OSError as error:
            raise LogError(f'log {str(self.path)!r} cannot be read: {error.strerror}') from None

    def _records(self) -> Iterator[McapRecord]:
        """All records that can be read, those in chunks one by one."""
        with self._reading() as file:
            for piece in scan(file, self._survey.stop):
                yield from piece.content or ()

    def _contents(
        self, metadata: BagMetadata, notes: Mapping[str, dict[str, str]]
    ) -> Iterator[McapRecord]:
        """What a recovered file holds, in its order; it is counted in metadata."""
        for record in self._records():
            if isinstance(record, Message) and self._survey.is_known(record.channel_id):
                topic = self._survey.channels[record.channel_id].topic
                metadata.topics.setdefault(topic, self._topic(record.channel_id))
                record.log_time = max(record.log_time, metadata.end or 0)
                metadata.count(topic, record.log_time)
                yield record
            elif isinstance(record, Attachment):
                yield record
            elif isinstance(record, Metadata) and record.name not in {ROSBAG2, *notes}:
                yield _counted(record, metadata)
        for name, values in notes.items():
            yield _counted(Metadata(name, values), metadata)

    def _copy(self, stream: BinaryIO, notes: Mapping[str, dict[str, str]]) -> BagMetadata:
        writer = start_file(stream)
        metadata = BagMetadata(self.path.name)
        channels: dict[int, int] = {}
        schemas: dict[int, int] = {}
        for record in self._contents(metadata, notes):
            if isinstance(record, Message):
                if record.channel_id not in channels:
                    channels[record.channel_id] = self._register(
                        writer, record.channel_id, schemas
                    )
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
            elif isinstance(record, Attachment):
                writer.add_attachment(
                    record.create_time,
                    record.log_time,
                    record.name,
                    record.media_type,
                    record.data,
                )
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
        finish_file(writer, stream, metadata)
        return metadata

    def _register(self, writer: Writer, channel_id: int, schemas: dict[int, int]) -> int:
        schema = self._schema(channel_id)
        if schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
        return register_channel(writer, schemas[schema.id], self._topic(channel_id))

    def _topic(self, channel_id: int) -> TopicCount:
        channel = self._survey.channels[channel_id]
        type_hash = channel.metadata.get('topic_type_hash', '')
        return TopicCount(
            channel.topic, self._schema(channel_id).name, _offered(channel), type_hash
        )

    def _schema(self, channel_id: int) -> Schema:
        return self._survey.schemas[self._survey.channels[channel_id].schema_id]


def _counted(note: Metadata, metadata: BagMetadata) -> Metadata:
    values = note.metadata.items()
    metadata.custom.update({f'{note.name}.{key}': value for key, value in values})
    return note


def _state(path: Path) -> tuple[int, ...]:
    """What tells a file from one that took its place, or was written to."""
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def _offered(channel: Channel) -> list[dict[str, Any]]:
    """The QoS that the channel's metadata has as text."""
    try:
        offered = yaml.safe_load(channel.metadata['offered_qos_profiles'])
    except (KeyError, yaml.YAMLError):
        offered = None
    return offered if isinstance(offered, list) and offered else qos_profiles(_DEFAULT_QOS)

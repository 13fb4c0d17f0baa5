"""Close a log that was broken off: index, summary and metadata.yaml.

What is read is copied message by message; nothing is decoded, so any log of ROS 2 will do.
"""

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeGuard

import yaml
from mcap.exceptions import InvalidMagic
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.logs.bag_metadata import BagMetadata, TopicCount, write_metadata
from resting_aspects_ros.logs.log_reader import (
    check_definition,
    is_being_written,
    one_file,
    written_hash,
)
from resting_aspects_ros.logs.mcap_file import ROSBAG2, finish_file, register_channel, start_file
from resting_aspects_ros.logs.topics import Qos, qos_profiles

# A log in which more than its end was lost is kept under this name.
DAMAGED = '.damaged'
# Of a channel that does not say what was offered: what rosbag2 takes for it.
_DEFAULT_QOS = Qos(10)


@dataclass
class Extent:
    """How much of a file can be read.

    lost_bytes : int
        After the last record that is whole; those of an index that is only half there included.
    lost_chunks : int
        Whole in length, and not in what they hold: none of their messages can be had.
    finished : bool
        The file has its end.
    """

    messages: int = 0
    attachments: int = 0
    lost_bytes: int = 0
    lost_chunks: int = 0
    finished: bool = False


class BrokenLog:
    """A log that may have been broken off, and all that can be read of it.

    log : Path
        The folder of a run, or its MCAP file.

    Raises LogError if it is no log.
    """

    def __init__(self, log: Path) -> None:
        self.path = one_file(log)
        self._folder = log if log.is_dir() else None
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self.extent = self._measure()

    @property
    def closed(self) -> bool:
        """It has its end, can be read up to there, and has metadata.yaml beside it."""
        found = self.extent
        beside = self._folder is None or (self._folder / 'metadata.yaml').is_file()
        return found.finished and not found.lost_chunks and beside

    @property
    def being_written(self) -> bool:
        """Whether a process is writing it now."""
        return is_being_written(self.path)

    def messages(self, types: Collection[str]) -> Iterator[tuple[str, bytes]]:
        """Type and CDR of each message of these types, in the order of the file.

        Raises LogError if one was written with another definition than the installed one.
        """
        for channel in self._channels.values():
            schema = self._schemas.get(channel.schema_id)
            if schema is not None and schema.name in types:
                check_definition(self.path, schema.name, written_hash(channel))
        for record in self._records(Extent()):
            if self._is_known(record) and self._schema(record.channel_id).name in types:
                yield self._schema(record.channel_id).name, record.data

    def recover(self, notes: Mapping[str, dict[str, str]]) -> None:
        """Write the file anew, with its end, and metadata.yaml if the log is a folder.

        The new file takes the place of the old one when it is on the disk. The old one is kept,
        as `.damaged`, if more than its end cannot be read.

        notes : mapping
            Records of free text by name, written instead of those of the same name.

        Raises LogError if it cannot be written, or a process is writing it; then all is as it was.
        """
        if self.being_written:
            raise LogError(f'log {str(self.path)!r} is being written, allowed is one that is not')
        new = self.path.with_name(f'{self.path.name}.recovering')
        try:
            with new.open('wb') as stream:
                metadata = self._copy(stream, notes)
            if self.extent.lost_chunks:
                os.link(self.path, self.path.with_name(self.path.name + DAMAGED))
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

    def _measure(self) -> Extent:
        extent = Extent()
        for record in self._records(extent):
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channels[record.id] = record
            elif isinstance(record, Message):
                extent.messages += 1
            elif isinstance(record, Attachment):
                extent.attachments += 1
        return extent

    def _records(self, extent: Extent) -> Iterator[McapRecord]:
        """All records that can be read, those in chunks one by one; notes in extent what cannot.

        Those at the end of the file come too: they repeat the schemas and channels.
        """
        try:
            with self.path.open('rb') as file:
                yield from self._read(file, extent)
        except OSError as error:
            raise LogError(f'log {str(self.path)!r} cannot be read: {error.strerror}') from None

    def _read(self, file: BinaryIO, extent: Extent) -> Iterator[McapRecord]:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        whole_until = 0
        records = iter(StreamReader(file, emit_chunks=True).records)
        while True:
            try:
                record = next(records)
            except StopIteration:
                extent.finished = True
                return
            except OSError:
                raise
            except InvalidMagic:
                if whole_until == 0:
                    raise LogError(f'{str(self.path)!r} is no MCAP file') from None
                break
            except Exception:  # noqa: BLE001 - whatever the parser makes of half a record
                break
            whole_until = file.tell()
            if isinstance(record, Chunk):
                try:
                    inner = breakup_chunk(record, validate_crc=True)
                except Exception:  # noqa: BLE001 - or the decompressor
                    extent.lost_chunks += 1
                    continue
                yield from inner
            else:
                yield record
        extent.lost_bytes = size - whole_until

    def _copy(self, stream: BinaryIO, notes: Mapping[str, dict[str, str]]) -> BagMetadata:
        writer = start_file(stream)
        metadata = BagMetadata(self.path.name)
        channels: dict[int, int] = {}
        schemas: dict[int, int] = {}
        for record in self._records(Extent()):
            if self._is_known(record):
                if record.channel_id not in channels:
                    channels[record.channel_id] = self._register(
                        writer, record.channel_id, schemas, metadata
                    )
                topic = self._channels[record.channel_id].topic
                log_time = max(record.log_time, metadata.end or 0)
                writer.add_message(
                    channels[record.channel_id],
                    log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
                metadata.count(topic, log_time)
            elif isinstance(record, Attachment):
                writer.add_attachment(
                    record.create_time,
                    record.log_time,
                    record.name,
                    record.media_type,
                    record.data,
                )
            elif isinstance(record, Metadata) and record.name not in {ROSBAG2, *notes}:
                _note(writer, metadata, record.name, record.metadata)
        for name, values in notes.items():
            _note(writer, metadata, name, values)
        finish_file(writer, stream, metadata)
        return metadata

    def _register(
        self, writer: Writer, channel_id: int, schemas: dict[int, int], metadata: BagMetadata
    ) -> int:
        channel = self._channels[channel_id]
        schema = self._schema(channel_id)
        if schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
        count = TopicCount(
            channel.topic,
            schema.name,
            _offered(channel),
            channel.metadata.get('topic_type_hash', ''),
        )
        metadata.topics[channel.topic] = count
        return register_channel(writer, schemas[schema.id], count)

    def _is_known(self, record: McapRecord) -> TypeGuard[Message]:
        """Whether it is a message, and what it is of was not lost."""
        if not isinstance(record, Message) or record.channel_id not in self._channels:
            return False
        return self._channels[record.channel_id].schema_id in self._schemas

    def _schema(self, channel_id: int) -> Schema:
        return self._schemas[self._channels[channel_id].schema_id]


def _note(writer: Writer, metadata: BagMetadata, name: str, values: dict[str, str]) -> None:
    writer.add_metadata(name, values)
    metadata.custom.update({f'{name}.{key}': value for key, value in values.items()})


def _offered(channel: Channel) -> list[dict[str, Any]]:
    """The QoS that the channel's metadata has as text."""
    try:
        offered = yaml.safe_load(channel.metadata['offered_qos_profiles'])
    except (KeyError, yaml.YAMLError):
        offered = None
    return offered if isinstance(offered, list) and offered else qos_profiles(_DEFAULT_QOS)

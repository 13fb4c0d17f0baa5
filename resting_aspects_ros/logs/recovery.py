"""Recovery of a log that was not closed: writes index, summary and metadata.yaml.

Messages are copied one by one without being decoded, so any log of ROS 2 can be recovered.
"""

import glob
import uuid
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel
from mcap.writer import Writer

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import named, parse_yaml, printable
from resting_aspects_ros.logs.bag import (
    BagMetadata,
    is_compressed,
    log_files,
    read_information,
    write_metadata,
)
from resting_aspects_ros.logs.mcap_file import LoggedMessage, McapFile
from resting_aspects_ros.logs.topics import Qos, qos_profiles
from resting_aspects_ros.logs.writer import (
    ROSBAG2,
    finish_file,
    register_channel,
    start_file,
)
from resting_aspects_ros.system import lock_file

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
    """Rewrite a log that was not closed with its end, and with metadata.yaml if it is a folder.

    The new file replaces the old one after it was synced to disk. For a closed log, only
    metadata.yaml is written, and only if it does not match the log.

    log : Path
        The folder of a run, or its MCAP file.
    records : mapping
        Metadata records by name, which are added to a log that was not closed and replace those
        with the same name.

    Raises LogError if it is not a log, is damaged before its end, or cannot be written. The log
    is unchanged then. If only metadata.yaml cannot be written, a second recovery writes it.
    """
    path, *others = log_files(log)
    if others or is_compressed(path):
        raise LogError(
            f'{named("log", log)} cannot be recovered: expected one file that is not compressed'
        )
    with ExitStack() as stack:
        file = McapFile(path, stack)
        if printable(path.name) != path.name:
            raise LogError(
                f'{named("log", path)} cannot be recovered: expected a file name in UTF-8, '
                'because the metadata contain it'
            )
        # The lock is held during the recovery, so that no other process writes the log.
        if lock_file(file.stream) is False:
            return RecoveryResult(0, being_written=True)
        try:
            return _recovered(file, log if log.is_dir() else None, records or {})
        except OSError as error:
            raise LogError(
                f'{named("log", path)} cannot be written: {error.strerror or error}'
            ) from error


def _recovered(file: McapFile, folder: Path | None, records: _Records) -> RecoveryResult:
    metadata = BagMetadata(file.path.name)
    closed = file.index is not None
    if closed:
        for _ in _counted(file, metadata):
            pass
        for name, values in file.metadata.items():
            if name != ROSBAG2:
                metadata.add_record(name, values)
    else:
        _replace_by_copy(file, metadata, records)
    if folder is not None and read_information(folder) != metadata.information():
        closed = False
        write_metadata(folder, metadata)
    return RecoveryResult(file.message_count, closed=closed)


def _counted(file: McapFile, metadata: BagMetadata) -> Iterator[LoggedMessage | Attachment]:
    """Yield attachments and messages in file order, and count the messages."""
    for found in file.records():
        if isinstance(found, Attachment):
            yield found
            continue
        name, message = found.channel.topic, found.message
        if name not in metadata.topics:
            metadata.add_topic(name, found.type, _offered(found.channel), found.type_hash or '')
        message.log_time = max(message.log_time, metadata.end or 0)
        metadata.count(name, message.log_time)
        yield found


def _replace_by_copy(file: McapFile, metadata: BagMetadata, records: _Records) -> None:
    """Replace the file by a complete copy; raises OSError if this fails."""
    path = file.path
    for abandoned in path.parent.glob(f'{glob.escape(path.name)}.*.recovering'):
        abandoned.unlink()  # left by a recovery that was killed
    new = path.with_name(f'{path.name}.{uuid.uuid4().hex}.recovering')
    try:
        with new.open('xb') as stream:
            writer = start_file(stream)
            _copy(file, metadata, writer)
            for name, values in {**file.metadata, **records}.items():
                if name != ROSBAG2:
                    writer.add_metadata(name, values)
                    metadata.add_record(name, values)
            finish_file(writer, stream, metadata)
        new.replace(path)
    finally:
        with suppress(OSError):
            new.unlink()


def _copy(file: McapFile, metadata: BagMetadata, writer: Writer) -> None:
    channels: dict[int, int] = {}
    schemas: dict[int, int] = {0: 0}  # 0: a channel without a schema
    for each in _counted(file, metadata):
        if isinstance(each, Attachment):
            writer.add_attachment(
                each.create_time, each.log_time, each.name, each.media_type, each.data
            )
            continue
        schema, channel, message = each
        if channel.id not in channels:
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            topic = metadata.topics[channel.topic]['topic_metadata']
            channels[channel.id] = register_channel(writer, schemas[channel.schema_id], topic)
        writer.add_message(
            channels[channel.id],
            message.log_time,
            message.data,
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

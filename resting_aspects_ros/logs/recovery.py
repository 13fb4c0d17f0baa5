"""Recovery of a log that was not closed: writes index, summary and metadata.yaml.

Messages are copied one by one without being decoded, so any log of ROS 2 can be recovered.
"""

import glob
import uuid
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import named, parse_yaml, printable
from resting_aspects_ros.logs.bag import (
    FILE_NAME,
    is_compressed,
    log_files,
    write_metadata,
)
from resting_aspects_ros.logs.reader import McapFile
from resting_aspects_ros.logs.topics import Qos, qos_profiles
from resting_aspects_ros.logs.writer import ROSBAG2, BagWriter
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

    The new file replaces the old one after it was synced to disk.

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
        if file.closed and (folder is None or (folder / FILE_NAME).is_file()):
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

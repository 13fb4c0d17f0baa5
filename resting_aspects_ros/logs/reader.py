"""Reading of logs, closed or not: messages by type, and for playback.

A log may be being written, truncated or damaged. The records of a file are parsed by the reader of
mcap, one by one from their own bytes: mcap trusts the lengths within a record, unpacks a chunk to
any size and skips what it does not know. The index at the end of a closed file is for other
programs: logs are small, and are read from their start.

Every batch is flushed, so a crash truncates a file at its end, and all complete records before
the end are valid. Any other deviation is damage, and a damaged file is rejected. Unlike `mcap
recover`, this module does not search a damaged file for readable records.
"""

from __future__ import annotations

import heapq
import os
import zlib
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from resting_aspects_ros.errors import LogError, NoLogError, one_line
from resting_aspects_ros.input_files import named
from resting_aspects_ros.logs.bag import (
    EXPECTED,
    MAGIC,
    OUTCOME,
    LogOutcome,
    log_files,
    open_file,
    unpacking_failure,
)
from resting_aspects_ros.logs.topics import Qos, check_definition, recorded_qos
from resting_aspects_ros.system import lock_file, unlock_file

# Maximum size in bytes of a record and of an unpacked chunk. The largest record of a log is a
# part's description with its mesh.
MAX_RECORD = 1 << 28

# Size of opcode and length, which precede the content of a record.
_HEAD = 9
_IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_IN_DATA = (
    *_IN_CHUNKS,
    Opcode.HEADER,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    Opcode.DATA_END,
)
# A power failure can leave zeros at the end of a file, more than any valid record ends with.
_MIN_ZEROS = 16


class LoggedMessage(NamedTuple):
    """A serialized message, with its channel and schema; a channel may have no schema."""

    schema: Schema | None
    channel: Channel
    message: Message

    @property
    def topic(self) -> str:
        """Name of the topic in the log."""
        return str(self.channel.topic)

    @property
    def time(self) -> int:
        """Log time, ns since 1970."""
        return int(self.message.log_time)

    @property
    def data(self) -> bytes:
        """The message as CDR, with the four bytes of its encapsulation header."""
        return bytes(self.message.data)

    @property
    def type(self) -> str:
        """The message type; empty without a schema."""
        return '' if self.schema is None else self.schema.name

    @property
    def type_hash(self) -> str | None:
        """Hash of the definition with which the message was written; None if unknown."""
        return self.channel.metadata.get('topic_type_hash') or None

    @property
    def qos(self) -> Qos | None:
        """QoS of the topic, None if it is not recorded; LogError if it is not valid."""
        return recorded_qos(self.channel.metadata.get('offered_qos_profiles', ''))


class _DamageError(Exception):
    """The bytes are not valid MCAP; the message describes what was found."""


class _TruncatedError(_DamageError):
    """A record is longer than what contains it."""


class McapFile:
    """One MCAP file that is open for reading; `stack` closes it. For attributes see `Log`.

    metadata : dict
        The metadata records that were read, by name.
    message_count : int
        Number of messages that were read.
    """

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.message_count = 0
        self.stream = stack.enter_context(open_file(path))
        with self._checked():
            self.being_written = _is_locked(self.stream)
            self._size = self.stream.seek(0, os.SEEK_END)
            self.stream.seek(max(0, self._size - len(MAGIC)))
            self.closed = self.stream.read() == MAGIC and self._size > len(MAGIC)
            self.stream.seek(0)
            begins = self.stream.read(len(MAGIC))
        if not MAGIC.startswith(begins):
            message = f'{named("log", path)} is damaged, or not an MCAP file: it begins with'
            raise NoLogError(f'{message} {begins!r}; {EXPECTED}')

    def messages(self) -> Iterator[LoggedMessage]:
        """Yield the messages in file order, see `Log.messages`."""
        return (each for each in self.records() if isinstance(each, LoggedMessage))

    def records(self) -> Iterator[LoggedMessage | Attachment]:
        """Yield the messages and attachments in file order, up to a truncated end."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        self.message_count = 0
        with self._checked():
            for record in self._data():
                if isinstance(record, Message):
                    channel = channels.get(record.channel_id)
                    if channel is None:
                        raise _DamageError(f'a message of unknown channel {record.channel_id}')
                    self.message_count += 1
                    yield LoggedMessage(schemas.get(channel.schema_id), channel, record)
                elif isinstance(record, Attachment):
                    yield record
                elif isinstance(record, Metadata):
                    self.metadata[record.name] = record.metadata
                elif isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    if record.schema_id and record.schema_id not in schemas:
                        raise _DamageError(f'a channel of unknown schema {record.schema_id}')
                    channels[record.id] = record

    @contextmanager
    def _checked(self) -> Iterator[None]:
        """Convert every exception of reading or parsing to a LogError."""
        try:
            yield
        except LogError:
            raise
        except OSError as error:
            raise LogError(f'{named("log", self.path)} cannot be read: {error.strerror}') from None
        except Exception as error:
            found = str(error) or f'content that cannot be read ({type(error).__name__})'
            raise LogError(
                f'{named("log", self.path)} is damaged: found {one_line(found)}; "mcap recover", '
                'of the MCAP command line tool, copies the readable messages'
            ) from error

    def _data(self) -> Iterator[Any]:
        """Yield the records before the index, also those in chunks."""
        self.stream.seek(len(MAGIC))
        crc = zlib.crc32(MAGIC)
        while True:
            try:
                frame = _frame(self.stream, self._size)
                record = _parsed(frame, _IN_DATA)
                content = _chunk_records(record) if isinstance(record, Chunk) else [record]
            except Exception as error:
                cut = isinstance(error, _TruncatedError) or self._ends_in_zeros()
                if self.closed or not cut:
                    raise
                return
            if isinstance(record, DataEnd):
                _check_crc('data', record.data_section_crc, crc)
                return
            crc = zlib.crc32(frame, crc)
            yield from content

    def _ends_in_zeros(self) -> bool:
        """Return whether only zeros follow the last record, as after a power failure."""
        self.stream.seek(min(self.stream.tell() - 1, max(0, self._size - _MIN_ZEROS)))
        return not self.stream.read().strip(b'\0')


def _is_locked(file: IO[bytes]) -> bool:
    """Return whether another process, or another stream of this process, is writing the file."""
    locked = lock_file(file, shared=True)
    if locked:
        unlock_file(file)
    return locked is False


# -- records --------------------------------------------------------------------------------------


class _Content(BytesIO):
    """The bytes of a record; reading beyond their end raises _DamageError."""

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        if len(data) != size:
            raise _DamageError('a field that exceeds its record')
        return data


def _frame(stream: IO[bytes], size: int) -> bytes:
    """Return the next record, with its opcode and length, of a stream with a known size."""
    head = stream.read(min(_HEAD, size - stream.tell()))
    length = int.from_bytes(head[1:], 'little')
    if len(head) < _HEAD or length > size - stream.tell():
        raise _TruncatedError('a record that exceeds its container')
    if length > MAX_RECORD:
        raise _DamageError(f'a record of {length} bytes: expected at most {MAX_RECORD}')
    return head + stream.read(length)


def _parsed(frame: bytes, allowed: tuple[int, ...]) -> Any:
    """Return a record; raises _DamageError, or any exception of mcap for invalid content.

    Private records, which MCAP allows, are rejected: no writer of ROS logs uses them.
    """
    if frame[0] not in allowed:
        raise _DamageError(f'an unexpected record with the opcode {frame[0]}')
    reader = StreamReader(_Content(frame), skip_magic=True, emit_chunks=True)
    return next(reader.records)


def _chunk_records(chunk: Chunk) -> list[Any]:
    """Unpack a chunk, and parse its records one by one; for errors see `_parsed`."""
    content = _unpacked(chunk)
    _check_crc('a chunk', chunk.uncompressed_crc, zlib.crc32(content))
    stream, records = BytesIO(content), []
    while stream.tell() < len(content):
        try:
            frame = _frame(stream, len(content))
        except _TruncatedError as error:
            raise _DamageError(str(error)) from None
        records.append(_parsed(frame, _IN_CHUNKS))
    return records


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > MAX_RECORD:
        raise _DamageError(f'a chunk of {size} bytes unpacked: expected at most {MAX_RECORD}')
    # Unpacking stops one byte after the declared size, which is enough to detect excess data.
    try:
        if chunk.compression == 'zstd':
            with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
                content = reader.read(size + 1)
        elif chunk.compression == 'lz4':
            content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        elif chunk.compression:
            raise _DamageError(f'a chunk with the unknown compression {chunk.compression[:20]!r}')
        else:
            content = chunk.data
    except (zstandard.ZstdError, RuntimeError) as error:  # the second is that of lz4
        raise _DamageError(unpacking_failure(error)) from None
    if len(content) != size:
        raise _DamageError(f'a chunk whose unpacked size is not the declared {size} bytes')
    return bytes(content)


def _check_crc(what: str, crc: int, computed: int) -> None:
    if crc not in (0, computed):
        raise _DamageError(f'{what} with a wrong checksum')


# -- logs -----------------------------------------------------------------------------------------


@contextmanager
def open_log(path: Path) -> Iterator[Log]:
    """Open a log for reading, as a context manager.

    path : Path
        A folder, its metadata.yaml, or an MCAP file.

    Raises NoLogError if a file cannot be opened or is not an MCAP file, LogError as `log_files`.
    """
    with ExitStack() as stack:
        yield Log(path, [McapFile(file, stack) for file in log_files(path)])


class Log:
    """A log of one or several open files.

    path : Path
        The MCAP file; of a split bag, the path that was given.
    closed : bool
        Whether each file has the end of a closed file.
    being_written : bool
        Whether a process is writing a file.
    """

    def __init__(self, path: Path, files: list[McapFile]) -> None:
        self._files = files
        self._name = named('log', path)
        self.path = path if len(files) > 1 else files[0].path
        self.closed = all(file.closed for file in files)
        self.being_written = any(file.being_written for file in files)

    @property
    def message_count(self) -> int:
        """Number of messages that were read."""
        return sum(file.message_count for file in self._files)

    @property
    def outcome(self) -> LogOutcome | None:
        """The outcome that a closed log records; known after all messages were read."""
        found = [file.metadata[OUTCOME] for file in self._files if OUTCOME in file.metadata]
        return LogOutcome.of(found[-1]) if found and self.closed else None

    @property
    def warning(self) -> str:
        """The warning for a log that is not closed; empty for a closed one."""
        if self.being_written:
            return f'{self._name} is being written: the messages in it so far are used'
        if self.closed:
            return ''
        return (
            f'{self._name} was not closed: the messages in it are used '
            '("resting_aspects recover" closes it)'
        )

    def messages(self) -> Iterator[LoggedMessage]:
        """Yield all messages in file order; of a split bag, in time order.

        From a log that was not closed, or is being written, all complete messages are read. Raises
        LogError if a file cannot be read or is damaged, which may be detected only at its end.
        """
        each = (file.messages() for file in self._files)
        return heapq.merge(*each, key=lambda message: message.time)

    def of_types(self, types: Collection[str]) -> Iterator[LoggedMessage]:
        """Yield all messages of the types.

        Raises LogError as `messages`, or if a message was written with a definition of its type
        that differs from the installed one.
        """
        checked: set[tuple[str, str | None]] = set()
        for message in self.messages():
            if (kind := message.type) in types:
                if (kind, message.type_hash) not in checked:
                    check_definition(self.path, kind, message.type_hash)
                    checked.add((kind, message.type_hash))
                yield message


def messages(path: Path, type_name: str) -> Iterator[bytes]:
    """Yield all messages of a type in a log as CDR; see `Log.of_types`."""
    with open_log(path) as log:
        for message in log.of_types([type_name]):
            yield message.data


# -- playback -------------------------------------------------------------------------------------


class Recording:
    """The messages of a log, which is read once for its topics and again for each playback.

    The log may be one that was not closed or is being written. At most one chunk is in memory at
    a time.

    path : Path
        A folder, its metadata.yaml, or an MCAP file.

    Raises LogError if it is not a log, cannot be read, is damaged before its end, has no message,
    or two types for a topic.

    topics : dict
        The first message of each topic, by name.
    start, end : int
        Log times of the first and the last message, ns since 1970.
    warning : str
        See `Log.warning`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, LoggedMessage] = {}
        self.start = self.end = 0
        with open_log(path) as log:
            self.warning = log.warning
            for message in _in_time(log):
                self.start = self.start if self.topics else message.time
                self.end = message.time
                first = self.topics.setdefault(message.topic, message)
                if (message.type, message.type_hash) != (first.type, first.type_hash):
                    raise LogError(
                        one_line(
                            f'invalid log {str(path)!r}: expected one type for topic '
                            f'{message.topic}, found {message.type} ({message.type_hash}) and '
                            f'{first.type} ({first.type_hash})',
                            600,
                        )
                    )
        if not self.topics:
            raise LogError(f'invalid log {str(path)!r}: expected at least one message, found none')

    def messages(self, topics: Collection[str]) -> Iterator[LoggedMessage]:
        """Yield the messages of some topics in time order; times never decrease."""
        with open_log(self.path) as log:
            for message in _in_time(log):
                if message.topic in topics:
                    yield message


def _in_time(log: Log) -> Iterator[LoggedMessage]:
    """Yield the messages with log times that do not decrease."""
    time = 0
    for each in log.messages():
        time = each.message.log_time = max(time, each.time)
        yield each

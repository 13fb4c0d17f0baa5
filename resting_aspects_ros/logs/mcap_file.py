"""Reading of one MCAP file, which may be closed, being written, truncated or damaged.

The records are parsed by the readers of mcap, one by one from their own bytes: mcap trusts the
lengths within a record, unpacks a chunk to any size and skips what it does not know.

Every batch is flushed, so a crash truncates a file at its end, and all complete records before
the end are valid. Any other deviation is damage, and a damaged file is rejected. Unlike `mcap
recover`, this module does not search a damaged file for readable records.
"""

import os
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from resting_aspects_ros.errors import LogError, NoLogError, one_line
from resting_aspects_ros.input_files import named
from resting_aspects_ros.logs.bag import EXPECTED, MAGIC, open_file, unpacking_failure
from resting_aspects_ros.system import lock_file, unlock_file

# Maximum size in bytes of a record, of an unpacked chunk and of the index. The largest record of
# a log is a part's description with its mesh.
MAX_RECORD = 1 << 28

# Size of opcode and length, which precede the content of a record.
_HEAD = 9
# Size of the last record, the footer, and of the magic bytes after it.
_END = 29 + len(MAGIC)
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


class _DamageError(Exception):
    """The bytes are not valid MCAP; the message describes what was found."""


class McapFile:
    """One MCAP file that is open for reading; `stack` closes it. For attributes see `Log`.

    metadata : dict
        The metadata records that were read, by name.
    """

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._read = 0
        self.stream = stack.enter_context(open_file(path))
        with self._checked():
            self.being_written = _is_locked(self.stream)
            self._size = self.stream.seek(0, os.SEEK_END)
            begins = self._at(0, len(MAGIC))
            ends = self._at(max(0, self._size - len(MAGIC)), len(MAGIC))
        if not MAGIC.startswith(begins):
            message = f'{named("log", path)} is damaged, or not an MCAP file: it begins with'
            raise NoLogError(f'{message} {begins!r}; {EXPECTED}')
        self.closed = ends == MAGIC and self._size > len(MAGIC)

    @property
    def message_count(self) -> int:
        """Number of messages; without an index, of those that were read."""
        statistics = self.index.statistics if self.index else None
        return self._read if statistics is None else statistics.message_count

    def messages(self) -> Iterator[LoggedMessage]:
        """Yield the messages in file order, see `Log.messages`."""
        return (each for each in self.records() if isinstance(each, LoggedMessage))

    def records(self) -> Iterator[LoggedMessage | Attachment]:
        """Yield the messages and attachments in file order, up to a truncated end."""
        with self._checked():
            for record in self._data():
                if isinstance(record, Message):
                    self._read += 1
                    yield self._logged(record)
                elif isinstance(record, Attachment):
                    yield record
                else:
                    self._note(record)

    @cached_property
    def index(self) -> Summary | None:
        """The index at the end; None if there is none that covers all messages."""
        if not self.closed:
            return None
        with self._checked():
            found = NonSeekingReader(BytesIO(MAGIC + self._summary())).get_summary()
            if found is None or not _is_complete(found):
                return None
            for each in (*found.schemas.values(), *found.channels.values()):
                self._note(each)
            return found

    def indexed_metadata(self, name: str) -> dict[str, str]:
        """Return the last metadata record of a name, or no values; requires an index."""
        assert self.index is not None
        values: dict[str, str] = {}
        with self._checked():
            for each in self.index.metadata_indexes:
                if each.name == name:
                    values = _parsed(self._frame(each.offset), [Opcode.METADATA]).metadata
        return values

    def indexed_message(self, type_name: str, *, last: bool) -> LoggedMessage | None:
        """Return the first or last message of a type; None without; requires an index."""
        assert self.index is not None
        kinds = {k for k, schema in self.index.schemas.items() if schema.name == type_name}
        wanted = {k for k, each in self.index.channels.items() if each.schema_id in kinds}
        places = [
            each.chunk_start_offset
            for each in self.index.chunk_indexes
            # A writer may omit the message index.
            if not each.message_index_offsets or wanted & each.message_index_offsets.keys()
        ]
        with self._checked():
            for place in sorted(places, reverse=last):
                records = _chunk_records(_parsed(self._frame(place), [Opcode.CHUNK]))
                messages = [each for each in records if isinstance(each, Message)]
                if found := [each for each in messages if each.channel_id in wanted]:
                    return self._logged(found[-1 if last else 0])
        return None

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

    def _data(self) -> Iterator[McapRecord]:
        """Yield the records before the index, also those in chunks."""
        crc, start = zlib.crc32(MAGIC), len(MAGIC)
        while frame := self._frame(start):
            try:
                record = _parsed(frame, _IN_DATA)
                content = _chunk_records(record) if isinstance(record, Chunk) else [record]
            except Exception:
                if not self.closed and self._ends_in_zeros(start + len(frame) - 1):
                    return  # as after a power failure
                raise
            if isinstance(record, DataEnd):
                _check_crc('data', record.data_section_crc, crc)
                if self.closed:
                    self._summary()
                return
            yield from content
            crc, start = zlib.crc32(frame, crc), start + len(frame)

    def _logged(self, message: Message) -> LoggedMessage:
        channel = self._channels.get(message.channel_id)
        if channel is None:
            raise _DamageError(f'a message of the unknown channel {message.channel_id}')
        return LoggedMessage(self._schemas.get(channel.schema_id), channel, message)

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            if record.schema_id and record.schema_id not in self._schemas:
                raise _DamageError(f'a channel of the unknown schema {record.schema_id}')
            self._channels[record.id] = record

    def _summary(self) -> bytes:
        """Return the end of a closed file: index, if there is one, footer and magic bytes."""
        end = self._at(max(0, self._size - _END), _END)
        if end[:_HEAD] != bytes([Opcode.FOOTER, 20, *bytes(7)]):
            raise _DamageError('no footer')
        start, _, crc = struct.unpack('<QQI', end[_HEAD : -len(MAGIC)])
        size = self._size - (start or self._size - _END)
        if not _END <= size <= min(MAX_RECORD, self._size - len(MAGIC)):
            raise _DamageError(f'a summary at byte {start} of {self._size}')
        summary = self._at(self._size - size, size)
        if start:  # the checksum covers all before itself
            _check_crc('a summary', crc, zlib.crc32(summary[: -len(MAGIC) - 4]))
        return summary

    def _frame(self, start: int) -> bytes:
        """Return the bytes of the record at an offset; empty if the record is truncated."""
        head = self._at(start, _HEAD)
        length = int.from_bytes(head[1:], 'little')
        if len(head) == _HEAD and length <= self._size - start - _HEAD:
            if length > MAX_RECORD:
                raise _DamageError(f'a record of {length} bytes: expected at most {MAX_RECORD}')
            return self._at(start, _HEAD + length)
        if self.closed:
            raise _DamageError(f'a record at byte {start} that exceeds the file')
        return b''

    def _ends_in_zeros(self, start: int) -> bool:
        """Return whether the file has only zeros from an offset on, at least _MIN_ZEROS."""
        start = min(start, max(0, self._size - _MIN_ZEROS))
        return not self._at(start, self._size).strip(b'\0')

    def _at(self, start: int, length: int) -> bytes:
        """Return up to ``length`` bytes, but none beyond the size at the time of opening."""
        self.stream.seek(min(start, self._size))
        return self.stream.read(max(0, min(length, self._size - start)))


def _is_locked(file: IO[bytes]) -> bool:
    """Return whether another process, or another stream of this process, is writing the file."""
    locked = lock_file(file, shared=True)
    if locked:
        unlock_file(file)
    return locked is False


# -- records --------------------------------------------------------------------------------------


class _Frame(BytesIO):
    """The bytes of a record; reading beyond their end raises _DamageError."""

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        if len(data) != size:
            raise _DamageError('a field that exceeds its record')
        return data


def _parsed(frame: bytes, allowed: Collection[int]) -> Any:
    """Return a record; raises _DamageError, or any exception of mcap for invalid content.

    Private records, which MCAP allows, are rejected: no writer of ROS logs uses them.
    """
    if not frame or frame[0] not in allowed:
        raise _DamageError(f'an unexpected record with the opcode {frame[0] if frame else None}')
    reader = StreamReader(
        _Frame(frame), skip_magic=True, emit_chunks=True, record_size_limit=MAX_RECORD
    )
    record = next(reader.records)
    if isinstance(record, Attachment):  # mcap does not compare its checksum
        crc = int.from_bytes(frame[-4:], 'little')
        _check_crc('an attachment', crc, zlib.crc32(frame[_HEAD:-4]))
    return record


def _chunk_records(chunk: Chunk) -> Iterator[McapRecord]:
    """Unpack a chunk, and parse its records one by one; for errors see `_parsed`."""
    content = _unpacked(chunk)
    _check_crc('a chunk', chunk.uncompressed_crc, zlib.crc32(content))
    return (_parsed(frame, _IN_CHUNKS) for frame in _frames(content))


def _frames(content: bytes) -> Iterator[bytes]:
    start = 0
    while start < len(content):
        end = start + _HEAD + int.from_bytes(content[start + 1 : start + _HEAD], 'little')
        if not start + _HEAD <= end <= len(content):
            raise _DamageError('a record that exceeds its container')
        yield content[start:end]
        start = end


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


def _is_complete(summary: Summary) -> bool:
    """Return whether an index covers all messages; _DamageError if it is inconsistent."""
    statistics, chunks = summary.statistics, summary.chunk_indexes
    if statistics is None or statistics.chunk_count != len(chunks):
        return False
    used = set(statistics.channel_message_counts).union(*(c.message_index_offsets for c in chunks))
    if unknown := used - summary.channels.keys():
        raise _DamageError(f'a message index of the unknown channel {min(unknown)}')
    return bool(statistics.chunk_count or not statistics.message_count)

"""Reading of the records and the index of an MCAP file.

Every batch is flushed, so a crash truncates a file at its end, and all complete records before
the end are valid. Any other deviation is damage, and a damaged file is rejected. Unlike `mcap
recover`, this module does not search a damaged file for readable records.
"""

import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, TypeVar

from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.summary import Summary

from resting_aspects_ros.errors import LogError, NoLogError, one_line
from resting_aspects_ros.input_files import named
from resting_aspects_ros.logs.bag_files import EXPECTED, open_unpacked
from resting_aspects_ros.logs.mcap_format import FOOTER_SIZE, MAGIC, is_locked
from resting_aspects_ros.logs.record_format import (
    HEAD,
    MAX_RECORD,
    DamageError,
    chunk_records,
    is_complete,
    parse_record,
    parse_summary,
)

Self = TypeVar('Self', bound='LogFile')  # typing.Self is newer than Python 3.10
# A power failure can leave zeros at the end of a file, more than any valid record ends with.
_MIN_ZEROS = 16


class LogFile:
    """An MCAP file, closed or truncated, opened for reading; to be used as a context manager.

    path : Path

    Raises NoLogError if the file cannot be opened or is not an MCAP file.

    being_written : bool
        Whether a process is writing the file.
    finished : bool
        Whether the file has the end of a closed file.
    messages : int
        Number of messages that ``records`` has read.
    schemas, channels : dict
        The schemas and channels that were read, by id.
    metadata : dict
        The metadata records that were read, by name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.messages = 0
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        try:
            if path.exists() and not path.is_file():
                raise NoLogError(f'{named("log", path)} is neither a file nor a folder')
            self.stream: BinaryIO = open_unpacked(path)
        except OSError as error:
            message = f'{named("log", path)} cannot be read: {error.strerror}; {EXPECTED}'
            raise NoLogError(message) from None
        try:
            with self._checked():
                self.being_written = is_locked(self.stream)
                self._size = self.stream.seek(0, os.SEEK_END)
                begins = self._at(0, len(MAGIC))
                ends = self._at(max(0, self._size - len(MAGIC)), len(MAGIC))
            if not MAGIC.startswith(begins):
                message = f'{named("log", path)} is damaged, or not an MCAP file: it begins with'
                raise NoLogError(f'{message} {begins!r}; {EXPECTED}')
            self.finished = ends == MAGIC and self._size > len(MAGIC)
        except BaseException:
            self.stream.close()
            raise

    def __enter__(self: Self) -> Self:  # noqa: PYI019
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stream.close()

    def type_of(self, channel_id: int) -> str:
        """Return the message type of a known channel; empty if the file has no schema for it."""
        schema = self.schemas.get(self.channels[channel_id].schema_id)
        return '' if schema is None else schema.name

    def records(self) -> Iterator[Message | Metadata | Attachment]:
        """Yield the messages, metadata and attachments in file order, up to a truncated end.

        Their schemas and channels are in ``schemas`` and ``channels``. Raises LogError if the file
        cannot be read or is damaged; damage may be detected only at the end.
        """
        with self._checked():
            yield from self._records()

    def summary(self) -> Summary | None:
        """Return the index at the end; None if there is none. LogError if it is damaged."""
        if not self.finished:
            return None
        with self._checked():
            return self._summary()

    def metadata_at(self, start: int) -> Metadata:
        """Return the metadata record at an offset in bytes; LogError if there is none."""
        with self._checked():
            record = self._record(start)
            if not isinstance(record, Metadata):
                raise DamageError(f'no metadata at byte {start}')
            return record

    def messages_at(self, start: int) -> list[Message]:
        """Return the messages of the chunk at an offset in bytes; LogError if there is none."""
        with self._checked():
            chunk = self._record(start)
            if not isinstance(chunk, Chunk):
                raise DamageError(f'no chunk at byte {start}')
            records = list(chunk_records(chunk))
            for record in records:
                self._note(record)
            return [record for record in records if isinstance(record, Message)]

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

    def _records(self) -> Iterator[Message | Metadata | Attachment]:
        crc, in_data, start = zlib.crc32(MAGIC), True, len(MAGIC)
        while start <= self._size and (raw := self._frame(start)):
            end = start + len(raw)
            try:
                record = parse_record(raw[0], raw[HEAD:])
                content = chunk_records(record) if isinstance(record, Chunk) else [record]
            except Exception:
                if not self.finished and self._ends_in_zeros(end - 1):
                    return  # as after a power failure
                raise
            if isinstance(record, Footer):
                self._check_footer(record, end)
                return
            if isinstance(record, DataEnd):
                in_data = False
                if record.data_section_crc not in (0, crc):
                    raise DamageError('data with a wrong checksum')
            for each in content:
                self._note(each)
                if isinstance(each, Message | Metadata | Attachment) and in_data:
                    self.messages += isinstance(each, Message)
                    yield each
            crc, start = zlib.crc32(raw, crc), end

    def _summary(self) -> Summary | None:
        end = self._size - len(MAGIC) - FOOTER_SIZE
        footer = self._record(end)
        if not isinstance(footer, Footer):
            raise DamageError('no footer')
        self._check_footer(footer, self._size - len(MAGIC))
        start = footer.summary_start
        found = parse_summary(self._at(start, end - start) if start else b'')
        for each in (*found.schemas.values(), *found.channels.values()):
            self._note(each)
        return found if is_complete(found) else None

    def _record(self, start: int) -> McapRecord:
        """Return the record at an offset."""
        raw = self._frame(start)
        return parse_record(raw[0], raw[HEAD:])

    def _frame(self, start: int) -> bytes:
        """Return the bytes of the record at an offset; empty if the record is truncated."""
        if not len(MAGIC) <= start <= self._size:
            raise DamageError(f'a record at byte {start} of {self._size}')
        head = self._at(start, HEAD)
        length = int.from_bytes(head[1:], 'little')
        if len(head) == HEAD and length <= self._size - start - HEAD:
            if length > MAX_RECORD:
                raise DamageError(f'a record of {length} bytes: expected at most {MAX_RECORD}')
            return self._at(start, HEAD + length)
        if self.finished:
            raise DamageError(f'a record at byte {start} that exceeds the file')
        return b''

    def _note(self, record: McapRecord) -> None:
        """Store schemas, channels and metadata, and check that messages have a channel."""
        if isinstance(record, Message):
            if record.channel_id not in self.channels:
                raise DamageError(f'a message of the unknown channel {record.channel_id}')
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            if record.schema_id and record.schema_id not in self.schemas:
                raise DamageError(f'a channel of the unknown schema {record.schema_id}')
            self.channels[record.id] = record

    def _check_footer(self, footer: Footer, end: int) -> None:
        """Raise DamageError if the file does not end at ``end``, or the summary is damaged."""
        if not MAGIC.startswith(self._at(end, len(MAGIC) + 1)):
            raise DamageError('more data after the footer')
        start = footer.summary_start
        if start and not len(MAGIC) <= start <= end - FOOTER_SIZE <= start + MAX_RECORD:
            raise DamageError(f'a summary at byte {start} of {self._size}')
        # The checksum covers the summary and the footer up to the checksum itself.
        if start and footer.summary_crc not in (0, zlib.crc32(self._at(start, end - 4 - start))):
            raise DamageError('a summary with a wrong checksum')

    def _ends_in_zeros(self, start: int) -> bool:
        """Return whether the file has only zeros from an offset on, at least _MIN_ZEROS."""
        start = min(start, max(0, self._size - _MIN_ZEROS))
        return not self._at(start, self._size).strip(b'\0')

    def _at(self, start: int, length: int) -> bytes:
        """Return up to ``length`` bytes, but none beyond the size at the time of opening."""
        self.stream.seek(start)
        return self.stream.read(max(0, min(length, self._size - start)))

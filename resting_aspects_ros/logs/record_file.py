"""An MCAP file, open for reading: single records, each checked, and the state of the file.

Every batch is flushed, so a crash cuts a file at its end: what is whole before that counts.
Anything else that is not as a writer left it is damage. A damaged file is refused: nothing here
looks for what may still be readable in it, as `mcap recover` does.
"""

import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, TypeVar

from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema

from resting_aspects_ros.core.errors import LogError, NoLogError, one_line
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.logs.file_lock import is_locked
from resting_aspects_ros.logs.mcap_file import MAGIC
from resting_aspects_ros.logs.record_format import (
    HEAD,
    MAX_RECORD,
    DamageError,
    can_be_cut,
    chunk_records,
    parse_record,
)

Self = TypeVar('Self', bound='RecordFile')  # typing.Self is newer than Python 3.10
ALLOWED = 'allowed is the folder of a run, or an .mcap file'
_BLOCK = 1 << 20
# A loss of power leaves a file with zeros at its end, more than any record ends in.
_ZEROS = 16


@dataclass(frozen=True)
class Frame:
    """A record's opcode and content, and where it is in the file, bytes."""

    start: int
    opcode: int
    content: bytes

    @property
    def end(self) -> int:
        """Where the next record begins."""
        return self.start + HEAD + len(self.content)

    @property
    def head(self) -> bytes:
        """The bytes before the content."""
        return bytes([self.opcode]) + len(self.content).to_bytes(8, 'little')


class RecordFile:
    """An MCAP file, open for reading as it is now; to be used with `with`.

    path : Path

    Raises NoLogError if it cannot be opened or is no MCAP file.

    being_written : bool
        A process is writing it.
    finished : bool
        It ends as a closed file does.
    schemas, channels : dict
        Those that were read, by their ids in the file.
    texts : dict
        The records of free text that were read, by name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.texts: dict[str, dict[str, str]] = {}
        try:
            if path.exists() and not path.is_file():
                raise NoLogError(f'{named("log", path)} is neither a file nor a folder')
            self.stream: BinaryIO = path.open('rb')
        except OSError as error:
            words = f'{named("log", path)} cannot be read: {error.strerror}'
            raise NoLogError(f'{words}, {ALLOWED}') from None
        try:
            with self.checked():
                self.being_written = is_locked(self.stream)
                self.size = self.stream.seek(0, os.SEEK_END)
                begins = self.at(0, len(MAGIC))
                ends = self.at(max(0, self.size - len(MAGIC)), len(MAGIC))
            if not MAGIC.startswith(begins):
                words = f'{named("log", path)} is damaged, or no MCAP file: it begins with'
                raise NoLogError(f'{words} {begins!r}, {ALLOWED}')
            self.finished = ends == MAGIC and self.size > len(MAGIC)
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
        """Return the type of the messages of a known channel; empty if the file does not say."""
        schema = self.schemas.get(self.channels[channel_id].schema_id)
        return '' if schema is None else schema.name

    def record_at(self, start: int) -> McapRecord:
        """Read the record at an offset, in bytes; LogError if there is none."""
        with self.checked():
            frame = self.frame(start)
            record = None if frame is None else self.parse(frame)
            if record is None:
                raise DamageError(f'no record at byte {start}')
            return record

    def chunk_at(self, start: int) -> Iterator[McapRecord]:
        """Read the records of the chunk at an offset, in bytes; LogError if there is none."""
        chunk = self.record_at(start)
        with self.checked():
            if not isinstance(chunk, Chunk):
                raise DamageError(f'no chunk at byte {start}')
            for record in chunk_records(chunk):
                self.note(record)
                yield record

    @contextmanager
    def checked(self) -> Iterator[None]:
        """Make one LogError of whatever reading or parsing raises."""
        try:
            yield
        except LogError:
            raise
        except OSError as error:
            raise LogError(f'{named("log", self.path)} cannot be read: {error.strerror}') from None
        except Exception as error:
            found = str(error) if isinstance(error, DamageError) else repr(error)
            raise LogError(
                f'{named("log", self.path)} is damaged: found {one_line(found)}; "mcap recover", '
                'of the MCAP command line tool, copies what is still readable'
            ) from error

    def frame(self, start: int) -> Frame | None:
        """Read a record at an offset; None if the file was cut within it."""
        if not len(MAGIC) <= start <= self.size:
            raise DamageError(f'a record at byte {start} of {self.size}')
        head = self.at(start, HEAD)
        length = int.from_bytes(head[1:], 'little')
        left = self.size - start - HEAD
        if length <= left:
            if length > MAX_RECORD:
                raise DamageError(f'a record of {length} bytes: expected at most {MAX_RECORD}')
            return Frame(start, head[0], self.at(start + HEAD, length))
        begins = self.at(start + HEAD, min(max(left, 0), _BLOCK))
        if self.finished or (left >= 0 and not can_be_cut(head[0], length, begins)):
            raise DamageError(f'a record at byte {start} that does not end within the file')
        return None

    def parse(self, frame: Frame) -> McapRecord | None:
        """Parse a record; None if it is one of another program. Raises as parse_record."""
        return parse_record(frame.opcode, frame.content, exact=not self.finished)

    def note(self, record: McapRecord | None) -> None:
        """Keep texts and what describes messages, and hold messages to it."""
        if isinstance(record, Message):
            if record.channel_id not in self.channels:
                raise DamageError(f'a message of the unknown channel {record.channel_id}')
        elif isinstance(record, Metadata):
            self.texts[record.name] = record.metadata
        elif isinstance(record, Schema):
            if self.schemas.setdefault(record.id, record) != record:
                raise DamageError(f'two schemas with the id {record.id}')
        elif isinstance(record, Channel):
            if self.channels.setdefault(record.id, record) != record:
                raise DamageError(f'two channels with the id {record.id}')
            if record.schema_id and record.schema_id not in self.schemas:
                raise DamageError(f'a channel of the unknown schema {record.schema_id}')

    def check_footer(self, footer: Footer, frame: Frame) -> None:
        """Raise DamageError if the file does not end there, or the summary is damaged."""
        if not MAGIC.startswith(self.at(frame.end, len(MAGIC) + 1)):
            raise DamageError('more data after the footer')
        start = footer.summary_start
        if not start:
            return
        if not len(MAGIC) <= start <= frame.start or frame.end - start > MAX_RECORD:
            raise DamageError(f'a summary at byte {start} of {self.size}')
        summary = self.at(start, frame.end - 4 - start)  # with the footer up to the checksum
        if footer.summary_crc not in (0, zlib.crc32(summary)):
            raise DamageError('a summary with a wrong checksum')

    def ends_in_zeros(self, start: int) -> bool:
        """Whether only zeros follow from an offset on, more than a record ends in."""
        start = min(start, max(0, self.size - _ZEROS))
        while block := self.at(start, _BLOCK):
            if any(block):
                return False
            start += len(block)
        return True

    def at(self, start: int, length: int) -> bytes:
        """Read so many bytes, or as many as there were when the file was opened."""
        self.stream.seek(start)
        return self.stream.read(max(0, min(length, self.size - start)))

"""The records of an MCAP file that may be damaged: those behind the damage are found again.

What has a checksum of its own, chunks and attachments, is held to it.
"""

import os
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import breakup_chunk

from resting_aspects_ros.logs.mcap_file import MAGIC

_READ: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: Header.read,
    Opcode.FOOTER: Footer.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.MESSAGE_INDEX: MessageIndex.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.METADATA: Metadata.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: SummaryOffset.read,
    Opcode.DATA_END: DataEnd.read,
}
_CHECKED = (Opcode.CHUNK, Opcode.ATTACHMENT)
# Opcode and length, which come before what a record holds.
_HEAD = 9
# Those of a record that is searched for: shorter than 4 GiB.
_CANDIDATE = re.compile(rb'(?=[\x03-\x0f](.{4})\0{4})', re.DOTALL)
_LONGEST = 1 << 32
_BLOCK = 1 << 20


@dataclass(frozen=True)
class Piece:
    """A part of a file.

    start, end : int
        Where it is, bytes.
    record : McapRecord
        None where none can be read.
    content : list of McapRecord
        The records of a chunk, or the record itself; None if it is damaged.
    cut : bool
        No record, but no more than what is left of one when a file is broken off.
    """

    start: int
    end: int
    record: McapRecord | None = None
    content: list[McapRecord] | None = None
    cut: bool = False


def scan(file: BinaryIO, stop: int | None) -> Iterator[Piece]:
    """All of a file's data in its order, without gaps; InvalidMagic if it is no MCAP file.

    stop : int
        Where the data ends, bytes, if that is known; else it ends where it says so.
    """
    yield from _Scan(file, stop).pieces()


class _Scan:
    def __init__(self, file: BinaryIO, stop: int | None) -> None:
        self._file = file
        self._size = file.seek(0, os.SEEK_END)
        self._known = stop is not None
        self._stop = self._size if stop is None else stop
        self._channels: set[int] = set()  # of messages outside of chunks

    def pieces(self) -> Iterator[Piece]:
        start = self._at(0, len(MAGIC))
        begin = len(start)
        if start != MAGIC[:begin]:
            piece = self._read(begin)
            if piece is None or not isinstance(piece.record, Header):
                raise InvalidMagic(list(start))
            yield Piece(0, begin)
        while begin < self._stop:
            piece = self._read(begin) or self._gap(begin)
            yield piece
            begin = piece.end
            if isinstance(piece.record, Channel):
                self._channels.add(piece.record.id)
            if isinstance(piece.record, DataEnd) and not self._known:
                return

    def _read(self, start: int) -> Piece | None:
        """The record that begins here; None if there is none, or one that does not end."""
        try:
            return self._parse(start)
        except EndOfFile:
            return None

    def _parse(self, start: int) -> Piece | None:
        """As read; EndOfFile if it could be one, and the file is cut within it."""
        opcode, length = self._head(start)
        if not self._allowed(opcode):
            return None
        stream = _RecordStream(self._file, length, self._size - start - _HEAD)
        try:
            if opcode == Opcode.MESSAGE:
                record: McapRecord = Message.read(stream, length)
            else:
                record = _READ[opcode](stream)
        except (EndOfFile, OSError):
            raise
        except Exception:  # noqa: BLE001 - whatever the parser makes of what is no record
            return None
        end = start + _HEAD + length
        if stream.count != length or end > self._stop:
            return None
        if isinstance(record, Message) and not self._is_sure(record, end):
            return None
        return Piece(start, end, record, self._content(start, end, record))

    def _allowed(self, opcode: int) -> bool:
        return opcode in _READ or (opcode == Opcode.MESSAGE and bool(self._channels))

    def _is_sure(self, message: Message, end: int) -> bool:
        """Almost any bytes could be a message."""
        return message.channel_id in self._channels and self._leads_on(end)

    def _content(self, start: int, end: int, record: McapRecord) -> list[McapRecord] | None:
        if isinstance(record, Chunk):
            try:
                return breakup_chunk(record, validate_crc=True)
            except Exception:  # noqa: BLE001 - or the decompressor
                return None
        if isinstance(record, Attachment):
            content = self._at(start + _HEAD, end - start - _HEAD)
            crc = int.from_bytes(content[-4:], 'little')
            if crc not in (0, zlib.crc32(content[:-4])):
                return None
        return [record]

    def _gap(self, start: int) -> Piece:
        """From here to the next record, or to the end."""
        end = self._next(start + 1)
        return Piece(start, end, cut=end == self._stop and self._is_cut(start))

    def _next(self, start: int) -> int:
        while True:
            block = self._at(start, min(_BLOCK, self._stop - start))
            for match in _CANDIDATE.finditer(block):
                at = start + match.start()
                length = int.from_bytes(match[1], 'little')
                if at + _HEAD + length <= self._stop and self._begins(at):
                    return at
            if len(block) < _HEAD or start + len(block) >= self._stop:
                return self._stop
            start += len(block) - _HEAD + 1

    def _begins(self, start: int) -> bool:
        """Whether it is sure that a record begins here: by its checksum, or by the next one."""
        opcode, length = self._head(start)
        if opcode not in _CHECKED and not self._leads_on(start + _HEAD + length):
            return False
        piece = self._read(start)
        return piece is not None and piece.content is not None

    def _leads_on(self, start: int) -> bool:
        """Whether another record follows, if only the first bytes of one that is cut."""
        if self._stop - start < _HEAD:
            return start == self._stop or (start < self._stop and not self._known)
        opcode, length = self._head(start)
        return self._allowed(opcode) and length < _LONGEST

    def _is_cut(self, start: int) -> bool:
        """Whether the rest is the beginning of a record, or zeros, as a loss of power leaves."""
        if self._known or self._at(self._size - len(MAGIC), len(MAGIC)) == MAGIC:
            return False
        try:
            self._parse(start)
        except EndOfFile:
            return True
        return self._is_zero(start)

    def _is_zero(self, start: int) -> bool:
        while block := self._at(start, _BLOCK):
            if any(block):
                return False
            start += len(block)
        return True

    def _head(self, start: int) -> tuple[int, int]:
        """Opcode and length; what holds comes next in the file."""
        head = self._at(start, _HEAD)
        if len(head) < _HEAD:
            raise EndOfFile
        return head[0], int.from_bytes(head[1:], 'little')

    def _at(self, start: int, length: int) -> bytes:
        self._file.seek(max(0, start))
        return self._file.read(length)


class _RecordStream(ReadDataStream):
    """Reads one record, and nothing of the next; EndOfFile where the file ends first."""

    def __init__(self, stream: BinaryIO, length: int, left: int) -> None:
        super().__init__(stream)
        self._length = length
        self._left = left

    def read(self, length: int) -> bytes:
        if length < 0 or self.count + length > self._length:
            raise ValueError('a field does not end within its record')
        if self.count + length > self._left:
            raise EndOfFile
        return super().read(length)

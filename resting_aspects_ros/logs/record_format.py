"""The content of single MCAP records, from bytes that may be damaged.

The parsers are those of the mcap library. It trusts the lengths within a record and unpacks a
chunk to whatever size comes out; here both are limited.
"""

import zlib
from collections.abc import Callable, Iterator
from io import BytesIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
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

# Bytes of a record, and of what a chunk is unpacked to. The largest that a log needs is a part's
# description with its mesh.
MAX_RECORD = 1 << 28
# Opcode and length, which precede the content of a record.
HEAD = 9
_PARSERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
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
_IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
# Opcodes from here on are for records of other programs.
_PRIVATE = 0x80
# Where the length of a record's last long field is: after so many bytes and so many texts; how
# many bytes that length has, and how many follow the field.
_LAST_FIELD: dict[int, tuple[int, int, int, int]] = {
    Opcode.HEADER: (0, 1, 4, 0),
    Opcode.SCHEMA: (2, 2, 4, 0),
    Opcode.CHANNEL: (4, 2, 4, 0),
    Opcode.CHUNK: (28, 1, 8, 0),
    Opcode.MESSAGE_INDEX: (2, 0, 4, 0),
    Opcode.ATTACHMENT: (16, 2, 8, 4),
    Opcode.METADATA: (0, 1, 4, 0),
}


class DamageError(Exception):
    """What was found instead of what a writer of MCAP leaves."""


def parse_record(opcode: int, content: bytes, *, exact: bool) -> McapRecord | None:
    """Parse a record; None if it is one of another program, which MCAP allows.

    exact : bool
        Refuse what a later version of MCAP may add: unknown records, and fields at the end.

    Raises DamageError, or whatever the parser raises for content that is none.
    """
    stream = _Content(content)
    if opcode == Opcode.MESSAGE:
        return Message.read(stream, len(content))
    if opcode not in _PARSERS:
        if exact or opcode < _PRIVATE:
            raise DamageError(f'a record with the unknown opcode {opcode}')
        return None
    record = _PARSERS[opcode](stream)
    if exact and stream.count != len(content):
        raise DamageError(f'{type(record).__name__} record of {len(content)} bytes')
    if isinstance(record, Attachment):
        _check_crc('an attachment', int.from_bytes(content[-4:], 'little'), content[:-4])
    return record


def split_records(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Split bytes into records: opcode and content of each. Raises DamageError."""
    start = 0
    while start < len(content):
        begin = start + HEAD
        start = begin + int.from_bytes(content[start + 1 : begin], 'little')
        if not begin <= start <= len(content):
            raise DamageError('a record that does not end where it must')
        yield content[begin - HEAD], content[begin:start]


def chunk_records(chunk: Chunk) -> Iterator[McapRecord]:
    """Unpack a chunk, and parse its records one by one; errors as parse_record."""
    content = _unpacked(chunk)
    _check_crc('a chunk', chunk.uncompressed_crc, content)
    return _parsed(content)


def _parsed(content: bytes) -> Iterator[McapRecord]:
    for opcode, each in split_records(content):
        if opcode not in _IN_CHUNKS and opcode < _PRIVATE:
            raise DamageError(f'a record with the opcode {opcode} in a chunk')
        record = parse_record(opcode, each, exact=False)
        if record is not None:
            yield record


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > MAX_RECORD:
        raise DamageError(f'a chunk of {size} bytes unpacked: expected at most {MAX_RECORD}')
    # A byte more than was declared shows that there is more, and nothing is unpacked beyond.
    if chunk.compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
            content = reader.read(size + 1)
    elif chunk.compression == 'lz4':
        content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression:
        raise DamageError(f'a chunk with the unknown compression {chunk.compression[:20]!r}')
    else:
        content = chunk.data
    if len(content) != size:
        raise DamageError(f'a chunk that is not unpacked to its {size} bytes')
    return bytes(content)


def _check_crc(what: str, crc: int, content: bytes) -> None:
    if crc not in (0, zlib.crc32(content)):
        raise DamageError(f'{what} with a wrong checksum')


def can_be_cut(opcode: int, length: int, content: bytes) -> bool:
    """Whether this is the beginning of a record of so many bytes, of which the rest is missing.

    Its length is held to the one that the record itself repeats: were it just damaged, all that
    follows would be taken for a part of this record.
    """
    if opcode != Opcode.MESSAGE and opcode not in _PARSERS:
        return False
    at, texts, width, after = _LAST_FIELD.get(opcode, (len(content), 0, 1, 0))
    for _ in range(texts):
        at += 4 + int.from_bytes(content[at : at + 4], 'little')
    field = content[at : at + width]
    return len(field) < width or length == at + width + int.from_bytes(field, 'little') + after


class _Content(ReadDataStream):
    """A record's content; DamageError where a field does not end within it."""

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO())
        self._content = content

    def read(self, length: int) -> bytes:
        start = self._count
        self._count += length
        if not start <= self._count <= len(self._content):
            raise DamageError('a field that does not end within its record')
        return self._content[start : self._count]

"""Parsing of single MCAP records from bytes that may be damaged.

The parsers are those of the mcap library. The library trusts the lengths within a record and
unpacks a chunk to any size; this module limits both.
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
from mcap.summary import Summary

from resting_aspects_ros.logs.bag_files import unpacking_failure

# Maximum size in bytes of a record, and of an unpacked chunk. The largest record of a log is a
# part's description with its mesh.
MAX_RECORD = 1 << 28
# Size of opcode and length, which precede the content of a record.
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


class DamageError(Exception):
    """The bytes are not valid MCAP; the message describes what was found."""


def parse_record(opcode: int, content: bytes) -> McapRecord:
    """Parse a record; raises DamageError, or any exception of the parser for invalid content.

    Private records, which MCAP allows, are rejected: no writer of ROS logs uses them.
    """
    stream = ReadDataStream(_Content(content))
    if opcode == Opcode.MESSAGE:
        return Message.read(stream, len(content))
    if opcode not in _PARSERS:
        raise DamageError(f'a record with the unknown opcode {opcode}')
    record = _PARSERS[opcode](stream)
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
            raise DamageError('a record that exceeds its container')
        yield content[begin - HEAD], content[begin:start]


def chunk_records(chunk: Chunk) -> Iterator[McapRecord]:
    """Unpack a chunk, and parse its records one by one; for errors see `parse_record`."""
    content = _unpacked(chunk)
    _check_crc('a chunk', chunk.uncompressed_crc, content)
    return _parsed(content)


def _parsed(content: bytes) -> Iterator[McapRecord]:
    for opcode, each in split_records(content):
        if opcode not in _IN_CHUNKS:
            raise DamageError(f'a record with the opcode {opcode} in a chunk')
        yield parse_record(opcode, each)


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > MAX_RECORD:
        raise DamageError(f'a chunk of {size} bytes unpacked: expected at most {MAX_RECORD}')
    # Unpacking stops one byte after the declared size, which is enough to detect excess data.
    try:
        if chunk.compression == 'zstd':
            with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
                content = reader.read(size + 1)
        elif chunk.compression == 'lz4':
            content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        elif chunk.compression:
            raise DamageError(f'a chunk with the unknown compression {chunk.compression[:20]!r}')
        else:
            content = chunk.data
    except (zstandard.ZstdError, RuntimeError) as error:  # the second is that of lz4
        raise DamageError(unpacking_failure(error)) from None
    if len(content) != size:
        raise DamageError(f'a chunk whose unpacked size is not the declared {size} bytes')
    return bytes(content)


def _check_crc(what: str, crc: int, content: bytes) -> None:
    if crc not in (0, zlib.crc32(content)):
        raise DamageError(f'{what} with a wrong checksum')


def parse_summary(content: bytes) -> Summary:
    """Parse the index at the end of a file; for errors see `parse_record`."""
    summary = Summary()
    for opcode, each in split_records(content):
        record = parse_record(opcode, each)
        if isinstance(record, Schema):
            summary.schemas[record.id] = record
        elif isinstance(record, Channel):
            summary.channels[record.id] = record
        elif isinstance(record, Statistics):
            summary.statistics = record
        elif isinstance(record, ChunkIndex):
            summary.chunk_indexes.append(record)
        elif isinstance(record, MetadataIndex):
            summary.metadata_indexes.append(record)
    return summary


def is_complete(summary: Summary) -> bool:
    """Return whether an index covers all messages; DamageError if it is inconsistent."""
    statistics = summary.statistics
    if statistics is None or statistics.chunk_count != len(summary.chunk_indexes):
        return False
    counts = statistics.channel_message_counts
    named = {*counts, *(k for each in summary.chunk_indexes for k in each.message_index_offsets)}
    if unknown := named - summary.channels.keys():
        raise DamageError(f'a message index of the unknown channel {min(unknown)}')
    return bool(statistics.chunk_count or not statistics.message_count)


class _Content(BytesIO):
    """Content of a record; reading beyond its end raises DamageError."""

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        if len(data) != size:
            raise DamageError('a field that exceeds its record')
        return data

"""How much of a log can be read, and whether it has the end that belongs to it."""

import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import BinaryIO

from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Chunk, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.summary import Summary

from resting_aspects_ros.logs.mcap_file import summary_start
from resting_aspects_ros.logs.record_scan import Piece, scan

_BLOCK = 1 << 20


@dataclass
class Extent:
    """What was found in a file.

    messages, attachments : int
        That can be read.
    lost_bytes : int
        In which no record can be read, but for the last of a file that was broken off.
    lost_chunks : int
        Whole in length, and not in what they hold: none of their messages can be had.
    lost_messages : int
        Of topics whose description is lost.
    lost_attachments : list of str
        The names of those that are damaged.
    wrong_checksum : bool
        Something is not as it was written.
    finished : bool
        The file has its end, with the index that belongs to it.
    """

    messages: int = 0
    attachments: int = 0
    lost_bytes: int = 0
    lost_chunks: int = 0
    lost_messages: int = 0
    lost_attachments: list[str] = field(default_factory=list)
    wrong_checksum: bool = False
    finished: bool = False

    @property
    def damaged(self) -> bool:
        """Whether more is lost than the end of a file that was broken off."""
        return bool(self.losses()) or self.wrong_checksum

    def losses(self) -> list[str]:
        """What is lost, in words."""
        counted = (
            (self.lost_chunks, 'chunk', ''),
            (self.lost_messages, 'message', ' of unknown topics'),
            (self.lost_bytes, 'byte', ' in between'),
        )
        words = [f'{n} {what}{"s" * (n > 1)}{more}' for n, what, more in counted if n]
        return [*words, *(f'attachment {name!r}' for name in self.lost_attachments)]


class Survey:
    """What one pass over a file finds.

    extent : Extent
    schemas, channels : dict
        What its messages are, by the numbers that they have in the file.
    stop : int
        Where its data ends, bytes; None if that is known by its records only.

    Raises InvalidMagic if it is no MCAP file.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.extent = Extent()
        self.stop = summary_start(file)
        summary = _summary(file) if self.stop is not None else None
        self.schemas: dict[int, Schema] = dict(summary.schemas) if summary else {}
        self.channels: dict[int, Channel] = dict(summary.channels) if summary else {}
        self._messages: Counter[int] = Counter()
        # Where chunks, attachments and notes are, and how long, bytes.
        self._found: dict[type, dict[int, int]] = {Chunk: {}, Attachment: {}, Metadata: {}}
        end: Piece | None = None
        for end in scan(file, self.stop):
            self._take(end)
        if end is not None and isinstance(end.record, DataEnd):
            crc = end.record.data_section_crc
            self.extent.wrong_checksum = crc not in (0, _crc(file, end.start))
        self._count()
        self.extent.finished = summary is not None and self._agrees(summary)

    def is_known(self, channel_id: int) -> bool:
        """Whether it is known of which topic and type the messages of a channel are."""
        channel = self.channels.get(channel_id)
        return channel is not None and channel.schema_id in self.schemas

    def _take(self, piece: Piece) -> None:
        record = piece.record
        if record is None:
            self.extent.lost_bytes += 0 if piece.cut else piece.end - piece.start
        elif isinstance(record, Schema | Channel) and self._found[Chunk]:
            return  # of a summary that has no right checksum: those in the chunks have one
        elif piece.content is not None:
            self._found.get(type(record), {})[piece.start] = piece.end - piece.start
            for each in piece.content:
                self._note(each)
        elif isinstance(record, Attachment):
            self.extent.lost_attachments.append(record.name)
        else:
            self.extent.lost_chunks += 1

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, Message):
            self._messages[record.channel_id] += 1
        elif isinstance(record, Attachment):
            self.extent.attachments += 1

    def _count(self) -> None:
        for channel_id, number in self._messages.items():
            if self.is_known(channel_id):
                self.extent.messages += number
            else:
                self.extent.lost_messages += number

    def _agrees(self, summary: Summary) -> bool:
        """Whether a summary says what was found, no more and no less."""
        statistics = summary.statistics
        if statistics is None:
            return False
        counts = {key: n for key, n in statistics.channel_message_counts.items() if n}
        chunks = {each.chunk_start_offset: each.chunk_length for each in summary.chunk_indexes}
        attachments = {each.offset: each.length for each in summary.attachment_indexes}
        notes = {each.offset: each.length for each in summary.metadata_indexes}
        return (
            counts == self._messages
            and statistics.message_count == sum(counts.values())
            and self._found == {Chunk: chunks, Attachment: attachments, Metadata: notes}
        )


def _summary(file: BinaryIO) -> Summary | None:
    try:
        file.seek(0)
        return SeekingReader(file).get_summary()
    except OSError:
        raise
    except Exception:  # noqa: BLE001 - whatever the parser makes of what has no checksum
        return None


def _crc(file: BinaryIO, end: int) -> int:
    """The checksum over the beginning of a file, so many bytes."""
    crc = left = 0
    file.seek(0)
    left = end
    while left and (block := file.read(min(_BLOCK, left))):
        crc = zlib.crc32(block, crc)
        left -= len(block)
    return crc

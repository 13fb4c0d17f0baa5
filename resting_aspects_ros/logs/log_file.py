"""The records of an MCAP file in their order, and its index."""

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.summary import Summary

from resting_aspects_ros.logs.mcap_file import FOOTER_SIZE, MAGIC
from resting_aspects_ros.logs.record_file import RecordFile
from resting_aspects_ros.logs.record_format import (
    DamageError,
    chunk_records,
    parse_record,
    split_records,
)


@dataclass
class _Totals:
    """What was read of a file, to be held to what the file says of itself at its end.

    counts : Counter
        Messages by channel, metadata and attachments.
    crc : int
        The checksum over all bytes so far.
    in_data : bool
        The data section is not over.
    """

    counts: Counter[int | type] = field(default_factory=Counter)
    crc: int = zlib.crc32(MAGIC)
    in_data: bool = True

    def check(self, record: McapRecord | None) -> None:
        """Raise DamageError if a record says that there is other data than was read."""
        if isinstance(record, DataEnd):
            self.in_data = False
            if record.data_section_crc not in (0, self.crc):
                raise DamageError('data with a wrong checksum')
        elif isinstance(record, Statistics):
            found = {k: n for k, n in self.counts.items() if isinstance(k, int)}
            by_channel = {k: n for k, n in record.channel_message_counts.items() if n}
            if (
                (by_channel and by_channel != found)  # a writer may leave it out
                or record.message_count != sum(found.values())
                or record.metadata_count != self.counts[Metadata]
                or record.attachment_count != self.counts[Attachment]
            ):
                raise DamageError('statistics that differ from what is there')


class LogFile(RecordFile):
    """An MCAP file, open for reading, whole or broken off; to be used with `with`.

    messages : int
        How many ``records`` has read.
    """

    messages = 0

    def records(self) -> Iterator[Message | Metadata | Attachment]:
        """Read the messages, metadata and attachments, in their order, up to where it is cut.

        The schemas and channels of messages are in ``schemas`` and ``channels``. Raises LogError
        if the file cannot be read or is damaged. Only who reads to the end knows that it is not:
        checksums and counts of the whole file come last.
        """
        with self.checked():
            yield from self._records()

    def summary(self) -> Summary | None:
        """Read the index at the end; None if there is none. LogError if it is damaged."""
        if not self.finished:
            return None
        with self.checked():
            return self._summary()

    def _records(self) -> Iterator[Message | Metadata | Attachment]:
        totals = _Totals()
        start = len(MAGIC)
        while start <= self.size and (frame := self.frame(start)) is not None:
            try:
                record = self.parse(frame)
                content = chunk_records(record) if isinstance(record, Chunk) else [record]
            except Exception:
                if not self.finished and self.ends_in_zeros(frame.end - 1):
                    return  # as after a loss of power
                raise
            for each in content:
                self.note(each)
                if isinstance(each, Message | Metadata | Attachment) and totals.in_data:
                    totals.counts[
                        each.channel_id if isinstance(each, Message) else type(each)
                    ] += 1
                    self.messages += isinstance(each, Message)
                    yield each
            totals.check(record)
            if isinstance(record, Footer):
                self.check_footer(record, frame)
                return
            totals.crc = zlib.crc32(frame.content, zlib.crc32(frame.head, totals.crc))
            start = frame.end

    def _summary(self) -> Summary | None:
        end = self.size - len(MAGIC) - FOOTER_SIZE
        frame = self.frame(end)
        footer = None if frame is None else self.parse(frame)
        if frame is None or not isinstance(footer, Footer):
            raise DamageError('no footer')
        self.check_footer(footer, frame)
        if not footer.summary_start:
            return None
        found = Summary()
        start = footer.summary_start
        for opcode, content in split_records(self.at(start, end - start)):
            record = parse_record(opcode, content, exact=False)
            if isinstance(record, Schema):
                found.schemas[record.id] = record
            elif isinstance(record, Channel):
                found.channels[record.id] = record
            elif isinstance(record, Statistics):
                found.statistics = record
            elif isinstance(record, ChunkIndex):
                found.chunk_indexes.append(record)
            elif isinstance(record, MetadataIndex):
                found.metadata_indexes.append(record)
        for each in (*found.schemas.values(), *found.channels.values()):
            self.note(each)
        return found if _is_complete(found) else None


def _is_complete(summary: Summary) -> bool:
    """Whether an index has all messages; DamageError if it contradicts itself."""
    statistics = summary.statistics
    if statistics is None or statistics.chunk_count != len(summary.chunk_indexes):
        return False
    counts = statistics.channel_message_counts
    named = {*counts, *(k for each in summary.chunk_indexes for k in each.message_index_offsets)}
    if unknown := named - summary.channels.keys():
        raise DamageError(f'an index of messages of the unknown channel {min(unknown)}')
    if counts and sum(counts.values()) != statistics.message_count:
        raise DamageError('statistics that contradict themselves')
    return bool((counts and statistics.chunk_count) or not statistics.message_count)

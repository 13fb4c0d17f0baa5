"""Reading a closed log through the index at its end, without reading the rest of the file."""

from pathlib import Path

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.input_files import named
from resting_aspects_ros.logs.bag_files import log_files
from resting_aspects_ros.logs.message_reader import check_definition, written_hash
from resting_aspects_ros.logs.record_reader import LogFile


class NoIndexError(LogError):
    """The log was not closed, is being written, or comes from a writer that writes no index."""


class IndexedLog(LogFile):
    """A closed log, opened for reading; to be used as a context manager.

    log : Path
        The folder of a run, or its MCAP file.

    Raises LogError if it is damaged or not a log, NoIndexError if it has no index.
    """

    def __init__(self, log: Path) -> None:
        file, *others = log_files(log)
        if others:
            raise NoIndexError(f'{named("log", log)} has no index of all its files')
        super().__init__(file)
        try:
            summary = self.summary()
            if summary is None or summary.statistics is None:
                raise NoIndexError(
                    f'{named("log", self.path)} has no index: it was not closed, or is being '
                    'written ("resting_aspects recover" closes it)'
                )
        except BaseException:
            self.stream.close()
            raise
        self._index = summary
        self.message_count: int = summary.statistics.message_count

    def read_metadata(self) -> dict[str, dict[str, str]]:
        """Return the metadata records, by name."""
        records = [self.metadata_at(each.offset) for each in self._index.metadata_indexes]
        return {each.name: each.metadata for each in records}

    def first(self, type_name: str) -> bytes | None:
        """Return the first message of a type in the file as CDR; None if there is none."""
        return self._message(type_name, last=False)

    def last(self, type_name: str) -> bytes | None:
        """Return the last message of a type in the file as CDR; None if there is none."""
        return self._message(type_name, last=True)

    def _message(self, type_name: str, *, last: bool) -> bytes | None:
        wanted = {k for k in self.channels if self.type_of(k) == type_name}
        for k in wanted:
            check_definition(self.path, type_name, written_hash(self.channels[k]))
        chunks = [
            each.chunk_start_offset
            for each in self._index.chunk_indexes
            # A writer may omit the message index.
            if not each.message_index_offsets or wanted & each.message_index_offsets.keys()
        ]
        for start in sorted(chunks, reverse=last):
            data = [each.data for each in self.messages_at(start) if each.channel_id in wanted]
            if data:
                return bytes(data[-1] if last else data[0])
        return None

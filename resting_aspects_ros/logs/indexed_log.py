"""What a closed log says, found by the index at its end: the rest of the file is not read."""

from collections import Counter
from pathlib import Path
from types import TracebackType

from mcap.reader import SeekingReader
from mcap.summary import Summary

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.logs.log_reader import check_definition, one_file, written_hash
from resting_aspects_ros.logs.mcap_file import summary_start


class NoIndexError(LogError):
    """The log was broken off, or is being written."""


class IndexedLog:
    """A closed log, open for reading; use it with `with`.

    log : Path
        The folder of a run, or its MCAP file.

    Raises LogError if it is no log, NoIndexError if it has no index.
    """

    def __init__(self, log: Path) -> None:
        self.path = one_file(log)
        try:
            self._file = self.path.open('rb')
        except OSError as error:
            raise LogError(f'log {str(self.path)!r} cannot be read: {error.strerror}') from None
        try:
            self._reader, self._summary = self._open()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> 'IndexedLog':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()

    @property
    def span(self) -> tuple[int, int]:
        """Log time of the first and of the last message, ns since 1970."""
        statistics = self._summary.statistics
        assert statistics is not None
        return statistics.message_start_time, statistics.message_end_time

    def counts(self) -> Counter[str]:
        """How many messages of each type there are."""
        statistics = self._summary.statistics
        assert statistics is not None
        counts: Counter[str] = Counter()
        for channel, number in statistics.channel_message_counts.items():
            counts[self._type(channel)] += number
        return counts

    def notes(self) -> dict[str, dict[str, str]]:
        """The records of free text, by name."""
        try:
            return {each.name: each.metadata for each in self._reader.iter_metadata()}
        except Exception as error:
            raise self._damaged(error) from error

    def first(self, type_name: str) -> bytes | None:
        """The message of a type that was logged first, in CDR; None if there is none."""
        return self._message(type_name, reverse=False)

    def last(self, type_name: str) -> bytes | None:
        """The message of a type that was logged last, in CDR; None if there is none."""
        return self._message(type_name, reverse=True)

    def _message(self, type_name: str, *, reverse: bool) -> bytes | None:
        channels = [c for k, c in self._summary.channels.items() if self._type(k) == type_name]
        for channel in channels:
            check_definition(self.path, type_name, written_hash(channel))
        topics = {channel.topic for channel in channels}
        if not topics:
            return None
        try:
            for _, channel, message in self._reader.iter_messages(topics, reverse=reverse):
                if channel in channels:
                    return bytes(message.data)
        except Exception as error:
            raise self._damaged(error) from error
        return None

    def _type(self, channel: int) -> str:
        return self._summary.schemas[self._summary.channels[channel].schema_id].name

    def _open(self) -> tuple[SeekingReader, Summary]:
        try:
            reader = SeekingReader(self._file, validate_crcs=True)
            summary = reader.get_summary() if summary_start(self._file) is not None else None
        except OSError as error:
            raise LogError(f'log {str(self.path)!r} cannot be read: {error.strerror}') from None
        except Exception:  # noqa: BLE001 - whatever the parser makes of what has no checksum
            summary = None
        if summary is None or summary.statistics is None:
            raise NoIndexError(
                f'log {str(self.path)!r} has no index: it was broken off, or is being written '
                '("resting_aspects recover" closes it)'
            )
        return reader, summary

    def _damaged(self, error: Exception) -> LogError:
        return LogError(f'log {str(self.path)!r} is damaged: {error}')

"""Reading of a log that consists of several files, such as a split bag, in time order."""

import heapq
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from mcap.records import Channel, Message

from resting_aspects_ros.logs.bag_files import log_files
from resting_aspects_ros.logs.record_reader import LogFile

Self = TypeVar('Self', bound='SplitLog')  # typing.Self is newer than Python 3.10
# Each file numbers its channels with 16 bits.
_CHANNELS = 1 << 16


def open_log(path: Path) -> 'LogFile | SplitLog':
    """Open a log of one or several files; for paths and errors see `log_files`."""
    files = log_files(path)
    return LogFile(files[0]) if len(files) == 1 else SplitLog(path, files)


class SplitLog:
    """Several MCAP files that are read as one; the attributes are those of LogFile."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        with ExitStack() as stack:
            self._files = [stack.enter_context(LogFile(file)) for file in files]
            self._opened = stack.pop_all()
        self.finished = all(file.finished for file in self._files)
        self.being_written = any(file.being_written for file in self._files)

    def __enter__(self: Self) -> Self:  # noqa: PYI019
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._opened.close()

    @property
    def messages(self) -> int:
        """Number of messages that were read."""
        return sum(file.messages for file in self._files)

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records that were read, by name."""
        return {name: values for file in self._files for name, values in file.metadata.items()}

    def type_of(self, channel_id: int) -> str:
        """Return the message type of a known channel."""
        return self._files[channel_id // _CHANNELS].type_of(channel_id % _CHANNELS)

    def records(self) -> Iterator[Message]:
        """Yield the messages of all files in time order; see LogFile.records."""
        each = (self._messages(k, file) for k, file in enumerate(self._files))
        return heapq.merge(*each, key=lambda message: message.log_time)

    def _messages(self, number: int, file: LogFile) -> Iterator[Message]:
        for record in file.records():
            if isinstance(record, Message):
                channel = file.channels[record.channel_id]
                record.channel_id += number * _CHANNELS
                self.channels[record.channel_id] = channel
                yield record

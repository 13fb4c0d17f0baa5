"""The drops of a study that are done: a file to which finished points are appended."""

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, StrictStr

from resting_aspects_ros.core.errors import InvalidValueError, OutputError, one_line, shown
from resting_aspects_ros.core.schema import Count, validated

Counts = npt.NDArray[np.int64]

SCHEMA_VERSION = 1
STORE = 'points.jsonl'


class _Header(BaseModel):
    schema_version: Literal[SCHEMA_VERSION]  # type: ignore[valid-type]
    versions: dict[StrictStr, StrictStr]


class _Counts(BaseModel):
    point: StrictStr
    first: Count
    end: Count
    counts: list[list[Count]]


class PointStore:
    """Counts of points by key, in a file of JSON lines that is only ever appended to.

    A line that was cut short, because the disk was full or the machine stopped, is removed when
    the file is opened again; all lines before it are valid. The file is locked while it is open.

    Parameters
    ----------
    path : Path or None
        None: the counts are only kept in memory.
    versions : mapping
        Versions of everything that determines the counts. A file of other versions is refused.

    Raises
    ------
    InvalidValueError
        If another program uses the file, it has other versions, or it is not such a file.
    OutputError
        If the file cannot be written.
    """

    def __init__(self, path: Path | None, versions: Mapping[str, str]) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self._counts: dict[str, tuple[int, Counts]] = {}
        if path is None:
            return
        try:
            self._file = path.open('a+b')
        except OSError as error:
            raise OutputError(f'{str(path)!r} cannot be written: {error.strerror}') from error
        try:
            self._lock()
            self._read(versions)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> 'PointStore':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()

    def done(self, key: str) -> int:
        """Return the number of drops of a point that are done, which are its first ones."""
        return self._counts[key][0] if key in self._counts else 0

    def counts(self, key: str) -> Counts | None:
        """Return the counts of a point; None if it has no drops."""
        return self._counts[key][1] if key in self._counts else None

    def add(self, key: str, first: int, end: int, counts: Counts) -> None:
        """Append the counts of the drops [first, end) of a point; raises OutputError."""
        if first != self.done(key):
            raise ValueError(f'drops {first} to {end} do not follow {self.done(key)}')
        self._append({'point': key, 'first': first, 'end': end, 'counts': counts.tolist()})
        self._count(key, first, end, counts)

    def _count(self, key: str, first: int, end: int, counts: Counts) -> None:
        before = self._counts.get(key)
        if first == (0 if before is None else before[0]):
            total = counts if before is None else before[1] + counts
            if total.shape != counts.shape:
                raise ValueError(f'point {shown(key)} has counts of different shapes')
            self._counts[key] = (end, total)

    def _append(self, document: Mapping[str, Any]) -> None:
        if self._file is None:
            return
        size = self._file.seek(0, os.SEEK_END)
        try:
            self._file.write(json.dumps(document, separators=(',', ':')).encode() + b'\n')
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self._drop_after(size)
            raise OutputError(
                f'{str(self._path)!r} cannot be written: {error.strerror}; the '
                f'{len(self._counts)} points in it are complete, and the same command continues '
                'the study'
            ) from error

    def _drop_after(self, size: int) -> None:
        """Remove an incomplete line. If that fails, it is removed when the file is read."""
        assert self._file is not None
        try:
            raw = self._file.fileno()
            os.ftruncate(raw, size)
        except OSError:
            return

    def _lock(self) -> None:
        assert self._file is not None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InvalidValueError(
                f'invalid study {shown(str(self._path))}: expected one that no other program '
                'is running'
            ) from None
        except OSError:
            return  # a file system without locks

    def _read(self, versions: Mapping[str, str]) -> None:
        assert self._file is not None
        self._file.seek(0)
        data = self._file.read()
        whole = data[: data.rfind(b'\n') + 1]
        if len(whole) < len(data):
            os.ftruncate(self._file.fileno(), len(whole))
        lines = whole.splitlines()
        if not lines:
            self._append({'schema_version': SCHEMA_VERSION, 'versions': dict(versions)})
            return
        try:
            header, *documents = [json.loads(line) for line in lines]
            found = validated(_Header, header, 'line 1').versions
            for number, document in enumerate(documents, 2):
                each = validated(_Counts, document, f'line {number}')
                self._count(each.point, each.first, each.end, np.array(each.counts))
        except (ValueError, RecursionError, InvalidValueError) as error:
            raise InvalidValueError(
                f'invalid file {shown(str(self._path))}: expected points of a study: '
                f'{one_line(str(error))}'
            ) from None
        for name, here in versions.items():
            if found.get(name) != here:
                raise InvalidValueError(
                    f'invalid study {shown(str(self._path))}: its drops were made with {name} '
                    f'{found.get(name)}, expected {here}, because drops of two versions do not '
                    'belong together; use another folder'
                )

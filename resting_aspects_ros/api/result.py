"""What all results have: a document, a picture and a page; and output files.

Output files are checked before the work, and replaced only when they are complete.
"""

import csv
import os
import tempfile
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.runner import Consumer
from resting_aspects_ros.errors import InvalidValueError, OutputError
from resting_aspects_ros.statistics.poses import DecidedBy, RestingPoses, RestStatus

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.page import Page


# -- Files ----------------------------------------------------------------------------------------


POSES_HEADER = (
    'drop', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw',
    'status', 'decided_by', 'time_to_rest', 'energy_growth', 'aspect',
)  # fmt: skip


def make_folder(flag: str, folder: Path) -> None:
    """Make the folder that a flag names; InvalidValueError if nothing can be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # not access(2): the file system may be read-only
            pass
    except (OSError, ValueError) as error:
        raise InvalidValueError(
            f'invalid {flag} {str(folder)!r}: expected a folder that can be made and written: '
            f'{_reason(error)}'
        ) from None


def check_output(flag: str, path: Path | None) -> None:
    """Raise InvalidValueError if the file of a flag could not be written after the work."""
    if path is None:
        return
    if not path.parent.is_dir():
        problem = f'the folder {str(path.parent)!r} does not exist'
    elif path.is_dir():
        problem = 'this is a folder'
    elif not os.access(path if path.exists() else path.parent, os.W_OK):
        problem = 'writing is not permitted'
    else:
        return
    raise InvalidValueError(
        f'invalid {flag} {str(path)!r}: expected a file that can be written: {problem}'
    )


def check_files(flag: str, folder: Path, files: Iterable[str]) -> None:
    """Make the folder; raises InvalidValueError if it, or one of the files, cannot be written."""
    make_folder(flag, folder)
    for name in files:
        check_output(flag, folder / name)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path, and replace the file with it at the end if nothing failed.

    A device or a pipe is written directly.
    """
    target = path.resolve()  # a symbolic link is kept
    ordinary = (path.is_file() or not path.exists()) and not path.is_relative_to('/dev')
    try:
        if not ordinary:
            yield path
            return
        part = target.with_name(f'{target.stem}.{uuid.uuid4().hex[:8]}.part{target.suffix}')
        try:
            yield part
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f'{str(path)!r} cannot be written: {_reason(error)}') from error


def _reason(error: BaseException) -> str:
    return getattr(error, 'strerror', None) or str(error)


@contextmanager
def poses_file(flag: str, path: Path) -> Iterator[Consumer]:
    """Yield what writes a line for each drop into a file; `whole_file` moves it into place.

    Raises InvalidValueError if the file cannot be made, and OutputError if it cannot be written.
    """
    with ExitStack() as stack:
        try:
            part = stack.enter_context(whole_file(path))
            file = stack.enter_context(part.open('w', newline='', encoding='utf-8'))
        except (OSError, OutputError) as error:
            reason = _reason(error.__cause__ or error)
            raise InvalidValueError(
                f'invalid {flag} {str(path)!r}: expected a file that can be written: {reason}'
            ) from None
        csv.writer(file).writerow(POSES_HEADER)

        def write(poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
            try:
                csv.writer(file).writerows(_rows(poses, ids.tolist()))
                file.flush()
            except OSError as error:
                raise OutputError(f'{str(path)!r} cannot be written: {_reason(error)}') from error

        yield write


def _rows(poses: RestingPoses, ids: list[int]) -> Iterator[tuple[Any, ...]]:
    """Yield rows in full precision: Python prints the shortest text of exactly this number."""
    for k in range(len(poses)):
        yield (
            poses.first_drop + k,
            *poses.position[k].tolist(),
            *poses.orientation[k].tolist(),
            RestStatus(poses.status[k]).name,
            DecidedBy(poses.decided_by[k]).name,
            float(poses.time_to_rest[k]),
            float(poses.energy_growth[k]),
            ids[k],
        )


# -- Results --------------------------------------------------------------------------------------


class Result:
    """A result with a document; most results also have a picture or a page.

    Arguments of `to_json` and `report` are those of `document` and `page`.
    """

    def document(self, *given: Any) -> Mapping[str, object]:
        """Return the document that the command prints with ``--json``."""
        raise NotImplementedError

    def figure(self) -> 'Figure':
        """Return the picture of the result."""
        raise NotImplementedError

    def page(self, *given: Any) -> 'Page':
        """Return the page of the result."""
        raise NotImplementedError

    def to_json(self, *given: Any) -> str:
        """Return the document as text."""
        from resting_aspects_ros.report.document import plain, to_json

        return to_json({name: plain(value) for name, value in self.document(*given).items()})

    def save_json(self, path: str | Path) -> None:
        """Write the document; raises OutputError."""
        with whole_file(Path(path)) as part:
            part.write_text(self.to_json(), encoding='utf-8')

    def save_picture(self, path: str | Path) -> None:
        """Write the picture as PNG; raises OutputError."""
        save_figure(self.figure(), Path(path))

    def report(self, folder: str | Path, *given: Any) -> Path:
        """Write a page with its figures into a folder, which is made if necessary.

        Returns the path of the page; raises OutputError if it cannot be written.
        """
        make_folder('folder', Path(folder))
        return write_page(self.page(*given), Path(folder))


def save_figure(figure: 'Figure', path: Path) -> None:
    """Write a figure as PNG; raises OutputError."""
    from resting_aspects_ros.report.figure import png_bytes

    with whole_file(path) as part:
        part.write_bytes(png_bytes(figure))


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, with the keys of the first one as the header; raises OutputError."""
    with whole_file(path) as part, part.open('w', newline='', encoding='utf-8') as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def write_page(page: 'Page', folder: Path) -> Path:
    """Write a page with its figures, and return its path. Raises OutputError.

    Files that an earlier page had in addition are removed.
    """
    written = set()
    for name, data in page.files():
        with whole_file(folder / name) as file:
            file.write_bytes(data)
        written.add(name)
    for name in page.names:
        if name not in written:
            (folder / name).unlink(missing_ok=True)
    return folder / page.file

"""What all results have: a JSON document, a picture and a page, and the files of these."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.api.output_files import check_output, make_folder, whole_file
from resting_aspects_ros.report.document import plain, to_json

if TYPE_CHECKING:  # these imports are slow: they are made when a picture or a page is written
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.page import Page


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


def check_files(flag: str, folder: Path, names: Sequence[str]) -> None:
    """Make the folder; raises InvalidValueError if it, or a file in it, cannot be written."""
    make_folder(flag, folder)
    for name in names:
        check_output(flag, folder / name)


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

"""Outlines of a part: what a camera straight above sees of it in each aspect."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.api.result import Result, make_folder, whole_file
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import to_json
from resting_aspects_ros.report.outlines import (
    PIXELS_PER_MM,
    check_px_per_mm,
    coco_document,
    described_image,
    dxf_drawing,
    mask_name,
    outline_image,
    outlines_document,
    png_file,
    svg_drawing,
    template_name,
)
from resting_aspects_ros.vision.outline import LookAlike, Outline, find_outlines, look_alikes

DOCUMENT, COCO = 'outlines.json', 'coco.json'


@dataclass(frozen=True, eq=False)
class OutlinesResult(Result):
    """The outlines of a part, and which of them look alike.

    Attributes
    ----------
    outlines : tuple of Outline
        An outline for each symmetry class, in the order of the classes.
    look_alikes : dict of int to tuple of LookAlike
        By symmetry class, an entry for each other class, the most similar one first.
    part : Part
    aspects : AspectSet
    """

    outlines: tuple[Outline, ...]
    look_alikes: Mapping[int, tuple[LookAlike, ...]]
    part: Part
    aspects: AspectSet

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects outlines --json` prints."""
        return outlines_document(self.part, self.outlines, self.look_alikes)

    def save(self, folder: str | Path, px_per_mm: float = PIXELS_PER_MM) -> list[Path]:
        """Write all files of the outlines into a folder, which is made if necessary.

        These are ``outlines.json``; for each class ``class_<n>.svg`` and ``class_<n>.dxf``, at
        the true size, and ``class_<n>_template.png`` and ``class_<n>_mask.png``; and
        ``coco.json``, which describes the images.

        Parameters
        ----------
        folder : str or Path
        px_per_mm : float
            Pixels of the images for each mm on the tray.

        Returns
        -------
        list of Path
            The written files.

        Raises
        ------
        InvalidValueError
            The folder cannot be made, or an image would be too large or too small.
        OutputError
            A file cannot be written.
        """
        folder = Path(folder)
        check_px_per_mm(self.outlines, px_per_mm)
        make_folder('folder', folder)
        written = []
        for name, data in self._files(px_per_mm):
            with whole_file(folder / name) as file:
                file.write_bytes(data)
            written.append(folder / name)
        return written

    def _files(self, px_per_mm: float) -> Iterator[tuple[str, bytes]]:
        """Yield name and content of each file, the description of the images last."""
        yield DOCUMENT, self.to_json().encode()
        described = []
        for outline in self.outlines:
            number = outline.symmetry_class
            image = outline_image(outline, px_per_mm)
            described.append(described_image(image))
            title = f'{self.part.name}, class {number}'
            yield f'class_{number}.svg', svg_drawing(outline.polygon, title).encode()
            yield f'class_{number}.dxf', dxf_drawing(outline.polygon).encode()
            yield template_name(number), png_file(image.template)
            yield mask_name(number), png_file(image.mask)
        yield COCO, to_json(coco_document(self.part, described)).encode()

    def save_counting_sheet(self, path: str | Path) -> None:
        """Write the sheet for counting by hand, A4, as PDF or SVG by the ending of the path.

        An SVG file contains the pages one below the other.

        Raises
        ------
        InvalidValueError
            The path has another ending.
        OutputError
            The file cannot be written.
        """
        from resting_aspects_ros.report.sheet import counting_sheet

        path = Path(path)
        check_sheet_name('path', path)
        data = counting_sheet(
            self.part, self.aspects, self.outlines, self.look_alikes, path.suffix.lower()
        )
        with whole_file(path) as file:
            file.write_bytes(data)


def check_sheet_name(name: str, path: Path) -> None:
    """Raise InvalidValueError if the ending of a counting sheet is neither .pdf nor .svg."""
    if path.suffix.lower() not in ('.pdf', '.svg'):
        raise InvalidValueError(
            f'invalid {name} {shown(str(path))}: expected a file that ends in .pdf or .svg'
        )


def outlines(part: Part | str | Path) -> OutlinesResult:
    """Return what a camera straight above sees of a part in each aspect.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.outlines('box_10x20x30')
    >>> [round(1e6 * outline.area) for outline in result.outlines]
    [600, 300, 200]
    """
    loaded = given_part(part)
    aspects = find_aspects(loaded)
    found = find_outlines(loaded, aspects)
    return OutlinesResult(found, look_alikes(found), loaded, aspects)

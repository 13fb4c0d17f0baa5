"""A distribution as one self-contained HTML page, and its figures as files."""

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.core.estimators.estimate import METHODS
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import Array, Counts
from resting_aspects_ros.report.aspect_pose import shown_part
from resting_aspects_ros.report.colours import rgb
from resting_aspects_ros.report.comparison_text import (
    ReferenceCounts,
    comparison_text,
    difference_texts,
)
from resting_aspects_ros.report.figure_style import inline_svg, png_bytes, svg_text
from resting_aspects_ros.report.figures import (
    bands,
    comparison_figure,
    convergence_figure,
    estimates_figure,
)
from resting_aspects_ros.report.page_rows import RowText, row_texts
from resting_aspects_ros.report.picture import MAX_SHOWN, distribution_figure
from resting_aspects_ros.report.pie import pie_figure
from resting_aspects_ros.report.posed_part import (
    FROM_ABOVE,
    OBLIQUE,
    Image,
    lay,
    portraits,
    reduced,
)
from resting_aspects_ros.report.rounding import interval_text, share_text
from resting_aspects_ros.report.row_axes import NARROW, WIDE
from resting_aspects_ros.report.rows import Row, class_rows, outside_rows
from resting_aspects_ros.report.scene import scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = 'report.html'
# Of the figures' files; their endings are ENDINGS.
FIGURES = ('distribution', 'pie', 'convergence', 'estimates', 'comparison')
ENDINGS = ('png', 'svg')
_FILES = 'page_files'
# Of a picture in a row: twice what it is shown with, for fine screens; of many rows, see page.css.
PIXELS, PIXELS_OF_MANY, MANY = 320, 192, 12
SMALL = 64  # of a picture beside a bar
# Rows with pictures; of more those with the most drops have them.
MAX_PICTURED = 60


@dataclass(frozen=True, eq=False)
class Report:
    """All that a page says.

    part : Part or None
        Its shape; without it there are no pictures and no 3D view.
    notes : tuple of str
        What a reader has to know before all else, a sentence each.
    facts : mapping
        Label and value of what the drops were, by heading.
    history : ((m,) int, (m, k) int) or None
        Numbers of drops, ascending, and counts of each aspect after so many.
    estimates : mapping
        (k,) probabilities of the aspects by method.
    not_defined : mapping
        Why other methods say nothing, by their names.
    recommended : str
        Which method to trust, in a sentence.
    """

    title: str
    subtitle: str
    distribution: Distribution
    part: Part | None
    notes: tuple[str, ...] = ()
    facts: Mapping[str, Sequence[tuple[str, str]]] = field(default_factory=dict)
    history: tuple[Counts, Counts] | None = None
    estimates: Mapping[str, Array] = field(default_factory=dict)
    not_defined: Mapping[str, str] = field(default_factory=dict)
    recommended: str = ''
    measured: ReferenceCounts | None = None


def report_files(report: Report) -> Iterator[tuple[str, bytes]]:
    """Name and contents of each file: the page, and its figures."""
    drawn = _Drawn(report)
    figures = _figures(report, drawn)
    svgs = {name: svg_text(figure) for name, figure in figures.items()}
    narrow = {name: svg_text(each) for name, each in _wide_figures(report, drawn, NARROW)}
    for name, figure in figures.items():
        yield f'{name}.png', png_bytes(figure)
        yield f'{name}.svg', svgs[name].encode()
    yield PAGE, _page(report, drawn, svgs, narrow).encode()


class _Drawn:
    """The rows of a report, and the pictures of the part in them."""

    def __init__(self, report: Report) -> None:
        self.rows = class_rows(report.distribution)
        self.outside = outside_rows(report.distribution)
        self.part = report.part and shown_part(report.part, report.distribution.aspects.aspects)
        self.lying = lay(self.part, [row.aspects[0] for row in self.rows]) if self.part else []
        order = sorted(range(len(self.lying)), key=lambda k: -self.rows[k].count)
        self.pictured = sorted(order[:MAX_PICTURED])
        self.oblique = self._images(OBLIQUE)
        self.above = self._images(FROM_ABOVE)

    def _images(self, view: Array) -> dict[int, Image]:
        """By the row's index."""
        lying = [self.lying[k] for k in self.pictured]
        colours = [rgb(self.rows[k].colour) for k in self.pictured]
        pixels = PIXELS if len(self.rows) <= MANY else PIXELS_OF_MANY
        return dict(zip(self.pictured, portraits(lying, colours, pixels, view), strict=True))


def _figures(report: Report, drawn: _Drawn) -> dict[str, 'Figure']:
    """Those that there are, by name."""
    rows, distribution = drawn.rows, report.distribution
    return {
        'distribution': distribution_figure(
            distribution, drawn.part, f'{report.title}, {report.subtitle}'
        ),
        'pie': pie_figure(
            [*rows, *drawn.outside],
            [drawn.oblique.get(k) for k in range(len(rows) + len(drawn.outside))],
        ),
        **dict(_wide_figures(report, drawn, WIDE)),
    }


def _wide_figures(report: Report, drawn: _Drawn, width: float) -> Iterator[tuple[str, 'Figure']]:
    """Names and figures of what a telephone shows in another width, inches."""
    rows = drawn.rows
    if report.history is not None and len(report.history[0]) > 1 and rows:
        yield (
            'convergence',
            convergence_figure(
                rows, report.history[0], bands(report.distribution, *report.history), width
            ),
        )
    if report.estimates and rows:
        shares = {name: np.array(_of_rows(rows, p)) for name, p in report.estimates.items()}
        yield 'estimates', estimates_figure(rows, shares, width)
    if report.measured is not None:
        differences = difference_texts(report.measured.comparison)
        yield 'comparison', comparison_figure(rows, report.measured.sides(), differences, width)


def _page(
    report: Report, drawn: _Drawn, svgs: Mapping[str, str], narrow: Mapping[str, str]
) -> str:
    # A fifth of a second to import, which no other command needs.
    import jinja2

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    # The scripts and the style are our own or vendored, and no markup of theirs is data.
    template = environment.from_string(_file('page.html'))
    rows = [*drawn.rows, *drawn.outside]
    small = {k: reduced(image, len(image) // SMALL) for k, image in drawn.oblique.items()}
    kinds = (drawn.oblique, drawn.above, small)
    pictures = [[_picture(images, k) for images in kinds] for k in range(len(rows))]
    labels = {
        'pie': 'Pie chart of the shares of all drops',
        'distribution': 'Bars with intervals',
        'convergence': 'Shares after growing numbers of drops',
        'estimates': 'What analytic methods predict',
        'comparison': 'Simulated and measured side by side',
    }
    texts = row_texts(report.distribution, rows, pictures, report.part)
    return template.render(
        report=report,
        drops=report.distribution.drops,
        confidence=f'{100 * report.distribution.confidence:g}',
        interval=report.distribution.interval.capitalize(),
        rows=texts,
        bars=_largest(texts),
        unseen=_unseen(drawn.rows) if report.distribution.drops else '',
        figures={name: inline_svg(svg, name, labels[name]) for name, svg in svgs.items()},
        narrow={
            name: inline_svg(svg, f'{name}-narrow', labels[name]) for name, svg in narrow.items()
        },
        comparison=report.measured and comparison_text(report.measured, drawn.rows),
        estimates={
            METHODS[name].label: [share_text(p) for p in _of_rows(drawn.rows, shares)]
            for name, shares in report.estimates.items()
        },
        simplified=_simplified(report.part, drawn.part),
        scene=scene(drawn.part, drawn.rows, drawn.lying) if drawn.part and drawn.rows else None,
        style=_file('page.css'),
        script=_file('page.js'),
        modules={
            'three': _script_uri('three.module.min.js'),
            'OrbitControls': _script_uri('OrbitControls.js'),
        },
    )


def _largest(rows: Sequence[RowText]) -> list[RowText]:
    """As many as there is room for, in their order."""
    order = sorted(range(len(rows)), key=lambda k: -rows[k].count)
    return [rows[k] for k in sorted(order[:MAX_SHOWN])]


def _unseen(rows: Sequence[Row]) -> str:
    """Rows in which no drop ended, with the bounds of their probability, in words."""
    return ', '.join(
        f'{row.name} (at most {interval_text(row.interval).removeprefix("0 to ")})'
        for row in rows
        if not row.count
    )


def _of_rows(rows: Sequence[Row], of_aspects: Any) -> list[Any]:
    """Sums over the aspects of each row of what is given by aspect."""
    return [sum(of_aspects[aspect.id - 1] for aspect in row.aspects) for row in rows]


def _simplified(part: Part | None, shown: Part | None) -> tuple[int, int] | None:
    """Triangles of the part and of what is shown, if that is less."""
    if part is None or shown is None or len(part.faces) == len(shown.faces):
        return None
    return len(part.faces), len(shown.faces)


def _picture(images: Mapping[int, Image], row: int) -> str:
    """Of a row, as an address; empty if it has none."""
    from matplotlib.image import imsave

    if row not in images:
        return ''
    file = io.BytesIO()
    imsave(file, images[row], format='png')
    return _data_uri('image/png', file.getvalue())


def _file(name: str) -> str:
    return (resources.files(__package__) / _FILES / name).read_text(encoding='utf-8')


def _script_uri(name: str) -> str:
    return _data_uri('text/javascript', _file(name).encode())


def _data_uri(kind: str, data: bytes) -> str:
    return f'data:{kind};base64,{base64.b64encode(data).decode("ascii")}'

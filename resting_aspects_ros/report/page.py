"""Write a distribution as one self-contained HTML page, and its figures as files."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.estimate import METHODS
from resting_aspects_ros.errors import analysis
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.comparison import (
    ReferenceCounts,
    comparison_text,
    difference_texts,
)
from resting_aspects_ros.report.drop_figures import (
    bands,
    comparison_figure,
    convergence_figure,
    distribution_figure,
    estimates_figure,
    pie_figure,
)
from resting_aspects_ros.report.figure import NARROW, WIDE, inline_svg, svg_text
from resting_aspects_ros.report.format import Row, class_rows, outside_rows, rgb, share_text
from resting_aspects_ros.report.page_rows import largest_rows, row_texts, unseen_text
from resting_aspects_ros.report.page_template import (
    ENDINGS,
    figure_files,
    picture_uri,
    read_file,
    render_page,
    script_uri,
)
from resting_aspects_ros.report.picture import (
    FROM_ABOVE,
    OBLIQUE,
    Image,
    downsample,
    draw_parts,
    picture_part,
    pose_parts,
    triangle_counts,
)
from resting_aspects_ros.report.scene import scene
from resting_aspects_ros.statistics.distribution import Distribution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = 'report.html'
_LABELS = {
    'distribution': 'Bar chart of the probabilities with intervals',
    'pie': 'Pie chart of the shares of all drops',
    'convergence': 'Line chart of the probabilities against the number of drops',
    'estimates': 'Chart of the predictions of the analytic methods',
    'comparison': 'Bar chart of the simulated and the measured shares',
}
FIGURES = tuple(_LABELS)
_Draw = Callable[[float], 'Figure']
FILES = (PAGE, *(f'{figure}.{ending}' for figure in FIGURES for ending in ENDINGS))
# Side of a picture in a row, twice its size on the page for high-resolution screens, smaller on
# pages with more than MANY_ROWS rows (see page.css); and side of a picture beside a bar.
PIXELS, PIXELS_OF_MANY_ROWS, MANY_ROWS, SMALL_PIXELS = 320, 192, 12, 64
MAX_PICTURED_ROWS = 60  # of more rows, those with the most drops have pictures


@dataclass(frozen=True, eq=False)
class ContactRow:
    """A placement in surroundings: what touches each body, and a picture.

    contacts : tuple of (str, str)
        Name of the body, and what touches it.
    """

    contacts: tuple[tuple[str, str], ...]
    count: int
    symmetry_class: int | None = None
    probability: str = ''
    interval: str = ''
    image: Image | None = None

    @property
    def picture(self) -> str:
        """The picture as a data URI; empty if there is none."""
        return '' if self.image is None else picture_uri(self.image)


@dataclass(frozen=True, eq=False)
class Report:
    """The content of a page.

    part : Part or None
        Without the part, the page has no pictures and no 3D view.
    notes : tuple of str
        Sentences that are shown at the top, such as warnings.
    facts : mapping
        Labels and values that describe the part, the conditions and the run, by heading.
    history : ((m,) int, (m, k) int) or None
        Numbers of drops, ascending, and the counts of the k aspects after each of them.
    estimates : mapping
        (k,) probabilities of the aspects by method.
    not_defined : mapping
        By method, why it is not defined for the part.
    measured : ReferenceCounts or None
        The counts with which the drops are compared.
    contacts : tuple of ContactRow
        What the parts touch in surroundings with walls, the most frequent first.
    level_floor : bool
        Whether the parts lie on a level plane, as the pictures and the properties of the aspects
        assume.
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
    measured: ReferenceCounts | None = None
    contacts: tuple[ContactRow, ...] = ()
    level_floor: bool = True


def report_files(report: Report) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the content of each file: the figures, then the page."""
    drawn = _DrawnRows(report)
    notes = list(report.notes)
    svgs: dict[str, str] = {}
    narrow: dict[str, str] = {}
    responsive = dict(_responsive_figures(report, drawn))
    for name, draw in {**_figures(report, drawn), **responsive}.items():
        files: list[tuple[str, bytes]] = []
        with analysis(f'the figure {_LABELS[name]!r}', notes):
            figure = draw(WIDE)
            svg = svg_text(figure)
            files = list(figure_files(name, figure, svg))
            if name in responsive:
                narrow[name] = svg_text(draw(NARROW))
            svgs[name] = svg
        yield from files
    yield PAGE, _page(replace(report, notes=tuple(notes)), drawn, svgs, narrow).encode()


class _DrawnRows:
    """The rows of a report, and the pictures of the part in them."""

    def __init__(self, report: Report) -> None:
        self.rows = class_rows(report.distribution)
        self.outside = outside_rows(report.distribution)
        self.part = report.part and picture_part(report.part, report.distribution.aspects.aspects)
        aspects = [row.aspects[0] for row in self.rows]
        self.posed_parts = pose_parts(self.part, aspects) if self.part else []
        order = sorted(range(len(self.posed_parts)), key=lambda k: -self.rows[k].count)
        self.pictured = sorted(order[:MAX_PICTURED_ROWS])
        self.oblique = self._images(OBLIQUE)
        self.above = self._images(FROM_ABOVE)

    def scene(self) -> dict[str, object] | None:
        return scene(self.part, self.rows, self.posed_parts) if self.part and self.rows else None

    def _images(self, view: Array) -> dict[int, Image]:
        """Return the pictures by row index."""
        posed_parts = [self.posed_parts[k] for k in self.pictured]
        colours = [rgb(self.rows[k].colour) for k in self.pictured]
        pixels = PIXELS if len(self.rows) <= MANY_ROWS else PIXELS_OF_MANY_ROWS
        images = draw_parts(posed_parts, colours, pixels, view)
        return dict(zip(self.pictured, images, strict=True))


def _figures(report: Report, drawn: _DrawnRows) -> dict[str, _Draw]:
    """Return functions that draw the figures with a single width, by name."""
    rows, distribution = [*drawn.rows, *drawn.outside], report.distribution
    return {
        'distribution': lambda _: distribution_figure(
            distribution, drawn.part, f'{report.title}, {report.subtitle}'
        ),
        'pie': lambda _: pie_figure(rows, [drawn.oblique.get(k) for k in range(len(rows))]),
    }


def _responsive_figures(report: Report, drawn: _DrawnRows) -> Iterator[tuple[str, _Draw]]:
    """Yield names and functions of those for which there are data; widths are in inches."""
    rows, history, measured = drawn.rows, report.history, report.measured
    if history is not None and len(history[0]) > 1 and rows:
        shown = bands(report.distribution, *history)
        yield 'convergence', lambda width: convergence_figure(rows, history[0], shown, width)
    if report.estimates and rows:
        shares = {name: np.array(_row_sums(rows, p)) for name, p in report.estimates.items()}
        yield 'estimates', lambda width: estimates_figure(rows, shares, width)
    if measured is not None:
        sides, differences = measured.sides(), difference_texts(measured.comparison)
        yield 'comparison', lambda width: comparison_figure(rows, sides, differences, width)


def _page(
    report: Report, drawn: _DrawnRows, svgs: Mapping[str, str], narrow: Mapping[str, str]
) -> str:
    rows = [*drawn.rows, *drawn.outside]
    small = {
        k: downsample(image, len(image) // SMALL_PIXELS) for k, image in drawn.oblique.items()
    }
    views = (drawn.oblique, drawn.above, small)
    pictures = [
        [picture_uri(images[k]) if k in images else '' for images in views]
        for k in range(len(rows))
    ]
    texts = row_texts(report.distribution, rows, pictures, report.part, level=report.level_floor)
    return render_page(
        'page.html',
        report=report,
        drops=report.distribution.drops,
        has_history=report.history is not None,
        confidence=f'{100 * report.distribution.confidence:g}',
        interval=report.distribution.interval.capitalize(),
        rows=texts,
        bars=largest_rows(texts),
        unseen=unseen_text(drawn.rows) if report.distribution.drops else '',
        figures={name: inline_svg(svg, name, _LABELS[name]) for name, svg in svgs.items()},
        narrow={
            name: inline_svg(svg, f'{name}-narrow', _LABELS[name]) for name, svg in narrow.items()
        },
        comparison=report.measured and comparison_text(report.measured, drawn.rows),
        estimates={
            METHODS[name].label: [share_text(p) for p in _row_sums(drawn.rows, shares)]
            for name, shares in report.estimates.items()
        },
        simplified=triangle_counts(report.part, drawn.part),
        scene=drawn.scene(),
        script=read_file('page.js'),
        modules={
            'three': script_uri('three.module.min.js'),
            'OrbitControls': script_uri('OrbitControls.js'),
        },
    )


def _row_sums(rows: Sequence[Row], values: Any) -> list[Any]:
    return [sum(values[aspect.id - 1] for aspect in row.aspects) for row in rows]

"""Pages: sections with texts, tables, figures and pictures, in one self-contained HTML file.

A page and its sections contain items. A text is a paragraph that explains; all other items are
classes of this module, or a Table. The template has a macro for each of them, with its name.
"""

import base64
import functools
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import TYPE_CHECKING, Any, TypeAlias

import yaml

from resting_aspects_ros.errors import analysis
from resting_aspects_ros.report.figure import inline_svg, png_bytes, svg_text
from resting_aspects_ros.report.table import Table

if TYPE_CHECKING:  # these imports are slow: matplotlib is imported when a picture is written
    import jinja2
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.picture import Image

# Endings of the files of a figure.
ENDINGS = ('png', 'svg')
TEMPLATE, ITEMS = 'page.html', 'items.html'
_CSS_PIXELS_PER_INCH = 96
# Rows of a page with more of them are small.
MANY_ROWS = 12

Item: TypeAlias = (
    'str | Table | Text | Facts | Chart | Fold | Gallery | Findings | View | Bars | OutcomeRows'
)


@dataclass(frozen=True)
class Text:
    """A paragraph in a style other than that of an explanation.

    style : str
        'note' for a warning, 'verdict' for a result, 'part' for the heading of a part of a
        section, 'plain' for any other text.
    """

    text: str
    style: str


@dataclass(frozen=True)
class Facts:
    """Labels and values beside each other."""

    pairs: Sequence[tuple[str, str]]


@dataclass(frozen=True, eq=False)
class Chart:
    """A figure; if it fails, the page has a note instead.

    name : str
        Unique in the page; the name of its files.
    label : str
        Alternative text for screen readers.
    draw, saved, narrow : callable
        Return the figure for the page, for its files, such as one with a title, and for a narrow
        screen. Without ``saved`` there are no files, and without ``narrow`` it scrolls there.
    """

    name: str
    label: str
    draw: Callable[[], 'Figure']
    caption: str = ''
    saved: 'Callable[[], Figure] | None' = None
    narrow: 'Callable[[], Figure] | None' = None

    def files(self, svg: str = '') -> Iterator[tuple[str, bytes]]:
        """Yield name and content of the files; ``svg`` is the figure if it is that of the page."""
        if self.saved is not None:
            figure = self.saved()
            yield f'{self.name}.png', png_bytes(figure)
            yield f'{self.name}.svg', (svg or svg_text(figure)).encode()


@dataclass(frozen=True)
class Fold:
    """Items that are shown on request."""

    summary: str
    items: 'Sequence[Item]'


@dataclass(frozen=True)
class Tile:
    """What a gallery shows of a class: its picture (a data URI, or empty), name and texts."""

    name: str
    colour: str
    picture: str
    texts: Sequence[str]


@dataclass(frozen=True)
class Gallery:
    """Classes beside each other, of a thing that can have a heading with a link."""

    tiles: Sequence[Tile]
    heading: str = ''
    link: str = ''
    texts: Sequence[str] = ()


@dataclass(frozen=True)
class Findings:
    """Results as a list: a mark ('yes', 'no' or 'open'), the result, and what explains it."""

    entries: Sequence[tuple[str, str, str]]


@dataclass(frozen=True)
class View:
    """The 3D view of a part in the aspect of the selected row; ``scene`` is drop_page.scene.

    ``picture`` is shown until the view is drawn; name and share are those of the first row.
    """

    scene: Mapping[str, object]
    picture: str
    name: str
    share: str
    hint: str = ''


@dataclass(frozen=True)
class OutcomeRow:
    """A row of the page of a distribution. A text that does not apply is empty.

    bar : (float, float, float)
        Length of the bar, and start and length of its whisker, as percentages of the width.
    model : (float, float) or None
        Start and length of the model range, which is drawn thinner.
    facts : tuple of (str, str, str)
        Properties of the aspect that follow from the shape: label, value, explanation.
    oblique, above, small : str
        Pictures as data URIs.
    """

    name: str
    short: str
    note: str
    colour: str
    count: int
    probability: str
    interval: str
    bar: tuple[float, float, float]
    model_text: str = ''
    facts: tuple[tuple[str, str, str], ...] = ()
    oblique: str = ''
    above: str = ''
    small: str = ''
    model: tuple[float, float] | None = None


@dataclass(frozen=True)
class Bars:
    """A pie chart, and a bar with its whisker for each row."""

    chart: Chart
    rows: Sequence[OutcomeRow]
    caption: str


@dataclass(frozen=True)
class OutcomeRows:
    """The rows of a distribution, with pictures; ``view`` is whether they select the view."""

    rows: Sequence[OutcomeRow]
    drops: int
    view: bool
    many: int = MANY_ROWS


@dataclass(frozen=True)
class Section:
    """Items below a heading; ``anchor`` is its id, unique in the page."""

    heading: str
    anchor: str
    items: Sequence[Item]


@dataclass(frozen=True, eq=False)
class Page:
    """A page, with all that is needed to write it.

    title, topic, lead, subtitle : str
        What the page is about, such as the name of a part; its kind in a word or two and in a
        sentence; its conditions.
    reading : mapping
        Explanations by term.
    facts : mapping
        Labels and values of the part, the conditions and the run, by heading.
    notes : sequence of str
        Sentences that are shown at the top, such as warnings.
    top : sequence of items
        Shown before the sections, side by side.
    saved : sequence of Chart
        Figures that are files and not on the page.
    names : sequence of str
        Names of all files that such a page can have.
    """

    file: str
    title: str
    topic: str
    lead: str
    subtitle: str
    sections: Sequence[Section]
    reading: Mapping[str, str]
    facts: Mapping[str, Sequence[tuple[str, str]]] = field(default_factory=dict)
    notes: Sequence[str] = ()
    top: Sequence[Item] = ()
    saved: Sequence[Chart] = ()
    names: Sequence[str] = ()

    def files(self) -> Iterator[tuple[str, bytes]]:
        """Yield the name and the content of each file: the figures, then the page."""
        notes = list(self.notes)
        drawn: dict[str, dict[str, Any]] = {}
        items = [*self.top, *(item for section in self.sections for item in section.items)]
        for chart in (*self.saved, *_charts(items)):
            files: list[tuple[str, bytes]] = []
            with analysis(f'the figure {chart.label!r}', notes):
                svg, shown = ('', {}) if chart in self.saved else _inline(chart)
                files = list(chart.files(svg if chart.saved is chart.draw else ''))
                drawn[chart.name] = shown
            yield from files
        yield self.file, self._html(notes, drawn).encode()

    def html(self) -> str:
        """Return the page alone."""
        return dict(self.files())[self.file].decode()

    def _html(self, notes: Sequence[str], drawn: Mapping[str, Mapping[str, Any]]) -> str:
        views = [item for item in self.top if isinstance(item, View)]
        scripts = ('three.module.min.js', 'OrbitControls.js', 'view.js')
        # The template marks the scripts and the style as safe: they contain no data.
        return (
            templates()
            .get_template(TEMPLATE)
            .render(
                page=self,
                notes=notes,
                drawn=drawn,
                style=read_file('page.css'),
                scene=views[0].scene if views else None,
                script=read_file('page.js'),
                modules={name.partition('.')[0]: script_uri(name) for name in scripts if views},
            )
        )


@functools.cache
def templates() -> 'jinja2.Environment':
    """Return the templates of page_files, with all values escaped."""
    # The import takes 0.2 s, and few commands need it.
    import jinja2

    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        loader=jinja2.FunctionLoader(read_file),
        trim_blocks=True,
    )
    environment.globals['kind'] = lambda item: type(item).__name__
    return environment


def items_html(items: Sequence[Item]) -> str:
    """Return the HTML of items as a page shows them; a figure that fails is left out."""
    drawn: dict[str, dict[str, Any]] = {}
    for chart in _charts(items):
        with analysis(f'the figure {chart.label!r}'):
            drawn[chart.name] = _inline(chart)[1]
    macros: Any = templates().get_template(ITEMS).make_module({'drawn': drawn})
    return str(macros.show(items))


def _charts(items: Sequence[Item]) -> Iterator[Chart]:
    for item in items:
        if isinstance(item, Chart):
            yield item
        if isinstance(item, Bars):
            yield item.chart
        if isinstance(item, Fold):
            yield from _charts(item.items)


def _inline(chart: Chart) -> tuple[str, dict[str, Any]]:
    figure = chart.draw()
    svg = svg_text(figure)
    prefix = chart.name.replace('_', '-')
    narrow = ''
    if chart.narrow is not None:
        narrow = inline_svg(svg_text(chart.narrow()), f'{prefix}-narrow', chart.label)
    return svg, {
        'svg': inline_svg(svg, prefix, chart.label),
        'narrow': narrow,
        'width': round(_CSS_PIXELS_PER_INCH * figure.get_figwidth()),
    }


def file_names(page: str, figures: Sequence[str]) -> list[str]:
    """Return the names of the files of a page and its figures."""
    return [page, *(f'{figure}.{ending}' for figure in figures for ending in ENDINGS)]


def picture_uri(image: 'Image') -> str:
    """Return a picture as a data URI."""
    from PIL import Image as Picture

    file = io.BytesIO()
    Picture.fromarray((image * 255).round().astype('uint8')).save(file, format='png')
    return _data_uri('image/png', file.getvalue())


def script_uri(name: str) -> str:
    """Return a script of page_files as a data URI."""
    return _data_uri('text/javascript', read_file(name).encode())


def reading(kind: str, **values: str) -> dict[str, str]:
    """Return the explanations of a kind of page by term, from reading.yaml.

    ``values`` replace their names in braces.
    """
    texts = yaml.safe_load(read_file('reading.yaml'))[kind]
    return {term: text.format(**values) for term, text in texts.items()}


def read_file(name: str) -> str:
    """Return the text of a file of page_files."""
    return (resources.files(__package__) / 'page_files' / name).read_text(encoding='utf-8')


def _data_uri(media_type: str, data: bytes) -> str:
    return f'data:{media_type};base64,{base64.b64encode(data).decode("ascii")}'

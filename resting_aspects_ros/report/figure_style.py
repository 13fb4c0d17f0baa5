"""What all figures have in common, and how they are written."""

import io
import re
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:  # matplotlib takes half a second: imported when a figure is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TEXT, FAINT, GRID, PAPER = '#222226', '#6A6A70', '#E4E4E8', '#FFFFFF'
# What they become in a page, which is dark or light; see page_files/page.css.
_IN_PAGE = {TEXT: '--ink', FAINT: '--faint', GRID: '--line', PAPER: '--paper'}
PIXELS_PER_INCH = 144.0


def new_figure(width: float, height: float) -> 'Figure':
    """An empty figure of so many inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=PIXELS_PER_INCH, facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def plain_axes(axes: 'Axes', grid: Literal['x', 'y']) -> None:
    """Light lines along one axis, 'x' or 'y', and nothing around."""
    axes.set_axisbelow(True)
    axes.grid(axis=grid, color=GRID, linewidth=0.8)
    axes.tick_params(length=0, labelsize=8, labelcolor=FAINT)
    axes.spines[['top', 'right', 'bottom', 'left']].set_visible(False)


def percent_axis(axes: 'Axes', name: str, most: float) -> None:
    """Ticks of an axis, 'x' or 'y', that goes from 0 to a share of ``most``, in percent."""
    from matplotlib.ticker import MaxNLocator

    axis = getattr(axes, f'{name}axis')
    low, high = getattr(axes, f'get_{name}lim')()
    pixels = axes.bbox.size['xy'.index(name)] * most / (high - low)
    bins = min(max(int(pixels / PIXELS_PER_INCH / 0.6), 1), 5)
    ticks = MaxNLocator(bins, steps=[1, 2, 5, 10]).tick_values(0, most)
    axis.set_ticks([tick for tick in ticks if 0 <= tick <= most * 1.001])
    axis.set_major_formatter(lambda share, _: f'{100 * share:.6g} %')


def png_bytes(figure: 'Figure') -> bytes:
    """As a PNG file."""
    file = io.BytesIO()
    figure.savefig(file, format='png', dpi=PIXELS_PER_INCH)
    return file.getvalue()


def svg_text(figure: 'Figure') -> str:
    """As an SVG file; words stay words, and the same figure gives the same text."""
    import matplotlib as mpl

    file = io.StringIO()
    with mpl.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'resting_aspects_ros'}):
        figure.savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    return file.getvalue()


def inline_svg(svg: str, name: str, label: str) -> str:
    """An SVG file as an element of a page, in its colours; ``name`` keeps ids apart.

    Parameters
    ----------
    svg : str
        By svg_text.
    name : str
        Another one for each figure of the page; letters and '-'.
    label : str
        What the figure shows, for people who do not see it; without characters of XML.
    """
    svg = svg[svg.index('<svg') :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(url\(|href=")#', rf'\1#{name}-', svg)
    svg = re.sub(r'<metadata>.*?</metadata>', '', svg, flags=re.DOTALL)
    for colour, variable in _IN_PAGE.items():
        svg = re.sub(f'{colour}\\b', f'var({variable})', svg, flags=re.IGNORECASE)
    # As wide as its place, with its own ratio.
    svg = re.sub(r'(<svg [^>]*?) width="[^"]*"', r'\1', svg, count=1)
    svg = re.sub(r'(<svg [^>]*?) height="[^"]*"', r'\1', svg, count=1)
    return svg.replace('<svg ', f'<svg role="img" aria-label="{label}" ', 1)

"""The common style of all figures, and functions that write them as PNG and SVG."""

import io
import re
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:  # importing matplotlib takes 0.5 s: it is imported when a figure is made
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TEXT, FAINT, GRID, PAPER = '#222226', '#6A6A70', '#E4E4E8', '#FFFFFF'
# CSS variables that replace the colours in a page, which is dark or light; see page.css.
_IN_PAGE = {TEXT: '--ink', FAINT: '--faint', GRID: '--line', PAPER: '--paper'}
PIXELS_PER_INCH = 144.0


def new_figure(width: float, height: float) -> 'Figure':
    """Return an empty figure that needs no display; width and height in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=PIXELS_PER_INCH, facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def plain_axes(axes: 'Axes', grid: Literal['x', 'y']) -> None:
    """Style axes with light grid lines for one axis, 'x' or 'y', and without a frame."""
    axes.set_axisbelow(True)
    axes.grid(axis=grid, color=GRID, linewidth=0.8)
    axes.tick_params(length=0, labelsize=8, labelcolor=FAINT)
    axes.spines[['top', 'right', 'bottom', 'left']].set_visible(False)


def percent_axis(axes: 'Axes', name: str, top: float) -> None:
    """Set ticks in percent on an axis, 'x' or 'y', from 0 to the share ``top``."""
    from matplotlib.ticker import MaxNLocator

    axis = getattr(axes, f'{name}axis')
    low, high = getattr(axes, f'get_{name}lim')()
    pixels = axes.bbox.size['xy'.index(name)] * top / (high - low)
    bins = min(max(int(pixels / PIXELS_PER_INCH / 0.6), 1), 5)
    ticks = MaxNLocator(bins, steps=[1, 2, 5, 10]).tick_values(0, top)
    axis.set_ticks([tick for tick in ticks if 0 <= tick <= top * 1.001])
    axis.set_major_formatter(lambda share, _: f'{100 * share:.6g} %')


def png_bytes(figure: 'Figure') -> bytes:
    """Return the figure as a PNG file."""
    file = io.BytesIO()
    figure.savefig(file, format='png', dpi=PIXELS_PER_INCH)
    return file.getvalue()


def svg_text(figure: 'Figure') -> str:
    """Return the figure as an SVG file with text as text; equal figures give equal files."""
    import matplotlib as mpl

    file = io.StringIO()
    with mpl.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'resting_aspects_ros'}):
        figure.savefig(file, format='svg', metadata={'Date': None, 'Creator': None})
    return file.getvalue()


def inline_svg(svg: str, name: str, label: str) -> str:
    """Return an SVG file as an element of a page, in the colours of the page.

    Parameters
    ----------
    svg : str
        Text from svg_text.
    name : str
        Prefix of the ids, unique for each figure of the page; letters and '-'.
    label : str
        Alternative text of the figure for screen readers; without XML special characters.
    """
    svg = svg[svg.index('<svg') :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(url\(|href=")#', rf'\1#{name}-', svg)
    svg = re.sub(r'<metadata>.*?</metadata>', '', svg, flags=re.DOTALL)
    for colour, variable in _IN_PAGE.items():
        svg = re.sub(f'{colour}\\b', f'var({variable})', svg, flags=re.IGNORECASE)
    # Without width and height it fills its container and keeps its aspect ratio.
    svg = re.sub(r'(<svg [^>]*?) width="[^"]*"', r'\1', svg, count=1)
    svg = re.sub(r'(<svg [^>]*?) height="[^"]*"', r'\1', svg, count=1)
    return svg.replace('<svg ', f'<svg role="img" aria-label="{label}" ', 1)

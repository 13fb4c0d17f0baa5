"""What all pages share: their templates, and figures and pictures for them."""

import base64
import io
from collections.abc import Callable, Iterator
from importlib import resources
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.errors import analysis
from resting_aspects_ros.report.figure import inline_svg, png_bytes, svg_text

if TYPE_CHECKING:  # these imports are slow: matplotlib is imported when a picture is written
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.picture import Image

# Endings of the files of a figure.
ENDINGS = ('png', 'svg')
_CSS_PIXELS_PER_INCH = 96


def render_page(template: str, **values: Any) -> str:
    """Return a page, made from a template of page_files, with the style that all pages share."""
    # The import takes 0.2 s, and no other command needs it.
    import jinja2

    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        loader=jinja2.FunctionLoader(read_file),
    )
    # The templates mark the scripts and the style as safe: they contain no data.
    return environment.get_template(template).render(style=read_file('page.css'), **values)


def chart(
    draw: Callable[[], 'Figure'],
    name: str,
    label: str,
    caption: str = '',
    notes: list[str] | None = None,
) -> dict[str, Any]:
    """Return what the macro ``figure`` shows; nothing, with a note, if the figure fails.

    name : unique in the page
    label : alternative text for screen readers
    """
    found: dict[str, Any] = {}
    with analysis(f'the figure {label!r}', notes):
        figure = draw()
        found.update(
            svg=inline_svg(svg_text(figure), name, label),
            width=round(_CSS_PIXELS_PER_INCH * figure.get_figwidth()),
            label=label,
            caption=caption,
        )
    return found


def figure_files(name: str, figure: 'Figure', svg: str = '') -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the files of a figure; ``svg`` is its text, if that is known."""
    yield f'{name}.png', png_bytes(figure)
    yield f'{name}.svg', (svg or svg_text(figure)).encode()


def picture_uri(image: 'Image') -> str:
    """Return a picture as a data URI."""
    from matplotlib.image import imsave

    file = io.BytesIO()
    imsave(file, image, format='png')
    return _data_uri('image/png', file.getvalue())


def script_uri(name: str) -> str:
    """Return a script of page_files as a data URI."""
    return _data_uri('text/javascript', read_file(name).encode())


def read_file(name: str) -> str:
    """Return the text of a file of page_files."""
    return (resources.files(__package__) / 'page_files' / name).read_text(encoding='utf-8')


def _data_uri(media_type: str, data: bytes) -> str:
    return f'data:{media_type};base64,{base64.b64encode(data).decode("ascii")}'

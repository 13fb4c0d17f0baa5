"""The page: its tabs and its templates. It imports quickly, and the server needs nothing else."""

import functools
from importlib import resources
from typing import Any

import jinja2

from resting_aspects_ros.system import parts_folder

# The title of each tab, in the order on the page; see tabs.py for what they show.
TITLES = {
    'aspects': 'Aspects',
    'outlines': 'Outlines',
    'reorientation': 'Reorientation',
    'forecast': 'Forecast',
    'track': 'Track',
    'compare': 'Compare',
    'counts': 'Hand counts',
    'export': 'Export',
}


def examples() -> list[str]:
    """Return the names of the example parts."""
    return sorted(path.stem for path in parts_folder().glob('*.stl'))


@functools.cache
def templates() -> jinja2.Environment:
    """Return the templates of page_files, with all values escaped."""
    folder = resources.files(__package__) / 'page_files'
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        loader=jinja2.FunctionLoader(lambda name: (folder / name).read_text(encoding='utf-8')),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # Values and texts of a choice.
    environment.globals['pairs'] = lambda names: [(name, name.replace('_', ' ')) for name in names]
    return environment


def controls_html(macro: str, **values: Any) -> str:
    """Return the HTML of a macro of controls.html; all values are escaped."""
    macros: Any = templates().get_template('controls.html').module
    return str(getattr(macros, macro)(**values))

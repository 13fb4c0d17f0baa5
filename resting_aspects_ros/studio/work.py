"""What a tab receives to make what it shows, and HTML that several tabs need."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import jinja2

from resting_aspects_ros.api.drop import drop
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.report.page import Item, items_html
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings

T = TypeVar('T')
# Called with a topic and a message: the latest message of a topic is what the browser shows.
Publish = Callable[[str, dict[str, Any]], None]


@dataclass(frozen=True)
class Work:
    """A task of a room: settings and parts that do not change while it is done.

    second : Opened or None
        The part of the second side of a comparison, if it is another one.
    stopped : callable
        Whether newer settings replace these.
    keep : callable
        Called with a key and what makes a value; returns it, or the one that was made before.
    folder : Path
        Of the files of the room.
    """

    settings: Settings
    opened: Opened
    second: Opened | None
    workers: Workers
    stopped: Callable[[], bool]
    publish: Publish
    keep: Callable[[Any, Callable[[], Any]], Any]
    folder: Path

    def show(self, slot: str, items: Sequence[Item]) -> None:
        """Show items of the kit of reports in a slot of the page."""
        self.publish(slot, {'html': items_html(items)})

    def progress(self, what: str) -> Callable[[int, int], None]:
        """Return what shows the progress of a simulation."""

        def shown(done: int, total: int) -> None:
            self.publish('progress', {'text': f'{done:,} of {total:,} {what}'})

        return shown

    def options(self, what: str) -> dict[str, Any]:
        """Return the options of a function that simulates."""
        return {
            'workers': self.workers,
            'stopped': self.stopped,
            'progress': self.progress(what),
        }

    def drops(self) -> DropResult:
        """Return the drops of the part under the conditions, made once."""
        options = drop_options(self.settings)
        key = ('drops', self.opened.part.part_sha256, *map(repr, options.values()))
        result: DropResult = self.keep(
            key,
            lambda: drop(self.opened.part, keep_poses=False, **options, **self.options('drops')),
        )
        return result


def drop_options(settings: Settings) -> dict[str, Any]:
    """Return the options of `drop` that the settings request."""
    return {
        'drops': None if settings.precision else settings.drops,
        'surface': settings.conditions,
        'precision': settings.precision,
        'seed': settings.seed,
    }


@functools.cache
def _templates() -> jinja2.Environment:
    folder = resources.files(__package__) / 'page_files'
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        loader=jinja2.FunctionLoader(lambda name: (folder / name).read_text(encoding='utf-8')),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals['pairs'] = _pairs
    return environment


def _pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    """Return values and texts of a choice."""
    return [(name, name.replace('_', ' ')) for name in names]


def controls_html(macro: str, **values: Any) -> str:
    """Return the HTML of a macro of controls.html; all values are escaped."""
    macros: Any = _templates().get_template('controls.html').module
    return str(getattr(macros, macro)(**values))

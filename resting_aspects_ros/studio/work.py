"""What a tab receives to make what it shows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.drop import DropResult, drop
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.page import Fold, Item, Page, Text, items_html
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings

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

    def show_command(self, line: str) -> None:
        """Show the command that gives the same numbers; empty without one."""
        self.publish('same', {'text': line})

    def progress(self, what: str) -> Callable[[int, int], None]:
        """Return what shows the progress of a simulation."""

        def shown(done: int, total: int) -> None:
            self.publish('progress', {'text': f'{done:,} of {total:,} {what}'})

        return shown

    def options(self, what: str) -> dict[str, Any]:
        """Return the options of a function that simulates; ``what`` is named in its progress."""
        return {'workers': self.workers, 'stopped': self.stopped, 'progress': self.progress(what)}

    def made(
        self,
        function: Callable[..., Any],
        part: Part,
        options: dict[str, Any],
        what: str,
        **other: Any,
    ) -> Any:
        """Return the result of a function that simulates a part, made once for these options.

        ``other`` options do not change the result.
        """
        key = function.__name__, part.part_sha256, repr(options)
        return self.keep(key, lambda: function(part, **options, **self.options(what) | other))

    def drops(self, **other: Any) -> DropResult:
        """Return the drops of the part under the conditions, made once; see made."""
        options = drop_options(self.settings)
        result: DropResult = self.made(
            drop, self.opened.part, options, 'drops', keep_poses=False, **other
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


def page_items(page: Page, *, backwards: bool = False) -> list[Item]:
    """Return the items of the sections of a page, each below its heading, and its words."""
    items: list[Item] = []
    for section in reversed(page.sections) if backwards else page.sections:
        items += [Text(section.heading, 'part'), *section.items]
    return [*items, words_item(page.reading)]


def words_item(reading: Mapping[str, str]) -> Fold:
    """Return the explanations of a page, shown on request."""
    return Fold('what the words mean', [f'{term}: {text}' for term, text in reading.items()])

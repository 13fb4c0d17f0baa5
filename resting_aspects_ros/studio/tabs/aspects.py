"""How the part lies: the share of each class, while the conditions are changed."""

from resting_aspects_ros.api.conditions import has_level_floor, outcome_hints
from resting_aspects_ros.api.drop import drop
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.model_range import model_range_text
from resting_aspects_ros.api.runner import DropTally
from resting_aspects_ros.report.drop_page import NOT_LEVEL
from resting_aspects_ros.report.page import Item, Text
from resting_aspects_ros.simulation.job import MAX_DROPS
from resting_aspects_ros.statistics.distribution import Distribution, no_drops
from resting_aspects_ros.studio.recipe import drop_recipe
from resting_aspects_ros.studio.rows import Opened, changing_texts, pickable_text
from resting_aspects_ros.studio.settings import Settings
from resting_aspects_ros.studio.work import Work, drop_options

# The bars are shown again when the number of drops has grown by this factor.
GROWTH = 1.1


def controls(settings: Settings, opened: Opened) -> str:
    """Return no controls: the conditions are those of all tabs."""
    del settings, opened
    return ''


def show(work: Work) -> None:
    """Drop the part, and show the shares meanwhile."""
    recipe = drop_recipe(work.opened.source, work.settings)
    work.publish('same', {'text': recipe.line})
    result = work.keep(_key(work), lambda: _dropped(work))
    _show_bars(work, result.distribution, result.subtitle)
    items: list[Item] = []
    if not has_level_floor(work.settings.conditions):
        items.append(Text(NOT_LEVEL, 'note'))
    radius = work.opened.part.hull_radius
    hints = outcome_hints(result.distribution, work.settings.conditions, radius)
    items += [Text(hint, 'note') for hint in hints]
    work.show('hints', items)
    about = model_range_text(result.distribution, result.no_model_range)
    work.show('range', [Text(about, 'plain')])


def _key(work: Work) -> tuple[str, ...]:
    options = drop_options(work.settings)
    return ('drops', work.opened.part.part_sha256, *map(repr, options.values()))


def _dropped(work: Work) -> DropResult:
    """Return the drops, and show their shares while they are made."""
    tally = DropTally(no_drops(work.opened.aspects), MAX_DROPS)
    shown = 0
    count = work.progress('drops')

    def progress(done: int, total: int) -> None:
        nonlocal shown
        if done and done >= GROWTH * shown:
            shown = done
            _show_bars(work, tally.distribution, '')
        count(done, total)

    options = {**work.options('drops'), 'progress': progress}
    return drop(
        work.opened.part,
        keep_poses=False,
        consumers=[tally.add],
        **drop_options(work.settings),
        **options,
    )


def _show_bars(work: Work, distribution: Distribution, caption: str) -> None:
    if not distribution.drops:
        return
    work.publish(
        'bars',
        {
            'rows': changing_texts(distribution),
            'caption': caption,
            'pickable': pickable_text(distribution, work.settings.pickable),
        },
    )

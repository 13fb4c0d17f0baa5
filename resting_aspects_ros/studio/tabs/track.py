"""Which traps of a bowl or linear feeder pass only the wanted orientation."""

from resting_aspects_ros.api.track import design_track
from resting_aspects_ros.report.page import Item, Text
from resting_aspects_ros.studio.recipe import track_on, track_recipe
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings, rail_sliders
from resting_aspects_ros.studio.work import Work, controls_html

NO_DESIGN = 'No traps pass only the wanted row. The table shows all rows.'
ON_A_PLANE = 'The shares are those of drops on a level plane: surroundings have no effect on them.'


def controls(settings: Settings, opened: Opened) -> str:
    """Return the sliders of the track and the wanted row."""
    del opened
    return controls_html('rail', sliders=rail_sliders(settings.rail))


def show(work: Work) -> None:
    """Design the traps, and show them with the parts per minute."""
    settings, rail = work.settings, work.settings.rail
    work.publish('same', {'text': track_recipe(work.opened, settings).line})
    conditions = settings.conditions.changed(surroundings=None)
    found = design_track(
        work.opened.part,
        rail.want,
        track_on(work.opened.part, rail),
        drops=settings.drops,
        surface=conditions,
        tolerance=rail.tolerance,
        seed=settings.seed,
        **work.options('drops'),
    )
    if work.stopped():
        return
    items: list[Item] = []
    if settings.conditions.surroundings is not None:
        items.append(Text(ON_A_PLANE, 'note'))
    if not found.designs:
        items.append(Text(NO_DESIGN, 'verdict'))
    items += [Text(sentence, 'plain') for sentence in found.sentences]
    page = found.best.page()
    for section in reversed(page.sections):  # the traps first
        items += [Text(section.heading, 'part'), *section.items]
    work.show('track', items)

"""How many parts per minute a robot picks."""

from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.api.forecast import PER_ASPECT, forecast
from resting_aspects_ros.api.forecast_result import forecast_page
from resting_aspects_ros.api.reorient import reorient
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.report.page import Item, Text
from resting_aspects_ros.studio.recipe import forecast_recipe, reorient_options
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings, cell_sliders
from resting_aspects_ros.studio.work import Work, controls_html

NOTHING_PICKABLE = 'Mark at least one class as pickable in the tab Aspects.'
ON_A_TRAY = 'The forecast is that of a level tray: the surroundings have no effect on it.'


def controls(settings: Settings, opened: Opened) -> str:
    """Return the sliders of the feeder, the camera and the robot."""
    del opened
    names = shipped_actions().names()
    return controls_html('cell', actions=names, sliders=cell_sliders(settings.cell))


def show(work: Work) -> None:
    """Forecast and show the parts per minute."""
    settings, cell = work.settings, work.settings.cell
    if not settings.pickable:
        work.publish('same', {'text': ''})
        work.show('forecast', [Text(NOTHING_PICKABLE, 'verdict')])
        return
    work.publish('same', {'text': forecast_recipe(work.opened.source, settings).line})
    simulated = _simulated(work)
    if not simulated.complete or work.stopped():
        return
    result = forecast(
        simulated,
        pickable_classes=sorted(settings.pickable),
        robot=cell.robot,
        vibrate=cell.vibrate,
        settle=cell.settle,
        image=cell.image,
        tray=(cell.width, cell.depth),
        clearance=cell.clearance,
        parts_on_tray=cell.parts_on_tray,
    )
    items: list[Item] = []
    if settings.conditions.surroundings is not None:
        items.append(Text(ON_A_TRAY, 'note'))
    page = forecast_page([result])
    for section in page.sections:
        items += [Text(section.heading, 'part'), *section.items]
    work.show('forecast', items)


def _simulated(work: Work) -> ReorientResult:
    """Return the drops and the action of the feeder, made once."""
    level = work.settings.conditions.changed(surroundings=None)
    options = {
        **reorient_options(work.settings),
        'per_aspect': PER_ASPECT,
        'surface': level,
        'action': work.settings.cell.action,
    }
    key = ('forecast', work.opened.part.part_sha256, *map(repr, options.values()))
    return work.keep(key, lambda: reorient(work.opened.part, **options, **work.options('actions')))

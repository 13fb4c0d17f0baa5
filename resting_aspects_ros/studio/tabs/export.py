"""Files of the results, and the command line and the Python that give the same numbers."""

from resting_aspects_ros.studio.files import FILES
from resting_aspects_ros.studio.recipe import (
    Recipe,
    drop_recipe,
    forecast_recipe,
    outlines_recipe,
    reorient_recipe,
    track_recipe,
)
from resting_aspects_ros.studio.rows import Opened
from resting_aspects_ros.studio.settings import Settings
from resting_aspects_ros.studio.work import Work, controls_html


def controls(settings: Settings, opened: Opened) -> str:
    """Return the links to all files."""
    del settings, opened
    return controls_html('files', files={name: each.title for name, each in FILES.items()})


def show(work: Work) -> None:
    """Show the recipes of all tabs, and the entry of a surfaces file."""
    work.publish('same', {'text': drop_recipe(work.opened.source, work.settings).line})
    entry = FILES['surfaces.yaml'].make(work).decode()
    html = controls_html('recipes', recipes=recipes(work).items(), entry=entry)
    work.publish('export', {'html': html})


def recipes(work: Work) -> dict[str, Recipe]:
    """Return the recipe of each tab that has one, by its title."""
    source, settings = work.opened.source, work.settings
    found = {
        'Aspects': drop_recipe(source, settings),
        'Outlines': outlines_recipe(source),
        'Reorientation': reorient_recipe(source, settings),
        'Track': track_recipe(work.opened, settings),
    }
    if settings.pickable:
        found['Forecast'] = forecast_recipe(source, settings)
    return found

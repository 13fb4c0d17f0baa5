"""The shipped surfaces, and conditions in a few words for titles."""

import functools

from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.core.errors import one_line
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.surfaces import Surfaces


@functools.cache
def shipped_surfaces() -> Surfaces:
    """Return the surfaces of config/surfaces.yaml, which is read once."""
    return Surfaces.read(surfaces_file())


def surface_text(conditions: DropConditions) -> str:
    """Return the surface, and what was changed of it; see Surfaces.text."""
    return one_line(shipped_surfaces().text(conditions))

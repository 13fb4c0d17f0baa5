"""Conditions in a few words, for titles."""

from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.surfaces import Surfaces


def surface_text(conditions: DropConditions) -> str:
    """The surface, and what was changed of it; see Surfaces.text."""
    return Surfaces.read(surfaces_file()).text(conditions)

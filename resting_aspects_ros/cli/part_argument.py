"""The part that the flags of a command describe."""

import argparse

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.core.errors import warn
from resting_aspects_ros.core.part import Part


def part_of(arguments: argparse.Namespace) -> Part:
    """Return the part that the flags of `add_part` describe, and print its warnings."""
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    for warning in part.warnings:
        warn(warning)
    return part

"""The grey band of a trap: the dimensions at which only some parts of a row pass at a speed.

Parts run over the trap with dimensions on both sides of the critical value, farther and farther
away from it, until at least 95 % of them pass, and until at least 95 % of them fall off.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.tracks.description import Track
from resting_aspects_ros.tracks.design import Band
from resting_aspects_ros.tracks.orientations import Orientation
from resting_aspects_ros.tracks.simulate import OUTCOMES, run_over

# Distances from the critical value at which parts run, m, and parts at each.
OFFSETS = (1e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3)
PARTS = 20
# Share of the parts that must pass, or be rejected.
ENOUGH = 0.95


def measured_band(
    part: Part,
    row: Orientation,
    trap: Any,
    dimension: str,
    critical: float,
    track: Track,
    conditions: DropConditions,
    seed: int,
) -> Band:
    """Return the band of a row and a trap; an end that is not within 4 mm is infinite.

    critical : the critical value of the dimension by statics, m
    """
    more_pass = 1.0 if dimension in ('height', 'width') else -1.0

    def end(direction: float, outcome: str, offsets: Sequence[float]) -> float:
        for offset in offsets:
            value = critical + direction * offset
            if value <= 0:
                break
            tried = dataclasses.replace(trap, **{dimension: value})
            counts = run_over(part, row, tried, track, conditions, PARTS, (seed, 13, row.id))
            if counts[OUTCOMES.index(outcome)] >= ENOUGH * PARTS:
                return value
        return math.inf

    return Band(end(more_pass, 'pass', OFFSETS), end(-more_pass, 'reject', OFFSETS))

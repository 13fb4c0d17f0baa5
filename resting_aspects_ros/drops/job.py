"""What a worker needs to drop a part, in the part's own scale.

Lengths are in units of the hull radius R, times in T = sqrt(R / g), and the mass is 1, so that
g is 1.
"""

import math
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspects import SAME_FACET
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.joining import Joined, join_minima
from resting_aspects_ros.core.landscape import Landscape
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rest import RestRule
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.drops.conditions import DropConditions, HeightOf

# Steps in T: from here on, finer steps move no aspect of an L bracket by more than sampling does.
STEPS_PER_T = 160
# A step moves no point of the part by more than this, R, at the speed of impact, however high it
# fell; thrown, up to 3 standard deviations of its speed and spin.
TRAVEL_PER_STEP = 0.05
# A flat side is narrow if it reaches less than this, R, from below the centre of mass to an edge.
NARROW = 0.15
# Faster impacts, R / T, are refused: their many small steps would hold a worker for hours.
FASTEST_IMPACT = 100.0


@dataclass(frozen=True, eq=False)
class DropJob:
    """All that a worker needs to drop a part: plain data, the same for every drop of a run.

    hull : (k, 3) float
        Hull vertices from the centre of mass along the principal axes, in units of R.
    moments : (3,) float
        Principal moments of inertia in units of mass x R^2.
    axes : (3, 3) float
        Principal axes as columns, part frame.
    centre_of_mass : (3,) float
        Part frame, m.
    radius : float
        R, the hull radius, m.
    rest : RestRule
        Of the part, part axes.
    lowest : float
        Least height of the centre of mass at rest, R.
    rolling_length : float
        The length by which the rolling friction is meant, R; see `rolling_length`.
    until_still : bool
        Run on where the energy has decided the aspect, until the part is still: what checks the
        decision, and shows what it saves.
    refinement : int
        Time steps for each one that would be made.
    """

    hull: Array
    moments: Array
    axes: Array
    centre_of_mass: Array
    radius: float
    conditions: DropConditions
    seed: int
    rest: RestRule
    lowest: float
    rolling_length: float
    until_still: bool = False
    refinement: int = 1

    @property
    def time_unit(self) -> float:
        """T = sqrt(R / g), s."""
        return math.sqrt(self.radius / self.conditions.gravity)

    @property
    def impact(self) -> float:
        """Speed at which the fastest point of the part meets the surface, m/s.

        With 3 standard deviations of the speed and the spin at release; the horizontal speed
        counts, because friction makes it spin.
        """
        c = self.conditions
        fall = 2 * c.gravity * c.height
        thrown = math.hypot(3 * c.speed_horizontal, 3 * c.speed_vertical)
        return math.sqrt(fall + thrown**2) + 3 * c.spin * self.radius

    @property
    def steps_per_t(self) -> int:
        """Time steps in T."""
        impact = self.impact * self.time_unit / self.radius
        return max(STEPS_PER_T, math.ceil(impact / TRAVEL_PER_STEP)) * self.refinement

    @property
    def time_step(self) -> float:
        """Of the engine, s."""
        return self.time_unit / self.steps_per_t


def make_job(
    part: Part,
    conditions: DropConditions,
    seed: int,
    *,
    until_still: bool = False,
    refinement: int = 1,
) -> DropJob:
    """The job of dropping a part; InvalidValueError if it cannot be dropped in that way.

    ``until_still`` and ``refinement`` as DropJob has them.
    """
    radius = part.hull_radius
    if conditions.height_of is HeightOf.CENTRE_OF_MASS and conditions.height <= radius:
        raise InvalidValueError(
            f'height of the centre of mass is {conditions.height:g} m, allowed for {part.name} is '
            f'more than {radius:.4g} m: lower, the part could touch the surface when released'
        )
    landscape = Landscape(part)
    aspects = join_minima(landscape)
    job = DropJob(
        hull=(part.hull_vertices - part.centre_of_mass) @ part.principal_axes / radius,
        moments=part.principal_moments / (part.mass * radius**2),
        axes=part.principal_axes,
        centre_of_mass=part.centre_of_mass,
        radius=radius,
        conditions=conditions,
        seed=seed,
        rest=RestRule(landscape, aspects),
        lowest=float(landscape.heights.min()) / radius,
        rolling_length=rolling_length(landscape, aspects),
        until_still=until_still,
        refinement=refinement,
    )
    fastest = FASTEST_IMPACT * job.radius / job.time_unit
    if job.impact > fastest:
        raise InvalidValueError(
            f'height, speed and spin of release let {part.name} meet the surface at '
            f'{job.impact:.4g} m/s, allowed for its size and gravity is up to {fastest:.4g} m/s'
        )
    return job


def rolling_length(landscape: Landscape, aspects: list[Joined]) -> float:
    """The length that rolling friction is a share of, R: 1 but for slender parts.

    Rolling friction is there to stop what rolls. Of a slender part a share of R is a lever that
    could hold it tilted on an edge, so its length is in proportion to the narrowest of its flat
    sides instead; though not below its lowest height, the radius on which a slender roller rolls.
    """
    hull = landscape.hull
    flat = landscape.minima[[a.minima[0] for a in aspects if not a.curved]]
    at_edges = np.isin(hull.sides, flat) & (hull.angles > SAME_FACET)[:, None]
    narrowest = hull.margins[at_edges].min() if at_edges.any() else 0.0
    lowest = landscape.heights.min() / landscape.radius
    return float(min(1.0, max(narrowest / NARROW, lowest)))

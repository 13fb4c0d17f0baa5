"""What a worker needs to drop a part, in the part's own scale.

Lengths are in units of the hull radius R, times in T = sqrt(R / g), and the mass is 1, so that
g is 1.
"""

import math
from dataclasses import dataclass

from resting_aspects_ros.core.aspects.rest_rule import RestRule
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.conditions import DropConditions

# Steps in T: from here on, finer steps move no aspect of an L bracket by more than sampling does.
STEPS_PER_T = 160
# A step moves no point of the part by more than this, R, at the speed of impact, however high it
# fell; thrown, up to 3 standard deviations of its speed and spin.
TRAVEL_PER_STEP = 0.05


@dataclass(frozen=True, eq=False)
class DropJob:
    """All that a worker needs to drop a part: plain data, the same for every drop of a run.

    hull : (k, 3) float
        Hull vertices from the centre of mass along the principal axes, in units of R.
    moments : (3,) float
        Principal moments of inertia in units of mass x R^2.
    axes : (4,) float
        Unit quaternion xyzw, part from body: the body's axes are the principal axes.
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

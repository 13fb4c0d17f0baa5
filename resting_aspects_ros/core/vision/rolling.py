"""The outlines of a part that rolls or rocks, as a function of the roll, and their fit.

The roll is the angle about the axis of the sweep from the aspect's orientation; the axis keeps its
direction on the tray. The range is divided until the outlines of neighbours differ by less than
TOLERANCE, so that near a fit the mean square of the distances is a parabola over the roll.
"""

import heapq
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet, Sweep
from resting_aspects_ros.core.aspects.symmetry import Symmetry
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.fitting import Shape, shape_of
from resting_aspects_ros.core.vision.outline import (
    SAME_AXIS,
    Outline,
    roll_between,
    rolled,
    rolled_down,
    rolls_round,
    seen_outline,
    spread,
)
from resting_aspects_ros.core.vision.view_stack import ViewStack

# Root mean square distance of neighbours, R, that is not divided further, and the minimum step,
# rad. Outlines that are closer than the second value, R, are equal.
TOLERANCE, EQUAL, MIN_STEP = 5e-3, 3e-4, np.radians(0.5)
# Number of outlines at the start and at the end, and of a part that rolls in all directions.
START, END, DOME = 24, 64, 48
# With more triangles, the numbers are smaller in proportion, but at least MIN_VIEWS.
MANY_FACES, MIN_VIEWS = 50_000, 12


@dataclass(frozen=True, eq=False)
class Views:
    """The outlines of a class by roll; a single one if the part does not roll.

    aspect : Aspect
        The first one of the class.
    shapes : tuple of Shape
    orientations : (n, 4) float
        Unit quaternions xyzw, tray from part, at yaw 0.
    rolls : (n,) float
        rad, ascending; zeros if the part rolls in all directions.
    groups : (n,) int
        Number of the group of equal outlines with successive rolls.
    shares : (n,) float
        Share of the range of rolls that the group of each outline has.
    period : float
        Roll after which the outlines repeat, rad; 0 if they do not.
    """

    aspect: Aspect
    shapes: tuple[Shape, ...]
    orientations: Array
    rolls: Array
    groups: npt.NDArray[np.int64]
    shares: Array
    period: float = 0.0

    @cached_property
    def spectra(self) -> Array:
        """(n, 2, f) complex: the spectra of the signatures."""
        return np.stack([shape.spectrum for shape in self.shapes])

    @cached_property
    def squares(self) -> Array:
        """(n, 2) float: sums of the squares of the signatures."""
        return np.stack([shape.squares for shape in self.shapes])

    @cached_property
    def stack(self) -> ViewStack:
        """The shapes, for fits of several of them at once."""
        return ViewStack(self.shapes)

    def beside(self, k: int) -> list[int]:
        """Return the views before and after another one, fewer at the ends of the range."""
        return [n for step in (-1, 1) if (n := self.neighbour(k, step)) is not None]

    def neighbour(self, k: int, step: int) -> int | None:
        """Return the view before or after another one, None at the end of the range."""
        if len(self.shapes) < 3 or not self.rolls.any():
            return None
        other = k + step
        if self.period:
            return other % len(self.shapes)
        return other if 0 <= other < len(self.shapes) else None


def find_views(part: Part, aspects: AspectSet, outline: Outline) -> Views:
    """Return the outlines of a class by roll."""
    aspect = aspects.aspects[outline.aspect - 1]
    main = shape_of(outline.polygon)
    single = Views(
        aspect, (main,), aspect.orientation[None], np.zeros(1), np.zeros(1, np.int64), np.ones(1)
    )
    if aspect.sweep is Sweep.POINT or rolls_round(aspects.symmetry, aspect):
        return single
    fewer = max(1.0, len(part.faces) / MANY_FACES)
    if aspect.sweep not in (Sweep.ARC, Sweep.RING):
        downs = spread(aspect.directions, max(MIN_VIEWS, round(DOME / fewer)))
        orientations = np.array([rolled_down(aspect, down) for down in downs])
        shapes = tuple(Shape(seen_outline(part, each)) for each in orientations)
        number = np.arange(len(downs))
        shares = np.full(len(downs), 1 / len(downs))
        return Views(aspect, shapes, orientations, np.zeros(len(downs)), number, shares)
    low, high = _range(aspect)
    period = high - low if aspect.sweep is Sweep.RING else 0.0
    if period:
        period /= _order(aspects.symmetry, aspect)
        high = low + period
    start = np.linspace(low, high, max(MIN_VIEWS, round(START / fewer)) + 1)
    count = max(MIN_VIEWS + 1, round(END / fewer))
    made = {float(roll): Shape(seen_outline(part, rolled(aspect, roll))) for roll in start}
    gaps = [(-made[a].distance(made[b]), a, b) for a, b in pairwise(start)]
    heapq.heapify(gaps)
    size = TOLERANCE * part.hull_radius
    done = []
    while gaps:
        gap, a, b = heapq.heappop(gaps)
        if -gap <= size or b - a < 2 * MIN_STEP or len(made) >= count:
            done.append((a, -gap))
            continue
        middle = float(a + b) / 2
        made[middle] = Shape(seen_outline(part, rolled(aspect, middle)))
        for one, other in ((a, middle), (middle, b)):
            heapq.heappush(gaps, (-made[one].distance(made[other]), one, other))
    differences = np.array([gap for _, gap in sorted(done)])
    if differences.max() < EQUAL * part.hull_radius:
        return single
    rolls = np.array(sorted(made))
    return _views(aspect, made, rolls, differences > EQUAL * part.hull_radius, period)


def _views(
    aspect: Aspect,
    made: dict[float, Shape],
    rolls: Array,
    differs: npt.NDArray[np.bool_],
    period: float,
) -> Views:
    """Return the views with their shares; ``differs`` says which neighbours do."""
    steps = np.diff(rolls)
    cell = (np.append(steps, 0) + np.append(0, steps)) / 2 / steps.sum()
    group = np.append(0, np.cumsum(differs))
    if period:  # the last view is the first one
        cell[0] += cell[-1]
        group[group == group[-1]] = group[0]
        rolls, cell, group = rolls[:-1], cell[:-1], group[:-1]
    shares = np.bincount(group, cell)[group]
    shapes = tuple(made[float(roll)] for roll in rolls)
    orientations = np.array([rolled(aspect, roll) for roll in rolls])
    return Views(aspect, shapes, orientations, rolls, group, shares, period)


def _range(aspect: Aspect) -> tuple[float, float]:
    """Return the first and the last roll of a sweep about an axis, rad; 0 is between them."""
    if aspect.sweep is Sweep.RING:
        return 0.0, 2 * np.pi
    angles = np.sort([roll_between(aspect, down) % (2 * np.pi) for down in aspect.directions])
    gap = int(np.diff(angles, append=angles[0] + 2 * np.pi).argmax())
    if gap == len(angles) - 1:
        return float(angles[0]), float(angles[-1])
    return float(angles[gap + 1] - 2 * np.pi), float(angles[gap])


def _order(symmetry: Symmetry | None, aspect: Aspect) -> int:
    """Return the order of the symmetry of the part about the axis of a sweep."""
    if symmetry is None or symmetry.axis is not None:
        return 1
    moved = np.linalg.norm(symmetry.rotations @ aspect.axis - aspect.axis, axis=1)
    return max(1, int((moved < SAME_AXIS).sum()))

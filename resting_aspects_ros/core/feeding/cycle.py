"""The model of one cycle of a feeder: how many parts the robot picks, and how long it takes.

A cycle begins with a vibration. After the parts have come to rest, the feeder supplies as many
parts as are missing. Then one image is taken, and the robot picks the free parts in wanted aspects
that it shows, up to a maximum. A part that becomes free while another one is picked has to wait
for the next image.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.intervals import Array, Counts

MAX_TIME = 3600.0
# What each time belongs to, for the question what limits the rate.
RESOURCES = {
    'robot': ('robot', 'place'),
    'feeder': ('vibrate', 'settle', 'supply'),
    'vision': ('image',),
}


@dataclass(frozen=True)
class CycleTimes:
    """Times of a cycle, s.

    robot : float
        From one pick of the robot to the next; more than 0.
    vibrate, settle, image : float
        Vibration; until the parts are at rest; image with its evaluation.
    supply : float
        For each supplied part.
    place : float
        With overlap: how long of ``robot`` the robot is away from the tray after it has lifted the
        last part of a cycle. The next vibration, settling and image run in this time. 0: they
        begin when the robot is done.
    """

    robot: float
    vibrate: float
    settle: float
    image: float
    supply: float = 0.0
    place: float = 0.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and 0 <= value <= MAX_TIME) or (name == 'robot' and value == 0):
                least = 'more than 0' if name == 'robot' else '0 or more'
                raise InvalidValueError(
                    f'invalid {name} time {shown(value)} s: expected {least}, '
                    f'at most {MAX_TIME:g} s'
                )
        if self.place > self.robot:
            raise InvalidValueError(
                f'invalid place time {self.place:g} s: expected at most the robot time, '
                f'{self.robot:g} s'
            )

    @property
    def feeder(self) -> float:
        """Time of vibration, settling and image, s."""
        return self.vibrate + self.settle + self.image

    @property
    def overlap(self) -> float:
        """Time that a cycle with a pick is shorter because the feeder and the robot overlap, s."""
        return min(self.place, self.feeder)

    def scaled(self, name: str, factor: float) -> 'CycleTimes':
        """Return the times with a resource or a single time multiplied by a factor."""
        scaled = {
            each: min(factor * getattr(self, each), MAX_TIME)
            for each in RESOURCES.get(name, (name,))
        }
        return dataclasses.replace(self, **scaled)


@dataclass(frozen=True, eq=False)
class Picks:
    """Mean, variance, and probability of 0, of the number of picks in a cycle."""

    mean: Array
    variance: Array
    none: Array


def picks(number: int | Array | Counts, share: Array, max_picks: int | None = None) -> Picks:
    """Return the picks of a cycle, if each of the parts can be picked independently.

    The number of parts that can be picked is binomial; the robot picks at most ``max_picks``.

    Parameters
    ----------
    number : int or array of int
        Parts on the tray.
    share : array
        Probability that a part is wanted and free.
    max_picks : int or None
    """
    n, p = np.broadcast_arrays(np.asarray(number, dtype=np.float64), share)
    none = (1 - p) ** n
    if max_picks is None or max_picks >= n.max(initial=0):
        return Picks(n * p, n * p * (1 - p), none)
    mean, square = np.zeros_like(p), np.zeros_like(p)
    for k in range(1, max_picks + 1):
        # Probability of k or more.
        tail = np.where(k <= n, betainc(k, np.maximum(n - k + 1, 1), p), 0.0)
        mean += tail
        square += (2 * k - 1) * tail
    return Picks(mean, square - mean**2, none)


def cycle_time(times: CycleTimes, found: Picks, supplied: Array) -> Array:
    """Return the mean duration of a cycle, s.

    It is vibrate + settle + image + robot E[picks] + supply E[supplied parts], less the overlap in
    cycles with a pick: min(place, vibrate + settle + image).
    """
    return np.asarray(
        times.feeder
        + times.robot * found.mean
        + times.supply * supplied
        - times.overlap * (1 - found.none)
    )


def parts_per_minute(times: CycleTimes, found: Picks, supplied: Array) -> Array:
    """Return 60 E[picks] / E[duration of a cycle], the long-run rate (renewal reward theorem)."""
    duration = cycle_time(times, found, supplied)
    return np.asarray(60 * found.mean / np.maximum(duration, math.ulp(0.0)))


def time_shares(times: CycleTimes, found: Picks, supplied: Array) -> dict[str, float]:
    """Return the share of a mean cycle of each time; overlapping time counts as the feeder's."""
    spent = {
        'vibrate': times.vibrate,
        'settle': times.settle,
        'image': times.image,
        'supply': times.supply * float(supplied),
        'robot': times.robot * float(found.mean) - times.overlap * (1 - float(found.none)),
    }
    total = sum(spent.values())
    return {name: value / total if total else 0.0 for name, value in spent.items()}


def sensitivity(
    times: CycleTimes, found: Picks, supplied: Array, change: float = 0.1
) -> dict[str, tuple[float, float]]:
    """Return how the rate changes, as a share, if each time is shorter and longer by 10 %.

    The place time changes with the robot time.
    """
    base = float(parts_per_minute(times, found, supplied))

    def relative(name: str, factor: float) -> float:
        changed = _changed(times, name, factor)
        return float(parts_per_minute(changed, found, supplied)) / base - 1 if base else 0.0

    names = ('robot', 'vibrate', 'settle', 'image', 'supply')
    return {name: (relative(name, 1 - change), relative(name, 1 + change)) for name in names}


def limited_by(times: CycleTimes, found: Picks, supplied: Array) -> str | None:
    """Return the resource of RESOURCES whose time raises the rate most if it is 10 % shorter.

    It is None if nothing can be picked.
    """
    rates = {
        name: float(parts_per_minute(times.scaled(name, 0.9), found, supplied))
        for name in RESOURCES
    }
    return max(rates, key=lambda name: rates[name]) if any(rates.values()) else None


def _changed(times: CycleTimes, name: str, factor: float) -> CycleTimes:
    if name == 'robot':
        return times.scaled('robot', factor)
    return dataclasses.replace(times, **{name: min(factor * getattr(times, name), MAX_TIME)})

"""The conditions of a drop as plain numbers without dimension.

Lengths are in units of the hull radius R of the part, and times in units of T = sqrt(R / g), so
that gravity is 1. Drops of similar parts with equal numbers are similar.
"""

from dataclasses import dataclass, fields

import numpy as np

from resting_aspects_ros.core.rotations import Array

# Smallest height and rolling friction of which a logarithm is taken.
_LOWEST, _SMOOTHEST = 0.02, 3e-4
# Energy, m g R, of a part that is put down: about the height of its centre of mass on a corner
# above that in its aspects.
_PUT_DOWN = 0.3


@dataclass(frozen=True)
class Release:
    """The conditions of a drop of a part on a level plane.

    height : float
        Of the lowest point of the part, R.
    restitution, friction, rolling_friction : float
        As in the conditions of a drop, of the pair of materials.
    speed, speed_vertical : float
        Standard deviation of each horizontal component of the speed at release, and of the
        vertical one, R / T.
    spin : float
        Standard deviation of each component of the spin, 1 / T.
    """

    height: float
    restitution: float
    friction: float
    rolling_friction: float = 0.0
    speed: float = 0.0
    speed_vertical: float = 0.0
    spin: float = 0.0

    def features(self, moments: Array) -> Array:
        """Return the features of the conditions, in the order of RELEASE_FEATURES.

        ``moments`` (3,) are the principal moments of inertia of the part, m R^2.
        """
        thrown = self.speed**2 + self.speed_vertical**2 / 2 + self.spin**2 * moments.sum() / 2
        energy = self.height + thrown
        return np.array(
            [
                np.log(self.height + _LOWEST),
                np.log(energy + _PUT_DOWN),
                self.restitution,
                self.restitution**2,
                np.sqrt(self.friction),
                self.friction / (self.friction + 0.1),
                np.log(self.rolling_friction + _SMOOTHEST),
                np.sqrt(thrown),
                thrown / (energy + _PUT_DOWN),
                self.spin,
            ]
        )


# A part of 40 mm that is dropped from 60 mm onto rubber.
TYPICAL = Release(height=3.0, restitution=0.64, friction=0.25, rolling_friction=0.003)

RELEASE_FEATURES = (
    'log height',
    'log energy',
    'restitution',
    'square of restitution',
    'root of friction',
    'friction',
    'log rolling friction',
    'root of energy of the throw',
    'share of the throw',
    'spin',
)


@dataclass(frozen=True)
class Bounds:
    """The conditions of the drops to which an estimator was fitted; each is (low, high)."""

    height: tuple[float, float]
    restitution: tuple[float, float]
    friction: tuple[float, float]
    rolling_friction: tuple[float, float]
    speed: tuple[float, float]
    speed_vertical: tuple[float, float]
    spin: tuple[float, float]

    def outside(self, release: Release) -> str:
        """Return the name of a value that is not within the bounds; empty if all are."""
        for each in fields(self):
            low, high = getattr(self, each.name)
            if not low <= getattr(release, each.name) <= high:
                return each.name.replace('_', ' ')
        return ''

    def nearest(self, release: Release) -> Release:
        """Return the nearest conditions within the bounds."""
        values = {
            each.name: float(np.clip(getattr(release, each.name), *getattr(self, each.name)))
            for each in fields(self)
        }
        return Release(**values)

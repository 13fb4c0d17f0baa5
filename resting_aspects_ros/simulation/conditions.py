"""The physical conditions of a drop.

The metadata of the fields is the only declaration of units, bounds and descriptions. The checks
in this module and the command-line flags derive from it; the surfaces file and the table in the
documentation are tested against it.
"""

import dataclasses
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Optional

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.simulation.quantity import (
    Quantity,
    check_quantities,
    quantities_of,
    quantity,
)

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.surroundings.description import Surroundings

DEFAULT_SURFACE = 'rubber_mat'


class HeightOf(IntEnum):
    """Reference point of the release height; the codes of the message DropConditions."""

    LOWEST_POINT = 0
    CENTRE_OF_MASS = 1

    @property
    def label(self) -> str:
        """Readable name, such as 'lowest point'."""
        return self.name.lower().replace('_', ' ')


@dataclass(frozen=True)
class DropConditions:
    """Validated conditions of a drop. Friction and restitution belong to the pair of materials.

    Raises
    ------
    InvalidValueError
        If a value is not a finite number within its bounds.
    """

    height: float = quantity(
        'height', 'm', 'height of release', high=100.0, above=True, at_release=True
    )
    restitution: float = quantity('restitution', '', 'restitution of part on surface', high=1.0)
    friction: float = quantity('friction', '', 'Coulomb friction of part on surface', high=10.0)
    # A higher value would let a part rest tilted on an edge or a corner. For slender parts, the
    # length is less than the hull radius; see simulation.plan.rolling_length.
    rolling_friction: float = quantity(
        'rolling friction',
        '',
        'rolling friction: torque limit / (hull radius x normal force)',
        high=0.1,
    )
    spinning_friction: float = quantity(
        'spinning friction',
        '',
        'friction against spin about the contact normal, like rolling friction',
        high=1.0,
    )
    gravity: float = quantity('gravity', 'm/s2', 'gravity', low=1e-6, high=1000.0)
    speed_horizontal: float = quantity(
        'horizontal speed spread',
        'm/s',
        'standard deviation of each horizontal component of the speed at release',
        high=100.0,
        at_release=True,
    )
    speed_vertical: float = quantity(
        'vertical speed spread',
        'm/s',
        'standard deviation of the vertical speed at release',
        high=100.0,
        at_release=True,
    )
    spin: float = quantity(
        'spin spread',
        'rad/s',
        'standard deviation of each component of the spin at release',
        high=10000.0,
        at_release=True,
    )
    height_of: HeightOf = HeightOf.LOWEST_POINT
    surface: str = ''
    # None: an infinite level plane.
    surroundings: Optional['Surroundings'] = None

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.surroundings is not None and self.surroundings.level:
            object.__setattr__(self, 'surroundings', None)
        try:
            object.__setattr__(self, 'height_of', HeightOf(self.height_of))
        except ValueError:
            allowed = ' or '.join(f'{h.value} ({h.name})' for h in HeightOf)
            raise InvalidValueError(
                f'invalid height_of {shown(self.height_of)}: expected {allowed}'
            ) from None

    def values(self) -> tuple[float, ...]:
        """Return the values that a surface has, without its name, for comparison."""
        return (*(getattr(self, name) for name in QUANTITIES), float(self.height_of))

    def key(self) -> tuple[object, ...]:
        """Return everything physical, for comparison: the values and the surroundings."""
        return (*self.values(), self.surroundings_key)

    @property
    def surroundings_key(self) -> str:
        """The key of the surroundings; empty for an infinite level plane."""
        return '' if self.surroundings is None else self.surroundings.key

    def document(self) -> dict[str, object]:
        """Return the conditions as plain JSON types, with the surroundings as a mapping."""
        values = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        around = self.surroundings
        return {
            **values,
            'height_of': self.height_of.name,
            'surroundings': '' if around is None else around.document,
        }

    def changed(self, **changes: Any) -> 'DropConditions':
        """Return conditions with other values; the surface's name is removed if they differ."""
        new = dataclasses.replace(self, **changes)
        if new.key() == self.key():
            return self
        return new if new.values() == self.values() else dataclasses.replace(new, surface='')


QUANTITIES: dict[str, Quantity] = quantities_of(DropConditions)

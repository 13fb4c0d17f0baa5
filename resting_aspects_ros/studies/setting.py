"""What is simulated at a point of a study: conditions, surroundings and an action."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from resting_aspects_ros.core.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.simulation.actions import NamedAction, make_action
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions
from resting_aspects_ros.simulation.quantity import Quantity, quantities_of
from resting_aspects_ros.simulation.surroundings.description import (
    BODY_VALUES,
    RELEASE_VALUES,
    Surroundings,
)
from resting_aspects_ros.simulation.surroundings.library import changed_surroundings


@dataclass(frozen=True)
class Setting:
    """What is simulated at a point of a study.

    surroundings : Surroundings or None
        Instead of those of the conditions; None: those of the conditions.
    action : NamedAction or None
        What is done to parts at rest; None: parts are dropped.
    """

    conditions: DropConditions
    surroundings: Surroundings | None = None
    action: NamedAction | None = None

    @property
    def drop_conditions(self) -> DropConditions:
        """The conditions with the surroundings."""
        if self.surroundings is None:
            return self.conditions
        return dataclasses.replace(self.conditions, surroundings=self.surroundings)

    def quantity(self, name: str) -> Quantity:
        """Return unit and bounds of what a factor varies; raises InvalidValueError."""
        known = self.quantities()
        if name in known:
            return known[name]
        group = name.partition('.')[0]
        if group == 'surroundings' and self.surroundings is None:
            raise InvalidValueError(
                f'invalid factor {shown(name)}: expected surroundings, in which it is varied'
            )
        if group == 'action' and self.action is None:
            raise InvalidValueError(
                f'invalid factor {shown(name)}: expected an action, whose value is varied'
            )
        raise InvalidValueError(
            f'invalid factor {shown(name)}: expected one of {", ".join(known)}'
            f'{did_you_mean(name, known)}'
        )

    def quantities(self) -> dict[str, Quantity]:
        """Return everything that can vary, by name."""
        found = dict(QUANTITIES)
        if self.surroundings is not None:
            shape = self.surroundings.shape
            found |= {f'surroundings.{k}': each for k, each in quantities_of(shape).items()}
            for body in shape.body_names:
                found |= {f'surroundings.{body}.{k}': each for k, each in BODY_VALUES.items()}
            found |= {f'surroundings.release.{k}': each for k, each in RELEASE_VALUES.items()}
        if self.action is not None:
            values = quantities_of(self.action.action)
            found |= {f'action.{k}': each for k, each in values.items()}
        return found

    def changed(self, values: Mapping[str, float]) -> 'Setting':
        """Return the setting with other values of factors, SI units; raises InvalidValueError."""
        groups: dict[str, dict[str, float]] = {'': {}, 'surroundings': {}, 'action': {}}
        for name, value in values.items():
            self.quantity(name)
            group, dot, inner = name.partition('.')
            groups[group if dot else ''][inner if dot else name] = value
        new = self
        if groups['']:
            new = dataclasses.replace(new, conditions=self.conditions.changed(**groups['']))
        if groups['surroundings']:
            assert self.surroundings is not None
            other = changed_surroundings(self.surroundings, groups['surroundings'])
            new = dataclasses.replace(new, surroundings=other)
        if groups['action']:
            assert self.action is not None
            action = self.action.action
            both: dict[str, Any] = {**dataclasses.asdict(action), **groups['action']}
            other_action = make_action(action.kind, both)
            new = dataclasses.replace(
                new, action=dataclasses.replace(self.action, action=other_action)
            )
        return new

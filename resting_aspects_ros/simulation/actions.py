"""What a feeder does to parts at rest: the actions, and named ones, read from a YAML file."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.impulses import Kick
from resting_aspects_ros.simulation.nozzle import Nozzle
from resting_aspects_ros.simulation.quantity import (
    Quantity,
    check_name,
    described_kind,
    made_from,
    quantities_of,
)
from resting_aspects_ros.simulation.step_action import Step
from resting_aspects_ros.simulation.vibration import Vibration

Action = Kick | Nozzle | Vibration | Step
KINDS: dict[str, type[Kick] | type[Nozzle] | type[Vibration] | type[Step]] = {
    each.kind: each for each in (Kick, Nozzle, Vibration, Step)
}
# The time that an action takes, with the time until parts are at rest again.
TIME = Quantity('time', 's', 'time from one action to the next', high=3600.0, above=True)
DEFAULT_TIME = 1.0


@dataclasses.dataclass(frozen=True)
class NamedAction:
    """An action with its name and the time that it takes, s. ``source`` is that of its numbers."""

    name: str
    action: Action
    time: float = DEFAULT_TIME
    source: str = ''

    def __post_init__(self) -> None:
        if not isinstance(self.action, tuple(KINDS.values())):
            raise InvalidValueError(
                f'invalid action {shown(self.action)} of {self.name}: expected one of '
                f'{", ".join(each.__name__ for each in KINDS.values())}'
            )
        object.__setattr__(self, 'time', TIME.check('time', self.time))

    @property
    def values(self) -> dict[str, Any]:
        """Name, kind, time and all numbers of the action, in SI units."""
        numbers = dataclasses.asdict(self.action)
        return {'name': self.name, 'kind': self.action.kind, 'time': self.time, **numbers}

    @property
    def text(self) -> str:
        """The action in words: 'kick, speed 0.3 m/s, spin spread 10 rad/s'; zeros are left out."""
        parts = [self.action.kind]
        for name, each in quantities_of(self.action).items():
            if value := getattr(self.action, name):
                parts.append(f'{each.label} {value:g} {each.unit}'.rstrip())
        return ', '.join(parts)


class Actions:
    """The named actions."""

    def __init__(self, actions: Mapping[str, NamedAction]) -> None:
        self._actions = dict(actions)

    def names(self) -> list[str]:
        """Return all names, in the order of the file."""
        return list(self._actions)

    def get(self, name: str) -> NamedAction:
        """Return a named action; raises InvalidValueError."""
        if name not in self._actions:
            expected = [*KINDS, *(each for each in self._actions if each not in KINDS)]
            raise InvalidValueError(
                f'invalid action {shown(name)}: expected one of {", ".join(expected)}'
                f'{did_you_mean(name, expected)}'
            )
        return self._actions[name]

    @classmethod
    def read(cls, path: Path) -> 'Actions':
        """Read a file of the form of config/actions.yaml; raises InvalidValueError."""
        document = read_yaml(path, 'actions file')
        label = named('actions file', path)
        if not isinstance(document, dict) or not document:
            raise InvalidValueError(f'invalid {label}: expected a mapping of names to actions')
        return cls({name: _named_action(label, name, entry) for name, entry in document.items()})


def make_action(kind: str, values: Mapping[str, Any]) -> Action:
    """Return the action of a kind with these values; raises InvalidValueError.

    Values that are left out have their defaults.
    """
    return made_from(KINDS, 'action', kind, values)


def _named_action(label: str, name: object, entry: object) -> NamedAction:
    try:
        name = check_name('an action', name)
        kind, values, source = described_kind('action', entry, KINDS)
        time = values.pop('time', DEFAULT_TIME)
        return NamedAction(name, make_action(kind, values), time, source)
    except InvalidValueError as error:
        raise InvalidValueError(f'{label}, {shown(name)}: {error}') from None

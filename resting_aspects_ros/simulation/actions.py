"""What a feeder does to parts at rest: the actions, and named ones, read from a YAML file."""

import dataclasses
import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.impulses import Kick
from resting_aspects_ros.simulation.nozzle import Nozzle
from resting_aspects_ros.simulation.quantity import Quantity, quantities_of
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
            close = difflib.get_close_matches(str(name).lower(), expected, n=1)
            hint = f'; did you mean {close[0]!r}?' if close else ''
            raise InvalidValueError(
                f'invalid action {shown(name)}: expected one of {", ".join(expected)}{hint}'
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
    if kind not in KINDS:
        raise InvalidValueError(
            f'invalid kind of action {shown(kind)}: expected one of {", ".join(KINDS)}'
        )
    made = KINDS[kind]
    fields = {field.name: field for field in dataclasses.fields(made)}
    unknown = [name for name in values if name not in fields]
    if unknown:
        raise InvalidValueError(
            f'invalid value {shown(unknown[0])} of a {kind}: expected {", ".join(fields)}'
        )
    missing = [
        name
        for name, field in fields.items()
        if field.default is dataclasses.MISSING and name not in values
    ]
    if missing:
        raise InvalidValueError(f'missing {missing[0]} of a {kind}')
    return made(**values)


def _named_action(label: str, name: object, entry: object) -> NamedAction:
    if not isinstance(name, str) or not name.isidentifier():
        raise InvalidValueError(
            f'{label}: invalid name {shown(name)} of an action: expected a name such as my_tap'
        )
    where = f'{label}, {name}'
    if not isinstance(entry, dict) or not isinstance(entry.get('kind'), str):
        raise InvalidValueError(f'{where}: expected a mapping with the key kind')
    values = {str(key): value for key, value in entry.items()}
    kind, time = values.pop('kind'), values.pop('time', DEFAULT_TIME)
    source = values.pop('source', '')
    if not isinstance(source, str):
        raise InvalidValueError(f'{where}: invalid source {shown(source)}: expected text')
    try:
        return NamedAction(name, make_action(kind, values), time, source)
    except InvalidValueError as error:
        raise InvalidValueError(f'{where}: {error}') from None

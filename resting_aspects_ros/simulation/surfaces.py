"""Named sets of conditions (surfaces), read from a YAML file."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf

DEFAULT_SURFACE = 'rubber_mat'
# Conditions that differ from every surface in more values than this are described as custom.
MAX_CHANGES = 4
# Number of samples of an uncertain surface.
MIN_SAMPLES, MAX_SAMPLES = 8, 1000
UNCERTAINTY = 'uncertainty'

# Equally probable values of the conditions of a surface that are not known.
Samples = tuple[Mapping[str, float], ...]


class Surfaces:
    """The named sets of conditions, and the samples of those that are not known exactly."""

    def __init__(
        self, sets: Mapping[str, DropConditions], samples: Mapping[str, Samples] | None = None
    ) -> None:
        self._sets = dict(sets)
        self._samples = dict(samples or {})

    def names(self) -> list[str]:
        """Return all names, sorted."""
        return sorted(self._sets)

    def get(self, name: str = '') -> DropConditions:
        """Return the conditions of a surface; an empty name selects the default surface."""
        name = name or DEFAULT_SURFACE
        if name not in self._sets:
            raise InvalidValueError(
                f'invalid surface {shown(name)}: expected one of {", ".join(self.names())}'
            )
        return self._sets[name]

    def samples(self, name: str = '') -> Samples:
        """Return the samples of a surface, such as `calibrate` writes; empty if it has none."""
        return self._samples.get(name or DEFAULT_SURFACE, ())

    def named(self, conditions: DropConditions) -> DropConditions:
        """Return the conditions, without the surface's name if the surface has other values."""
        known = self._sets.get(conditions.surface)
        if known is not None and known.values() == conditions.values():
            return (
                known
                if known.key() == conditions.key()
                else dataclasses.replace(known, surroundings=conditions.surroundings)
            )
        return dataclasses.replace(conditions, surface='')

    def text(self, conditions: DropConditions) -> str:
        """Describe conditions: 'steel', or 'steel with friction 0.3 and spin 5 rad/s'."""
        if conditions.surface:
            return conditions.surface
        changes = {name: _changes(known, conditions) for name, known in self._sets.items()}
        name = min(changes, key=lambda name: (len(changes[name]), name != DEFAULT_SURFACE))
        if len(changes[name]) > MAX_CHANGES:
            return 'own conditions'
        if not changes[name]:
            return name
        *most, last = changes[name]
        return f'{name} with {", ".join(most)}{" and " if most else ""}{last}'

    @classmethod
    def read(cls, path: Path) -> 'Surfaces':
        """Read a file of the form of config/surfaces.yaml; raises InvalidValueError."""
        document = read_yaml(path, 'surfaces file')
        label = named('surfaces file', path)
        if not isinstance(document, dict) or not document:
            raise InvalidValueError(f'invalid {label}: expected a mapping of names to conditions')
        sets = {name: _conditions(label, name, entry) for name, entry in document.items()}
        samples = {
            name: _samples(label, name, sets[name], entry[UNCERTAINTY])
            for name, entry in document.items()
            if UNCERTAINTY in entry
        }
        if DEFAULT_SURFACE not in sets:
            raise InvalidValueError(
                f'invalid {label}: expected the default surface, {DEFAULT_SURFACE}, among others'
            )
        return cls(sets, samples)


def _changes(known: DropConditions, conditions: DropConditions) -> list[str]:
    """Return a description of each value that differs from a surface."""
    changes = [
        f'{quantity.label} {getattr(conditions, name):g} {quantity.unit}'.rstrip()
        for name, quantity in QUANTITIES.items()
        if getattr(conditions, name) != getattr(known, name)
    ]
    if conditions.height_of != known.height_of:
        changes.append(f'height of {conditions.height_of.label}')
    return changes


def _conditions(label: str, name: object, entry: object) -> DropConditions:
    where = f'{label}, {name if isinstance(name, str) and name.isidentifier() else shown(name)}'
    needed = {*QUANTITIES, 'height_of'}
    if not isinstance(name, str):
        raise InvalidValueError(f'{where}: invalid name of a surface: expected text')
    if not isinstance(entry, dict) or set(entry) - {'source', UNCERTAINTY} != needed:
        raise InvalidValueError(
            f'{where}: invalid keys: expected exactly {", ".join(sorted(needed))}'
        )
    values = {key: entry[key] for key in needed}
    try:
        values['height_of'] = HeightOf.__members__[values['height_of']]
        return DropConditions(surface=name, **values)
    except (KeyError, TypeError):
        allowed = ' or '.join(h.name for h in HeightOf)
        raise InvalidValueError(
            f'{where}: invalid height_of {shown(entry["height_of"])}: expected {allowed}'
        ) from None
    except InvalidValueError as error:
        raise InvalidValueError(f'{where}: {error}') from None


def _samples(label: str, name: str, conditions: DropConditions, given: object) -> Samples:
    """Return the samples of an entry: a list of values for each condition, of equal length."""
    where = f'{label}, {name}: invalid {UNCERTAINTY}'
    lists = list(given.values()) if isinstance(given, dict) else []
    if (
        not isinstance(given, dict)
        or not lists
        or not set(given) <= set(QUANTITIES)
        or not all(isinstance(each, list) and len(each) == len(lists[0]) for each in lists)
        or not MIN_SAMPLES <= len(lists[0]) <= MAX_SAMPLES
    ):
        raise InvalidValueError(
            f'{where} {shown(given)}: expected a mapping of conditions to lists of equal length, '
            f'with {MIN_SAMPLES} to {MAX_SAMPLES} values each'
        )
    found = tuple(dict(zip(given, row, strict=True)) for row in zip(*lists, strict=True))
    try:
        for each in found:
            conditions.changed(**each)
    except InvalidValueError as error:
        raise InvalidValueError(f'{where}: {error}') from None
    return found

"""Named sets of conditions (surfaces), read from a YAML file."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import create_model

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.schema import FileModel, Number, validated
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SURFACE,
    QUANTITIES,
    DropConditions,
    HeightOf,
)
from resting_aspects_ros.simulation.config_files import surfaces_file
from resting_aspects_ros.simulation.quantity import check_name

# Conditions that differ from every surface in more values than this are described as custom.
MAX_CHANGES = 4
# Number of samples of an uncertain surface.
MIN_SAMPLES, MAX_SAMPLES = 8, 1000
UNCERTAINTY = 'uncertainty'

_fields: dict[str, Any] = dict.fromkeys(QUANTITIES, (Any, ...))
_fields['height_of'] = (Literal['LOWEST_POINT', 'CENTRE_OF_MASS'], ...)
_samples: Any = dict[Literal[tuple(QUANTITIES)], list[Number]]  # type: ignore[misc]
# An entry of a surfaces file. Its numbers are checked by DropConditions.
SurfaceEntry: Any = create_model(
    'SurfaceEntry',
    __base__=FileModel,
    **_fields,
    source=(Any, ''),
    uncertainty=(_samples, {}),
)
EXPECTED = {
    'height_of': ' or '.join(each.name for each in HeightOf),
    UNCERTAINTY: 'a mapping of conditions to lists of equal length, with '
    f'{MIN_SAMPLES} to {MAX_SAMPLES} values each',
}

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

    def extended(self, path: Path) -> 'Surfaces':
        """Return these surfaces and those of a file, which replace others of the same name."""
        own = Surfaces.read(path)
        return Surfaces(self._sets | own._sets, self._samples | own._samples)  # noqa: SLF001

    @classmethod
    def read(cls, path: Path) -> 'Surfaces':
        """Read a file of the form of config/surfaces.yaml; raises InvalidValueError."""
        document = read_yaml(path, 'surfaces file')
        label = named('surfaces file', path)
        if not isinstance(document, dict) or not document:
            raise InvalidValueError(f'invalid {label}: expected a mapping of names to conditions')
        sets: dict[str, DropConditions] = {}
        samples: dict[str, Samples] = {}
        for name, entry in document.items():
            where = f'{label}, {name}' if isinstance(name, str) and name.isidentifier() else label
            try:
                check_name('a surface', name)
                given = validated(SurfaceEntry, entry, expected=EXPECTED)
                sets[name], samples[name] = _conditions(name, given)
            except InvalidValueError as error:
                raise InvalidValueError(f'{where}: {error}') from None
        return cls(sets, samples)


def all_surfaces(own: str | Path | None = None) -> Surfaces:
    """Return the surfaces of the suite, and those of a file if it is given."""
    shipped = Surfaces.read(surfaces_file())
    return shipped.extended(Path(own)) if own else shipped


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


def _conditions(name: str, given: Any) -> tuple[DropConditions, Samples]:
    """Return the conditions of a checked entry, and its samples; raises InvalidValueError."""
    lists: dict[str, list[float]] = given.uncertainty
    sizes = {len(each) for each in lists.values()}
    if len(sizes) > 1 or not all(MIN_SAMPLES <= size <= MAX_SAMPLES for size in sizes):
        raise InvalidValueError(
            f'invalid {UNCERTAINTY} {shown(lists)}: expected {EXPECTED[UNCERTAINTY]}'
        )
    samples = tuple(
        dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)
    )
    values = {key: getattr(given, key) for key in QUANTITIES}
    found = DropConditions(surface=name, height_of=HeightOf[given.height_of], **values)
    for each in samples:
        found.changed(**each)
    return found, samples

"""The conditions of drops: their values with units and bounds, and the named surfaces.

Also the numbers of a run: its drops, its seed and its engine. No NumPy: help shows all at once.
The metadata of the fields is the only declaration of units, bounds and descriptions. The checks
in this module and the command-line flags derive from it; the surfaces file and the table in the
documentation are tested against it.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Optional, TypeVar

from pydantic import create_model

from resting_aspects_ros.errors import InvalidValueError, did_you_mean, one_line, shown
from resting_aspects_ros.input_files import (
    FileModel,
    Number,
    named,
    parse_quantity,
    read_yaml,
    validated,
)
from resting_aspects_ros.system import config_folder

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.surroundings import Surroundings


# -- Number of drops, seed and engine -------------------------------------------------------------


MAX_DROPS = 2_000_000
MAX_SEED = 2**64 - 1
# The default seed is fixed, so that identical requests have identical results.
DEFAULT_SEED = 1
DEFAULT_DROPS = 1000
# The engines: the kernel, for parts that only touch planes, also on a GPU, and Bullet.
KERNEL, CUDA, BULLET = 'kernel', 'cuda', 'bullet'
NO_BULLET = (
    'Bullet, which simulates drops on blocks, meshes and edges, is not installed: '
    'pip install pybullet'
)


def check_drops(drops: int) -> None:
    """Raise InvalidValueError if the number of drops of a run is out of bounds."""
    check_integer('drops', drops, 1, MAX_DROPS)


def check_seed(seed: int) -> None:
    """Raise InvalidValueError if the seed is out of bounds."""
    check_integer('seed', seed, 0, MAX_SEED)


def check_integer(name: str, value: object, low: int, high: int) -> None:
    """Raise InvalidValueError unless a value is an integer within bounds."""
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected an integer from {low} to {high}'
        )


# -- Numbers with a unit and bounds ---------------------------------------------------------------


T = TypeVar('T')
MAX_NAME = 64


@dataclass(frozen=True)
class Quantity:
    """A number with a unit and bounds.

    label : str
        Readable name, such as 'horizontal speed spread'.
    above : bool
        Whether the lower bound itself is excluded. The upper bound is always included.
    at_release : bool
        Whether it describes the release of a part, so that it has no effect on a part at rest.
    """

    label: str
    unit: str
    text: str
    low: float = 0.0
    high: float = math.inf
    above: bool = False
    at_release: bool = False

    def allowed(self) -> str:
        """Return the allowed range as text, such as '0 to 10000 rad/s'."""
        unit = f' {self.unit}' if self.unit else ''
        if self.unit == 'rad' and math.isfinite(self.high):
            unit += f' ({math.degrees(self.low):.4g} to {math.degrees(self.high):.4g} deg)'
        lower = f'more than {self.low:g} and at most' if self.above else f'{self.low:g} to'
        return f'{lower} {self.high:g}{unit}'

    def check(self, name: str, value: Any) -> float:
        """Return a number, or a text such as '60mm', in SI units; raises InvalidValueError."""
        if isinstance(value, str):
            value = parse_quantity(name, value, self.unit)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        # The comparison precedes the conversion, because an integer can be too large for a float.
        within = number and self.low <= value <= self.high and math.isfinite(value)
        if within and (value > self.low or not self.above):
            return float(value)
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected {self.allowed()}')


def quantity(label: str, unit: str, text: str, *, default: Any = ..., **options: Any) -> Any:
    """Return a dataclass field with a Quantity; ``...`` stands for a field without a default."""
    given = {} if default is ... else {'default': default}
    return field(metadata={'quantity': Quantity(label, unit, text, **options)}, **given)


def quantities_of(declared: Any) -> dict[str, Quantity]:
    """Return the quantities of a dataclass by the names of their fields, in their order."""
    return {
        f.name: f.metadata['quantity']
        for f in dataclasses.fields(declared)
        if 'quantity' in f.metadata
    }


class Described:
    """The base of frozen dataclasses whose quantities are checked when one is made.

    They become floats; raises InvalidValueError. Flags, keys of files, documents and texts follow
    from the quantities.
    """

    kind: ClassVar[str] = ''

    def __post_init__(self) -> None:
        for name, each in quantities_of(self).items():
            object.__setattr__(self, name, each.check(name, getattr(self, name)))

    @property
    def numbers(self) -> dict[str, float]:
        """The quantities by name, SI units."""
        return {name: getattr(self, name) for name in quantities_of(self)}


def check_name(what: str, name: Any) -> str:
    """Return the name of an entry of a YAML file, such as 'a surface'; InvalidValueError."""
    if isinstance(name, str) and name.isidentifier() and len(name) <= MAX_NAME:
        return name
    raise InvalidValueError(
        f'invalid name {shown(name)} of {what}: expected at most {MAX_NAME} letters, digits and '
        '_, without spaces, a letter first, such as my_table'
    )


def read_entries(
    path: Path, kind: str, what: str, entries: str, make: Callable[[str, Any], T]
) -> dict[str, T]:
    """Return what the entries of a YAML file describe, by their names.

    ``make`` returns what an entry of a name describes. Raises InvalidValueError, with the file.
    """
    document, label = read_yaml(path, kind), named(kind, path)
    if not isinstance(document, dict) or not document:
        raise InvalidValueError(f'invalid {label}: expected a mapping of names to {entries}')
    found: dict[str, T] = {}
    for name, entry in document.items():
        where = f'{label}, {name}' if isinstance(name, str) and name.isidentifier() else label
        try:
            check_name(what, name)
            found[name] = make(name, entry)
        except InvalidValueError as error:
            raise InvalidValueError(f'{where}: {error}') from None
    return found


def described_kind(
    what: str, document: Any, kinds: Mapping[str, Any]
) -> tuple[str, dict[str, Any], str]:
    """Return the kind, the values and the source of an entry of a YAML file.

    ``what`` is what the entry describes, such as 'action'. Raises InvalidValueError.
    """
    if not isinstance(document, Mapping) or 'kind' not in document:
        raise InvalidValueError(
            f'invalid {what} {shown(document)}: expected a mapping with the key kind'
        )
    values = {key if isinstance(key, str) else shown(key): document[key] for key in document}
    kind, source = values.pop('kind'), values.pop('source', '')
    _check_kind(kinds, what, kind)
    if not isinstance(source, str):
        raise InvalidValueError(f'invalid source {shown(source)}: expected text')
    return kind, values, source


def made_from(
    kinds: Mapping[str, type[T]],
    what: str,
    kind: str,
    values: Mapping[str, Any],
    others: Sequence[str] = (),
) -> T:
    """Return the dataclass of a kind with these values; values left out have their defaults.

    ``others`` are names beside those of its fields that an error lists. Raises InvalidValueError.
    """
    _check_kind(kinds, what, kind)
    made: Any = kinds[kind]
    fields = [each for each in dataclasses.fields(made) if each.init and each.repr]
    names = [*(each.name for each in fields), *others]
    for name in values:
        if name not in names:
            raise InvalidValueError(
                f'invalid value {shown(name)} of a {kind}: expected one of {", ".join(names)}'
                f'{did_you_mean(name, names)}'
            )
    for each in fields:
        if each.default is dataclasses.MISSING and each.name not in values:
            raise InvalidValueError(f'missing {each.name} of a {kind}')
        text = values.get(each.name, '')
        if 'quantity' not in each.metadata and not isinstance(text, str | Path):
            raise InvalidValueError(f'invalid {each.name} {shown(text)}: expected text')
    result: T = made(**values)
    return result


def _check_kind(kinds: Mapping[str, Any], what: str, kind: Any) -> None:
    if not isinstance(kind, str) or kind not in kinds:
        raise InvalidValueError(
            f'invalid kind of {what} {shown(kind)}: expected one of {", ".join(kinds)}'
            f'{did_you_mean(kind, kinds) if isinstance(kind, str) else ""}'
        )


# -- Conditions -----------------------------------------------------------------------------------


DEFAULT_SURFACE = 'rubber_mat'


class HeightOf(IntEnum):
    """Reference point of the release height; the codes of the message DropConditions."""

    LOWEST_POINT = 0
    CENTRE_OF_MASS = 1

    @property
    def label(self) -> str:
        """Readable name, such as 'lowest point'."""
        return self.name.lower().replace('_', ' ')


# Equally probable values of conditions that are not known exactly.
Samples = tuple[Mapping[str, float], ...]


@dataclass(frozen=True)
class DropConditions(Described):
    """Validated conditions of a drop. Friction and restitution belong to the pair of materials.

    uncertainty : tuple of dict of str to float
        Equally probable values of those that are not known exactly, such as `calibrate` writes.
        They are no part of what is simulated: conditions that differ only in them are equal.

    Raises InvalidValueError if a value is not a finite number within its bounds.
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
    uncertainty: Samples = field(default=(), compare=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
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
        return (*self.numbers.values(), float(self.height_of))

    def key(self) -> tuple[object, ...]:
        """Return everything physical, for comparison: the values and the surroundings."""
        return (*self.values(), self.surroundings_key)

    @property
    def uncertain(self) -> tuple[str, ...]:
        """Names of the conditions that are not known exactly."""
        return tuple(self.uncertainty[0]) if self.uncertainty else ()

    @property
    def surroundings_key(self) -> str:
        """The key of the surroundings; empty for an infinite level plane."""
        return '' if self.surroundings is None else self.surroundings.key

    def document(self) -> dict[str, object]:
        """Return the conditions as plain JSON types, with the surroundings as a mapping."""
        fields = (each for each in dataclasses.fields(self) if each.compare)
        values = {each.name: getattr(self, each.name) for each in fields}
        around = self.surroundings
        return {
            **values,
            'height_of': self.height_of.name,
            'surroundings': '' if around is None else around.document,
        }

    def changed(self, **changes: Any) -> 'DropConditions':
        """Return conditions with other values; the surface's name is removed if they differ.

        If one of the uncertain values is stated, all of them are taken as known: they were fitted
        or assumed together.
        """
        new = dataclasses.replace(self, **changes)
        if not set(changes).isdisjoint(self.uncertain):
            new = dataclasses.replace(new, uncertainty=())
        elif new.key() == self.key():
            return self
        return new if new.values() == self.values() else dataclasses.replace(new, surface='')


@dataclass(frozen=True)
class Noise(Described):
    """Standard deviations of normal errors of given states, for each component in tray axes."""

    orientation: float = quantity(
        'orientation noise', 'rad', 'noise of the orientation', high=10.0, default=0.0
    )
    velocity: float = quantity(
        'velocity noise', 'm/s', 'noise of the velocity', high=100.0, default=0.0
    )
    spin: float = quantity('spin noise', 'rad/s', 'noise of the spin', high=1e4, default=0.0)


QUANTITIES: dict[str, Quantity] = quantities_of(DropConditions)


# -- Named surfaces -------------------------------------------------------------------------------


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


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The named sets of conditions, and what each resembles and where its values come from."""

    sets: Mapping[str, DropConditions]
    sources: Mapping[str, str] = field(default_factory=dict)

    def names(self) -> list[str]:
        """Return all names, sorted."""
        return sorted(self.sets)

    def get(self, name: str = '') -> DropConditions:
        """Return the conditions of a surface; an empty name selects the default surface."""
        name = name or DEFAULT_SURFACE
        if name not in self.sets:
            raise InvalidValueError(
                f'invalid surface {shown(name)}: expected one of {", ".join(self.names())}'
                f'{did_you_mean(name, self.names())}'
            )
        return self.sets[name]

    def recorded_uncertainty(self, conditions: DropConditions) -> Samples | None:
        """Return equally probable values of what is not known exactly; empty if all is.

        For conditions that were read from a log or a message, which do not have them. They are
        those of the surface with this name. Without a name they are those of a surface with equal
        values of the conditions that are uncertain there, such as one with another height.

        None: there is no surface with this name and these values.
        """
        if conditions.surface:
            named = self.sets.get(conditions.surface)
            if named is None or named.values() != conditions.values():
                return None
            return named.uncertainty
        for each in self.sets.values():
            same = all(getattr(each, x) == getattr(conditions, x) for x in each.uncertain)
            if each.uncertain and same:
                return each.uncertainty
        return ()

    def source(self, name: str = '') -> str:
        """Return the source of a surface; can be empty."""
        return self.sources.get(name or DEFAULT_SURFACE, '')

    def named(self, conditions: DropConditions) -> DropConditions:
        """Return the conditions, without the surface's name if the surface has other values."""
        known = self.sets.get(conditions.surface)
        if known is None or known.values() != conditions.values():
            return dataclasses.replace(conditions, surface='')
        return known.changed(surroundings=conditions.surroundings)

    def text(self, conditions: DropConditions) -> str:
        """Describe conditions: 'steel', or 'steel with friction 0.3 and spin 5 rad/s'."""
        if conditions.surface:
            return conditions.surface
        changes = {name: _changes(known, conditions) for name, known in self.sets.items()}
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
        found = read_entries(path, 'surfaces file', 'a surface', 'conditions', _surface)
        return cls(
            {name: conditions for name, (conditions, _) in found.items()},
            {name: source for name, (_, source) in found.items()},
        )


def all_surfaces(own: str | Path | None = None) -> Surfaces:
    """Return the surfaces of the suite, and those of a file, which replace others of a name."""
    found = Surfaces.read(config_folder() / 'surfaces.yaml')
    if own:
        added = Surfaces.read(Path(own))
        found = Surfaces({**found.sets, **added.sets}, {**found.sources, **added.sources})
    return found


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


def _surface(name: str, entry: Any) -> tuple[DropConditions, str]:
    """Return the conditions and the source of an entry; raises InvalidValueError."""
    given = validated(SurfaceEntry, entry, expected=EXPECTED)
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
    return dataclasses.replace(found, uncertainty=samples), one_line(str(given.source))

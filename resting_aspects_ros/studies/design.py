"""What varies in a study, between which values, and at which points of their ranges."""

import dataclasses
import inspect
import itertools
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from scipy.stats import qmc

from resting_aspects_ros.api.conditions import given_conditions, shipped_surfaces
from resting_aspects_ros.api.model_range import covered_text, missing_at
from resting_aspects_ros.api.plan import check_height, named_action
from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.actions import DEFAULT_TIME, KINDS, NamedAction, make_action
from resting_aspects_ros.simulation.conditions import (
    QUANTITIES,
    DropConditions,
    HeightOf,
    Quantity,
    Surfaces,
    check_integer,
    check_name,
    described_kind,
    quantities_of,
)
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.surroundings import (
    BODY_VALUES,
    RELEASE_VALUES,
    Surroundings,
    changed_surroundings,
    make_surroundings,
    named_surroundings,
)

DESIGNS = ('curves', 'factorial')
DEFAULT_DESIGN = 'curves'
# Base points; a power of two fills the space most evenly.
DEFAULT_POINTS = 16
# Levels of a factor that has no levels of its own, in curves and in a factorial design.
CURVE_LEVELS, FACTORIAL_LEVELS = 7, 3
MAX_POINTS = 100_000
MAX_LEVELS = 1000
# Values are rounded to this number of digits, so that they do not depend on rounding errors.
DIGITS = 12
EXPECTED = 'LOW:HIGH, LOW:HIGH:LEVELS or LOW:HIGH:log, such as 20mm:200mm:7'


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

    @property
    def no_model_range(self) -> str:
        """Why shares have no model range here; empty if they have one."""
        return missing_at(self.drop_conditions, acted=self.action is not None)

    @property
    def range_text(self) -> str:
        """What the model ranges of shares cover here, where conditions are taken as exact."""
        missing = self.no_model_range
        return f'No model range: {missing}.' if missing else covered_text(())

    @property
    def document(self) -> dict[str, Any]:
        """The setting as plain values, as `read_setting` reads it."""
        conditions = self.conditions.document()
        conditions.pop('surroundings')
        conditions['height_of'] = HeightOf(self.conditions.height_of).name
        name = conditions.pop('surface')
        return {
            **({'surface': name} if name else {}),
            'conditions': conditions,
            **({} if self.surroundings is None else {'surroundings': self.surroundings.document}),
            **({} if self.action is None else {'action': self.action.values}),
        }

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

    def value(self, name: str) -> float | None:
        """Return a value that can vary, SI units; None if it has a default in the surroundings."""
        group, dot, inner = name.partition('.')
        if not dot:
            return float(getattr(self.conditions, name))
        if group == 'action':
            assert self.action is not None
            return float(getattr(self.action.action, inner))
        assert self.surroundings is not None
        body, dot, inner_name = inner.partition('.')
        if not dot:
            return float(self.surroundings.shape_values[inner])
        known = self.surroundings
        values = known.release if body == 'release' else known.bodies.get(body, {})
        found = values.get(inner_name, getattr(self.conditions, inner_name, None))
        return None if found is None else float(found)

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
            both: dict[str, Any] = {**action.numbers, **groups['action']}
            other_action = make_action(action.kind, both)
            new = dataclasses.replace(
                new, action=dataclasses.replace(self.action, action=other_action)
            )
        return new

    def at(self, values: Mapping[str, float]) -> 'Setting | str':
        """Return the setting with other values of factors, or why it is impossible."""
        try:
            return self.changed(values)
        except InvalidValueError as error:
            return str(error)


def given_setting(
    surface: str | DropConditions,
    changes: Mapping[str, Any],
    surroundings: str | Path | Surroundings | None,
    action: str | Action | NamedAction | None,
) -> Setting:
    """Return the setting of arguments as those of `drop`; raises InvalidValueError."""
    conditions = given_conditions(surface, changes)
    if surroundings is None:
        surroundings = conditions.surroundings
    if surroundings is not None and not isinstance(surroundings, Surroundings):
        surroundings = named_surroundings(surroundings)
    return Setting(
        conditions.changed(surroundings=None),
        surroundings,
        None if action is None else named_action(action),
    )


def read_setting(
    surface: str,
    conditions: Mapping[str, float | str],
    surroundings: Any,
    action: Any,
    folder: Path,
    surfaces: Surfaces | None = None,
) -> Setting:
    """Return a setting of names, texts and mappings, as files have them; InvalidValueError.

    Files are relative to ``folder``. The surface is one of ``surfaces``, by default of the suite.
    """
    values, known = condition_values(conditions), surfaces or shipped_surfaces()
    if len(values) > len(QUANTITIES) and surface not in ('', *known.names()):
        # A saved study has all values of a surface whose file need not exist any more.
        base = DropConditions(surface=check_name('a surface', surface), **values)
    else:
        base = known.get(surface).changed(**values)
    if isinstance(surroundings, str):
        is_file = surroundings.endswith(('.yaml', '.yml'))
        surroundings = folder / surroundings if is_file else surroundings
    elif surroundings is not None:
        surroundings = make_surroundings(surroundings)
    if action is not None and not isinstance(action, str):
        kind, numbers, _ = described_kind('action', action, KINDS)
        name, time = numbers.pop('name', kind), numbers.pop('time', DEFAULT_TIME)
        if not isinstance(name, str):
            raise InvalidValueError(f'invalid name {shown(name)} of an action: expected text')
        action = NamedAction(name, make_action(kind, numbers), time)
    return given_setting(base, {}, surroundings, action)


def condition_values(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return conditions that are numbers or texts with a unit in SI units; InvalidValueError."""
    values: dict[str, Any] = {}
    for name, value in given.items():
        if name == 'height_of':
            values[name] = HeightOf.__members__.get(str(value).upper(), value)
        elif name in QUANTITIES:
            unit = QUANTITIES[name].unit
            values[name] = parse_quantity(name, value, unit) if isinstance(value, str) else value
        else:
            raise InvalidValueError(
                f'invalid condition {shown(name)}: expected one of {", ".join(QUANTITIES)}'
            )
    return values


@dataclass(frozen=True)
class Factor:
    """A quantity that varies between two values.

    name : str
        Name of a condition, or of a value of the surroundings or the action, such as
        'surroundings.angle' or 'action.speed'.
    low, high : float
        SI units; both are included.
    levels : int or None
        Number of values, if only some are used; None: all values in between.
    logarithmic : bool
        Whether equal ratios instead of equal differences are equally far apart.
    unit, label : str
        Of the quantity.

    Raises
    ------
    InvalidValueError
        If the range is empty, or cannot be logarithmic.
    """

    name: str
    low: float
    high: float
    levels: int | None = None
    logarithmic: bool = False
    unit: str = ''
    label: str = ''

    def __post_init__(self) -> None:
        if not self.low < self.high or f'{self.low:.{DIGITS}g}' == f'{self.high:.{DIGITS}g}':
            raise InvalidValueError(
                f'invalid range {self.low:g} to {self.high:g} of {self.name}: expected a lower '
                'and a higher value'
            )
        if self.logarithmic and self.low <= 0:
            raise InvalidValueError(
                f'invalid lowest value {self.low:g} of {self.name}: expected more than 0 for '
                'logarithmic steps'
            )
        number = type(self.levels) is int and 2 <= self.levels <= MAX_LEVELS
        if self.levels is not None and not number:
            raise InvalidValueError(
                f'invalid number of levels {shown(self.levels)} of {self.name}: expected an '
                f'integer from 2 to {MAX_LEVELS}, or none for all values in between'
            )

    @property
    def title(self) -> str:
        """Label with the unit in which values are shown, such as 'height (mm)'."""
        label, unit = self.label or self.name, self._shown[0]
        return f'{label} ({unit})' if unit else label

    @property
    def scale(self) -> float:
        """Shown number of an SI unit: 1000 for lengths, which are shown in mm."""
        return self._shown[1]

    @property
    def _shown(self) -> tuple[str, float]:
        return {'m': ('mm', 1000.0), 'rad': ('deg', 180 / math.pi)}.get(
            self.unit, (self.unit, 1.0)
        )

    def values(self, shares: Array) -> Array:
        """Return the values for numbers from 0 (low) to 1 (high)."""
        u = np.asarray(shares, dtype=np.float64)
        if self.logarithmic:
            found = self.low ** (1 - u) * self.high**u
        else:
            found = (1 - u) * self.low + u * self.high
        rounded = np.array([float(f'{v:.{DIGITS}g}') for v in found.ravel()])
        return np.clip(rounded.reshape(found.shape), self.low, self.high)

    def shares(self, values: Array) -> Array:
        """Return the numbers from 0 to 1 for values; the inverse of ``values``."""
        v = np.asarray(values, dtype=np.float64)
        if self.logarithmic:
            return np.asarray(np.log(v / self.low) / np.log(self.high / self.low))
        return np.asarray((v - self.low) / (self.high - self.low))

    def text(self, value: float) -> str:
        """Return a value with its unit, such as '50 mm'; lengths in mm and angles in degrees."""
        unit, scale = self._shown
        number = scale * value
        text = f'{number:.0f}' if abs(number) >= 1000 else f'{number:.3g}'
        return f'{text} {unit}'.rstrip()

    @property
    def document(self) -> dict[str, Any]:
        """The factor as plain values, as `read_factor` reads it."""
        document: dict[str, Any] = {'low': self.low, 'high': self.high}
        if self.levels:
            document['levels'] = self.levels
        if self.logarithmic:
            document['logarithmic'] = True
        return document


def parse_ranges(texts: Sequence[str]) -> dict[str, str]:
    """Return the ranges of texts such as ``height=20mm:200mm:7`` by name; InvalidValueError."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, values = (word.strip() for word in text.partition('='))
        if not equals:
            raise InvalidValueError(f'invalid factor {shown(text)}: expected NAME={EXPECTED}')
        if name in found:
            raise InvalidValueError(f'invalid factors: expected {name} only once')
        found[name] = values
    return found


def read_factor(name: str, given: Any, base: Setting) -> Factor:
    """Return a factor from its range: a text, a pair or a mapping; raises InvalidValueError."""
    name = name.replace('-', '_')
    quantity = base.quantity(name)
    if isinstance(given, str):
        given = _range(name, given)
    elif isinstance(given, tuple | list) and len(given) == 2:
        given = dict(zip(('low', 'high'), given, strict=True))
    known = {'low', 'high', 'levels', 'logarithmic'}
    if not isinstance(given, Mapping) or not {'low', 'high'} <= given.keys() <= known:
        raise InvalidValueError(
            f'invalid range {shown(given)} of {name}: expected {EXPECTED}, or a mapping with low, '
            'high and perhaps levels and logarithmic'
        )
    low, high = (
        quantity.check(
            f'{end} of {name}',
            parse_quantity(name, each, quantity.unit) if isinstance(each, str) else each,
        )
        for end, each in (('low', given['low']), ('high', given['high']))
    )
    levels, logarithmic = given.get('levels'), given.get('logarithmic', False)
    if type(logarithmic) is not bool:
        raise InvalidValueError(
            f'invalid range {shown(given)} of {name}: expected true or false for logarithmic'
        )
    return Factor(name, low, high, levels, logarithmic, quantity.unit, quantity.label)


def _range(name: str, text: str) -> dict[str, Any]:
    """Return the range in a text as a mapping."""
    words = [word.strip() for word in text.split(':')]
    found: dict[str, Any] = {'logarithmic': words[-1].lower() == 'log'}
    if found['logarithmic']:
        del words[-1]
    if len(words) == 3 and words[2].isdecimal() and len(words[2]) < DIGITS:
        found['levels'] = int(words.pop())
    if len(words) != 2 or '' in words:
        raise InvalidValueError(f'invalid range {shown(text)} of {name}: expected {EXPECTED}')
    return {'low': words[0], 'high': words[1], **found}


def check_factors(factors: Sequence[Factor], base: Setting, parts: Sequence[Part]) -> None:
    """Raise InvalidValueError if there is none, two vary the same, or a height is implausible."""
    names = [factor.name for factor in factors]
    if not names:
        raise InvalidValueError('missing factor: expected at least one, such as height=20mm:0.2')
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(f'invalid factors: expected {name} only once')
    heights = [factor.high for factor in factors if factor.name == 'height']
    for part in parts:
        check_height(part, max(heights, default=base.conditions.height))


def point_values(factors: Sequence[Factor], points: Array) -> list[dict[str, float]]:
    """Return the values of the factors at points (m, d) of the unit cube."""
    columns = [f.values(points[:, k]).tolist() for k, f in enumerate(factors)]
    names = [factor.name for factor in factors]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a design along one factor: only this factor varies in a line.

    points : (b, l) int
        Indices of the points of the design.
    levels, weights : (l,) float
        Values of the factor, 0 to 1, and their weights in an average over the factor.
    fixed : bool
        Whether the lines are all combinations of the levels of the other factors; otherwise they
        are a random sample of lines.
    """

    points: Indices
    levels: Array
    weights: Array
    fixed: bool


@dataclass(frozen=True, eq=False)
class Design:
    """Points (m, d) of the unit cube, and the lines along each of the d factors."""

    points: Array
    lines: tuple[Lines, ...]


def make_design(name: str, factors: Sequence[Factor], base_points: int, seed: int) -> Design:
    """Return a design, one of DESIGNS; raises InvalidValueError.

    A factorial design has no base points. With more base points, the first points are the same.
    """
    if name not in DESIGNS:
        raise InvalidValueError(
            f'invalid design {shown(name)}: expected one of {", ".join(DESIGNS)}'
        )
    if name == 'factorial':
        return factorial(factors)
    check_integer('number of points', base_points, 1, MAX_POINTS)
    return curves(factors, base_points, seed)


def curves(factors: Sequence[Factor], base_points: int, seed: int) -> Design:
    """Return the curves over each factor from base points of a scrambled Sobol sequence.

    These are individual conditional curves (Goldstein, Kapelner, Bleich and Pitkin 2015), in a
    radial design (Campolongo, Saltelli and Cariboni 2011, Computer Physics Communications
    182:978). The levels are the nodes of Gauss and Lobatto, which contain both ends of the range
    and with which averages over it are exact for polynomials up to degree 11; a factor with
    levels has these, with equal weights.
    """
    spans = [_levels(factor) for factor in factors]
    _check_count(base_points * sum(len(levels) for levels, _ in spans))
    base = on_levels(sobol(len(factors), base_points, seed), factors)
    axes = np.arange(len(factors))
    rows = [
        np.where(axes == k, levels[:, None], point)
        for point in base
        for k, (levels, _) in enumerate(spans)
    ]
    points, where = _unique(np.concatenate(rows))
    starts = np.cumsum([0, *map(len, rows)])
    each = [where[a:b] for a, b in itertools.pairwise(starts.tolist())]
    lines = []
    for k, (levels, weights) in enumerate(spans):
        # Base points with the same values of all other factors have the same line.
        _, first = np.unique(np.delete(base, k, axis=1), axis=0, return_index=True)
        own = np.array([each[b * len(factors) + k] for b in np.sort(first).tolist()])
        others = [factor.levels or 0 for j, factor in enumerate(factors) if j != k]
        complete = all(others) and len(own) == math.prod(others)
        lines.append(Lines(own, levels, weights, complete))
    return Design(points, tuple(lines))


def factorial(factors: Sequence[Factor]) -> Design:
    """Return all combinations of the levels; the last factor changes fastest."""
    counts = [factor.levels or FACTORIAL_LEVELS for factor in factors]
    _check_count(math.prod(counts))
    spans = [np.linspace(0, 1, n) for n in counts]
    points = np.array(list(itertools.product(*spans)))
    index = np.arange(len(points)).reshape(counts)
    lines = [
        Lines(np.moveaxis(index, k, -1).reshape(-1, n), spans[k], np.full(n, 1 / n), True)
        for k, n in enumerate(counts)
    ]
    return Design(points, tuple(lines))


def sobol(d: int, points: int, seed: int | Sequence[int]) -> Array:
    """Return the first points (points, d) of a scrambled Sobol sequence."""
    # The name of the argument depends on the version of SciPy.
    known = inspect.signature(qmc.Sobol.__init__).parameters
    random: dict[str, Any] = {'rng' if 'rng' in known else 'seed': np.random.default_rng(seed)}
    sequence = qmc.Sobol(d, scramble=True, **random)
    with warnings.catch_warnings():
        # A number that is no power of two is allowed: the sequence can be continued later.
        warnings.simplefilter('ignore', UserWarning)
        return np.asarray(sequence.random(points))


def on_levels(points: Array, factors: Sequence[Factor]) -> Array:
    """Return the points (..., d) with the nearest level of each factor that has levels."""
    found = points.copy()
    for k, factor in enumerate(factors):
        if factor.levels:
            # Each level has an equal share of the range.
            level = np.minimum(np.floor(points[..., k] * factor.levels), factor.levels - 1)
            found[..., k] = level / (factor.levels - 1)
    return found


def gauss_lobatto(count: int) -> tuple[Array, Array]:
    """Return nodes in [0, 1], with both ends, and weights of an average, exact to 2 count - 3."""
    last = np.eye(count)[-1]  # the Legendre polynomial of degree count - 1
    nodes = np.concatenate([[-1.0], np.sort(legendre.legroots(legendre.legder(last))), [1.0]])
    weights = 1 / (count * (count - 1) * legendre.legval(nodes, last) ** 2)
    return (nodes + 1) / 2, weights


def _levels(factor: Factor) -> tuple[Array, Array]:
    if not factor.levels:
        return gauss_lobatto(CURVE_LEVELS)
    return np.linspace(0, 1, factor.levels), np.full(factor.levels, 1 / factor.levels)


def _unique(points: Array) -> tuple[Array, Indices]:
    """Return the points without repetitions, in their order, and where each of them is."""
    _, first, where = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return points[first[order]], np.argsort(order)[where.ravel()]


def _check_count(points: int) -> None:
    if points > MAX_POINTS:
        raise InvalidValueError(
            f'invalid design of {points} points: expected at most {MAX_POINTS}'
        )

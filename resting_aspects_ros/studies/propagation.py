"""Carry the uncertainty of a calibrated surface through to the distribution of a part."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, StrictStr, create_model

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.api.inputs.json_document import parse_json
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.input_file import named, read_input
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.schema import Number, validated
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED, MAX_SEED
from resting_aspects_ros.simulation.surfaces import MIN_SAMPLES, Surfaces
from resting_aspects_ros.studies.action_points import check_action_point
from resting_aspects_ros.studies.calibration.result import CalibrationResult
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.point_plans import OTHER
from resting_aspects_ros.studies.point_runs import drop_points
from resting_aspects_ros.studies.propagated_result import PropagatedResult

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

SAMPLES = 32
DROPS = 10_000
MAX_BYTES = 1 << 24


_numbers: dict[str, Any] = dict.fromkeys(QUANTITIES, (Number, ...))
_height_of: Any = (Literal['LOWEST_POINT', 'CENTRE_OF_MASS'], ...)
_Draw: Any = dict[Literal[tuple(QUANTITIES)], Number]  # type: ignore[misc]
_Conditions: Any = create_model('Conditions', **_numbers, height_of=_height_of)
EXPECTED = {
    'conditions': 'a mapping with all conditions',
    'draws': 'a list of mappings of conditions to numbers',
}


class CalibrationFile(BaseModel):
    """What is read of the file calibration.json."""

    surface: StrictStr
    conditions: _Conditions
    draws: list[_Draw]


@dataclass(frozen=True)
class UncertainSurface:
    """Conditions, and equally probable values of those that are not known.

    draws : tuple of dict of str to float
        Values of the fitted conditions, drawn from the posterior of a calibration.
    """

    conditions: DropConditions
    draws: tuple[Mapping[str, float], ...]

    def samples(self, count: int, seed: int) -> list[DropConditions]:
        """Return conditions under ``count`` of the draws, chosen at random."""
        order = np.random.default_rng((seed, 7)).permutation(len(self.draws))[:count]
        return [self.conditions.changed(**self.draws[k]) for k in order.tolist()]


def uncertain_surface(
    given: CalibrationResult | Mapping[str, Any] | str | Path,
) -> UncertainSurface:
    """Return an uncertain surface: a named one, a calibration, its document or its file.

    Raises InvalidValueError if it has no samples of its conditions.
    """
    if isinstance(given, str) and given in shipped_surfaces().names():
        return named_surface(given, shipped_surfaces())
    label, document = 'calibration', given
    try:
        if isinstance(given, CalibrationResult):
            document = given.document()
        elif isinstance(given, str | Path):
            label = named('calibration', given)
            document = parse_json(Path(given), read_input(Path(given), MAX_BYTES, 'file'))
        checked = validated(CalibrationFile, document, expected=EXPECTED)
        values = dict(checked.conditions)
        values['height_of'] = HeightOf[values['height_of']]
        base = DropConditions(surface=checked.surface, **values)
        if len(checked.draws) < MIN_SAMPLES:
            raise InvalidValueError(
                f'invalid draws {shown(checked.draws)}: expected at least {MIN_SAMPLES}'
            )
        for each in checked.draws:
            base.changed(**each)
    except InvalidValueError as error:
        raise InvalidValueError(
            f'invalid {label}: {error}; expected the file calibration.json of `resting_aspects '
            f'calibrate COUNTS.yaml --out DIR`, with at least {MIN_SAMPLES} draws, or the name of '
            'a surface with an uncertainty'
        ) from None
    return UncertainSurface(base, tuple(checked.draws))


def named_surface(name: str, surfaces: Surfaces) -> UncertainSurface:
    """Return a surface with its samples; raises InvalidValueError."""
    conditions, draws = surfaces.get(name), surfaces.samples(name)
    if not draws:
        raise InvalidValueError(
            f'invalid surface {conditions.surface}: expected one with an uncertainty; '
            '`resting_aspects calibrate` writes such an entry of a surfaces file'
        )
    return UncertainSurface(conditions, draws)


def propagate(
    part: Part,
    surface: UncertainSurface | CalibrationResult | Mapping[str, Any] | str | Path,
    drops: int = DROPS,
    *,
    samples: int = SAMPLES,
    seed: int = DEFAULT_SEED,
    confidence: float = CONFIDENCE,
    workers: int | Workers | None = None,
    progress: Callable[[int], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> PropagatedResult:
    """Drop a part under conditions that are drawn from what a calibration leaves possible.

    Parameters
    ----------
    surface : UncertainSurface, CalibrationResult, mapping, str or Path
        Name of a surface with an uncertainty in config/surfaces.yaml; or a calibration, its
        document, or its file calibration.json.
    drops : int
        Number of drops at all samples together, rounded down to a multiple of ``samples``.
    samples : int
        Number of draws of the posterior, at least 8.

    Raises
    ------
    InvalidValueError
        The surface has no uncertainty, a value is out of bounds, or the part cannot be dropped
        under one of the samples.
    """
    if not isinstance(surface, UncertainSurface):
        surface = uncertain_surface(surface)
    if type(samples) is not int or not MIN_SAMPLES <= samples <= len(surface.draws):
        raise InvalidValueError(
            f'invalid samples {shown(samples)}: expected an integer from {MIN_SAMPLES} to '
            f'{len(surface.draws)}, the number of draws'
        )
    if type(drops) is not int or drops < 2 * samples:
        raise InvalidValueError(
            f'invalid drops {shown(drops)}: expected at least {2 * samples}, 2 for each sample'
        )
    points = surface.samples(samples, seed)
    each = drops // samples
    landscape = Landscape(part)
    aspects = find_aspects(part, landscape)
    for point in points:
        check_action_point(part, Setting(point), landscape, aspects)
    counts = np.zeros((samples, len(aspects)), dtype=np.int64)
    other = np.zeros((samples, len(OTHER)), dtype=np.int64)
    made = np.zeros(samples, dtype=np.int64)
    with given_workers(workers) as pool:
        # The drops of a point follow from its conditions: equal draws need different seeds.
        for repetition, rows in enumerate(_repetitions(points)):
            before = int(made.sum())
            found = drop_points(
                part,
                [points[k] for k in rows],
                each,
                (seed + repetition) % (MAX_SEED + 1),
                workers=pool,
                progress=lambda done, before=before: progress(before + done),  # type: ignore[misc]
                stopped=stopped,
                landscape=landscape,
            )
            counts[rows], other[rows], made[rows] = found.counts, found.other, found.drops
    complete = made == each
    return _result(part, aspects, surface, points, counts, other, complete, each, seed, confidence)


def _repetitions(points: list[DropConditions]) -> list[list[int]]:
    """Return the indices of the points, so that no list contains equal points."""
    found: list[list[int]] = []
    seen: dict[DropConditions, int] = {}
    for k, point in enumerate(points):
        number = seen.get(point, 0)
        seen[point] = number + 1
        if number == len(found):
            found.append([])
        found[number].append(k)
    return found


def _result(
    part: Part,
    aspects: AspectSet,
    surface: UncertainSurface,
    points: list[DropConditions],
    counts: Counts,
    other: Counts,
    complete: npt.NDArray[np.bool_],
    each: int,
    seed: int,
    confidence: float,
) -> PropagatedResult:
    """Return the result of the samples that have all of their drops."""
    kept = np.flatnonzero(complete).tolist()
    names = sorted({name for draw in surface.draws for name in draw})
    return PropagatedResult(
        part,
        aspects,
        dataclasses.replace(surface.conditions),
        tuple({name: getattr(points[k], name) for name in names} for k in kept),
        counts[kept],
        other[kept],
        each,
        seed,
        confidence,
        len(kept) == len(points),
    )

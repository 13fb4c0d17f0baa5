"""Read the JSON document of a distribution that `drop`, `request` or `classify` printed.

`drop` and `request` describe the run, too, so that their result is read back for a report.
"""

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from pydantic import (
    BaseModel,
    StrictBool,
    StrictInt,
    StrictStr,
    confloat,
    conint,
    create_model,
)

from resting_aspects_ros.api.counts import MAX_BYTES, CountedDrops, check_same_part, single_groups
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.runner import Convergence
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.aspect_set import PUBLISHED_FIELDS, Aspect, AspectSet, Sweep
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError, shown, warn
from resting_aspects_ros.input_files import (
    MAX_COUNTED,
    Count,
    Number,
    file_text,
    invalid_field,
    open_text,
    parse_json,
    validated,
)
from resting_aspects_ros.part.library import load_part
from resting_aspects_ros.part.part import Part, is_valid_name
from resting_aspects_ros.simulation.conditions import (
    MAX_SEED,
    QUANTITIES,
    DropConditions,
    HeightOf,
)
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import surroundings_from
from resting_aspects_ros.statistics.comparison import REST, DropCounts
from resting_aspects_ros.statistics.distribution import METHOD, Distribution
from resting_aspects_ros.statistics.model_range import ModelRange

if TYPE_CHECKING:
    Id: TypeAlias = int
    Seed: TypeAlias = int
    Numbering: TypeAlias = int
    Coordinate: TypeAlias = float
    Share: TypeAlias = float
else:
    Id = conint(strict=True, ge=1, le=MAX_COUNTED)
    Seed = conint(strict=True, ge=0, le=MAX_SEED)
    Numbering = Literal[ASPECT_NUMBERING]
    # Of a unit vector or a quaternion, which are rounded.
    Coordinate = confloat(strict=True, ge=-1.001, le=1.001) | conint(strict=True, ge=-1, le=1)
    Share = confloat(strict=True, ge=0, le=1) | conint(strict=True, ge=0, le=1)
Pair: TypeAlias = tuple[Number, Number]
Vector: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
_conditions: dict[str, Any] = dict.fromkeys(QUANTITIES, (Number, ...))
_conditions |= {'height_of': (Literal['LOWEST_POINT', 'CENTRE_OF_MASS'], ...)}
# A mapping, as in a YAML file; or its text, which is empty for the level plane.
_surroundings: Any = StrictStr | dict[str, Any]  # pydantic 1 would make {} of ''
_conditions |= {'surroundings': (_surroundings, '')}
# Bounds are checked by DropConditions.
Conditions: Any = create_model('Conditions', **_conditions, surface=(StrictStr, ...))


class CountedAspect(BaseModel):
    """The fields of an aspect that a comparison needs."""

    id: Id
    count: Count
    down_in_part: Vector
    rolls: StrictBool = False
    symmetry_class: Id | None = None


class ReportAspect(CountedAspect):
    """The fields of an aspect that a report needs."""

    symmetry_class: Id
    multiplicity: Id
    sweep: Literal['POINT', 'ARC', 'RING', 'DOME', 'SPHERE']
    axis: Vector
    orientation: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    com_height: Number
    min_barrier: Number | None
    neighbour: Count
    basin_share: Number
    merged: Number = 0.0  # documents of earlier versions do not have it
    support: list[Pair]
    model_lower: Share | None = None
    model_upper: Share | None = None


class RangedClass(BaseModel):
    """The model range of a symmetry class."""

    symmetry_class: Count
    model_lower: Share | None = None
    model_upper: Share | None = None


class CountsDocument(BaseModel):
    """Counts over aspects, as `classify` prints them."""

    schema_version: Literal[2]
    part: StrictStr
    part_sha256: StrictStr
    complete: StrictBool = True
    drops: Count
    unclassified: Count
    unsettled: Count
    failed: Count
    lost: Count = 0
    sliding: Count = 0
    aspects: Sequence[CountedAspect]


class HistoryRow(BaseModel):
    """Counts over aspects after the first drops of a run."""

    drops: Count
    counts: list[Count]


class RunDocument(CountsDocument):
    """The distribution of a run, as `drop` and `request` print it."""

    run_id: StrictStr
    conditions: Conditions
    seed: Seed
    first_drop: Seed
    drops_asked: Seed
    precision: Number
    engine: StrictStr
    engine_version: StrictStr
    suite_version: StrictStr
    time_step: Number
    started: Seed
    aspects: Sequence[ReportAspect]
    interval: Literal['wilson', 'simultaneous']
    confidence: Number
    energy_growth: Number
    aspect_numbering: Numbering
    mesh_file: StrictStr | None = None
    body: StrictInt | None = None
    unit: StrictStr | None = None
    history: list[HistoryRow] = []
    model_uncertain: tuple[StrictStr, ...] | None = None
    no_model_range: StrictStr | None = None
    classes: Sequence[RangedClass] = ()
    convergence: Convergence | None = None

    def description(self) -> RunDescription:
        """Return the run; raises InvalidValueError for invalid conditions."""
        conditions = dict(self.conditions)
        conditions['height_of'] = HeightOf[conditions['height_of']]
        surroundings = conditions.pop('surroundings')
        text = surroundings if isinstance(surroundings, str) else json.dumps(surroundings)
        conditions['surroundings'] = surroundings_from(text)
        values: dict[str, Any] = {
            each.name: getattr(self, each.name) for each in fields(RunDescription)
        }
        values |= {'conditions': DropConditions(**conditions), 'drops': self.drops_asked}
        return RunDescription(**values)


def read_document(path: Path, text: str) -> CountsDocument:
    """Return the checked document; raises InvalidValueError with file and field."""
    document = parse_json(path, text)
    method = document.get('method', METHOD)
    if method != METHOD:
        raise InvalidValueError(
            f'{file_text(path)} is of method {shown(method)}: expected a JSON document of drops'
        )
    model = RunDocument if 'run_id' in document else CountsDocument
    return validated(model, document, file_text(path))


def counts_of(path: Path, document: CountsDocument) -> CountedDrops:
    """Return the counts in a document; raises InvalidValueError for contradictions."""
    if document.part and not is_valid_name(document.part):
        raise invalid_field(
            path, 'part', document.part, 'a name of lower case letters, digits and _'
        )
    aspects = sorted(document.aspects, key=lambda each: each.id)
    ids = tuple(aspect.id for aspect in aspects)
    if len(set(ids)) < len(ids):
        raise invalid_field(path, 'ids', ids, 'each aspect once')
    counts = np.array([aspect.count for aspect in aspects], dtype=np.int64)
    down = [[math.nan] * 3 if aspect.rolls else aspect.down_in_part for aspect in aspects]
    classes = [aspect.symmetry_class for aspect in aspects]
    run, model = None, None
    if isinstance(document, RunDocument):
        try:
            run = document.description()
        except InvalidValueError as error:
            raise InvalidValueError(f'invalid conditions in {file_text(path)}: {error}') from None
        model = _model(path, document)
    given = CountedDrops(
        str(path),
        single_groups(ids),
        DropCounts(counts, *(getattr(document, name) for name in REST)),
        down=np.array(down, dtype=np.float64).reshape(-1, 3),
        part=document.part,
        part_sha256=document.part_sha256,
        run=run,
        complete=document.complete,
        classes=tuple(each for each in classes if each) if None not in classes else None,
        model=model,
    )
    if document.drops != given.drops:
        raise invalid_field(path, 'drops', document.drops, f'{given.drops}, the sum of all counts')
    return given


def document_result(
    path: Path,
    part_text: str | None,
    unit: str | None,
    parts: Path | None,
    body: int | str | None,
) -> DropResult:
    """Read a result; the part is ``part_text``, else that of the document if it is found.

    Raises InvalidValueError with file, field, value and what was expected.
    """
    with open_text(path, 'result file', MAX_BYTES) as file:
        document = read_document(path, file.read())
    given = counts_of(path, document)
    if given.run is None or not isinstance(document, RunDocument):
        raise InvalidValueError(
            f'{str(path)!r} has no run: expected a log (the folder of a run, or its '
            '.mcap file), or a JSON document of drop or request'
        )
    part = _part(path, document, part_text, unit, parts, body)
    ordered = sorted(document.aspects, key=lambda each: each.id)
    _check_aspects(path, ordered)
    aspects = AspectSet(given.part_sha256, tuple(map(_aspect, ordered)))
    if part is not None:
        found = find_aspects(part)
        aspects = found if found.matches(aspects) else aspects
    try:
        distribution = Distribution(
            aspects,
            given.tally.counts,
            given.tally.unclassified,
            given.tally.unsettled,
            given.tally.failed,
            document.interval,
            document.confidence,
            document.precision > 0,
            document.energy_growth,
            model=given.model,
        )
        distribution.intervals()
        history = _history(document, distribution)
    except ValueError as error:
        raise InvalidValueError(f'{str(path)!r}: {error}') from None
    return DropResult(
        distribution,
        given.run,
        part,
        given.complete,
        document.convergence,
        history=history,
        no_model_range=document.no_model_range or '',
    )


def _model(path: Path, document: RunDocument) -> ModelRange | None:
    """Return the model ranges of a document; raises InvalidValueError if some are missing."""
    if document.model_uncertain is None:
        return None
    aspects = sorted(document.aspects, key=lambda each: each.id)
    tables = [
        np.array([(each.model_lower, each.model_upper) for each in rows], dtype=np.float64)
        for rows in (aspects, sorted(document.classes, key=lambda each: each.symmetry_class))
    ]
    by_aspect, by_class = (each.reshape(-1, 2) for each in tables)
    of_class = Counter[int]()
    for each in aspects:
        of_class[each.symmetry_class] += each.count
    numbers = sorted(each.symmetry_class for each in document.classes)
    low, high = np.concatenate([by_aspect, by_class]).T
    counts = [each.count for each in aspects] + [of_class[k] for k in numbers]
    shares = np.array(counts) / max(document.drops, 1)
    known = {*numbers} == {*of_class} and len(numbers) == len(of_class)
    if not known or not ((low <= shares) & (shares <= high)).all():
        raise InvalidValueError(
            f'{str(path)!r}: invalid model range: expected bounds of each aspect and class'
        )
    uncertain = document.model_uncertain
    if unknown := set(uncertain) - set(QUANTITIES):
        raise invalid_field(path, 'model_uncertain', min(unknown), 'conditions')
    return ModelRange(by_aspect, by_class, uncertain, document.confidence)


def _part(
    path: Path,
    document: RunDocument,
    text: str | None,
    unit: str | None,
    parts: Path | None,
    body: int | str | None,
) -> Part | None:
    """Return the part of the document; raises RestingAspectsError if ``text`` is another part."""
    if text is not None:
        part = load_part(text, unit, parts, body)
        check_same_part(
            (f'--part {text!r}', part.name, part.part_sha256),
            (repr(str(path)), document.part, document.part_sha256),
        )
        return part
    try:
        if document.mesh_file is None:
            part = load_part(document.part, unit, parts, body)
        else:
            unit, body = unit or document.unit, body or document.body
            part = load_part(document.mesh_file, unit, None, body)
    except RestingAspectsError as error:
        why = str(error)
    else:
        if part.part_sha256 == document.part_sha256:
            return part
        why = f'{part.name!r} has changed since it was dropped'
    warn(f'the report has no pictures: {why}; name the part with --part')
    return None


def _check_aspects(path: Path, aspects: Sequence[ReportAspect]) -> None:
    """Raise InvalidValueError for aspects that a report cannot show."""
    ids = {each.id for each in aspects}
    for each in aspects:
        x, y = np.array(each.support, dtype=np.float64).reshape(-1, 2).T
        with np.errstate(over='ignore', invalid='ignore'):
            area = abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
        if each.sweep == 'POINT' and not 0 < area < math.inf:
            raise InvalidValueError(
                f'invalid support of aspect {each.id} in {str(path)!r}: expected a polygon'
            )
        if each.neighbour and each.neighbour not in ids:
            raise InvalidValueError(
                f'invalid neighbour {each.neighbour} of aspect {each.id} in {str(path)!r}: '
                'expected an aspect'
            )


def _aspect(given: ReportAspect) -> Aspect:
    fields = {name: _with_arrays(getattr(given, name)) for name in PUBLISHED_FIELDS}
    if given.min_barrier is None:
        fields['min_barrier'] = math.inf
    fields['sweep'] = Sweep[given.sweep]
    fields['support'] = fields['support'].reshape(-1, 2)
    down = fields['down_in_part']
    return Aspect(**fields, directions=down[None], links=np.zeros((0, 2), dtype=np.int64))


def _with_arrays(value: Any) -> Any:
    return np.array(value, dtype=np.float64) if isinstance(value, list | tuple) else value


def _history(document: RunDocument, distribution: Distribution) -> tuple[Counts, Counts] | None:
    """Return counts after ascending numbers of drops; raises ValueError if they are invalid."""
    rows = document.history
    if not rows:
        return None
    drops = np.array([row.drops for row in rows], dtype=np.int64)
    if any(len(row.counts) != len(distribution.aspects) for row in rows):
        raise ValueError('invalid history: expected a count of each aspect in each row')
    counts = np.array([row.counts for row in rows], dtype=np.int64).reshape(len(rows), -1)
    if not (np.diff(drops, prepend=0) > 0).all() or (counts.sum(axis=1) > drops).any():
        raise ValueError(
            'invalid history: expected ascending drops, each at least the sum of its counts'
        )
    if drops[-1] != distribution.drops or (counts[-1] != distribution.counts).any():
        raise ValueError('invalid history: expected the counts of the document in its last row')
    return drops, counts

"""Read the JSON document of a distribution that `drop` or `request` printed."""

import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from pydantic import BaseModel, StrictBool, StrictInt, StrictStr, conint, create_model

from resting_aspects_ros.api.counts import MAX_BYTES, CountedDrops, check_same_part, single_groups
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.runner import Convergence
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError, located, shown
from resting_aspects_ros.input_files import (
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
from resting_aspects_ros.statistics.comparison import DropCounts
from resting_aspects_ros.statistics.distribution import METHOD, Distribution
from resting_aspects_ros.statistics.model_range import ModelRange

if TYPE_CHECKING:
    Seed: TypeAlias = int
    Numbering: TypeAlias = int
    Condition: TypeAlias = str
else:
    Condition = Literal[tuple(QUANTITIES)]
    Seed = conint(strict=True, ge=0, le=MAX_SEED)
    Numbering = Literal[ASPECT_NUMBERING]
_conditions: dict[str, Any] = dict.fromkeys(QUANTITIES, (Number, ...))
_conditions |= {'height_of': (Literal['LOWEST_POINT', 'CENTRE_OF_MASS'], ...)}
# A mapping, as in a YAML file; or its text, which is empty for the level plane.
_surroundings: Any = StrictStr | dict[str, Any]  # pydantic 1 would make {} of ''
_conditions |= {'surroundings': (_surroundings, '')}
# Bounds are checked by DropConditions.
Conditions: Any = create_model('Conditions', **_conditions, surface=(StrictStr, ...))


class RangedShare(BaseModel):
    """The count of an aspect or a class, with the model range of its share."""

    count: Count
    model_lower: Number | None = None
    model_upper: Number | None = None


class CountedAspect(RangedShare):
    """An aspect; everything else about it follows from the part."""

    id: Count
    symmetry_class: Count


class CountedClass(RangedShare):
    """A symmetry class."""

    symmetry_class: Count


class HistoryRow(BaseModel):
    """Counts over aspects after the first drops of a run."""

    drops: Count
    counts: list[Count]


class RunDocument(BaseModel):
    """The distribution of a run."""

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
    interval: Literal['wilson', 'simultaneous']
    confidence: Number
    energy_growth: Number
    aspect_numbering: Numbering
    mesh_file: StrictStr | None = None
    body: StrictInt | None = None
    unit: StrictStr | None = None
    history: list[HistoryRow] = []
    model_uncertain: tuple[Condition, ...] | None = None
    no_model_range: StrictStr | None = None
    classes: Sequence[CountedClass] = ()
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


def read_document(path: Path, text: str) -> RunDocument:
    """Return the checked document; raises InvalidValueError with file and field."""
    document = parse_json(path, text)
    method = document.get('method', METHOD)
    if method != METHOD:
        raise InvalidValueError(
            f'{file_text(path)} is of method {shown(method)}: expected a JSON document of drops'
        )
    return validated(RunDocument, document, file_text(path))


def counts_of(path: Path, document: RunDocument) -> CountedDrops:
    """Return the counts in a document; raises InvalidValueError for contradictions."""
    if not is_valid_name(document.part):
        raise invalid_field(
            path, 'part', document.part, 'a name of lower case letters, digits and _'
        )
    aspects = sorted(document.aspects, key=lambda each: each.id)
    ids = tuple(aspect.id for aspect in aspects)
    if len(set(ids)) < len(ids):
        raise invalid_field(path, 'ids', ids, 'each aspect once')
    counts = np.array([aspect.count for aspect in aspects], dtype=np.int64)
    with located(f'invalid conditions in {file_text(path)}'):
        run = document.description()
    given = CountedDrops(
        str(path),
        single_groups(ids),
        DropCounts(
            counts,
            document.unclassified,
            document.unsettled + document.lost + document.sliding,
            document.failed,
        ),
        run=run,
        complete=document.complete,
        classes=tuple(aspect.symmetry_class for aspect in aspects),
        model=_model(path, document, aspects),
    )
    if document.drops != given.drops:
        raise invalid_field(path, 'drops', document.drops, f'{given.drops}, the sum of all counts')
    return given


def _model(
    path: Path, document: RunDocument, aspects: Sequence[CountedAspect]
) -> ModelRange | None:
    """Return the model ranges of a document; raises InvalidValueError if some are missing."""
    if document.model_uncertain is None:
        return None
    classes = sorted(document.classes, key=lambda each: each.symmetry_class)
    known = [each.symmetry_class for each in classes]
    rows: list[RangedShare] = [*aspects, *classes]
    shares = np.array([each.count for each in rows]) / max(document.drops, 1)
    bounds = np.array([(each.model_lower, each.model_upper) for each in rows], dtype=np.float64)
    low, high = bounds.reshape(-1, 2).T
    complete = known == sorted({each.symmetry_class for each in aspects})
    if not complete or not ((low <= shares) & (shares <= high)).all():
        raise InvalidValueError(
            f'{str(path)!r}: invalid model range: expected bounds of each aspect and class'
        )
    return ModelRange(
        bounds[: len(aspects)],
        bounds[len(aspects) :],
        document.model_uncertain,
        document.confidence,
    )


def document_result(
    path: Path,
    part_text: str | None,
    unit: str | None,
    parts: Path | None,
    body: int | str | None,
) -> DropResult:
    """Read a result; the part is ``part_text``, else that of the document.

    Raises InvalidValueError with file, field, value and what was expected, or if the part is not
    found.
    """
    with open_text(path, 'result file', MAX_BYTES) as file:
        document = read_document(path, file.read())
    given = counts_of(path, document)
    part = _part(path, document, part_text, unit, parts, body)
    aspects = find_aspects(part)
    if given.ids != tuple(each.id for each in aspects):
        raise invalid_field(path, 'ids', given.ids, f'the {len(aspects)} aspects of {part.name}')
    with located(repr(str(path))):
        distribution = Distribution(
            aspects,
            given.tally.counts,
            document.unclassified,
            document.unsettled,
            document.failed,
            document.interval,
            document.confidence,
            document.precision > 0,
            document.energy_growth,
            document.lost,
            document.sliding,
            model=given.model,
        )
        distribution.intervals()
    return DropResult(
        distribution,
        document.description(),
        part,
        given.complete,
        document.convergence,
        history=_history(path, document, distribution.counts),
        no_model_range=document.no_model_range or '',
    )


def _part(
    path: Path,
    document: RunDocument,
    text: str | None,
    unit: str | None,
    parts: Path | None,
    body: int | str | None,
) -> Part:
    """Return the part of the document; raises InvalidValueError if it is not found."""
    if text is None and document.mesh_file is not None:
        text, parts = document.mesh_file, None
        unit, body = unit or document.unit, body or document.body
    name = document.part if text is None else text
    try:
        part = load_part(name, unit, parts, body)
    except RestingAspectsError as error:
        raise InvalidValueError(
            f'the part of {file_text(path)} is not found: {error}; name it with --part'
        ) from None
    check_same_part(
        (f'part {name!r}', part.name, part.part_sha256),
        (repr(str(path)), document.part, document.part_sha256),
    )
    return part


def _history(path: Path, document: RunDocument, last: Counts) -> tuple[Counts, Counts] | None:
    """Return counts after ascending numbers of drops, which end with ``last``."""
    rows = [row.counts for row in document.history]
    if not rows:
        return None
    if any(len(row) != len(last) for row in rows) or rows[-1] != last.tolist():
        raise invalid_field(
            path, 'history', rows[-1], 'counts of each aspect, the last row those of the document'
        )
    drops = np.array([row.drops for row in document.history], dtype=np.int64)
    return drops, np.array(rows, dtype=np.int64)

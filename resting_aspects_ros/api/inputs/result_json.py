"""Read the JSON document of a distribution that `drop`, `request` or `classify` printed."""

import json
import math
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

from resting_aspects_ros.api.convergence import Convergence
from resting_aspects_ros.api.inputs.counts import CountedDrops
from resting_aspects_ros.api.inputs.json_document import (
    file_text,
    invalid_field,
    parse_json,
)
from resting_aspects_ros.core.aspects.aspect import ASPECT_NUMBERING
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.part import is_valid_name
from resting_aspects_ros.core.schema import MAX_COUNTED, Count, Number, validated
from resting_aspects_ros.core.statistics.comparison import REST, DropCounts
from resting_aspects_ros.core.statistics.distribution import METHOD
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.simulation.run_description import MAX_SEED, RunDescription
from resting_aspects_ros.simulation.surroundings.library import key_of_document

if TYPE_CHECKING:
    Id: TypeAlias = int
    Seed: TypeAlias = int
    Numbering: TypeAlias = int
    Coordinate: TypeAlias = float
else:
    Id = conint(strict=True, ge=1, le=MAX_COUNTED)
    Seed = conint(strict=True, ge=0, le=MAX_SEED)
    Numbering = Literal[ASPECT_NUMBERING]
    # Of a unit vector or a quaternion, which are rounded.
    Coordinate = confloat(strict=True, ge=-1.001, le=1.001) | conint(strict=True, ge=-1, le=1)
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
    convergence: Convergence | None = None

    def description(self) -> RunDescription:
        """Return the run; raises InvalidValueError for invalid conditions."""
        conditions = dict(self.conditions)
        conditions['height_of'] = HeightOf[conditions['height_of']]
        surroundings = conditions.pop('surroundings')
        text = surroundings if isinstance(surroundings, str) else json.dumps(surroundings)
        conditions['surroundings'] = key_of_document(text)
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
    try:
        run = document.description() if isinstance(document, RunDocument) else None
    except InvalidValueError as error:
        raise InvalidValueError(f'invalid conditions in {file_text(path)}: {error}') from None
    given = CountedDrops(
        str(path),
        ids,
        DropCounts(counts, *(getattr(document, name) for name in REST)),
        np.array(down, dtype=np.float64).reshape(-1, 3),
        document.part,
        document.part_sha256,
        run,
        document.complete,
        tuple(each for each in classes if each is not None) if None not in classes else None,
    )
    if document.drops != given.drops:
        raise invalid_field(path, 'drops', document.drops, f'{given.drops}, the sum of all counts')
    return given

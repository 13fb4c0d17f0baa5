"""The JSON document of a distribution, as `drop` and `request` print it, read back."""

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.commands.given_counts import MOST_COUNTED, GivenCounts
from resting_aspects_ros.core.comparison import REST, Tally
from resting_aspects_ros.core.distribution import METHOD
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import is_valid_name
from resting_aspects_ros.drops.conditions import DropConditions, HeightOf
from resting_aspects_ros.drops.run import MOST_SEED, RunDescription
from resting_aspects_ros.report.document import SCHEMA_VERSION

# ns since the epoch: the year 2262.
MOST_TIME = 2**63 - 1


def read_document(path: Path, text: str) -> GivenCounts:
    """Read it; raises InvalidValueError with file, field, value and what is allowed."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidValueError(f'{str(path)!r} is no JSON: {error}') from None
    fields = _Fields(path, document)
    fields.whole('schema_version', low=SCHEMA_VERSION, high=SCHEMA_VERSION)
    if 'runs' in document or document.get('method', METHOD) != METHOD:
        kind = 'several runs, by merge' if 'runs' in document else f'method {document["method"]!r}'
        raise InvalidValueError(
            f'{str(path)!r} is of {kind}, allowed is a JSON document of one run of drops'
        )
    aspects = sorted(fields.aspects(), key=lambda aspect: aspect.whole('id', low=1))
    ids = tuple(aspect.whole('id', low=1) for aspect in aspects)
    if len(set(ids)) < len(ids):
        raise InvalidValueError(f'{str(path)!r}: ids are {ids}, allowed is each aspect once')
    counts = np.array([aspect.whole('count') for aspect in aspects], dtype=np.int64)
    given = GivenCounts(
        path,
        ids,
        Tally(counts, *(fields.whole(name) for name in REST)),
        np.array([aspect.down() for aspect in aspects]).reshape(-1, 3),
        _part(fields),
        fields.text('part_sha256'),
        _run(fields),
        # A document that does not say was made of all that there was.
        document.get('complete') is not False,
        tuple(aspect.whole('symmetry_class', low=1) for aspect in aspects)
        if all('symmetry_class' in aspect.values for aspect in aspects)
        else None,
    )
    if fields.whole('drops') != given.drops:
        raise InvalidValueError(
            f'{str(path)!r}: drops is {document["drops"]}, allowed is {given.drops}, the sum of '
            'all counts'
        )
    return given


def _part(fields: '_Fields') -> str:
    name = fields.text('part')
    if name and not is_valid_name(name):
        raise fields.wrong('part', name, 'a name of lower case letters, digits and _')
    return name


def _run(fields: '_Fields') -> RunDescription | None:
    """The run, if the document is of one: `classify` writes documents too."""
    document = fields.values
    if 'run_id' not in document:
        return None
    values: dict[str, Any] = {
        'seed': fields.whole('seed', high=MOST_SEED),
        'first_drop': fields.whole('first_drop', high=MOST_SEED),
        'drops': fields.whole('drops_asked', high=MOST_SEED),
        'started': fields.whole('started', high=MOST_TIME),
    }
    try:
        conditions = dict(document['conditions'])
        height_of = HeightOf[conditions.pop('height_of')]
        values['conditions'] = DropConditions(**conditions, height_of=height_of)
        names = [field.name for field in dataclasses.fields(RunDescription)]
        return RunDescription(**{name: document[name] for name in names} | values)
    except (KeyError, TypeError, ValueError, InvalidValueError) as error:
        raise InvalidValueError(
            f'{str(fields.path)!r} describes its run otherwise than this version writes it: '
            f'{type(error).__name__}, {error}'
        ) from None


@dataclasses.dataclass(frozen=True)
class _Fields:
    """Checked access to the fields of an object in the document."""

    path: Path
    values: Any
    where: str = ''

    def __post_init__(self) -> None:
        if not isinstance(self.values, Mapping):
            of = '' if self.where else 'the document'
            raise self.wrong(of, self.values, 'an object')

    def wrong(self, name: str, value: object, allowed: str) -> InvalidValueError:
        shown = f'is {value!r:.100}' if value is not None else 'is missing'
        return InvalidValueError(
            f'{str(self.path)!r}: {(self.where + name).rstrip(".")} {shown}, allowed is {allowed}'
        )

    def whole(self, name: str, low: int = 0, high: int = MOST_COUNTED) -> int:
        value = self.values.get(name)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise self.wrong(name, value, f'{low} to {high}' if low < high else f'{low}')
        return value

    def text(self, name: str) -> str:
        value = self.values.get(name)
        if not isinstance(value, str):
            raise self.wrong(name, value, 'a text')
        return value

    def down(self) -> list[float]:
        """Of an aspect; NaN where the part rolls."""
        value = self.values.get('down_in_part')
        numbers = isinstance(value, list) and all(isinstance(x, int | float) for x in value)
        if not numbers or len(value) != 3:
            raise self.wrong('down_in_part', value, 'three numbers')
        return [math.nan] * 3 if self.values.get('rolls') is True else [float(x) for x in value]

    def aspects(self) -> list['_Fields']:
        value = self.values.get('aspects')
        if not isinstance(value, list):
            raise self.wrong('aspects', value, 'a list, as drop and request print it')
        return [_Fields(self.path, each, f'aspects[{k}].') for k, each in enumerate(value)]

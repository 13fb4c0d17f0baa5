"""Read JSON documents with the models of pydantic, which are their schema.

Only features that pydantic 1.10, in Ubuntu 24.04, and 2 have in common are used.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from resting_aspects_ros.core.errors import InvalidValueError, one_line, shown
from resting_aspects_ros.core.input_file import MAX_PATH

Model = TypeVar('Model', bound=BaseModel)


def parse_json(path: Path, text: str) -> dict[str, Any]:
    """Return the JSON object in a text; raises InvalidValueError with the file."""
    try:
        document = json.loads(
            text,
            object_pairs_hook=_unique,
            parse_constant=_finite,
            parse_float=_finite,
            parse_int=_integer,
        )
    except (ValueError, RecursionError) as error:
        raise InvalidValueError(f'{file_text(path)} is not JSON: {one_line(str(error))}') from None
    if not isinstance(document, dict):
        raise invalid_field(path, 'document', document, 'a JSON object')
    return document


def validated(path: Path, document: Mapping[str, Any], model: type[Model]) -> Model:
    """Return the checked document; raises InvalidValueError with file, field and value."""
    try:
        return model(**document)
    except ValidationError as error:
        raise _refusal(path, document, error.errors()[0]) from None


def invalid_field(path: Path, name: str, value: object, expected: str) -> InvalidValueError:
    """Return the error for a field, such as 'aspects[0].count'."""
    return InvalidValueError(
        f'invalid {name} {shown(value)} in {file_text(path)}: expected {expected}'
    )


def file_text(path: Path) -> str:
    """Return the path as text for messages."""
    return shown(str(path), MAX_PATH)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in found if names.count(name) > 1)
        raise ValueError(f'the key {shown(twice)} occurs twice in an object')
    return found


def _finite(text: str) -> float:
    if math.isfinite(number := float(text)):
        return number
    raise ValueError(f'{text} is not a finite number')


def _integer(text: str) -> int:
    _finite(text)  # the number may be converted to a float
    return int(text)


def _refusal(path: Path, document: Any, error: Any) -> InvalidValueError:
    """Return the first error of pydantic with the value, which version 1 does not report."""
    name, value = '', document
    for step in error['loc']:
        place = f'[{step}]' if isinstance(step, int) else f'.{step}'
        try:
            value = value[step]
        except (KeyError, IndexError, TypeError):
            if 'missing' in error['type']:
                return InvalidValueError(f'{file_text(path)} has no {(name + place).lstrip(".")}')
            break  # a branch of a union
        name += place
    expected = error['msg']
    for start in ('Input should be ', 'ensure this value is ', 'value is not '):
        expected = expected.removeprefix(start)
    return invalid_field(path, name.lstrip('.'), value, expected)

"""Read JSON documents, whose schema are models of pydantic; see core.schema."""

import json
import math
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.errors import MAX_SHOWN, InvalidValueError, one_line, shown
from resting_aspects_ros.core.input_file import MAX_PATH


def parse_json(path: Path, text: str | bytes) -> dict[str, Any]:
    """Return the JSON object in a text, UTF-8 if it is bytes; raises InvalidValueError."""
    try:
        document = json.loads(
            text.decode('utf-8-sig') if isinstance(text, bytes) else text,
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
    raise ValueError(f'{one_line(text, MAX_SHOWN)} is not a finite number')


def _integer(text: str) -> int:
    _finite(text)  # the number may be converted to a float
    return int(text)

"""Check documents of YAML and JSON files with models of pydantic, which are their schema.

Only features that pydantic 1.10, in Ubuntu 24.04, and 2 have in common are used.
"""

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from pydantic import BaseModel, ValidationError, confloat, conint, constr

from resting_aspects_ros.core.errors import (
    InvalidValueError,
    RestingAspectsError,
    did_you_mean,
    shown,
)

Model = TypeVar('Model', bound=BaseModel)
# More than MAX_DROPS of a run, and less than the 1e9 that numpy accepts for random tables.
MAX_COUNTED = 100_000_000

if TYPE_CHECKING:
    Number: TypeAlias = float
    Positive: TypeAlias = float
    FromOne: TypeAlias = int
    Named: TypeAlias = str
    Count: TypeAlias = int
else:
    # Finite numbers; an integer can be converted to a float.
    _LARGEST = int(sys.float_info.max)
    Number = confloat(strict=True, allow_inf_nan=False) | conint(
        strict=True, ge=-_LARGEST, le=_LARGEST
    )
    Positive = confloat(strict=True, gt=0, allow_inf_nan=False) | conint(
        strict=True, gt=0, le=_LARGEST
    )
    FromOne = conint(strict=True, ge=1)
    Named = constr(strict=True, min_length=1)
    Count = conint(strict=True, ge=0, le=MAX_COUNTED)


class FileModel(BaseModel, extra='forbid'):
    """Base of the models of files in which an unknown key is an error."""


def validated(
    model: type[Model],
    document: Any,
    label: str = '',
    expected: Mapping[str, str] | None = None,
    error: type[RestingAspectsError] = InvalidValueError,
) -> Model:
    """Return a document as an instance of a model.

    Parameters
    ----------
    model : type
        A model of pydantic.
    document : mapping
    label : str
        The file, or the entry in it, for messages; empty if the caller adds it.
    expected : mapping of str to str, optional
        What is expected of a field, by its name, instead of the description by pydantic.
    error : type
        Exception class; raised with a single line that names the label, the first invalid field,
        its value and what was expected.
    """
    where = f' in {label}' if label else ''
    fields: Any = getattr(model, 'model_fields', None) or model.__fields__
    names = list(fields)
    if not isinstance(document, Mapping):
        raise error(
            f'invalid content {shown(document)}{where}: expected a mapping with the keys '
            f'{", ".join(names)}, not a {type(document).__name__}'
        )
    keys = {key if isinstance(key, str) else shown(key): key for key in document}
    try:
        return model(**{name: document[key] for name, key in keys.items()})
    except ValidationError as found:
        # A misspelt key comes before the key that is missing instead.
        first = min(found.errors(), key=lambda e: len(e['loc']) > 1 or 'extra' not in e['type'])
    name = str(first['loc'][0])
    if len(first['loc']) == 1 and 'extra' in first['type']:
        raise error(
            f'invalid key {shown(keys[name])}{where}: expected one of {", ".join(names)}'
            f'{did_you_mean(name, names)}'
        )
    raise error(_refusal(document, label, where, expected or {}, first))


def _refusal(
    document: Any, label: str, where: str, expected: Mapping[str, str], first: Any
) -> str:
    """Return the message for an error of pydantic, with the value, which version 1 does not have.

    A missing or surplus item of a field in ``expected`` is an error of that field.
    """
    name, value = '', document
    text = first['msg']
    for start in ('Input should be ', 'ensure this value is ', 'value is not '):
        text = text.removeprefix(start)
    for step in first['loc']:
        place = f'[{step}]' if isinstance(step, int) else f'.{step}'
        try:
            value = value[step]
        except (KeyError, IndexError, TypeError):
            if 'missing' in first['type']:
                missing = (name + place).lstrip('.')
                return f'{label} has no {missing}' if label else f'missing {missing}'
            break  # a branch of a union
        name += place
        if step in expected:
            text = expected[step]
            break
    return f'invalid {name.lstrip(".")} {shown(value)}{where}: expected {text}'

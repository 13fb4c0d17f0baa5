"""Input files: regular files of limited size; YAML, JSON and CSV; schemas; numbers with a unit."""

import csv
import io
import json
import math
import os
import re
import stat
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, TypeAlias, TypeVar

import yaml
from pydantic import BaseModel, ValidationError, confloat, conint, constr

from resting_aspects_ros.errors import (
    MAX_PATH,
    InvalidValueError,
    RestingAspectsError,
    did_you_mean,
    one_line,
    shown,
)


def read_input(
    path: Path,
    max_bytes: int,
    what: str,
    error: type[RestingAspectsError] = InvalidValueError,
) -> bytes:
    """Return the content of a regular file of at most ``max_bytes``.

    The type is checked before the file is opened, because opening a pipe blocks until a writer
    appears and reading a device may never end. Raises ``error`` with a single line that names
    ``what`` the file is, such as 'mesh', and its path, if it does not exist, is no regular file,
    is too large, or cannot be read.
    """
    label = named(what, path)
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):
            kind = 'a folder' if stat.S_ISDIR(mode) else 'a pipe, a device or a socket'
            raise error(f'{label} is {kind}: expected a regular file')
        with path.open('rb') as file:
            data = file.read(max_bytes + 1)
    except FileNotFoundError:
        raise error(f'{label} does not exist') from None
    except (OSError, ValueError) as cause:  # ValueError: a path with a null byte
        reason = getattr(cause, 'strerror', None) or one_line(str(cause))
        raise error(f'{label} cannot be read: {reason}') from None
    if len(data) > max_bytes:
        size = f'{max_bytes >> 20} MiB' if max_bytes >= 1 << 20 else f'{max_bytes >> 10} KiB'
        raise error(f'{label} is too large: expected at most {size}')
    return data


def is_file(path: Path) -> bool:
    """Return whether a path is a file; False also for a link to a name that is too long."""
    return os.path.isfile(path)  # noqa: PTH113 it does not raise


def is_folder(path: Path) -> bool:
    """Return whether a path is a folder; see is_file."""
    return os.path.isdir(path)  # noqa: PTH112 it does not raise


def named(what: str, path: str | Path) -> str:
    """Return the name of a file in error messages: its kind and its path."""
    return f'{what} {shown(str(path), MAX_PATH)}'


def printable(name: str) -> str:
    r"""Return a file name as valid UTF-8; on Linux it can be any bytes: '\udcff' for byte 255."""
    return name.encode('utf-8', 'backslashreplace').decode('utf-8')


# -- YAML -----------------------------------------------------------------------------------------


MAX_BYTES = 1 << 16  # a part description has less than 1000 bytes, the surfaces less than 10000
_INT, _FLOAT = 'tag:yaml.org,2002:int', 'tag:yaml.org,2002:float'


class _Loader(yaml.SafeLoader):
    """Refuses aliases, which can expand to more values than fit into any memory, and double keys.

    It reads numbers as YAML 1.2 does: in YAML 1.1, 1e-6 is text, and the range 5:50 is 350.
    """

    yaml_implicit_resolvers = {  # noqa: RUF012 as in its base
        first: [(tag, pattern) for tag, pattern in pairs if tag not in (_INT, _FLOAT)]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise ValueError('it has an alias (*), which is not supported')
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                line = key.start_mark.line + 1
                raise ValueError(f'the key {shown(key.value)} occurs twice, again in line {line}')
            seen.add(key.value)
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    """Writes an object that is used twice again, not as an alias, and numbers in lines."""

    def ignore_aliases(self, _: object) -> bool:
        return True

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> Any:
        numbers = all(isinstance(each, int | float) for each in sequence)
        return super().represent_sequence(tag, sequence, flow_style or numbers)


# Text such as 12e34 is written with quotation marks, because the loader would read a number.
for _side in (_Loader, _Dumper):
    _side.add_implicit_resolver(
        _INT, re.compile(r'[-+]?(?:0|[1-9][0-9_]*|0x[0-9a-fA-F]+)$'), list('-+0123456789')
    )
    _side.add_implicit_resolver(
        _FLOAT,
        re.compile(
            r'(?:[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?'
            r'|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$'
        ),
        list('-+.0123456789'),
    )


def yaml_text(document: object) -> str:
    """Return plain data as YAML in block style, with keys in their order.

    The text is ASCII with escapes, because rosbags reads metadata.yaml in the encoding of the
    reader's locale. Text that readers of YAML 1.1 or 1.2 would take for a number is quoted.
    """
    return str(yaml.dump(document, Dumper=_Dumper, sort_keys=False, default_flow_style=False))


def read_yaml(
    path: Path,
    what: str,
    max_bytes: int = MAX_BYTES,
    error: type[RestingAspectsError] = InvalidValueError,
) -> Any:
    """Return the document in a YAML file as plain Python types; None if it is empty.

    Raises ``error`` with a single line that names the file if it is not a readable regular file of
    at most ``max_bytes``, or not valid YAML; see parse_yaml.
    """
    data = read_input(path, max_bytes, what, error)
    return parse_yaml(data, named(what, path), error, max_bytes)


def parse_yaml(
    data: bytes | str,
    label: str,
    error: type[RestingAspectsError] = InvalidValueError,
    max_length: int = MAX_BYTES,
) -> Any:
    """Return the document in YAML text as plain Python types; None if it is empty.

    Raises ``error``, with a single line that begins with the label, if the text is not valid YAML
    or too long (it would take minutes to read), a value does not fit its tag, a key occurs twice
    in a mapping, or there is an alias.
    """
    try:
        if len(data) > max_length:
            raise ValueError(f'it has more than {max_length} characters')
        return yaml.load(data, _Loader)  # noqa: S506 it is a SafeLoader
    except Exception as cause:  # noqa: BLE001 its constructors raise exceptions of any type
        reason = (
            'it is nested too deeply'
            if isinstance(cause, RecursionError)
            else one_line(str(cause))
        )
        raise error(f'{label} is not valid YAML: {reason or type(cause).__name__}') from None


# -- Schemas --------------------------------------------------------------------------------------


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
    """Return a document as an instance of a model of pydantic.

    Raises ``error`` with a single line that names the label (the file, or the entry in it; empty
    if the caller adds it), the first invalid field, its value and what was expected: that in
    ``expected`` by the name of the field, or the description by pydantic.
    """
    where = f' in {label}' if label else ''
    fields: Any = getattr(model, 'model_fields', None) or model.__fields__
    names = list(fields)
    if not isinstance(document, Mapping):
        raise error(
            f'invalid content {shown(document)}{where}: expected a mapping with the keys '
            f'{", ".join(names)}, not a {type(document).__name__}'
        )
    try:
        return model(**{str(key): value for key, value in document.items()})
    except ValidationError as found:
        # A misspelt key comes before the key that is missing instead.
        first = min(found.errors(), key=lambda e: len(e['loc']) > 1 or 'extra' not in e['type'])
    name = str(first['loc'][0])
    if len(first['loc']) == 1 and 'extra' in first['type']:
        raise error(
            f'invalid key {shown(name)}{where}: expected one of {", ".join(names)}'
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


# -- Numbers with a unit --------------------------------------------------------------------------


# Factors to SI units, by the SI unit of the quantity.
_FACTORS: dict[str, dict[str, float]] = {
    'm': {'m': 1.0, 'um': 1e-6, 'mm': 1e-3, 'cm': 1e-2, 'in': 0.0254, 'ft': 0.3048},
    'm/s': {'m/s': 1.0, 'mm/s': 1e-3, 'cm/s': 1e-2},
    'm/s2': {'m/s2': 1.0, 'm/s^2': 1.0, 'mm/s2': 1e-3, 'mm/s^2': 1e-3},
    'rad/s': {'rad/s': 1.0, 'deg/s': 0.017453292519943295, 'rpm': 0.10471975511965977},
    'rad': {'rad': 1.0, 'deg': 0.017453292519943295},
    's': {'s': 1.0, 'ms': 1e-3},
    'Hz': {'Hz': 1.0},
    'N': {'N': 1.0, 'mN': 1e-3},
    'N s': {'Ns': 1.0, 'mNs': 1e-3},
    '': {},
}
# A number and, perhaps, what follows it.
NUMBER = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*')


def parse_quantity(name: str, text: str, unit: str) -> float:
    """Return a number in the SI unit ``unit``: ``60mm`` is 0.06 m. A bare number is in that unit.

    Raises InvalidValueError, which lists the units.
    """
    match = NUMBER.fullmatch(text)
    factors = _FACTORS[unit]
    if match is None or (match[2] and match[2] not in factors):
        expected = (
            f'a number, in {unit} or with one of {", ".join(factors)}' if unit else 'a number'
        )
        raise InvalidValueError(f'invalid {name} {shown(text)}: expected {expected}')
    return float(match[1]) * factors.get(match[2], 1.0)


# -- JSON -----------------------------------------------------------------------------------------


def parse_json(path: Path, text: str | bytes) -> dict[str, Any]:
    """Return the JSON object in a text, UTF-8 if it is bytes; raises InvalidValueError."""
    try:
        document = json.loads(
            text.decode('utf-8-sig') if isinstance(text, bytes) else text,
            parse_constant=_not_finite,
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


def _not_finite(text: str) -> float:
    raise ValueError(f'{text} is not a finite number')


# -- CSV ------------------------------------------------------------------------------------------


@contextmanager
def open_text(path: Path, what: str, max_bytes: int) -> Iterator[TextIO]:
    """Open a text file; errors of decoding and CSV inside the `with` become InvalidValueError.

    what : str
        Kind of the file, for messages.
    """
    file = io.BytesIO(read_input(path, max_bytes, what))
    try:
        yield io.TextIOWrapper(file, encoding='utf-8-sig', newline='')
    except UnicodeDecodeError:
        raise InvalidValueError(f'{named(what, path)} is not text in UTF-8') from None
    except csv.Error as error:
        raise InvalidValueError(f'{named(what, path)} is not a CSV: {error}') from None


class CsvTable:
    """Header and rows of a CSV.

    header, names : list of str
        Names of the columns, without space around them; and in lower case.
    """

    def __init__(self, path: Path, lines: Iterable[str]) -> None:
        self._path = path
        lines = iter(lines)
        first = next(lines, '')
        delimiter = next((each for each in ';,\t' if each in first), ',')
        self._reader = csv.reader(chain([first], lines), delimiter=delimiter)
        self._line, names = next(self._filled(), (1, []))
        self.header = [name.strip() for name in names]
        self.names = [name.lower() for name in self.header]

    def wrong_header(self, expected: str) -> InvalidValueError:
        """Return the error for the names of the columns."""
        return InvalidValueError(
            f'invalid column names {shown(", ".join(self.header))} in {str(self._path)!r} line '
            f'{self._line}: expected {expected}'
        )

    def column(self, name: str, expected: str) -> int:
        """Return the index of the column of a name; InvalidValueError unless there is one."""
        if self.names.count(name) != 1:
            raise self.wrong_header(f'one column {name}; {expected}')
        return self.names.index(name)

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the rows that are not empty, with line numbers; each is as long as the header."""
        for line, row in self._filled():
            if len(row) != len(self.header):
                raise InvalidValueError(
                    f'invalid number of columns {len(row)} in {str(self._path)!r} line {line}: '
                    f'expected {len(self.header)}, as in the header'
                )
            yield line, row

    def wrong(
        self, line: int, row: Sequence[str], column: int, expected: str
    ) -> InvalidValueError:
        """Return the error for a cell."""
        return InvalidValueError(
            f'invalid {self.header[column]} {shown(row[column])} in {str(self._path)!r} '
            f'line {line}: expected {expected}'
        )

    def number(self, line: int, row: Sequence[str], column: int) -> float:
        """Return the number in a cell; raises InvalidValueError unless it is finite."""
        try:
            number = float(row[column])
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise self.wrong(line, row, column, 'a finite number, such as -0.5')
        return number

    def count(self, line: int, row: Sequence[str], column: int) -> int:
        """Return the integer from 0 to MAX_COUNTED in a cell; raises InvalidValueError."""
        text = row[column].strip()
        number = int(text) if re.fullmatch('[0-9]{1,9}', text) else -1
        if not 0 <= number <= MAX_COUNTED:
            raise self.wrong(line, row, column, f'an integer from 0 to {MAX_COUNTED}')
        return number

    def _filled(self) -> Iterator[tuple[int, list[str]]]:
        return (
            (self._reader.line_num, row)
            for row in self._reader
            if any(cell.strip() for cell in row)
        )

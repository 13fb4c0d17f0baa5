"""Read YAML files; any defect in them raises a single error with a message of one line."""

import re
from pathlib import Path
from typing import Any

import yaml

from resting_aspects_ros.core.errors import (
    InvalidValueError,
    RestingAspectsError,
    one_line,
    shown,
)
from resting_aspects_ros.core.input_file import named, read_input

MAX_BYTES = 1 << 16  # a part description has less than 1000 bytes, the surfaces less than 10000
# Maximum number of values after aliases are expanded. Ten lines of nested aliases can expand to
# more values than fit into any memory.
MAX_VALUES = 100_000
MAX_DEPTH = 50


_INT, _FLOAT = 'tag:yaml.org,2002:int', 'tag:yaml.org,2002:float'


class _Loader(yaml.SafeLoader):
    """Reads numbers as YAML 1.2 does: in YAML 1.1, 1e-6 is text, and the range 5:50 is 350."""

    yaml_implicit_resolvers = {  # noqa: RUF012 as in its base
        first: [(tag, pattern) for tag, pattern in pairs if tag not in (_INT, _FLOAT)]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


_Loader.add_implicit_resolver(
    _INT, re.compile(r'[-+]?(?:0|[1-9][0-9_]*|0x[0-9a-fA-F]+)$'), list('-+0123456789')
)
_Loader.add_implicit_resolver(
    _FLOAT,
    re.compile(
        r'(?:[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?'
        r'|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$'
    ),
    list('-+.0123456789'),
)


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
    or too long (it would take minutes to read), a value does not fit its tag, the nesting is too
    deep, a key occurs twice in a mapping, or aliases contain themselves or expand to more than
    MAX_VALUES values.
    """
    try:
        if len(data) > max_length:
            raise ValueError(f'it has more than {max_length} characters')
        loader = _Loader(data)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _count(node, {})
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except Exception as cause:  # noqa: BLE001 its constructors raise exceptions of any type
        reason = (
            'it is nested too deeply'
            if isinstance(cause, RecursionError)
            else one_line(str(cause))
        )
        raise error(f'{label} is not valid YAML: {reason or type(cause).__name__}') from None


def _count(node: yaml.Node, known: dict[yaml.Node, int], depth: int = 0) -> int:
    """Return the number of values in a node with aliases expanded; ValueError if too many."""
    if depth > MAX_DEPTH:
        raise RecursionError
    if node not in known:
        known[node] = (
            MAX_VALUES  # until it is counted, so that an alias that contains itself is an error
        )
        children: list[Any] = node.value if isinstance(node, yaml.CollectionNode) else []
        if isinstance(node, yaml.MappingNode):
            _check_keys([key for key, _ in children])
            children = [child for pair in children for child in pair]
        known[node] = 1 + sum(_count(child, known, depth + 1) for child in children)
    if known[node] >= MAX_VALUES:
        raise ValueError(f'it has more than {MAX_VALUES} values, or an alias that contains itself')
    return known[node]


def _check_keys(keys: list[yaml.Node]) -> None:
    """Raise ValueError if a key occurs twice, of which the last would be used."""
    seen = set()
    for key in keys:
        if isinstance(key, yaml.ScalarNode):
            if (key.tag, key.value) in seen:
                line = key.start_mark.line + 1
                raise ValueError(f'the key {shown(key.value)} occurs twice, again in line {line}')
            seen.add((key.tag, key.value))

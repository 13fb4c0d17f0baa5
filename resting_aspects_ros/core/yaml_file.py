"""Reading YAML that people write: any damage in it becomes one error in one line."""

from pathlib import Path
from typing import Any

import yaml

from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError, one_line
from resting_aspects_ros.core.input_file import named, read_input

MAX_BYTES = 1 << 16  # a part's sheet needs less than a thousand, the surfaces less than ten
# Values in a document after its aliases are replaced. Ten lines of aliases of aliases stand for
# more than any memory holds.
MAX_VALUES = 100_000
MAX_DEPTH = 50


def read_yaml(
    path: Path,
    what: str,
    max_bytes: int = MAX_BYTES,
    error: type[RestingAspectsError] = InvalidValueError,
) -> Any:
    """Return the document in a YAML file, of plain types; None if it is empty.

    Raises ``error`` with one line that names the file if it is not a readable regular file of at
    most ``max_bytes``, or not YAML; see parse_yaml.
    """
    data = read_input(path, max_bytes, what, error)
    return parse_yaml(data, named(what, path), error, max_bytes)


def parse_yaml(
    data: bytes | str,
    label: str,
    error: type[RestingAspectsError] = InvalidValueError,
    max_length: int = MAX_BYTES,
) -> Any:
    """Return the document in the text of a YAML file, of plain types; None if it is empty.

    Raises ``error``, in one line that begins with the label, for text that is too long, which
    takes minutes to read, or not YAML, values
    that do not fit their tag, nesting that is too deep, and aliases that contain themselves or
    stand for more than MAX_VALUES values.
    """
    try:
        if len(data) > max_length:
            raise ValueError(f'it has more than {max_length} characters')
        loader = yaml.SafeLoader(data)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _count(node, {})
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except Exception as cause:  # noqa: BLE001 its constructors raise whatever they stumble over
        reason = (
            'it is nested too deeply'
            if isinstance(cause, RecursionError)
            else one_line(str(cause))
        )
        raise error(f'{label} is not valid YAML: {reason or type(cause).__name__}') from None


def _count(node: yaml.Node, known: dict[yaml.Node, int], depth: int = 0) -> int:
    """Return the number of values in a node, each alias replaced; ValueError if too many."""
    if depth > MAX_DEPTH:
        raise RecursionError
    if node not in known:
        known[node] = MAX_VALUES  # until it is counted: an alias within itself has no end
        children: list[Any] = node.value if isinstance(node, yaml.CollectionNode) else []
        if isinstance(node, yaml.MappingNode):
            children = [child for pair in children for child in pair]
        known[node] = 1 + sum(_count(child, known, depth + 1) for child in children)
    if known[node] >= MAX_VALUES:
        raise ValueError(f'it has more than {MAX_VALUES} values, or an alias that contains itself')
    return known[node]

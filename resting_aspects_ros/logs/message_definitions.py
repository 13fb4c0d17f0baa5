"""Definitions of message types, from the share folders of the installed packages.

Every log contains the definitions of its types, so that it can be read without the packages.
"""

from __future__ import annotations

import json
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.errors import LogError

_BUILT_IN = re.compile(r'bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string')
_SEPARATOR = '=' * 80

# The type of a field without its bounds: `geometry_msgs/Pose` of `geometry_msgs/Pose[<=3] p`.
# A constant (`uint8 OK=0`) matches too; the type of a constant is built in.
_FIELD = re.compile(r'\s*(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[A-Za-z]', re.ASCII)


@dataclass(frozen=True)
class Schema:
    """The definition of a message type.

    name : str
        `package/msg/Type`.
    text : str
        Text of the .msg file, followed by the texts of all types it depends on (encoding
        `ros2msg`).
    type_hash : str
        `RIHS01_...`, the hash with which ROS 2 distinguishes versions of a type.
    """

    name: str
    text: str
    type_hash: str


def load_schema(type_name: str) -> Schema:
    """Return the definition of a type from the installed packages.

    type_name : str
        `package/msg/Type`.

    Raises LogError if the type, or a type it depends on, is not installed; the message lists the
    folders that were searched.
    """
    package, _, short = type_name.partition('/msg/')
    path = _find(package, short)
    return Schema(type_name, _full_text(package, short), _type_hash(type_name, path))


def share_folders() -> list[Path]:
    """Return the folders with one subfolder per package, in search order.

    Sourced workspaces come first. The wheels of a virtual environment install into its own
    `share` folder, which does not need to be sourced.
    """
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    return [Path(prefix) / 'share' for prefix in dict.fromkeys([*prefixes, sys.prefix])]


def _full_text(package: str, short: str) -> str:
    """Join a definition and its dependencies, each once, in the order of their first use."""
    wanted = [(package, short)]
    parts: list[str] = []
    for name in wanted:  # the loop appends to this list
        text = _read(_find(*name))
        # Foxglove's parser finds a dependency by its short name only.
        heading = f'{_SEPARATOR}\nMSG: {"/".join(name)}\n' if parts else ''
        parts.append(heading + text.removesuffix('\n') + '\n')
        wanted += [each for each in _dependencies(text, name[0]) if each not in wanted]
    return '\n'.join(parts)


def _dependencies(text: str, package: str) -> list[tuple[str, str]]:
    """Return the (package, type) of each field with a message type, once, in order."""
    types: dict[tuple[str, str], None] = {}
    for line in text.splitlines():
        field = _FIELD.match(line)
        if field is None or _BUILT_IN.fullmatch(field['type']):
            continue
        *named, short = field['type'].split('/')
        # As in rosidl, a type without a package belongs to the same package.
        types[named[0] if named else package, short] = None
    return list(types)


def _find(package: str, short: str) -> Path:
    folders = share_folders()
    for folder in folders:
        path = folder / package / 'msg' / f'{short}.msg'
        if path.is_file():
            return path
    raise LogError(
        f'the definition of message type {package}/msg/{short} is not installed: '
        f'there is no {package}/msg/{short}.msg in {", ".join(map(str, folders))}'
    )


def _type_hash(type_name: str, path: Path) -> str:
    """Read a type's hash from the description that rosidl installs beside its .msg file."""
    description = path.with_suffix('.json')
    text = _read(description)
    try:
        hashes = json.loads(text)['type_hashes']
        return str({each['type_name']: each['hash_string'] for each in hashes}[type_name])
    except (ValueError, KeyError, TypeError) as error:
        raise LogError(f'{description} contains no hash of {type_name}: {error!r}') from error


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f'the definition {path} cannot be read: {error}') from error

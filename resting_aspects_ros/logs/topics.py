"""Topics of a log: name, type and offered QoS as plain data, and the definition of the type.

Every log contains the definitions of its types, so that it can be read without the packages.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resting_aspects_ros.errors import LogError, shown
from resting_aspects_ros.input_files import named, parse_yaml

# The message types in the log of a run.
POSES_TYPE = 'resting_aspects_interfaces/msg/RestingPoses'
PART_TYPE = 'resting_aspects_interfaces/msg/PartDescription'
SURROUNDINGS_TYPE = 'resting_aspects_interfaces/msg/SurroundingsDescription'
DISTRIBUTION_TYPE = 'resting_aspects_interfaces/msg/AspectDistribution'
TRANSITIONS_TYPE = 'resting_aspects_interfaces/msg/TransitionMatrix'

# The names that rmw uses on Jazzy, from the weakest policy to the strongest. A rosbag2 player does
# not offer a topic with any other name.
_POLICIES = {
    'history': ('keep_last', 'keep_all'),
    'reliability': ('best_effort', 'reliable'),
    'durability': ('volatile', 'transient_local'),
}
# The names that rosbag2 writes for unknown policies: DDS transmits neither history nor depth. The
# policy is then that of the default QoS of ROS.
_UNSPECIFIED = ('unknown', 'system_default', 'best_available')
_DEFAULTS = {'history': 'keep_last', 'reliability': 'reliable', 'durability': 'volatile'}

# RMW_DURATION_INFINITE
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True)
class Qos:
    """The quality of service that a publisher offers, with the names that rosbag2 stores.

    rclpy uses the same names: `profile.reliability.short_key`. Deadline, lifespan and liveliness
    have no field, because the suite uses their defaults. The depth is ignored with `keep_all`.
    """

    depth: int
    reliability: str = 'reliable'
    durability: str = 'volatile'
    history: str = 'keep_last'


@dataclass(frozen=True)
class Topic:
    """One recorded topic.

    name : str
        Absolute name on the ROS graph, such as `/resting_poses`.
    type : str
        `resting_aspects_interfaces/msg/RestingPoses`.
    """

    name: str
    type: str
    qos: Qos


def qos_profiles(qos: Qos) -> list[dict[str, Any]]:
    """Return the `offered_qos_profiles` of a topic with one kind of publisher, all nine keys.

    Both the channel in the MCAP file and metadata.yaml use this result, because a reader treats
    two different profiles as two topics.
    """
    return [
        {
            'history': qos.history,
            'depth': qos.depth,
            'reliability': qos.reliability,
            'durability': qos.durability,
            'deadline': _INFINITE,
            'lifespan': _INFINITE,
            'liveliness': 'automatic',
            'liveliness_lease_duration': _INFINITE,
            'avoid_ros_namespace_conventions': False,
        }
    ]


def recorded_qos(text: str) -> Qos | None:
    """Parse the `offered_qos_profiles` of a topic; None if there are none.

    For several publishers, the result has the strongest policy that any of them offered, which is
    compatible with the readers of all. Unspecified policies get the defaults of ROS. If the
    history is unspecified, the depth is 0.

    Raises LogError if the text is not valid.
    """
    offered = parse_yaml(text, f'QoS {shown(text)}', LogError)
    if not offered:
        return None
    try:
        depth = max(0 if each['history'] in _UNSPECIFIED else each['depth'] for each in offered)
        strongest = {name: _strongest(name, offered) for name in _POLICIES}
        if not 0 <= depth < 2**31:
            raise ValueError(f'depth {depth}')
        return Qos(int(depth), **strongest)
    except (LookupError, TypeError, ValueError) as error:
        raise LogError(
            f'invalid QoS {shown(text)}: expected profiles as rosbag2 writes them; {shown(error)}'
        ) from None


def _strongest(name: str, offered: Sequence[Any]) -> str:
    """Return the strongest policy in profiles; raises ValueError for an unknown policy."""
    policies = [each[name] for each in offered]
    named = [_DEFAULTS[name] if each in _UNSPECIFIED else each for each in policies]
    if unknown := set(named) - set(_POLICIES[name]):
        raise ValueError(f'{name} {unknown.pop()!r}')
    return str(max(named, key=_POLICIES[name].index))


# -- definitions ----------------------------------------------------------------------------------


def load_schema(type_name: str) -> tuple[str, str]:
    """Return the definition of a type from the installed packages, and its hash.

    The text is that of the .msg file, followed by those of all types that it depends on (encoding
    `ros2msg`). ROS 2 distinguishes versions of a type by the hash, `RIHS01_...`.

    type_name : str
        `package/msg/Type`.

    Raises LogError if the type, or a type it depends on, is not installed; the message lists the
    folders that were searched.
    """
    hashes = _type_hashes(type_name)
    texts = [_read(_find(type_name)).removesuffix('\n')]
    for name in sorted(hashes.keys() - {type_name}):
        text = _read(_find(name)).removesuffix('\n')
        # Foxglove's parser finds a dependency by its short name only.
        texts.append(f'{"=" * 80}\nMSG: {name.replace("/msg/", "/")}\n{text}')
    return '\n\n'.join(texts) + '\n', hashes[type_name]


def check_definition(path: Path, type_name: str, type_hash: str | None) -> None:
    """Raise LogError if a type is not installed, or the log was written with another definition.

    CDR does not describe its content, so data read with another definition would be meaningless.

    type_hash : str
        Hash of the definition in the log; None if it is not recorded.
    """
    installed = _type_hashes(type_name)[type_name]
    if type_hash not in (None, installed):
        raise LogError(
            f'{named("log", path)} was recorded by another version of resting_aspects_ros, whose '
            f'{type_name} has the type hash {shown(type_hash)}: expected that of the installed '
            f'version, {installed!r}'
        )


def share_folders() -> list[Path]:
    """Return the folders with one subfolder per package, in search order.

    Sourced workspaces come first. The wheels of a virtual environment install into its own
    `share` folder, which does not need to be sourced.
    """
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    return [Path(prefix) / 'share' for prefix in dict.fromkeys([*prefixes, sys.prefix])]


def _type_hashes(type_name: str) -> dict[str, str]:
    """Return the hashes of a type and of all types that it depends on, by their names.

    They are in the description of the type that rosidl installs beside its .msg file.
    """
    description = _find(type_name).with_suffix('.json')
    text = _read(description)
    try:
        hashes = {
            each['type_name']: each['hash_string'] for each in json.loads(text)['type_hashes']
        }
        return {type_name: hashes.pop(type_name), **hashes}
    except (ValueError, KeyError, TypeError) as error:
        raise LogError(f'{description} contains no hash of {type_name}: {error!r}') from error


def _find(type_name: str) -> Path:
    package, _, short = type_name.partition('/msg/')
    folders = share_folders()
    for folder in folders:
        path = folder / package / 'msg' / f'{short}.msg'
        if path.is_file():
            return path
    raise LogError(
        f'the definition of message type {type_name} is not installed: '
        f'there is no {type_name}.msg in {", ".join(map(str, folders))}'
    )


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f'the definition {path} cannot be read: {error}') from error

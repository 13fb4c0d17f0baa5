"""How many poses a batch holds, by its CDR bytes: to read each of them takes 25 us."""

import struct
from collections.abc import Iterator
from importlib import import_module
from itertools import takewhile

from resting_aspects_interfaces.msg import RestingPoses

from resting_aspects_ros.core.errors import LogError

# Bytes of each kind of field that comes before the poses; also what it is aligned to.
_SIZES = {
    'uint8': 1,
    'int32': 4,
    'uint32': 4,
    'double': 8,
    'uint64': 8,
}
# They say the order of bytes; what is aligned is counted from after them.
_HEADER = 4


def poses_in(data: bytes) -> int:
    """The number of poses in a RestingPoses in CDR; LogError if it is none."""
    order = '<' if data[1:2] == b'\1' else '>'

    def number(at: int) -> int:
        return int(struct.unpack_from(f'{order}I', data, _HEADER + at)[0])

    at = 0
    try:
        for kind in _BEFORE:
            if kind == 'string':
                at += -at % 4
                at += 4 + number(at)
            else:
                at += -at % _SIZES[kind] + _SIZES[kind]
        return number(at + -at % 4)
    except struct.error:
        raise LogError(f'{len(data)} bytes are no batch of resting poses') from None


def _plain(kinds: Iterator[str]) -> Iterator[str]:
    """The kinds of fields, with those of messages in their places."""
    for kind in kinds:
        package, _, name = kind.rpartition('/')
        if package:
            message = getattr(import_module(f'{package}.msg'), name)
            yield from _plain(iter(message.get_fields_and_field_types().values()))
        else:
            yield kind


_FIELDS = RestingPoses.get_fields_and_field_types()
_BEFORE = tuple(_plain(_FIELDS[name] for name in takewhile(lambda n: n != 'poses', _FIELDS)))

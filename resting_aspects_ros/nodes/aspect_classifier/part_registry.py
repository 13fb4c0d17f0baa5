"""The parts that the classifier was told of, and their aspects."""

import time
from collections.abc import Callable, Mapping
from hashlib import sha256

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import PartDescription

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import PartError, RestingAspectsError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.ros.callbacks import sleep_for
from resting_aspects_ros.ros.conversions import check_description, part_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.status import unknown_part

# A simulator's parts come in one after another; after so long without a new one all are there, s.
QUIET = 5.0
# While parts come in, one that is asked for is looked for this often, s.
PERIOD = 0.1


def read_part(data: bytes, name: str) -> tuple[Part, AspectSet]:
    """Return the part of a serialised description on parts/<name>; for a FileWorker."""
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    part = part_from(message)
    return part, find_aspects(part)


class PartRegistry:
    """The parts as they are described now, and the aspects of every version that was seen.

    Parameters
    ----------
    files : reads descriptions, so that no mesh can block the node
    changed : called with the part when a description was read
    rejected : called with part_sha256 and the reason when one cannot be used
    """

    def __init__(
        self,
        node: Node,
        files: FileWorker,
        changed: Callable[[Part], None],
        rejected: Callable[[str, str], None],
    ) -> None:
        self._node = node
        self._files = files
        self._changed = changed
        self._rejected = rejected
        self._newest: dict[str, bytes] = {}  # by name: the description that is being read
        self._described: dict[str, bytes] = {}  # by name: hash of the description read last
        self._parts: dict[str, Part] = {}
        self._last: dict[str, Part] = {}  # by name, also those that are offered no more
        self._versions: dict[str, tuple[Part, AspectSet]] = {}
        self._unusable: dict[str, tuple[str, str]] = {}  # by name: part_sha256, why
        self._last_news = time.monotonic()
        self._simulator_was_there = False

    async def describe(self, name: str, data: bytes) -> None:
        """Read a serialised description of a part, unless a newer one comes meanwhile.

        One that is read already is not read again: a replay in a loop repeats it, and could
        repeat it faster than it is read.
        """
        digest = sha256(data).digest()
        if self._described.get(name) == digest:
            return
        self._described[name] = digest
        self._newest[name] = data
        self._last_news = time.monotonic()
        error: RestingAspectsError | None = None
        try:
            part, aspects = await self._files.run(read_part, data, name)
        except RestingAspectsError as raised:
            error = raised
        finally:
            self._last_news = time.monotonic()
            newest = self._newest.get(name) is data
            if newest:
                del self._newest[name]
        if error is None:
            self._versions[part.part_sha256] = part, aspects
            if newest:
                self._unusable.pop(name, None)
                self._parts[name] = self._last[name] = part
                self._changed(part)
        elif newest:
            self._described.pop(name, None)
            sha = deserialize_message(data, PartDescription).part_sha256
            self._forget(name)
            self._unusable[name] = sha, f'part {name!r} cannot be used: {error}'
            self._node.get_logger().warning(self._unusable[name][1])
            self._rejected(sha, self._unusable[name][1])

    def remove(self, name: str) -> None:
        """The part is offered no more; its aspects stay known."""
        self._newest.pop(name, None)
        self._described.pop(name, None)
        self._forget(name)

    def _forget(self, name: str) -> None:
        self._parts.pop(name, None)
        self._unusable.pop(name, None)

    def get(self, name: str) -> Part | None:
        """Return the part as it is offered now."""
        return self._parts.get(name)

    def offered(self) -> list[tuple[str, str]]:
        """Return name and part_sha256 of each, sorted."""
        return sorted((name, part.part_sha256) for name, part in self._parts.items())

    def why_not(self, part_sha256: str) -> str:
        """Return why a version of a part cannot be used; empty if that is not known."""
        return next((why for sha, why in self._unusable.values() if sha == part_sha256), '')

    def aspects(self, part_sha256: str) -> AspectSet | None:
        """Return those of a version of a part, or None if no description of it was read."""
        known = self._versions.get(part_sha256)
        return known[1] if known else None

    def version(self, part_sha256: str) -> tuple[Part, AspectSet]:
        """Return a version of a part that was read, and its aspects."""
        return self._versions[part_sha256]

    async def usable(self, name: str, simulator_is_there: Callable[[], bool]) -> dict[str, Part]:
        """Return the parts that can be asked about, by name; waits for that one to come in.

        Without a simulator no part is offered; what is known of it is known still. Raises
        PartError if the part is offered and cannot be used.
        """
        while True:
            there = simulator_is_there()
            if there and not self._simulator_was_there:
                self._last_news = time.monotonic()  # its parts are still to be discovered
            self._simulator_was_there = there
            parts = self._parts if there else self._last
            if name in self._unusable:
                raise PartError(self._unusable[name][1])
            reading = name in self._newest or time.monotonic() - self._last_news < QUIET
            if name in parts or not reading:
                return dict(parts)
            await sleep_for(self._node, PERIOD)


def requested_part(parts: Mapping[str, Part], name: str) -> Part:
    """Return the part of a name; raises UnknownPartError, which lists the others."""
    if name in parts:
        return parts[name]
    raise unknown_part(name, parts)

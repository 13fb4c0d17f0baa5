"""The parts that the classifier has received, and their aspects."""

import time
from collections.abc import Callable, Mapping
from hashlib import sha256

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import PartDescription

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import PartError, RestingAspectsError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import sleep_for
from resting_aspects_ros.ros.conversions import check_description, part_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.status import unknown_part

# The parts of a simulator arrive one after another. Time without a new part after which all parts
# have arrived, s.
QUIET_PERIOD = 5.0
# Interval of checks for a requested part while parts arrive, s.
CHECK_PERIOD = 0.1


def read_part(data: bytes, name: str) -> tuple[Part, AspectSet]:
    """Return the part in a serialized description on parts/<name>; runs in a FileWorker."""
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    part = part_from(message)
    return part, find_aspects(part)


class PartRegistry:
    """The parts as currently described, and the aspects of every version received.

    Parameters
    ----------
    files : reads descriptions, so that a mesh cannot block the node
    changed : called with the part when a description has been read
    """

    def __init__(
        self,
        node: Node,
        files: FileWorker,
        changed: Callable[[Part], None],
    ) -> None:
        self._node = node
        self._files = files
        self._changed = changed
        self._newest: dict[str, bytes] = {}  # by name: the description that is being read
        self._described: dict[str, bytes] = {}  # by name: hash of the description read last
        self._parts: dict[str, Part] = {}
        self._last: dict[str, Part] = {}  # by name, including parts that are no longer offered
        self._versions: dict[str, tuple[Part, AspectSet]] = {}
        self._unusable: dict[str, tuple[str, str]] = {}  # by name: part_sha256, reason
        self._last_arrival = time.monotonic()
        self._simulator_was_ready = False

    async def describe(self, name: str, data: bytes) -> None:
        """Read a serialized description of a part; ignore the result if a newer one has arrived.

        The same description is read only once: a looped replay repeats it, possibly faster than
        it can be read.
        """
        digest = sha256(data).digest()
        if self._described.get(name) == digest:
            return
        self._described[name] = digest
        self._newest[name] = data
        self._last_arrival = time.monotonic()
        error: RestingAspectsError | None = None
        try:
            part, aspects = await self._files.run(read_part, data, name)
        except RestingAspectsError as raised:
            error = raised
        finally:
            self._last_arrival = time.monotonic()
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

    def remove(self, name: str) -> None:
        """Remove a part that is no longer offered; its aspects stay known."""
        self._newest.pop(name, None)
        self._described.pop(name, None)
        self._forget(name)

    def _forget(self, name: str) -> None:
        self._parts.pop(name, None)
        self._unusable.pop(name, None)

    def get(self, name: str) -> Part | None:
        """Return the currently offered part of a name, or None."""
        return self._parts.get(name)

    def offered(self) -> list[tuple[str, str]]:
        """Return name and part_sha256 of each offered part, sorted."""
        return sorted((name, part.part_sha256) for name, part in self._parts.items())

    def why_not(self, part_sha256: str) -> str:
        """Return why a version of a part cannot be used; empty if no reason is known."""
        return next((why for sha, why in self._unusable.values() if sha == part_sha256), '')

    def aspects(self, part_sha256: str) -> AspectSet | None:
        """Return the aspects of a version of a part, or None if it has not been read."""
        known = self._versions.get(part_sha256)
        return known[1] if known else None

    def version(self, part_sha256: str) -> tuple[Part, AspectSet]:
        """Return a version of a part that has been read, and its aspects."""
        return self._versions[part_sha256]

    async def usable(self, name: str, simulator_is_ready: Callable[[], bool]) -> dict[str, Part]:
        """Return the parts that can be requested, by name; waits for the named part to arrive.

        Without a simulator, no part is offered, and the result contains the parts offered before.
        Raises PartError if the part is offered but cannot be used.
        """
        while True:
            is_ready = simulator_is_ready()
            if is_ready and not self._simulator_was_ready:
                self._last_arrival = time.monotonic()  # its parts are not discovered yet
            self._simulator_was_ready = is_ready
            parts = self._parts if is_ready else self._last
            if name in self._unusable:
                raise PartError(self._unusable[name][1])
            reading = name in self._newest or time.monotonic() - self._last_arrival < QUIET_PERIOD
            if name in parts or not reading:
                return dict(parts)
            await sleep_for(self._node, CHECK_PERIOD)


def requested_part(parts: Mapping[str, Part], name: str) -> Part:
    """Return a part by name; raises UnknownPartError, which lists the known parts."""
    if name in parts:
        return parts[name]
    raise unknown_part(name, parts)

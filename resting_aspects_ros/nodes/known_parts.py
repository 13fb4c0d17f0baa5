"""The parts that the classifier was told of, and their aspects."""

import time
from collections.abc import Mapping

from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.nodes.requests import unknown_part

# A simulator's parts come in one after another; after so long without a new one all are there, s.
QUIET = 5.0


class KnownParts:
    """The parts as they are described now, and the aspects of every version that was seen."""

    def __init__(self) -> None:
        self._parts: dict[str, Part] = {}
        self._last: dict[str, Part] = {}  # by name, also those that are offered no more
        self._by_sha: dict[str, Part] = {}
        self._aspects: dict[str, AspectSet] = {}
        self._last_news = time.monotonic()

    def describe(self, part: Part) -> None:
        """Take a part as it is offered now."""
        self._parts[part.name] = self._last[part.name] = part
        self._by_sha[part.part_sha256] = part
        self._last_news = time.monotonic()

    def come_in(self) -> bool:
        """Whether a part that is not there may be on its way: the node or a part is just there."""
        return time.monotonic() - self._last_news < QUIET

    def remove(self, name: str) -> None:
        """The part is offered no more; its aspects stay known."""
        self._parts.pop(name, None)

    def names(self) -> list[str]:
        """Of the parts that are offered, sorted."""
        return sorted(self._parts)

    def get(self, name: str) -> Part | None:
        """The part as it is offered now."""
        return self._parts.get(name)

    def usable(self, simulator_is_there: bool) -> dict[str, Part]:
        """The parts that can be asked about, by name.

        Without a simulator no part is offered; what is known of it is known still.
        """
        return dict(self._parts if simulator_is_there else self._last)

    def offered(self) -> list[tuple[str, str]]:
        """Name and part_sha256 of each, sorted."""
        return [(name, self._parts[name].part_sha256) for name in self.names()]

    def aspects(self, part_sha256: str) -> AspectSet | None:
        """Those of a version of a part, or None if no description of it was seen."""
        if part_sha256 not in self._aspects and part_sha256 in self._by_sha:
            self._aspects[part_sha256] = find_aspects(self._by_sha[part_sha256])
        return self._aspects.get(part_sha256)

    def version(self, part_sha256: str) -> tuple[Part, AspectSet]:
        """A version of a part that was seen, and its aspects."""
        aspects = self.aspects(part_sha256)
        assert aspects is not None
        return self._by_sha[part_sha256], aspects


def asked_part(parts: Mapping[str, Part], name: str) -> Part:
    """The part of a name; raises UnknownPartError, which lists the others."""
    if name in parts:
        return parts[name]
    raise unknown_part(name, parts)

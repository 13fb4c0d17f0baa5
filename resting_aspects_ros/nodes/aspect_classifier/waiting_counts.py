"""Counts that arrive before their part is offered."""

from collections.abc import Callable

from resting_aspects_interfaces.msg import ObservedCounts

# Maximum number of messages that wait.
MAX_WAITING = 100


class WaitingCounts:
    """Messages on observed_counts/<part> that wait for their part, in the order of arrival.

    Messages contain totals. Therefore a message replaces an earlier one of the same session and
    version of the part that has the same fields. Of too many, the oldest are forgotten.
    """

    def __init__(self) -> None:
        self._messages: dict[tuple[object, ...], tuple[str, ObservedCounts]] = {}

    @property
    def names(self) -> list[str]:
        """Names of the topics whose messages wait, sorted."""
        return sorted({name for name, _ in self._messages.values()})

    def add(self, name: str, message: ObservedCounts) -> None:
        """Add a message on the topic of a part."""
        totals = message.action, bool(message.supplied), bool(message.moved)
        key = name, message.part, message.part_sha256, message.session, *totals
        self._messages.pop(key, None)
        self._messages[key] = name, message
        while len(self._messages) > MAX_WAITING:
            del self._messages[next(iter(self._messages))]

    def take(self, is_known: Callable[[str], object]) -> list[tuple[str, ObservedCounts]]:
        """Remove and return the messages of known parts."""
        found = {k: each for k, each in self._messages.items() if is_known(each[0])}
        for key in found:
            del self._messages[key]
        return list(found.values())

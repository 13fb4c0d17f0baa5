"""Signals that ask a program to end: Ctrl-C, a service manager, a terminal that closes."""

import signal
from types import TracebackType
from typing import Any

from resting_aspects_ros.system import SIGNALS


def catch(handler: Any) -> dict[signal.Signals, Any]:
    """Install a handler, except for ignored signals; returns the previous handlers."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    before = {number: old for number, old in before.items() if old is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, handler)
    return before


class Interruption:
    """Deferred interruption: signals are noted during `with`, and checked at safe points.

    Once the work ends because of a signal, further signals are ignored, so that a second Ctrl-C
    does not corrupt the results that are being saved.
    """

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> 'Interruption':  # noqa: PYI034 - Self is newer than Python 3.10
        self._before = catch(self._note)
        return self

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal was received."""
        if self.asked:
            raise KeyboardInterrupt

    def _note(self, *_: object) -> None:
        self.asked = True

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.asked else handler)

"""Ctrl-C, heeded only where nothing is half done."""

import signal
from types import TracebackType
from typing import Any

from resting_aspects_ros.signals import catch


class Interruption:
    """Notes that somebody wants an end, from `with` on; the work looks when it can end.

    A signal that is ignored stays so, as nohup has it. When the work ends because of it, it is
    not asked again: a second Ctrl-C must not spoil what is being saved.
    """

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> 'Interruption':  # noqa: PYI034 - Self is newer than Python 3.10
        self._before = catch(self._note)
        return self

    def check(self) -> None:
        """Raise KeyboardInterrupt if an end was asked for."""
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

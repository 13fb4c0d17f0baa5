"""Signals that ask a program to end, and how it does while it has nothing to put in order.

Nothing heavy is imported here: a program sets its handlers before it imports what takes time.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from types import FrameType
from typing import Any

# A service manager and a terminal that closes mean the same as Ctrl-C.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def catch(handler: Any) -> dict[signal.Signals, Any]:
    """Have the signals handled, but those that are ignored; returns what handled them before."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    before = {number: old for number, old in before.items() if old is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, handler)
    return before


def end_at_once(number: int, _: FrameType | None) -> None:
    """A handler for as long as nothing is begun: quietly, with the exit code of the signal.

    Some libraries take any exception for a sign that what they could use is not installed: a
    KeyboardInterrupt that is raised while they are imported is lost.
    """
    os._exit(128 + number)


@contextmanager
def handled_by(handler: Any) -> Iterator[None]:
    """Have the signals handled otherwise for a while."""
    before = catch(handler)
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def ending_at_once() -> AbstractContextManager[None]:
    """Let a signal end the process at once; to be used around imports."""
    return handled_by(end_at_once)

"""Signals that ask a program to end: Ctrl-C, a service manager, a terminal that closes."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def catch(handler: Any) -> dict[signal.Signals, Any]:
    """Install a handler, except for ignored signals; returns the previous handlers."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    before = {number: old for number, old in before.items() if old is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, handler)
    return before


@contextmanager
def handled_by(handler: Any) -> Iterator[None]:
    """Install a handler for the duration of the block."""
    before = catch(handler)
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)

"""End the process after a time, even if native code never returns."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

# Constants of Linux: <time.h>, <signal.h>.
_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _Event(ctypes.Structure):
    """``struct sigevent`` of a timer that calls a function with a value; 64 bytes."""

    _fields_ = (
        ('value', ctypes.c_void_p),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_byte * 32),
    )


class _Times(ctypes.Structure):
    """``struct itimerspec``: period and start, each in s and ns."""

    _fields_ = tuple((name, ctypes.c_long) for name in ('every_s', 'every_ns', 's', 'ns'))


@contextmanager
def at_most(seconds: int, code: int) -> Iterator[None]:
    """End this process with an exit code if the block takes longer, without any cleaning up.

    A thread of Python could not do so: native code that waits for ever may hold the lock of the
    interpreter. A timer of the operating system calls ``_exit`` of the C library instead.
    """
    library = ctypes.CDLL(None)
    end = ctypes.cast(library._exit, ctypes.c_void_p)  # noqa: SLF001 - a public C function
    event = _Event(value=code, notify=_SIGEV_THREAD, function=end)
    timer = ctypes.c_void_p()
    library.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer))
    library.timer_settime(timer, 0, ctypes.byref(_Times(s=seconds)), None)
    try:
        yield
    finally:
        library.timer_delete(timer)

"""The errors of the suite: one root, one subclass per cause.

Every message names the thing, its value and what was expected, so that it can be shown as it is:
in one line, without control characters, and short whatever the input was.
"""

import reprlib
import warnings

MAX_SHOWN = 80


class RestingAspectsError(Exception):
    """Root of all errors that the suite raises on purpose."""


class RestingAspectsWarning(UserWarning):
    """The result is usable, but something about it may not be what the user expects."""


class PartError(RestingAspectsError):
    """A mesh or its mass properties cannot be used."""


class UnknownPartError(RestingAspectsError):
    """No part of that name is registered."""


class InvalidValueError(RestingAspectsError):
    """A value (a condition, a number of drops, a name) is not allowed."""


class EngineError(RestingAspectsError):
    """The physics engine could not do what it was asked."""


class LogError(RestingAspectsError):
    """A log cannot be written or read."""


class NoLogError(LogError):
    """What is given as a log is none."""


def warn(text: str) -> None:
    """Warn the caller of the Python interface; the command line prints it on standard error."""
    warnings.warn(text, RestingAspectsWarning, stacklevel=3)


def shown(value: object, length: int = MAX_SHOWN) -> str:
    """Return the repr of any value for a message: one line, at most ``length`` characters.

    Text is shortened in the middle, so that the ending of a path remains. Never raises, and takes
    no longer for a value that is nested or refers to itself.
    """
    short = reprlib.Repr()
    short.maxlevel = 3
    short.maxstring = short.maxother = short.maxlong = length
    try:
        text = short.repr(value)
    except Exception:  # noqa: BLE001 an int of more digits than Python converts; any __repr__
        text = f'<{type(value).__name__}>'
    return one_line(text, length)


def one_line(text: str, length: int = 300) -> str:
    """Return text of another program or a file for a message: one line, no control characters."""
    text = ' '.join(text[: 4 * length].split())
    text = ''.join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    return text if len(text) <= length else f'{text[: length - 3]}...'

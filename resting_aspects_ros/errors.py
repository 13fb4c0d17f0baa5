"""The exceptions of the suite: one root class and one subclass per cause."""

import difflib
import reprlib
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

# Maximum length of a value and of a path in a message.
MAX_SHOWN, MAX_PATH = 80, 300


class RestingAspectsError(Exception):
    """Root of all exceptions that the suite raises intentionally.

    result : object
        What was complete when simulations failed midway, as the function would have returned it;
        None without any.
    """

    result: Any = None


class RestingAspectsWarning(UserWarning):
    """The result is usable but may not be what the user expects."""


class PartError(RestingAspectsError):
    """A mesh or its mass properties cannot be used."""


class UnknownPartError(RestingAspectsError):
    """No part with this name is registered."""


class InvalidValueError(RestingAspectsError):
    """A value (a condition, a number of drops, a name) is invalid."""


class EngineError(RestingAspectsError):
    """The physics engine failed."""


class StoppedError(RestingAspectsError):
    """The work was stopped before it had a result."""


class LogError(RestingAspectsError):
    """A log cannot be written or read."""


class NoLogError(LogError):
    """The given file or folder is not a log."""


class OutputError(RestingAspectsError):
    """A result cannot be written."""


@contextmanager
def analysis(name: str, notes: list[str] | None = None) -> Iterator[None]:
    """Turn a failure of one analysis of finished drops into a warning that names it.

    The drops cannot be repeated cheaply, so that a figure, a test or a table that fails must not
    cost them, nor what else is made of them. The sentence is also appended to ``notes``. Failures
    of the engine and of files are raised.
    """
    try:
        yield
    except (OSError, EngineError, LogError, OutputError):
        raise
    except Exception as error:  # noqa: BLE001 any error: the other results are still made
        reason = one_line(f'{type(error).__name__}: {error}')
        sentence = f'{name} could not be made ({reason}); everything else is complete'
        warnings.warn(sentence, RestingAspectsWarning, stacklevel=3)
        if notes is not None:
            notes.append(f'{sentence[0].upper()}{sentence[1:]}.')


@contextmanager
def located(where: str) -> Iterator[None]:
    """Put the file, or the entry in it, in front of the message of an error in the `with`."""
    try:
        yield
    except RestingAspectsError as error:
        raise type(error)(f'{where}: {error}') from None


def warn(text: str) -> None:
    """Issue a warning; the command line prints it on standard error."""
    warnings.warn(text, RestingAspectsWarning, stacklevel=3)


class _ShortRepr(reprlib.Repr):
    """Shows numbers of NumPy as Python does: 0.5, not np.float64(0.5)."""

    def repr1(self, value: Any, level: int) -> str:
        # NumPy is not imported here: it would slow down the help.
        if type(value).__module__ == 'numpy' and value.ndim == 0:
            value = value.item()
        return super().repr1(value, level)


def shown(value: object, length: int = MAX_SHOWN) -> str:
    """Return the repr of any value for a message, in one line of at most ``length`` characters.

    Text is shortened in the middle, so that the end of a path remains visible. The function never
    raises, and nested or self-referential values do not slow it down.
    """
    short = _ShortRepr()
    short.maxlevel = 3
    short.maxstring = short.maxother = short.maxlong = length
    try:
        text = short.repr(value)
    except Exception:  # noqa: BLE001 an int with too many digits, or any error in __repr__
        text = f'<{type(value).__name__}>'
    return one_line(text, length)


def one_line(text: str, length: int = 300) -> str:
    """Return external text for a message, in one line and without control characters."""
    text = ' '.join(text[: 4 * length].split())
    text = ''.join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    return text if len(text) <= length else f'{text[: length - 3]}...'


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return the end of an error that suggests a known name; empty if none is similar."""
    close = difflib.get_close_matches(str(name).lower(), list(known), n=1)
    return f'; did you mean {close[0]!r}?' if close else ''

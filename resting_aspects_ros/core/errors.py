"""The errors of the suite: one root, one subclass per cause.

Every message names the thing, its value and what was allowed, so that it can be shown as it is.
"""


class RestingAspectsError(Exception):
    """Root of all errors that the suite raises on purpose."""


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

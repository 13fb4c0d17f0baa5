"""The Python client: ask a running suite about parts, with ROS knowledge or without.

>>> from resting_aspects_ros.client import RestingAspectsClient
>>> with RestingAspectsClient() as client:
...     found = client.get_distribution('l_bracket', drops=1000)

This is the public name of what nodes/client.py, which knows ROS, does.
"""

from resting_aspects_ros.core.errors import (
    InvalidValueError,
    RestingAspectsError,
    UnknownPartError,
)
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.nodes.client import RestingAspectsClient
from resting_aspects_ros.nodes.own_node import ClientUseError
from resting_aspects_ros.nodes.question import AnswerTimeoutError
from resting_aspects_ros.nodes.requests import BusyError, CanceledError, NotAvailableError

__all__ = [
    'AnswerTimeoutError',
    'BusyError',
    'CanceledError',
    'ClientUseError',
    'DropConditions',
    'InvalidValueError',
    'NotAvailableError',
    'RestingAspectsClient',
    'RestingAspectsError',
    'UnknownPartError',
]

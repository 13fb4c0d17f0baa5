"""The Python client: ask a running suite about parts, with ROS knowledge or without.

>>> from resting_aspects_ros.client import RestingAspectsClient
>>> with RestingAspectsClient() as client:
...     found = client.get_distribution('l_bracket', drops=1000)
...     pickable = probability_of(found, [1, 3])

These are the public names of what other programs use; what they do is in nodes, which knows ROS.
"""

from resting_aspects_ros.core.errors import (
    InvalidValueError,
    RestingAspectsError,
    UnknownPartError,
)
from resting_aspects_ros.core.intervals import Interval
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.nodes.client import RestingAspectsClient
from resting_aspects_ros.nodes.distribution_messages import probability_of
from resting_aspects_ros.nodes.own_node import ClientUseError
from resting_aspects_ros.nodes.pending_request import AnswerTimeoutError
from resting_aspects_ros.nodes.requests import BusyError, CanceledError, NotAvailableError

__all__ = [
    'AnswerTimeoutError',
    'BusyError',
    'CanceledError',
    'ClientUseError',
    'DropConditions',
    'Interval',
    'InvalidValueError',
    'NotAvailableError',
    'RestingAspectsClient',
    'RestingAspectsError',
    'UnknownPartError',
    'probability_of',
]

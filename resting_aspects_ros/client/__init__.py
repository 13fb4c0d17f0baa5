"""The Python client: ask a running suite about parts, with ROS knowledge or without.

>>> from resting_aspects_ros.client import RestingAspectsClient
>>> with RestingAspectsClient() as client:
...     found = client.get_distribution('l_bracket', drops=1000)
...     pickable = probability_of(found, [1, 3])

These are the public names of what other programs use; what they do is in nodes, which knows ROS.
"""

from resting_aspects_ros.client.client import RestingAspectsClient
from resting_aspects_ros.client.pending_request import AnswerTimeoutError
from resting_aspects_ros.client.private_node import ClientUseError
from resting_aspects_ros.core.errors import (
    InvalidValueError,
    RestingAspectsError,
    UnknownPartError,
)
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.ros.distribution_conversions import probability_of
from resting_aspects_ros.ros.status import BusyError, CanceledError, NotAvailableError
from resting_aspects_ros.simulation.conditions import DropConditions

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

"""Python client of a running suite; it can be used with and without knowledge of ROS.

>>> from resting_aspects_ros.client import RestingAspectsClient
>>> with RestingAspectsClient() as client:
...     distribution = client.get_distribution('l_bracket', drops=1000)
...     pickable = probability_of(distribution, [1, 3])

This package exports the public names. It sends requests to the nodes of the suite over ROS.
"""

from resting_aspects_ros.client.client import RestingAspectsClient
from resting_aspects_ros.client.connection import AnswerTimeoutError, ClientUseError
from resting_aspects_ros.errors import (
    InvalidValueError,
    RestingAspectsError,
    UnknownPartError,
)
from resting_aspects_ros.ros.distribution_conversions import probability_of, transition_matrix_from
from resting_aspects_ros.ros.requests import BusyError, CanceledError, NotAvailableError
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.statistics.intervals import Interval

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
    'transition_matrix_from',
]

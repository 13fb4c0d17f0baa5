"""Requests of the client for forecasts of the parts per minute of a feeder."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from rclpy.task import Future
from resting_aspects_interfaces.srv import FeederForecast

from resting_aspects_ros.client.async_client import check_ok
from resting_aspects_ros.client.pending_request import PendingRequest
from resting_aspects_ros.client.request_messages import check_name
from resting_aspects_ros.client.vision_client import VisionClient, finite_numbers
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.ros.interface import FORECAST

LENGTHS = {'tray': 2, 'gripper': None}
TEXTS = ('action',)
SWITCHES = ('use_counts', 'overlap')
COUNTS = ('parts_on_tray', 'max_picks')
LISTS = ('aspects', 'classes')


class ForecastClient(VisionClient):
    """The requests of RestingAspectsClient for forecasts."""

    def forecast(
        self, part: str, *, timeout: float | None = None, **options: Any
    ) -> FeederForecast.Response:
        """Return the parts per minute of a feeder, from the known drops and transitions of a part.

        Parameters
        ----------
        part : str
        options
            The other fields of the service FeederForecast, with its defaults: ``aspects`` or
            ``classes`` (in which the robot can pick the part), ``action``, ``use_counts``,
            ``robot_time``, ``vibrate_time``, ``settle_time``, ``image_time``, ``supply_time``,
            ``overlap``, ``place_time`` (s), ``tray``, ``clearance``, ``gripper`` (m),
            ``parts_on_tray``, ``max_picks`` and ``minutes``.

        Returns
        -------
        FeederForecast.Response
            ``parts_per_minute`` with ``lower`` and ``upper``, ``sentence``, and the other fields
            of the service.
        """
        return self._wait(lambda: self.forecast_async(part, timeout=timeout, **options))

    def forecast_async(self, part: str, *, timeout: float | None = None, **options: Any) -> Future:
        """Return a Future of the result of forecast."""
        self._check(timeout)
        request = forecast_request(part, **options)

        async def ask(pending: PendingRequest) -> FeederForecast.Response:
            response = await pending.call(self._services[FORECAST], request)
            check_ok(response.status)
            return response

        return self._start(f'the forecast of {part}', timeout, ask)


def forecast_request(part: str, **options: Any) -> FeederForecast.Request:
    """Return the request for the parameters of RestingAspectsClient.forecast.

    Checks the types, which rclpy does not; the service checks the values. Raises
    InvalidValueError.
    """
    check_name(part)
    request = FeederForecast.Request(part=part)
    fields = request.get_fields_and_field_types()
    for name, value in options.items():
        if name not in fields:
            raise InvalidValueError(
                f'invalid option {shown(name)}: expected one of {", ".join(list(fields)[1:])}'
            )
        setattr(request, name, _checked(name, value))
    return request


def _checked(name: str, value: Any) -> Any:
    if name in TEXTS:
        check_name(value)
        return value
    if name in SWITCHES:
        if not isinstance(value, bool | np.bool_):
            raise InvalidValueError(f'invalid {name} {shown(value)}: expected True or False')
        return bool(value)
    if name in LISTS:
        numbers = list(value) if isinstance(value, Iterable) else [value]
        return [_integer(name, each) for each in numbers]
    if name in COUNTS:
        return _integer(name, value)
    if name in LENGTHS:
        sides = list(value) if isinstance(value, Iterable) else [value]
        return finite_numbers(name, sides, LENGTHS[name] or len(sides))
    return finite_numbers(name, [value], 1)[0]


def _integer(name: str, value: Any) -> int:
    number = value.item() if hasattr(value, 'item') else value
    if type(number) is not int or not 0 <= number < 2**32:
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected integers from 0')
    return number

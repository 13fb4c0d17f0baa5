"""Requests of the client about outlines that a camera sees."""

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point
from rclpy.task import Future
from resting_aspects_interfaces.srv import IdentifyPart, LocatePart

from resting_aspects_ros.client.async_client import AsyncClient, check_ok
from resting_aspects_ros.client.pending_request import PendingRequest
from resting_aspects_ros.client.request_messages import check_name
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.ros.interface import IDENTIFY_PART, LOCATE_PART
from resting_aspects_ros.ros.outline_conversions import polygon_msgs
from resting_aspects_ros.vision.identification import Polygonal, observed_polygon


class VisionClient(AsyncClient):
    """The requests of RestingAspectsClient about outlines; those with _async return a Future."""

    def identify_part(
        self,
        polygon: Polygonal,
        parts: str | Iterable[str] = (),
        *,
        noise: float = 0.0,
        camera: npt.ArrayLike | None = None,
        timeout: float | None = None,
    ) -> IdentifyPart.Response:
        """Return which part an observed polygon shows, in which aspects and where.

        Parameters
        ----------
        polygon : shapely.Polygon, (n, 2) array, or mapping with 'outer' and 'holes'
            Tray frame, m; seen from above, x right and y up.
        parts : str or iterable of str
            Names of the parts that may be on the tray. Empty: all that the suite offers.
        noise : float
            Standard deviation of the boundary, m; 0: 0.1 mm.
        camera : (3,) float, optional
            Centre of projection of a pinhole camera in the tray frame, m, to correct the
            magnification of high parts. None: telecentric.

        Returns
        -------
        IdentifyPart.Response
            ``candidates`` by posterior, with 6D poses; ``none_probability`` and
            ``touching_probability``.
        """
        return self._wait(
            lambda: self.identify_part_async(
                polygon, parts, noise=noise, camera=camera, timeout=timeout
            )
        )

    def locate_part(
        self,
        part: str,
        aspect: int,
        x: float,
        y: float,
        yaw: float,
        *,
        timeout: float | None = None,
    ) -> LocatePart.Response:
        """Return the poses of a part that was recognised in an aspect at (x, y, yaw).

        Parameters
        ----------
        aspect : int
            Id of any aspect of the symmetry class.
        x, y : float
            Projection of the centre of mass, tray frame, m.
        yaw : float
            Yaw of the outline on outlines/<part>, rad, counter-clockwise seen from above.

        Returns
        -------
        LocatePart.Response
            ``poses``, tray from part, those in the given aspect first, with their aspects in
            ``pose_aspects``.
        """
        return self._wait(lambda: self.locate_part_async(part, aspect, x, y, yaw, timeout=timeout))

    def identify_part_async(
        self,
        polygon: Polygonal,
        parts: str | Iterable[str] = (),
        *,
        noise: float = 0.0,
        camera: npt.ArrayLike | None = None,
        timeout: float | None = None,
    ) -> Future:
        """Return a Future of the result of identify_part."""
        self._check(timeout)
        request = identification_request(polygon, parts, noise, camera)

        async def ask(pending: PendingRequest) -> IdentifyPart.Response:
            response = await pending.call(self._services[IDENTIFY_PART], request)
            check_ok(response.status)
            return response

        return self._start('the part of an outline', timeout, ask)

    def locate_part_async(
        self,
        part: str,
        aspect: int,
        x: float,
        y: float,
        yaw: float,
        *,
        timeout: float | None = None,
    ) -> Future:
        """Return a Future of the result of locate_part."""
        self._check(timeout)
        request = location_request(part, aspect, x, y, yaw)

        async def ask(pending: PendingRequest) -> LocatePart.Response:
            response = await pending.call(self._services[LOCATE_PART], request)
            check_ok(response.status)
            return response

        return self._start(f'the poses of {part}', timeout, ask)


def identification_request(
    polygon: Polygonal,
    parts: str | Iterable[str] = (),
    noise: float = 0.0,
    camera: npt.ArrayLike | None = None,
) -> IdentifyPart.Request:
    """Return the validated request for the parameters of RestingAspectsClient.identify_part."""
    if not isinstance(parts, Iterable):
        raise InvalidValueError(f'invalid parts {shown(parts)}: expected names of parts')
    names = [parts] if isinstance(parts, str) else list(parts)
    for name in names:
        check_name(name)
    position = () if camera is None else finite_numbers('camera', camera, 3)
    return IdentifyPart.Request(
        **polygon_msgs(observed_polygon(polygon)),
        parts=names,
        noise=finite_numbers('noise', [noise], 1)[0],
        camera=[Point(**dict(zip('xyz', position, strict=True)))] if position else [],
    )


def location_request(part: str, aspect: int, x: float, y: float, yaw: float) -> LocatePart.Request:
    """Return the validated request for the parameters of RestingAspectsClient.locate_part."""
    check_name(part)
    number: object = aspect.item() if isinstance(aspect, np.generic) else aspect
    if type(number) is not int or not 0 < number < 2**32:
        raise InvalidValueError(f'invalid aspect {shown(aspect)}: expected the id of an aspect')
    x, y, yaw = finite_numbers('x, y, yaw', [x, y, yaw], 3)
    return LocatePart.Request(part=part, aspect=number, x=x, y=y, yaw=yaw)


def finite_numbers(name: str, values: npt.ArrayLike, count: int) -> list[float]:
    """Return finite numbers; rclpy does not check fields."""
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape != (count,) or not all(map(math.isfinite, found)):
        expected = 'a finite number' if count == 1 else f'{count} finite numbers'
        raise InvalidValueError(f'invalid {name} {shown(values)}: expected {expected}')
    numbers: list[float] = found.tolist()
    return numbers

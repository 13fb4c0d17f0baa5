"""The services identify_part and locate_part, based on the outlines of the parts."""

import math
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from geometry_msgs.msg import Point
from rclpy.node import Node
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import IdentifyPart, LocatePart

from resting_aspects_ros.api.identify import identify_part, locate_part, mirror_text
from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.nodes.aspect_classifier.outline_store import OutlineStore
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry, requested_part
from resting_aspects_ros.ros.callbacks import await_future, serve
from resting_aspects_ros.ros.conversions import status
from resting_aspects_ros.ros.interface import IDENTIFY_PART, LOCATE_PART
from resting_aspects_ros.ros.outline_conversions import candidate_msg, polygon_from, pose_fields
from resting_aspects_ros.ros.status import NotAvailableError, status_from_errors
from resting_aspects_ros.vision.camera import Pinhole, surface_pinhole
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import Identification, observed_polygon
from resting_aspects_ros.vision.known_part import KnownPart

# Maximum number of points of an observed polygon: more could take minutes.
MAX_POINTS = 10_000
# Threads in which polygons are identified, so that none blocks the node.
THREADS = 2


class OutlineServices:
    """Serves identify_part and locate_part.

    Parameters
    ----------
    outlines : the outlines of the parts, with their prior shares
    check_ready : raises NotAvailableError while the node is not ready
    simulator_is_ready : returns whether a simulator offers parts
    """

    def __init__(
        self,
        node: Node,
        parts: PartRegistry,
        outlines: OutlineStore,
        check_ready: Callable[[], None],
        simulator_is_ready: Callable[[], bool],
    ) -> None:
        self._node = node
        self._parts = parts
        self._outlines = outlines
        self._check_ready = check_ready
        self._simulator_is_ready = simulator_is_ready
        self._threads = ThreadPoolExecutor(THREADS, 'identification')
        serve(node, IdentifyPart, IDENTIFY_PART, self._identify)
        serve(node, LocatePart, LOCATE_PART, self._locate)

    def stop(self) -> None:
        """Abandon the requests that wait for a thread."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _identify(
        self, request: IdentifyPart.Request, response: IdentifyPart.Response
    ) -> IdentifyPart.Response:
        response.none_probability = response.touching_probability = math.nan
        with status_from_errors(IDENTIFY_PART, response, self._node.get_logger().error):
            self._check_ready()
            polygon = await self._run(requested_polygon, request)
            known = await self._known_parts(request.parts)
            noise = OutlineNoise(request.noise) if request.noise != 0 else None
            camera = requested_camera(request.camera)
            found: Identification = await self._run(
                partial(identify_part, polygon, known, noise=noise, camera=camera)
            )
            response.candidates = [candidate_msg(each) for each in found.candidates]
            response.none_probability = found.none
            response.touching_probability = found.touching
            response.status = status(Status.OK, mirror_text(found))
        return response

    async def _locate(
        self, request: LocatePart.Request, response: LocatePart.Response
    ) -> LocatePart.Response:
        with status_from_errors(LOCATE_PART, response, self._node.get_logger().error):
            self._check_ready()
            (known,) = await self._known_parts([request.part])
            poses = locate_part(known, request.aspect, request.x, request.y, request.yaw)
            for name, value in pose_fields(poses).items():
                setattr(response, name, value)
            response.status = status(Status.OK)
        return response

    async def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a function that runs in a thread."""
        return await await_future(self._node, self._threads.submit(function, *arguments))

    async def _known_parts(self, names: Iterable[str]) -> list[KnownPart]:
        """Return the named parts, or all that have outlines; raises RestingAspectsError."""
        found: list[KnownPart] = []
        if named := list(dict.fromkeys(names)):
            for name in named:
                offered = await self._parts.usable(name, self._simulator_is_ready)
                found.append(self._outlines.known_part(requested_part(offered, name)))
            return found
        offered = await self._parts.usable('', self._simulator_is_ready)
        problems = []
        for _, part in sorted(offered.items()):
            try:
                found.append(self._outlines.known_part(part))
            except PartError as error:
                problems.append(str(error))
        if not found:
            reasons = problems or ['no part is offered, start drop_simulator']
            raise NotAvailableError('; '.join(reasons))
        return found


def requested_polygon(request: IdentifyPart.Request) -> Any:
    """Return the polygon in a request, a shapely.Polygon; raises InvalidValueError."""
    points = sum(len(each.points) for each in (request.outer, *request.holes))
    if points > MAX_POINTS:
        raise InvalidValueError(
            f'invalid polygon of {points} points: expected at most {MAX_POINTS}, simplify it'
        )
    return observed_polygon(polygon_from(request.outer, request.holes))


def requested_camera(position: list[Point]) -> Pinhole | None:
    """Return a camera that maps points on the surface to themselves, or None without one."""
    if not position:
        return None
    if len(position) > 1:
        raise InvalidValueError(
            f'invalid number of camera positions {len(position)}: expected at most one'
        )
    return surface_pinhole([position[0].x, position[0].y, position[0].z])

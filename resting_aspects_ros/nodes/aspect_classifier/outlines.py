"""The outlines of the parts, and the service identify_part."""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point
from rclpy.node import Node
from resting_aspects_interfaces.msg import PartOutlines
from resting_aspects_interfaces.srv import IdentifyPart

from resting_aspects_ros.api.identify import PSEUDO_COUNT, identify_part, mirror_text
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError, PartError, RestingAspectsError
from resting_aspects_ros.nodes.aspect_classifier.known import PartRegistry
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import PartTopics, await_future, guarded_task, start_task
from resting_aspects_ros.ros.conversions import (
    candidate_msg,
    outlines_msg,
    polygon_from,
)
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import IDENTIFY_PART, LATCHED, OUTLINES
from resting_aspects_ros.ros.requests import NotAvailableError, serve
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.vision.camera import Pinhole, surface_pinhole
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import Identification, observed_polygon
from resting_aspects_ros.vision.outline import LookAlike, Outline, find_outlines, look_alikes
from resting_aspects_ros.vision.rolling import KnownPart


def checked_outlines(part: Part, aspects: AspectSet) -> tuple[Outline, ...]:
    """Return the outlines of a part; runs in a FileWorker.

    Raises PartError if the part has no aspect or an outline is not valid.
    """
    if not len(aspects):
        raise PartError('the part has no aspect')
    return find_outlines(part, aspects)


def compare_outlines(one: Outline, others: tuple[Outline, ...]) -> list[LookAlike]:
    """Return how well each of the other outlines resembles an outline; runs in a FileWorker."""
    return [look_alikes((one, each))[one.symmetry_class][0] for each in others]


@dataclasses.dataclass
class _Entry:
    """The outlines of a version of a part; without them, the reason.

    counted : the distribution from which the shares of ``known`` were computed; None: they are
        the shares of the basins
    """

    part: Part
    known: KnownPart | None = None
    problem: str = ''
    counted: Distribution | None = None


@dataclasses.dataclass(eq=False)
class OutlineStore:
    """Computes the outlines of the offered parts one after another, and publishes them.

    files : computes, so that a large mesh cannot block the node
    newest : returns the newest distribution of a version of a part by its part_sha256, or None
    """

    node: Node
    files: FileWorker
    parts: PartRegistry
    newest: Callable[[str], Distribution | None]

    def __post_init__(self) -> None:
        self._entries: dict[str, _Entry] = {}  # by name, those to be computed last
        self._waiting: list[_Entry] = []
        self._topics = PartTopics(self.node, PartOutlines, OUTLINES, LATCHED)

    def update(self, part: Part) -> None:
        """Compute and publish the outlines of a version of a part, unless they are published."""
        known = self._entries.get(part.name)
        if known is not None and known.part.part_sha256 == part.part_sha256:
            return
        entry = self._entries[part.name] = _Entry(part)
        self._waiting.append(entry)
        if len(self._waiting) == 1:
            start_task(self.node, 'no outlines', self._compute_all)

    def known_part(self, part: Part) -> KnownPart:
        """Return the outlines of a part with the current prior shares of its classes.

        Raises NotAvailableError while they are computed, and PartError if they cannot be.
        """
        entry = self._entries.get(part.name)
        is_current = entry is not None and entry.part.part_sha256 == part.part_sha256
        if entry is None or not is_current or not (entry.known or entry.problem):
            raise NotAvailableError(
                f'the outlines of {part.name} are being computed, try again soon'
            )
        if entry.known is None:
            raise PartError(entry.problem)
        newest = self.newest(part.part_sha256)
        if newest is not entry.counted and newest is not None:
            shares = class_shares(entry.known.outlines, newest.counts + PSEUDO_COUNT)
            entry.known = dataclasses.replace(entry.known, shares=shares)
            entry.counted = newest
        return entry.known

    async def _compute_all(self) -> None:
        while self._waiting:
            entry = self._waiting[0]
            compute = guarded_task(self.node, f'no outlines of {entry.part.name}', self._compute)
            await compute(entry)
            self._waiting.pop(0)

    async def _compute(self, entry: _Entry) -> None:
        """Compute the outlines of a part, and publish them when they have been compared."""
        part, name = entry.part, entry.part.name
        _, aspects = self.parts.version(part.part_sha256)
        outlines: tuple[Outline, ...] = ()
        try:
            outlines = await self.files.run(checked_outlines, part, aspects)
            basins = class_shares(outlines, [each.basin_share for each in aspects])
            entry.known = KnownPart(part, aspects, outlines, basins)
        except RestingAspectsError as error:
            entry.problem = f'the outlines of {name} cannot be computed: {error}'
            self.node.get_logger().warning(entry.problem)
        compared = await self._compared(name, outlines)
        if self._entries[name] is entry:  # otherwise the part has changed
            self._topics.publish(name, outlines_msg(part, outlines, compared))

    async def _compared(
        self, name: str, outlines: tuple[Outline, ...]
    ) -> dict[int, list[LookAlike]]:
        """Return the result of look_alikes; a part with many classes takes minutes.

        Therefore each class is a task of its own for the process that reads files.
        """
        found: dict[int, list[LookAlike]] = {each.symmetry_class: [] for each in outlines}
        try:
            for k, one in enumerate(outlines[:-1], start=1):
                for other in await self.files.run(compare_outlines, one, outlines[k:]):
                    found[one.symmetry_class].append(other)
                    back = dataclasses.replace(other, symmetry_class=one.symmetry_class)
                    found[other.symmetry_class].append(back)
        except RestingAspectsError as error:
            self.node.get_logger().warning(f'the outlines of {name} are not compared: {error}')
            return {number: [] for number in found}
        return {k: sorted(each, key=lambda a: -a.overlap) for k, each in found.items()}


def class_shares(outlines: Sequence[Outline], by_aspect: npt.ArrayLike) -> Array:
    """Return the shares (c,) of the classes of the outlines, with the sum 1.

    by_aspect : (k,) shares or counts of the aspects by id, with a sum above 0
    """
    given = np.asarray(by_aspect, dtype=np.float64)
    shares = np.array([given[np.array(each.aspects) - 1].sum() for each in outlines])
    return np.asarray(shares / shares.sum())


# Maximum number of points of an observed polygon: more could take minutes.
MAX_POINTS = 10_000
# Threads in which polygons are identified, so that none blocks the node.
THREADS = 2


class IdentificationService:
    """Serves identify_part."""

    def __init__(self, node: Node, parts: PartRegistry, outlines: OutlineStore) -> None:
        self._node = node
        self._parts = parts
        self._outlines = outlines
        self._threads = ThreadPoolExecutor(THREADS, 'identification')
        serve(node, IdentifyPart, IDENTIFY_PART, self._identify)

    def stop(self) -> None:
        """Abandon the requests that wait for a thread."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _identify(
        self, request: IdentifyPart.Request, response: IdentifyPart.Response
    ) -> None:
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
        response.status.message = mirror_text(found)

    async def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return await await_future(self._node, self._threads.submit(function, *arguments))

    async def _known_parts(self, names: Iterable[str]) -> list[KnownPart]:
        """Return the named parts, or all that have outlines; raises RestingAspectsError."""
        if named := list(dict.fromkeys(names)):
            return [self._outlines.known_part(await self._parts.requested(name)) for name in named]
        offered = await self._parts.usable('')
        found, problems = [], []
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

"""Publishers of the classifier: distributions, markers for RViz, and the newest poses."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion, Vector3
from rclpy.node import Node
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import AspectDistribution, SurroundingsDescription
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from resting_aspects_ros.api.conditions import scene_of
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.nodes.aspect_classifier.counting import Tally
from resting_aspects_ros.nodes.aspect_classifier.known import PartRegistry
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import aspect_colour, probability_text, rgb
from resting_aspects_ros.report.picture import aspect_poses, message_faces
from resting_aspects_ros.ros.callbacks import PartTopics, WorkTimer, advertise, start_task
from resting_aspects_ros.ros.conversions import (
    check_surroundings,
    message_from,
    pose_msg,
    serialized_surroundings,
    surroundings_of,
    triangles_in_tray,
    xyz,
)
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.health import TopicDiscovery
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    CURRENT_POSES,
    FRAME,
    LATCHED,
    MARKERS,
    SURROUNDINGS,
    SURROUNDINGS_MARKERS,
    SURROUNDINGS_QOS,
)
from resting_aspects_ros.ros.program import FRAME_ID, Parameter, check_frame, on_change
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.scene import HalfSpace, MeshBody, Scene, SceneBody
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

# Namespaces of the mesh and text markers; the id of a marker is the id of the aspect.
MESHES, TEXTS = 'aspects', 'probabilities'
# Height of the letters, and of their centre above the part, in units of R. With this height, ten
# letters fit between two aspects.
LETTERS, ABOVE = 0.3, 0.35
TEXT_COLOUR = '#FFFFFF'  # on RViz's dark background


class PartMarkers:
    """The markers of one part, created once: only texts and stamps change with drops.

    Meshes are sent as triangles: a mesh resource would be a path of the simulator's machine, and
    RViz knows neither all formats of parts nor their units.
    """

    def __init__(self, part: Part, aspects: AspectSet, frame: str = FRAME) -> None:
        self._frame = frame
        self._delete_all = Marker(action=Marker.DELETEALL)
        triangles = part.vertices[message_faces(part, aspects)].reshape(-1, 3)
        points = [Point(**xyz(point)) for point in triangles]
        self._meshes, self._texts = [], []
        for one, aspect in zip(aspect_poses(part, aspects), aspects, strict=True):
            pose, (x, y, _) = pose_msg(one.position, one.orientation), one.centre_of_mass.tolist()
            mesh = _mesh(MESHES, aspect.id, aspect_colour(aspect), points, pose=pose)
            z, size = one.top + ABOVE * part.hull_radius, LETTERS * part.hull_radius
            self._meshes.append(mesh)
            self._texts.append(_text(TEXTS, aspect.id, x, y, z, size))

    def message(self, distribution: Distribution, stamp: Time) -> MarkerArray:
        """Return a marker that deletes all previous markers, followed by the markers of the part.

        The next call modifies the returned message.
        """
        for text, label in zip(self._texts, labels(distribution), strict=True):
            text.text = label
        markers = [self._delete_all, *self._meshes, *self._texts]
        header = Header(stamp=stamp, frame_id=self._frame)
        for marker in markers:
            marker.header = header
        return MarkerArray(markers=markers)


def labels(distribution: Distribution) -> list[str]:
    """Return the text above each aspect, such as '2: 27.1 %', or '2: no drops' without drops.

    The number of digits depends on the number of drops.
    """
    rows = zip(distribution.aspects, distribution.intervals(), strict=True)
    return [
        f'{aspect.id}: {probability_text(interval) if distribution.drops else "no drops"}'
        for aspect, interval in rows
    ]


def _mesh(name: str, number: int, colour: str, points: list[Point], **fields: Any) -> Marker:
    """Return the marker of triangles, whose corners are the points one after another."""
    return Marker(
        ns=name,
        id=number,
        type=Marker.TRIANGLE_LIST,
        action=Marker.ADD,
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=_colour(colour, fields.pop('opacity', 1.0)),
        points=points,
        **fields,
    )


def _text(name: str, number: int, x: float, y: float, z: float, size: float) -> Marker:
    return Marker(
        ns=name,
        id=number,
        type=Marker.TEXT_VIEW_FACING,
        action=Marker.ADD,
        pose=Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(w=1.0)),
        scale=Vector3(z=size),
        color=_colour(TEXT_COLOUR, 1.0),
    )


def _colour(text: str, opacity: float) -> ColorRGBA:
    red, green, blue = rgb(text)
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)


# Namespaces of the markers; the id of a marker is the place of the body in the surroundings.
BODIES, NAMES = 'bodies', 'body_names'
# Half the length of a patch of a plane, R. Drops in a chute spread by about 10 R.
PATCH = 20.0
# Height of the letters, R.
NAME_LETTERS = 0.5
# Grey, so that the coloured parts stand out; transparent, since parts can be behind a wall.
COLOURS = ('#9A9A9A', '#7F8FA6', '#A69A7F', '#8FA67F', '#A67F8F')
OPACITY = 0.6
# Maximum number of descriptions that are kept for their meshes.
MAX_KEPT = 10


def plane_patch(plane: Array, others: Sequence[Array], size: float) -> Array:
    """Return the corners (n, 3) of a patch of a plane in front of the other planes.

    Parameters
    ----------
    plane, others : (4,) float
        Coefficients a, b, c, d of the half-spaces ``a x + b y + c z + d <= 0``, unit normals.
    size : float
        Half the length of the patch, m; its centre is the point next to the origin.
    """
    normal, offset = plane[:3], -plane[3]
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    corners = np.array(
        [
            offset * normal + size * (s * first + t * second)
            for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
    )
    for other in others:
        corners = _in_front(corners, other)
    return corners


def surroundings_markers(scene: Scene, radius: float, frame: str) -> MarkerArray:
    """Return the markers of surroundings for a part of a hull radius, m."""
    planes = {
        k: np.array([*scene.in_tray(body.normal[None])[0], -body.offset])
        for k, body in enumerate(scene.bodies)
        if isinstance(body, HalfSpace)
    }
    markers = [Marker(action=Marker.DELETEALL)]
    for k, body in enumerate(scene.bodies):
        if k in planes:
            others = [plane for other, plane in planes.items() if other != k]
            corners = plane_patch(planes[k], others, PATCH * radius)
            triangles = np.array([corners[[0, i, i + 1]] for i in range(1, len(corners) - 1)])
        else:
            triangles = triangles_in_tray(scene, body)
        if len(triangles):
            markers += _body_markers(k, body, triangles.reshape(-1, 3), radius)
    for marker in markers:
        marker.header = Header(frame_id=frame)
    return MarkerArray(markers=markers)


def serialized_markers(
    part: Part, conditions: DropConditions, description: bytes | None, frame: str
) -> bytes:
    """Return the serialized markers of the surroundings of a run; runs in a FileWorker.

    ``description`` is a serialized SurroundingsDescription, which a mesh surface needs.
    """
    if description is not None:
        around = serialized_surroundings(description)
        conditions = dataclasses.replace(conditions, surroundings=around)
    scene = scene_of(part, conditions)
    return bytes(serialize_message(surroundings_markers(scene, part.hull_radius, frame)))


class SurroundingsMarkers:
    """Publishes surroundings_markers: the surroundings of the run whose distribution changed last.

    Parameters
    ----------
    files : creates the markers, so that a mesh cannot block the node
    """

    def __init__(self, node: Node, parts: PartRegistry, files: FileWorker, frame: str) -> None:
        self._node = node
        self._parts = parts
        self._files = files
        self._frame = frame
        self._publisher = advertise(node, MarkerArray, SURROUNDINGS_MARKERS, LATCHED)
        self._descriptions: dict[str, bytes] = {}  # of meshes, by the key of the surroundings
        self._wanted: RunDescription | None = None
        self._shown: tuple[str, str] = '', ''  # part_sha256 and surroundings
        TopicDiscovery(
            node, SURROUNDINGS, SurroundingsDescription, self._take, raw=True, qos=SURROUNDINGS_QOS
        )

    def show(self, run: RunDescription) -> None:
        """Publish the markers for a run, unless they are published already."""
        self._wanted = run
        wanted = run.part_sha256, run.conditions.surroundings_key
        if wanted == self._shown or not (wanted[1] or self._shown[1]):
            return
        self._shown = wanted
        if run.conditions.surroundings is None:
            self._publisher.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
            return
        start_task(self._node, 'surroundings are not shown', self._publish, run)

    async def _publish(self, run: RunDescription) -> None:
        part, _ = self._parts.version(run.part_sha256)
        description = self._descriptions.get(run.conditions.surroundings_key)
        data = await self._files.run(
            serialized_markers, part, run.conditions, description, self._frame
        )
        if self._shown == (run.part_sha256, run.conditions.surroundings_key):
            self._publisher.publish(data)

    def _take(self, part: str, data: bytes) -> None:
        """Keep the description of a mesh surface, which may be wanted already."""
        message = message_from(data)
        check_surroundings(message, part)
        found = surroundings_of(message.surroundings)
        if found is None or found.known or found.key in self._descriptions:
            return
        self._descriptions[found.key] = data
        while len(self._descriptions) > MAX_KEPT:
            self._descriptions.pop(next(iter(self._descriptions)))
        if self._wanted and self._wanted.conditions.surroundings_key == found.key:
            self._shown = '', ''
            self.show(self._wanted)


def _in_front(corners: Array, plane: Array) -> Array:
    """Return a convex polygon without its part in a half-space."""
    height = corners @ plane[:3] + plane[3]
    kept = []
    for k in range(len(corners)):
        here, there = height[k - 1], height[k]
        if (here < 0) != (there < 0):
            share = here / (here - there)
            kept.append(corners[k - 1] + share * (corners[k] - corners[k - 1]))
        if there >= 0:
            kept.append(corners[k])
    return np.array(kept).reshape(-1, 3)


def _body_markers(k: int, body: SceneBody, points: Array, radius: float) -> list[Marker]:
    corners = [Point(**xyz(point)) for point in points]
    opacity = 1.0 if isinstance(body, MeshBody) else OPACITY
    upright = Pose(orientation=Quaternion(w=1.0))
    colour = COLOURS[k % len(COLOURS)]
    mesh = _mesh(BODIES, k, colour, corners, opacity=opacity, pose=upright)
    x, y, z = points[np.argmax(points[:, 2])].tolist()
    size = NAME_LETTERS * radius
    name = _text(NAMES, k, x, y, z + size, size)
    speed = f', {body.contact.speed:g} m/s' if body.contact.speed else ''
    name.text = f'{body.name}{speed}'
    return [mesh, name]


# A message of markers can have 1.4 MB: a slow connection needs a longer period.
PUBLISH_PERIOD = Parameter(
    'publish_period',
    0.2,
    'interval at which distributions, markers and poses of active runs are published, s',
    bounds=(0.05, 10.0),
    changeable=True,
)
# Maximum number of poses. All are around the origin of the tray: more are indistinguishable.
MAX_SHOWN = 100


class DistributionPublisher:
    """Publishes aspect_distributions/<part>, markers of the last changed part, and current_poses.

    The markers are those of the part and those of its surroundings.

    It publishes at most every publish_period, a parameter of the node, and at the end of each run.
    Its timer runs only while something has changed or a subscriber has appeared.
    """

    def __init__(self, node: Node, parts: PartRegistry, files: FileWorker) -> None:
        self._node = node
        self._parts = parts
        self.topics = PartTopics(node, AspectDistribution, ASPECT_DISTRIBUTIONS, LATCHED)
        self._changed: dict[str, Tally] = {}  # by part, in the order of changes
        self._published: dict[str, tuple[tuple[object, ...], int]] = {}  # by part: kind, drops
        period = node.get_parameter(PUBLISH_PERIOD.name).value
        self._timer = WorkTimer(node, period, 'distributions are not published', self._work)
        self._markers = advertise(node, MarkerArray, MARKERS, LATCHED, matched=self._on_matched)
        # The distribution whose markers are not published yet, and its stamp.
        self._newest: tuple[Tally, Time] | None = None
        self._frame = check_frame(node.get_parameter(FRAME_ID.name).value)
        self._surroundings = SurroundingsMarkers(node, parts, files, self._frame)
        self.poses = CurrentPosesPublisher(node, self._timer.start, self._frame)
        self._shown: tuple[str, PartMarkers] | None = None  # part_sha256, its markers
        on_change(node, PUBLISH_PERIOD.name, PUBLISH_PERIOD.check, self._timer.set_period)

    def change(self, tally: Tally) -> None:
        """Store a distribution to be published next, unless one with more drops is published.

        One of another version of the part or of other conditions is replaced in any case.
        """
        part, kind = tally.run.part, _kind(tally)
        waiting = self._changed.get(part)
        more = [self._published.get(part, (None, 0))]
        more += [(_kind(waiting), waiting.drops)] if waiting is not None else []
        if any(known == kind and drops > tally.drops for known, drops in more):
            return
        self._changed.pop(part, None)
        self._changed[part] = tally
        self._timer.start()

    def restore(self, tally: Tally) -> None:
        """Store the distribution of earlier runs, unless its part version is published."""
        part = tally.run.part
        published = self._published.get(part, ((None,), 0))[0]
        if published[0] != tally.run.part_sha256 and part not in self._changed:
            self.change(tally)

    def publish(self) -> None:
        """Publish the changed distributions, markers and poses."""
        # A distribution that is complete except for its model range is published with it.
        changed = {k: each for k, each in self._changed.items() if not each.awaits_range}
        self._changed = {}
        for part, tally in changed.items():
            stamp = self._node.get_clock().now().to_msg()
            message = distribution_msg(
                tally.counted, tally.run, stamp, tally.complete, self._frame
            )
            self.topics.publish(part, message)
            self._published[part] = _kind(tally), tally.drops
        if changed:
            newest = next(reversed(changed.values()))
            self._newest = newest, stamp
            self._surroundings.show(newest.run)
        self._publish_markers()
        self.poses.publish()

    def _publish_markers(self) -> None:
        """Publish the markers of the newest distribution: at its end, or for a subscriber.

        A message takes many times as long as a distribution.
        """
        if self._newest is None:
            return
        newest, stamp = self._newest
        if newest.complete or self._markers.get_subscription_count():
            self._newest = None
            markers = self._markers_of(newest.run.part_sha256)
            self._markers.publish(markers.message(newest.counted, stamp))

    def _work(self) -> bool:
        self.publish()
        return False

    def _on_matched(self, _: object) -> None:
        self._timer.start()

    def _markers_of(self, part_sha256: str) -> PartMarkers:
        if self._shown is None or self._shown[0] != part_sha256:
            part, aspects = self._parts.version(part_sha256)
            self._shown = (part_sha256, PartMarkers(part, aspects, self._frame))
        return self._shown[1]


def _kind(tally: Tally) -> tuple[str, object]:
    """Return what two distributions have in common that can replace each other."""
    return tally.run.part_sha256, tally.run.conditions.key()


class CurrentPosesPublisher:
    """Publishes current_poses: the newest settled drops of a run.

    Without a subscriber it does not create messages; a late subscriber receives the newest poses.

    changed : called when there are new poses, or a subscriber has appeared
    """

    def __init__(self, node: Node, changed: Callable[[], None], frame: str = FRAME) -> None:
        self._frame = frame
        self._on_change = changed
        self._publisher = advertise(
            node, PoseArray, CURRENT_POSES, LATCHED, matched=lambda _: changed()
        )
        self._run_id = ''
        self._position = np.zeros((0, 3))
        self._orientation = np.zeros((0, 4))
        self._stamp = Time()
        self._changed = False

    def take(self, run_id: str, poses: RestingPoses, stamp: Time) -> None:
        """Store the poses of a batch; those of another run are removed."""
        known = len(self._position) if run_id == self._run_id else 0
        settled = np.flatnonzero(poses.status == RestStatus.SETTLED)[-MAX_SHOWN:]
        position = np.concatenate([self._position[:known], poses.position[settled]])
        orientation = np.concatenate([self._orientation[:known], poses.orientation[settled]])
        self._position, self._orientation = position[-MAX_SHOWN:], orientation[-MAX_SHOWN:]
        self._run_id, self._stamp, self._changed = run_id, stamp, True
        self._on_change()

    def publish(self) -> None:
        """Publish the poses if they are new and the topic has a subscriber."""
        if not self._changed or not self._publisher.get_subscription_count():
            return
        self._changed = False
        rows = zip(self._position, self._orientation, strict=True)
        self._publisher.publish(
            PoseArray(
                header=Header(stamp=self._stamp, frame_id=self._frame),
                poses=[pose_msg(position, orientation) for position, orientation in rows],
            )
        )

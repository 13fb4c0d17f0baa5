"""Publishers of the classifier: distributions, markers for RViz, and the newest poses."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion, Vector3
from rclpy.node import Node
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    SurroundingsBody,
    SurroundingsDescription,
)
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.support import ContactPlane
from resting_aspects_ros.nodes.aspect_classifier.counting import Tally
from resting_aspects_ros.nodes.aspect_classifier.known import PartRegistry
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import aspect_colour, probability_text, rgb
from resting_aspects_ros.report.picture import aspect_poses, message_part, plane_patch
from resting_aspects_ros.ros.callbacks import PartTopics, WorkTimer, advertise, start_task
from resting_aspects_ros.ros.conversions import (
    check_surroundings,
    message_from,
    pose_msg,
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
from resting_aspects_ros.simulation.job import RunDescription
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
        shown = message_part(part, len(aspects))
        triangles = shown.vertices[shown.faces].reshape(-1, 3)
        points = [Point(**xyz(point)) for point in triangles]
        self._meshes, self._texts = [], []
        for one, aspect in zip(aspect_poses(shown, aspects), aspects, strict=True):
            pose, (x, y, _) = pose_msg(one.position, one.orientation), one.centre_of_mass.tolist()
            mesh = _mesh(MESHES, aspect.id, aspect_colour(aspect), 1.0, points, pose)
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


def _mesh(
    name: str, number: int, colour: str, opacity: float, points: list[Point], pose: Pose
) -> Marker:
    """Return the marker of triangles, whose corners are the points one after another."""
    return Marker(
        ns=name,
        id=number,
        type=Marker.TRIANGLE_LIST,
        action=Marker.ADD,
        pose=pose,
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=_colour(colour, opacity),
        points=points,
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
# Maximum number of descriptions that are kept.
MAX_KEPT = 10


def surroundings_markers(message: SurroundingsDescription, radius: float) -> MarkerArray:
    """Return the markers of surroundings for a part of a hull radius, m."""
    planes = {
        k: ContactPlane(body.name, np.array(body.plane[0].coef[:3]), -body.plane[0].coef[3])
        for k, body in enumerate(message.bodies)
        if body.plane
    }
    markers = [Marker(action=Marker.DELETEALL)]
    for k, body in enumerate(message.bodies):
        if k in planes:
            others = [plane for other, plane in planes.items() if other != k]
            corners, faces = plane_patch(planes[k], others, np.zeros(3), PATCH * radius)
            points = [Point(**xyz(corner)) for corner in corners[faces].reshape(-1, 3)]
        else:
            (mesh,) = body.mesh
            points = [mesh.vertices[i] for each in mesh.triangles for i in each.vertex_indices]
        if points:
            markers += _body_markers(k, body, points, NAME_LETTERS * radius)
    for marker in markers:
        marker.header = Header(frame_id=message.header.frame_id)
    return MarkerArray(markers=markers)


def serialized_markers(description: bytes, radius: float) -> bytes:
    """Return the serialized markers of a serialized description; runs in a FileWorker."""
    return bytes(serialize_message(surroundings_markers(message_from(description), radius)))


class SurroundingsMarkers:
    """Publishes surroundings_markers: the surroundings of the run whose distribution changed last.

    files : creates the markers, so that a mesh cannot block the node
    """

    def __init__(self, node: Node, parts: PartRegistry, files: FileWorker) -> None:
        self._node = node
        self._parts = parts
        self._files = files
        self._publisher = advertise(node, MarkerArray, SURROUNDINGS_MARKERS, LATCHED)
        self._descriptions: dict[str, bytes] = {}  # by run id
        self._wanted: RunDescription | None = None
        self._shown = b''  # the description
        TopicDiscovery(
            node, SURROUNDINGS, SurroundingsDescription, self._take, raw=True, qos=SURROUNDINGS_QOS
        )

    def show(self, run: RunDescription) -> None:
        """Publish the markers for a run, once its surroundings are described."""
        self._wanted = run
        description = self._descriptions.get(run.run_id, b'')  # none for the infinite plane
        if description == self._shown:
            return
        self._shown = description
        if description:
            start_task(self._node, 'surroundings are not shown', self._publish, run, description)
        else:
            self._publisher.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))

    async def _publish(self, run: RunDescription, description: bytes) -> None:
        part, _ = self._parts.version(run.part_sha256)
        data = await self._files.run(serialized_markers, description, part.hull_radius)
        if self._shown == description:
            self._publisher.publish(data)

    def _take(self, part: str, data: bytes) -> None:
        message = message_from(data)
        check_surroundings(message, part)
        self._descriptions[message.run_id] = data
        while len(self._descriptions) > MAX_KEPT:
            self._descriptions.pop(next(iter(self._descriptions)))
        if self._wanted is not None:
            self.show(self._wanted)


def _body_markers(
    k: int, body: SurroundingsBody, points: list[Point], size: float
) -> list[Marker]:
    """Return the triangles of a body and its name, with letters of a height, m."""
    upright = Pose(orientation=Quaternion(w=1.0))
    mesh = _mesh(BODIES, k, COLOURS[k % len(COLOURS)], OPACITY, points, upright)
    top = max(points, key=lambda point: point.z)
    name = _text(NAMES, k, top.x, top.y, top.z + size, size)
    speed = math.hypot(body.velocity.x, body.velocity.y, body.velocity.z)
    name.text = f'{body.name}, {speed:g} m/s' if speed else body.name
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
        self._newest: dict[str, Tally] = {}  # by part
        self._changed: dict[str, Tally] = {}  # those to be published, in the order of changes
        period = node.get_parameter(PUBLISH_PERIOD.name).value
        self._timer = WorkTimer(node, period, 'distributions are not published', self._work)
        self._markers = advertise(node, MarkerArray, MARKERS, LATCHED, matched=self._on_matched)
        # The distribution whose markers are not published yet, and its stamp.
        self._unmarked: tuple[Tally, Time] | None = None
        self._frame = check_frame(node.get_parameter(FRAME_ID.name).value)
        self._surroundings = SurroundingsMarkers(node, parts, files)
        self.poses = CurrentPosesPublisher(node, self._timer.start, self._frame)
        self._shown: tuple[str, PartMarkers] | None = None  # part_sha256, its markers
        on_change(node, PUBLISH_PERIOD.name, PUBLISH_PERIOD.check, self._timer.set_period)

    def change(self, tally: Tally) -> None:
        """Store a distribution to be published next, unless one with more drops is known.

        One of another version of the part or of other conditions is replaced in any case.
        """
        part, known = tally.run.part, self._newest.get(tally.run.part)
        if known is not None and known.drops > tally.drops and _kind(known) == _kind(tally):
            return
        self._newest[part] = tally
        self._changed.pop(part, None)
        self._changed[part] = tally
        self._timer.start()

    def restore(self, tally: Tally) -> None:
        """Store the distribution of earlier runs, unless one of its part version is known."""
        known = self._newest.get(tally.run.part)
        if known is None or known.run.part_sha256 != tally.run.part_sha256:
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
        if changed:
            newest = next(reversed(changed.values()))
            self._unmarked = newest, stamp
            self._surroundings.show(newest.run)
        self._publish_markers()
        self.poses.publish()

    def _publish_markers(self) -> None:
        """Publish the markers of the newest distribution: at its end, or for a subscriber.

        A message takes many times as long as a distribution.
        """
        if self._unmarked is None:
            return
        newest, stamp = self._unmarked
        if newest.complete or self._markers.get_subscription_count():
            self._unmarked = None
            sha = newest.run.part_sha256
            if self._shown is None or self._shown[0] != sha:
                self._shown = sha, PartMarkers(*self._parts.version(sha), self._frame)
            self._markers.publish(self._shown[1].message(newest.counted, stamp))

    def _work(self) -> bool:
        self.publish()
        return False

    def _on_matched(self, _: object) -> None:
        self._timer.start()


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
        self._poses: deque[tuple[Array, Array]] = deque(maxlen=MAX_SHOWN)
        self._stamp = Time()
        self._changed = False

    def take(self, run_id: str, poses: RestingPoses, stamp: Time) -> None:
        """Store the poses of a batch; those of another run are removed."""
        if run_id != self._run_id:
            self._poses.clear()
        settled = np.flatnonzero(poses.status == RestStatus.SETTLED)[-MAX_SHOWN:]
        self._poses.extend(zip(poses.position[settled], poses.orientation[settled], strict=True))
        self._run_id, self._stamp, self._changed = run_id, stamp, True
        self._on_change()

    def publish(self) -> None:
        """Publish the poses if they are new and the topic has a subscriber."""
        if not self._changed or not self._publisher.get_subscription_count():
            return
        self._changed = False
        self._publisher.publish(
            PoseArray(
                header=Header(stamp=self._stamp, frame_id=self._frame),
                poses=[pose_msg(position, orientation) for position, orientation in self._poses],
            )
        )

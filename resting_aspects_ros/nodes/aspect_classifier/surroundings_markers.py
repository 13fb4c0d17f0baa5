"""RViz markers of surroundings: finite patches of the planes, and meshes."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from rclpy.node import Node
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import SurroundingsDescription
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from resting_aspects_ros.api.conditions import scene_of
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import rgb
from resting_aspects_ros.ros.callbacks import advertise, guarded_task
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import (
    LATCHED,
    SURROUNDINGS,
    SURROUNDINGS_MARKERS,
    SURROUNDINGS_QOS,
)
from resting_aspects_ros.ros.surroundings_conversions import (
    check_surroundings,
    message_from,
    serialized_surroundings,
    triangles_in_tray,
)
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.scene import HalfSpace, MeshBody, Scene, SceneBody

# Namespaces of the markers; the id of a marker is the place of the body in the surroundings.
BODIES, NAMES = 'bodies', 'body_names'
# Half the length of a patch of a plane, R. Drops in a chute spread by about 10 R.
PATCH = 20.0
# Height of the letters, R.
LETTERS = 0.5
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
        self._descriptions: dict[str, bytes] = {}  # of meshes, by document
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
        assert self._node.executor is not None  # this is called by it
        self._node.executor.create_task(
            guarded_task(self._node, 'surroundings are not shown', self._publish), run
        )

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
        if not message.mesh_sha256 or message.document in self._descriptions:
            return
        self._descriptions[message.document] = data
        while len(self._descriptions) > MAX_KEPT:
            self._descriptions.pop(next(iter(self._descriptions)))
        if self._wanted and self._wanted.conditions.surroundings_key == message.document:
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
    red, green, blue = rgb(COLOURS[k % len(COLOURS)])
    opacity = 1.0 if isinstance(body, MeshBody) else OPACITY
    speed = f', {body.contact.speed:g} m/s' if body.contact.speed else ''
    top = points[np.argmax(points[:, 2])]
    upright = Quaternion(w=1.0)
    return [
        Marker(
            ns=BODIES,
            id=k,
            type=Marker.TRIANGLE_LIST,
            action=Marker.ADD,
            pose=Pose(orientation=upright),
            scale=Vector3(x=1.0, y=1.0, z=1.0),
            color=ColorRGBA(r=red, g=green, b=blue, a=opacity),
            points=[Point(x=x, y=y, z=z) for x, y, z in points.tolist()],
        ),
        Marker(
            ns=NAMES,
            id=k,
            type=Marker.TEXT_VIEW_FACING,
            action=Marker.ADD,
            pose=Pose(
                position=Point(x=top[0], y=top[1], z=top[2] + LETTERS * radius),
                orientation=upright,
            ),
            scale=Vector3(z=LETTERS * radius),
            color=ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0),
            text=f'{body.name}{speed}',
        ),
    ]

"""Conversions between the surroundings of a run and ROS messages."""

import dataclasses

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point, Vector3
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import SurroundingsBody, SurroundingsDescription
from shape_msgs.msg import Mesh, MeshTriangle, Plane
from std_msgs.msg import Header

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.ros.conversions import time_msg
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation.job import RunDescription as Run
from resting_aspects_ros.simulation.scene import (
    Block,
    HalfSpace,
    MeshBody,
    Scene,
    SceneBody,
)
from resting_aspects_ros.simulation.surroundings import Surroundings, surroundings_from
from resting_aspects_ros.simulation.surroundings_kinds import MeshSurface, mesh_file

# Corners of the unit cube, and its triangles, which point outward.
_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
_FACES = (
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
)


def surroundings_msg(run: Run, scene: Scene, frame: str = FRAME) -> SurroundingsDescription:
    """Return the message that describes the surroundings of a run completely."""
    found = run.conditions.surroundings
    assert found is not None  # the scene is that of the surroundings
    message = SurroundingsDescription(
        header=Header(stamp=time_msg(run.started), frame_id=frame),
        part=run.part,
        run_id=run.run_id,
        name=found.name or found.shape.kind,
        document=found.key,
        text=found.text,
        bodies=[_body_msg(scene, body) for body in scene.bodies],
    )
    if isinstance(found.shape, MeshSurface):
        mesh = found.shape.file
        assert mesh is not None  # otherwise there is no scene
        message.mesh_file, message.mesh_sha256, message.mesh = mesh.name, mesh.sha256, mesh.data
    return message


def surroundings_from_msg(message: SurroundingsDescription) -> Surroundings:
    """Return the surroundings in a message, with their mesh.

    Parses a mesh file: a node calls it in a FileWorker. Raises InvalidValueError or PartError.
    """
    mesh = None
    if message.mesh_sha256:
        label = f'mesh {shown(message.mesh_file)} of the surroundings of {shown(message.part)}'
        mesh = mesh_file(bytes(message.mesh), message.mesh_file, label)
        if mesh.sha256 != message.mesh_sha256:
            raise InvalidValueError(
                f'invalid {label}: expected the hash {shown(message.mesh_sha256)}'
            )
    found = surroundings_from(message.document, mesh)
    if found is None:
        raise InvalidValueError("invalid document '' of surroundings: expected a JSON document")
    return dataclasses.replace(found, name=message.name)


def serialized_surroundings(data: bytes) -> Surroundings:
    """Return the surroundings in a serialized message; see surroundings_from_msg."""
    return surroundings_from_msg(message_from(data))


def message_from(data: bytes) -> SurroundingsDescription:
    """Return a serialized message; RuntimeError if it is unreadable."""
    return deserialize_message(data, SurroundingsDescription)


def check_surroundings(message: SurroundingsDescription, part: str) -> None:
    """Raise InvalidValueError if a message on surroundings/<part> is not of that part."""
    if message.part != part:
        raise InvalidValueError(
            f'invalid surroundings of part {part!r}: expected this name; they have the name '
            f'{shown(message.part)}'
        )


def _body_msg(scene: Scene, body: SceneBody) -> SurroundingsBody:
    velocity = scene.in_tray(body.velocity[None])[0]
    message = SurroundingsBody(
        name=body.name,
        friction=body.contact.friction,
        restitution=body.contact.restitution,
        rolling_friction=body.contact.rolling_friction,
        velocity=Vector3(**_xyz(velocity)),
    )
    if isinstance(body, HalfSpace):
        normal = scene.in_tray(body.normal[None])[0].tolist()
        message.plane = [Plane(coef=[*normal, -body.offset])]
    else:
        message.mesh = [_mesh_msg(scene, body)]
    return message


def triangles_in_tray(scene: Scene, body: SceneBody) -> Array:
    """Return the triangles (m, 3, 3) of a block or a mesh in the tray frame, m."""
    vertices, triangles = _surface(body)
    return scene.in_tray(vertices)[triangles]


def _surface(body: SceneBody) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return vertices, scene frame, and triangles of a block or a mesh."""
    if isinstance(body, MeshBody):
        return body.vertices, body.triangles
    assert isinstance(body, Block)
    return body.low + (body.high - body.low) * _CORNERS, np.array(_FACES)


def _mesh_msg(scene: Scene, body: SceneBody) -> Mesh:
    vertices, triangles = _surface(body)
    vertices = scene.in_tray(vertices)
    return Mesh(
        vertices=[Point(**_xyz(vertex)) for vertex in vertices],
        triangles=[
            MeshTriangle(vertex_indices=np.array(triangle, dtype=np.uint32))
            for triangle in triangles.tolist()
        ],
    )


def _xyz(vector: Array) -> dict[str, float]:
    return dict(zip('xyz', vector.tolist(), strict=True))

"""Conversions between the types of the suite and ROS messages."""

from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Inertia, Point, Point32, Polygon, Pose, Quaternion, Vector3
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    DropConditions,
    Outline,
    PartCandidate,
    PartDescription,
    PartOutlines,
    RunDescription,
    SurroundingsBody,
    SurroundingsDescription,
)
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg
from resting_aspects_interfaces.msg import Surroundings as SurroundingsMsg
from shape_msgs.msg import Mesh, MeshTriangle, Plane
from std_msgs.msg import Header

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.errors import InvalidValueError, one_line, shown
from resting_aspects_ros.part.loading import FORMATS, part_from_bytes
from resting_aspects_ros.part.part import Part, is_valid_name
from resting_aspects_ros.report.outlines import polygon_fields
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation import conditions as drop_conditions
from resting_aspects_ros.simulation.conditions import check_drops
from resting_aspects_ros.simulation.job import RunDescription as Run
from resting_aspects_ros.simulation.job import check_first_drop, check_run_id
from resting_aspects_ros.simulation.scene import Block, HalfSpace, MeshBody, Scene, SceneBody
from resting_aspects_ros.simulation.surroundings import Surroundings, described_surroundings
from resting_aspects_ros.simulation.surroundings_kinds import MeshSurface, mesh_file
from resting_aspects_ros.statistics.poses import RestingPoses
from resting_aspects_ros.vision import outline as part_outline
from resting_aspects_ros.vision.outline import LookAlike
from resting_aspects_ros.vision.rolling import Candidate

NANOSECONDS = 1_000_000_000
# Maximum number of drops in a message with poses.
MAX_POSES = 10_000
# Columns of a message with poses, and the number of values of each drop.
POSE_COLUMNS = {
    'position': 3,
    'orientation': 4,
    'status': 1,
    'decided_by': 1,
    'time_to_rest': 1,
    'energy_growth': 1,
}
# Fields of the tensor in geometry_msgs/Inertia, in the order of the upper triangle.
INERTIA = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
# Fields of a message with the texts of a mesh surface.
_MESH_FIELDS = {'mesh': 'mesh', 'unit': 'mesh_unit', 'mesh_sha256': 'mesh_sha256'}


def shared(source: object, kind: Any) -> dict[str, Any]:
    """Return the values of an object whose names are fields of a message type or a dataclass.

    Types and messages of the suite use the same names. What has another type in the message is
    replaced by the caller.
    """
    names = (
        [each.name for each in fields(kind)]
        if is_dataclass(kind)
        else list(kind.get_fields_and_field_types())
    )
    return {name: getattr(source, name) for name in names if hasattr(source, name)}


def time_msg(nanoseconds: int) -> Time:
    """Return a time message from nanoseconds since the epoch."""
    return Time(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def nanoseconds(stamp: Time) -> int:
    """Return the nanoseconds since the epoch of a time message."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def conditions_msg(conditions: drop_conditions.DropConditions) -> DropConditions:
    """Return the message for conditions."""
    values = shared(conditions, DropConditions)
    values['height_of'] = int(conditions.height_of)
    values['surroundings'] = surroundings_msg(conditions.surroundings)
    return DropConditions(**values)


def conditions_from(msg: DropConditions) -> drop_conditions.DropConditions:
    """Return the conditions in a message; raises InvalidValueError for an invalid value.

    A mesh surface has no mesh: a node that only counts poses does not need it.
    """
    values = shared(msg, drop_conditions.DropConditions)
    values['surroundings'] = surroundings_of(msg.surroundings)
    return drop_conditions.DropConditions(**values)


def surroundings_msg(found: Surroundings | None) -> SurroundingsMsg:
    """Return the message for the values of surroundings; None is an infinite level plane."""
    if found is None or found.level:
        return SurroundingsMsg()
    groups = {**found.bodies, 'release': found.release}
    values = found.shape.numbers | {
        f'{group}.{name}': value for group, each in groups.items() for name, value in each.items()
    }
    q = found.orientation
    return SurroundingsMsg(
        kind=found.shape.kind,
        name=found.name,
        names=list(values),
        values=list(values.values()),
        orientation=[] if q is None else [quaternion_msg(q)],
        **{_MESH_FIELDS[name]: text for name, text in found.shape.texts.items()},
    )


def surroundings_of(msg: SurroundingsMsg) -> Surroundings | None:
    """Return the surroundings in a message, without a mesh; None for one without any value.

    Raises InvalidValueError for an invalid value.
    """
    if msg == SurroundingsMsg():
        return None
    values = dict(zip(msg.names, msg.values, strict=False))
    if not len(values) == len(msg.names) == len(msg.values):
        raise InvalidValueError(
            f'invalid names of surroundings: expected {len(msg.values)} different names, one of '
            'each value'
        )
    texts = {name: getattr(msg, field) for name, field in _MESH_FIELDS.items()}
    document = {'kind': msg.kind} | {name: text for name, text in texts.items() if text}
    for each in msg.orientation:
        document['orientation'] = (each.x, each.y, each.z, each.w)
    return described_surroundings(document, values, one_line(msg.name))


def run_msg(run: Run) -> RunDescription:
    """Return the message for the description of a run."""
    values = shared(run, RunDescription)
    values |= {'conditions': conditions_msg(run.conditions), 'started': time_msg(run.started)}
    return RunDescription(**values)


def run_from(msg: RunDescription) -> Run:
    """Return the run description in a message; raises InvalidValueError for an invalid value."""
    if not msg.run_id:
        raise InvalidValueError("invalid run_id '': expected the id of a run")
    check_run_id(msg.run_id)
    if not is_valid_name(msg.part):
        raise InvalidValueError(
            f'invalid part {shown(msg.part)} of run {msg.run_id}: expected the name of a part'
        )
    check_drops(msg.drops)
    check_first_drop(msg.first_drop, msg.drops)
    values = shared(msg, Run)
    values |= {'conditions': conditions_from(msg.conditions), 'started': nanoseconds(msg.started)}
    return Run(**values)


def poses_msgs(
    poses: RestingPoses, run: Run, stamp: Time, *, last: bool, frame: str = FRAME
) -> list[RestingPosesMsg]:
    """Return the messages for poses of a run, at least one, each with at most MAX_POSES drops.

    last : whether the poses end the run
    """
    header, described = Header(stamp=stamp, frame_id=frame), run_msg(run)
    messages = []
    for first in range(poses.first_drop, max(poses.end, poses.first_drop + 1), MAX_POSES):
        piece = poses.between(first, first + MAX_POSES)
        columns = {name: column(getattr(piece, name)) for name in POSE_COLUMNS}
        messages.append(
            RestingPosesMsg(header=header, run=described, first_drop=piece.first_drop, **columns)
        )
    messages[-1].last = last
    return messages


def column(values: npt.NDArray[Any]) -> 'array[Any]':
    """Return the values of an array in order; rclpy checks every element of anything else."""
    types = {'uint8': 'B', 'int64': 'Q', 'float64': 'd'}
    column: array[Any] = array(types[values.dtype.name])
    column.frombytes(np.ascontiguousarray(values).tobytes())
    return column


def xyz(vector: Array) -> dict[str, float]:
    """Return the fields of a message for a vector (3,)."""
    return dict(zip('xyz', vector.tolist(), strict=True))


def quaternion_msg(xyzw: Iterable[float]) -> Quaternion:
    """Return the message for a quaternion (4,)."""
    return Quaternion(**dict(zip('xyzw', map(float, xyzw), strict=True)))


def xyzw(msg: Quaternion) -> Array:
    """Return the quaternion (4,) in a message."""
    return np.array([msg.x, msg.y, msg.z, msg.w])


def pose_msg(position: Array, orientation: Array) -> Pose:
    """Return the message for a pose; the orientation is a quaternion xyzw."""
    return Pose(position=Point(**xyz(position)), orientation=quaternion_msg(orientation))


def poses_from(msg: RestingPosesMsg) -> RestingPoses:
    """Return the poses in a message; raises InvalidValueError for an invalid pose or code."""
    n = len(msg.status)
    columns = {}
    for name, width in POSE_COLUMNS.items():
        values = np.array(getattr(msg, name))
        if len(values) != width * n:
            raise InvalidValueError(
                f'invalid number of values {len(values)} of {name}: expected {width * n} for '
                f'{n} drops'
            )
        columns[name] = values.reshape(n, width) if width > 1 else values
    poses = RestingPoses(int(msg.first_drop), **columns)
    check_first_drop(poses.first_drop, n)
    poses.check()
    return poses


def part_msg(part: Part) -> PartDescription:
    """Return the message that describes a part completely."""
    tensor = dict(zip(INERTIA, part.inertia[np.triu_indices(3)].tolist(), strict=True))
    return PartDescription(
        name=part.name,
        mesh_sha256=part.mesh_sha256,
        part_sha256=part.part_sha256,
        format=part.mesh_format,
        mesh=part.mesh_bytes,
        unit=part.unit,
        inertia=Inertia(m=part.mass, com=Vector3(**xyz(part.centre_of_mass)), **tensor),
        body=part.body,
    )


def check_description(msg: PartDescription, name: str) -> None:
    """Raise InvalidValueError if a description on parts/<name> is not of that part."""
    if msg.name != name or msg.format not in FORMATS:
        raise InvalidValueError(
            f'invalid description of part {name!r}: expected this name and a format of '
            f'{", ".join(FORMATS)}; it has name {shown(msg.name)} and format {shown(msg.format)}'
        )


def part_from(msg: PartDescription) -> Part:
    """Return the part in a message; raises PartError or InvalidValueError if it is invalid."""
    inertia = msg.inertia
    return part_from_bytes(
        bytes(msg.mesh),
        msg.format,
        msg.name,
        unit=msg.unit,
        mass=inertia.m,
        centre_of_mass=(inertia.com.x, inertia.com.y, inertia.com.z),
        inertia=np.array([getattr(inertia, name) for name in INERTIA]),
        body=msg.body or None,
    )


def serialized_poses(data: bytes) -> tuple[Run, RestingPoses, bool]:
    """Return run, poses and `last` of a serialized message; RuntimeError if it is unreadable."""
    msg = deserialize_message(data, RestingPosesMsg)
    return run_from(msg.run), poses_from(msg), bool(msg.last)


def serialized_part(data: bytes) -> Part:
    """Return the part of a serialized description; RuntimeError if it is unreadable."""
    return part_from(deserialize_message(data, PartDescription))


# -- surroundings ---------------------------------------------------------------------------------


def description_msg(run: Run, scene: Scene, frame: str = FRAME) -> SurroundingsDescription:
    """Return the message that describes the surroundings of a run completely."""
    found = run.conditions.surroundings
    assert found is not None  # the scene is that of the surroundings
    message = SurroundingsDescription(
        header=Header(stamp=time_msg(run.started), frame_id=frame),
        part=run.part,
        run_id=run.run_id,
        surroundings=surroundings_msg(found),
        text=found.text,
        bodies=[_body_msg(scene, body) for body in scene.bodies],
    )
    if found.shape.file is not None:
        message.mesh = found.shape.file.data
    return message


def serialized_surroundings(data: bytes) -> Surroundings:
    """Return the surroundings in a serialized message, with their mesh.

    Parses a mesh file: a node calls it in a FileWorker. Raises InvalidValueError or PartError.
    """
    message = message_from(data)
    found = surroundings_of(message.surroundings)
    if found is None:
        raise InvalidValueError("invalid kind '' of surroundings: expected one")
    shape = found.shape
    if not isinstance(shape, MeshSurface):
        return found
    label = f'mesh {shown(shape.mesh)} of the surroundings of {shown(message.part)}'
    mesh = mesh_file(bytes(message.mesh), shape.mesh, label)
    if mesh.sha256 != shape.mesh_sha256:
        raise InvalidValueError(f'invalid {label}: expected the hash {shown(shape.mesh_sha256)}')
    return found.with_mesh(mesh)


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
        velocity=Vector3(**xyz(velocity)),
    )
    if isinstance(body, HalfSpace):
        normal = scene.in_tray(body.normal[None])[0].tolist()
        message.plane = [Plane(coef=[*normal, -body.offset])]
    else:
        message.mesh = [_mesh_msg(scene, body)]
    return message


def _surface(body: SceneBody) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return vertices, scene frame, and triangles of a block or a mesh."""
    if isinstance(body, MeshBody):
        return body.vertices, body.triangles
    import trimesh  # takes half a second; most surroundings are half-spaces

    assert isinstance(body, Block)
    box = trimesh.creation.box(bounds=(body.low, body.high))
    return np.asarray(box.vertices), np.asarray(box.faces)


def _mesh_msg(scene: Scene, body: SceneBody) -> Mesh:
    vertices, triangles = _surface(body)
    vertices = scene.in_tray(vertices)
    return Mesh(
        vertices=[Point(**xyz(vertex)) for vertex in vertices],
        triangles=[
            MeshTriangle(vertex_indices=np.array(triangle, dtype=np.uint32))
            for triangle in triangles.tolist()
        ],
    )


# -- outlines and identified parts ----------------------------------------------------------------


# By the verdict of a LookAlike.
VERDICTS = {
    'distinct': Outline.DISTINCT,
    'same': Outline.SAME,
    'mirrored': Outline.MIRRORED,
}


def outlines_msg(
    part: Part,
    outlines: Sequence[part_outline.Outline],
    look_alikes: Mapping[int, Sequence[LookAlike]],
) -> PartOutlines:
    """Return the message for the outlines of a part.

    look_alikes : by symmetry class, the comparisons with the outlines of the other classes
    """
    return PartOutlines(
        part=part.name,
        part_sha256=part.part_sha256,
        aspect_numbering=ASPECT_NUMBERING,
        outlines=[_outline_msg(each, look_alikes[each.symmetry_class]) for each in outlines],
    )


def _outline_msg(outline: part_outline.Outline, others: Sequence[LookAlike]) -> Outline:
    x, y = outline.centroid.tolist()
    family = [polygon_msgs(each) for each in outline.family]
    values = shared(outline, Outline) | polygon_msgs(outline.polygon)
    values |= {
        'orientation': quaternion_msg(outline.orientation),
        'centroid': Point(x=x, y=y),
        'family': [each['outer'] for each in family],
        'family_holes': [hole for each in family for hole in each['holes']],
        'family_hole_of': [k for k, each in enumerate(family) for _ in each['holes']],
        'other_class': [each.symmetry_class for each in others],
        'other_overlap': [each.overlap for each in others],
        'other_resolution': [each.resolution for each in others],
        'other_verdict': [VERDICTS[each.verdict] for each in others],
    }
    return Outline(**values)


def polygon_msgs(polygon: Any) -> dict[str, Any]:
    """Return the fields ``outer`` and ``holes`` of a shapely.Polygon; coordinates have 32 bits."""
    rings: dict[str, Any] = polygon_fields(polygon)
    return {'outer': _ring_msg(rings['outer']), 'holes': [_ring_msg(r) for r in rings['holes']]}


def polygon_from(outer: Polygon, holes: Iterable[Polygon]) -> dict[str, Any]:
    """Return the boundaries as `observed_polygon` accepts them; they are not checked."""
    return {'outer': _ring(outer), 'holes': [_ring(each) for each in holes]}


def candidate_msg(candidate: Candidate) -> PartCandidate:
    """Return the message for a candidate of an identification."""
    poses = candidate.poses
    values = shared(candidate, PartCandidate) | {
        'poses': [pose_msg(each.position, each.orientation) for each in poses],
        'pose_aspects': [each.aspect for each in poses],
        'yaw_known': all(each.yaw_known for each in poses),
    }
    return PartCandidate(**values)


def _ring_msg(points: Iterable[tuple[float, float]]) -> Polygon:
    return Polygon(points=[Point32(x=x, y=y) for x, y in points])


def _ring(polygon: Polygon) -> Array:
    points = np.array([(p.x, p.y) for p in polygon.points], dtype=np.float64)
    return points.reshape(-1, 2)

"""Conversions between the types of the suite and ROS messages."""

from array import array
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Inertia, Point, Pose, Quaternion, Vector3
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    DropConditions,
    PartDescription,
    RunDescription,
    Status,
)
from resting_aspects_interfaces.msg import RestingPoses as RestingPosesMsg
from std_msgs.msg import Header

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.loading import FORMATS, part_from_bytes
from resting_aspects_ros.part.part import Part, is_valid_name
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation import conditions as drop_conditions
from resting_aspects_ros.simulation.job import RunDescription as Run
from resting_aspects_ros.simulation.job import (
    check_drops,
    check_first_drop,
    check_run_id,
)
from resting_aspects_ros.simulation.surroundings import Surroundings, surroundings_from
from resting_aspects_ros.statistics.poses import RestingPoses

NANOSECONDS = 1_000_000_000
# Maximum length of the JSON document of surroundings; those of the suite have 300 characters.
MAX_DOCUMENT = 100_000
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
# Fields with the same name and type in RunDescription and its message.
_RUN_FIELDS = {field.name for field in fields(Run)} - {'conditions', 'started'}


def status(code: int, message: str = '') -> Status:
    """Return a status message; its text is for the user."""
    return Status(code=code, message=message)


def time_msg(nanoseconds: int) -> Time:
    """Return a time message from nanoseconds since the epoch."""
    return Time(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def nanoseconds(stamp: Time) -> int:
    """Return the nanoseconds since the epoch of a time message."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def conditions_msg(conditions: drop_conditions.DropConditions) -> DropConditions:
    """Return the message for conditions."""
    values = {name: getattr(conditions, name) for name in drop_conditions.QUANTITIES}
    return DropConditions(
        surface=conditions.surface,
        height_of=int(conditions.height_of),
        surroundings=conditions.surroundings_key,
        **values,
    )


def conditions_from(msg: DropConditions) -> drop_conditions.DropConditions:
    """Return the conditions in a message; raises InvalidValueError for an invalid value.

    A mesh surface has no mesh: a node that only counts poses does not need it.
    """
    values = {name: getattr(msg, name) for name in drop_conditions.QUANTITIES}
    return drop_conditions.DropConditions(
        surface=msg.surface,
        height_of=msg.height_of,
        surroundings=surroundings_of(msg.surroundings),
        **values,
    )


def surroundings_of(document: str) -> Surroundings | None:
    """Return the surroundings of a JSON document, without the mesh; InvalidValueError."""
    if len(document) > MAX_DOCUMENT:
        raise InvalidValueError(
            f'invalid surroundings {shown(document)}: expected at most {MAX_DOCUMENT} characters'
        )
    return surroundings_from(document)


def run_msg(run: Run) -> RunDescription:
    """Return the message for the description of a run."""
    same = {name: getattr(run, name) for name in _RUN_FIELDS}
    return RunDescription(
        conditions=conditions_msg(run.conditions), started=time_msg(run.started), **same
    )


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
    same = {name: getattr(msg, name) for name in _RUN_FIELDS}
    return Run(
        conditions=conditions_from(msg.conditions), started=nanoseconds(msg.started), **same
    )


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
        columns = {name: _column(getattr(piece, name)) for name in POSE_COLUMNS}
        messages.append(
            RestingPosesMsg(header=header, run=described, first_drop=piece.first_drop, **columns)
        )
    messages[-1].last = last
    return messages


def _column(values: npt.NDArray[Any]) -> 'array[Any]':
    """Return the buffer of an array; rclpy checks every element of anything else."""
    column: array[Any] = array('B' if values.dtype == np.uint8 else 'd')
    column.frombytes(np.ascontiguousarray(values).tobytes())
    return column


def pose_msg(position: list[float], orientation: list[float]) -> Pose:
    """Return the message for a pose; the orientation is a quaternion xyzw."""
    x, y, z = position
    qx, qy, qz, qw = orientation
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


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
    x, y, z = part.centre_of_mass.tolist()
    tensor = dict(zip(INERTIA, part.inertia[np.triu_indices(3)].tolist(), strict=True))
    return PartDescription(
        name=part.name,
        mesh_sha256=part.mesh_sha256,
        part_sha256=part.part_sha256,
        format=part.mesh_format,
        mesh=part.mesh_bytes,
        unit=part.unit,
        inertia=Inertia(m=part.mass, com=Vector3(x=x, y=y, z=z), **tensor),
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


def serialized_range(data: bytes) -> tuple[Run, int, int, bool]:
    """Return run, first drop, number of drops and `last` of a serialized message with poses."""
    msg = deserialize_message(data, RestingPosesMsg)
    return run_from(msg.run), int(msg.first_drop), len(msg.status), bool(msg.last)


def serialized_part(data: bytes) -> Part:
    """Return the part of a serialized description; RuntimeError if it is unreadable."""
    return part_from(deserialize_message(data, PartDescription))

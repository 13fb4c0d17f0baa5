"""Conversions between the types of the suite and ROS messages."""

from dataclasses import fields

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    DropConditions,
    PartDescription,
    RestingPose,
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


def poses_msg(
    poses: RestingPoses, run: Run, stamp: Time, last: bool, frame: str = FRAME
) -> RestingPosesMsg:
    """Return the message for a batch of poses."""
    rows = zip(
        poses.position.tolist(),
        poses.orientation.tolist(),
        poses.status.tolist(),
        poses.decided_by.tolist(),
        poses.time_to_rest.tolist(),
        poses.energy_growth.tolist(),
        strict=True,
    )
    return RestingPosesMsg(
        header=Header(stamp=stamp, frame_id=frame),
        run=run_msg(run),
        first_drop=poses.first_drop,
        poses=[
            RestingPose(
                pose=pose_msg(position, orientation),
                status=code,
                decided_by=decided_by,
                time_to_rest=rest,
                energy_growth=growth,
            )
            for position, orientation, code, decided_by, rest, growth in rows
        ],
        last=last,
    )


def pose_msg(position: list[float], orientation: list[float]) -> Pose:
    """Return the message for a pose; the orientation is a quaternion xyzw."""
    x, y, z = position
    qx, qy, qz, qw = orientation
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def poses_from(msg: RestingPosesMsg) -> RestingPoses:
    """Return the poses of a batch; raises InvalidValueError for an invalid pose or code."""
    position = [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in msg.poses]
    orientation = [(o.x, o.y, o.z, o.w) for o in (entry.pose.orientation for entry in msg.poses)]
    poses = RestingPoses(
        first_drop=msg.first_drop,
        position=np.array(position, dtype=np.float64).reshape(-1, 3),
        orientation=np.array(orientation, dtype=np.float64).reshape(-1, 4),
        status=np.array([p.status for p in msg.poses], dtype=np.uint8),
        decided_by=np.array([p.decided_by for p in msg.poses], dtype=np.uint8),
        time_to_rest=np.array([p.time_to_rest for p in msg.poses], dtype=np.float64),
        energy_growth=np.array([p.energy_growth for p in msg.poses], dtype=np.float64),
    )
    check_first_drop(poses.first_drop, len(poses))
    poses.check()
    return poses


def part_msg(part: Part) -> PartDescription:
    """Return the message that describes a part completely."""
    x, y, z = part.centre_of_mass.tolist()
    return PartDescription(
        name=part.name,
        mesh_sha256=part.mesh_sha256,
        part_sha256=part.part_sha256,
        format=part.mesh_format,
        mesh=part.mesh_bytes,
        unit=part.unit,
        mass=part.mass,
        centre_of_mass=Point(x=x, y=y, z=z),
        inertia=part.inertia[np.triu_indices(3)],
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
    centre = msg.centre_of_mass
    return part_from_bytes(
        bytes(msg.mesh),
        msg.format,
        msg.name,
        unit=msg.unit,
        mass=msg.mass,
        centre_of_mass=(centre.x, centre.y, centre.z),
        inertia=np.asarray(msg.inertia, dtype=np.float64),
        body=msg.body or None,
    )


def serialized_poses(data: bytes) -> tuple[Run, RestingPoses, bool]:
    """Return run, poses and `last` of a serialized batch; RuntimeError if it is unreadable."""
    msg = deserialize_message(data, RestingPosesMsg)
    return run_from(msg.run), poses_from(msg), bool(msg.last)


def serialized_batch(data: bytes) -> tuple[Run, int, int, bool]:
    """Return run, first drop, number of drops and `last` of a serialized batch."""
    msg = deserialize_message(data, RestingPosesMsg)
    return run_from(msg.run), int(msg.first_drop), len(msg.poses), bool(msg.last)


def serialized_part(data: bytes) -> Part:
    """Return the part of a serialized description; RuntimeError if it is unreadable."""
    return part_from(deserialize_message(data, PartDescription))

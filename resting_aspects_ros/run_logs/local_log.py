"""Write the log of a run that is simulated in this process, without nodes."""

import dataclasses
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rclpy.serialization import serialize_message

from resting_aspects_ros.api.surroundings import scene_of
from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.topic_metadata import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    SURROUNDINGS_TYPE,
    Topic,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.batching import PoseBatches
from resting_aspects_ros.ros.conversions import part_msg, poses_msg, time_msg
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    LATCHED,
    PARTS,
    POSES,
    RESTING_POSES,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    batch_size,
    offered_qos,
)
from resting_aspects_ros.ros.surroundings_conversions import surroundings_msg
from resting_aspects_ros.run_logs.run_recorder import RunRecorder
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import ContactCounts, Distribution
from resting_aspects_ros.statistics.poses import RestingPoses


class LocalRunLog:
    """The log of a run, written batch by batch with the messages that the nodes would publish.

    Topics are those of nodes in the root namespace.

    Parameters
    ----------
    folder : Path
        Folder of logs, made if necessary. The log is a folder in it.
    part : Part
    run : RunDescription

    Raises
    ------
    LogError
        The log cannot be written.
    """

    def __init__(self, folder: Path, part: Part, run: RunDescription) -> None:
        self._run = run
        self._batches = PoseBatches(batch_size(run.drops))
        self._next_drop = run.first_drop
        self._recorder = RunRecorder(folder, run)
        if self._recorder.error:
            raise LogError(self._recorder.error)
        topic = Topic(f'/{PARTS}/{part.name}', PART_TYPE, offered_qos(LATCHED))
        message = part_msg(part)
        self._recorder.write_part(topic, serialize_message(message), message, time.time_ns())
        scene = scene_of(part, run.conditions)
        if not scene.level:
            topic = Topic(
                f'/{SURROUNDINGS}/{part.name}', SURROUNDINGS_TYPE, offered_qos(SURROUNDINGS_QOS)
            )
            surroundings = surroundings_msg(run, scene)
            self._recorder.write_surroundings(
                topic, serialize_message(surroundings), surroundings, time.time_ns()
            )

    @property
    def folder(self) -> Path:
        """The folder of the log."""
        return self._recorder.folder

    def add(self, poses: RestingPoses, _: npt.NDArray[np.int64]) -> None:
        """Write the batches that the poses complete; they follow those of the call before."""
        self._next_drop = poses.end
        for batch in self._batches.add(poses):
            self._write(batch, last=False)

    def close(self, distribution: Distribution, contacts: ContactCounts | None = None) -> None:
        """Write the remaining poses and the distribution, and finish the log.

        ``contacts`` are the same drops by what they touch.

        Raises LogError if the log does not have all of it.
        """
        recorder, run = self._recorder, self._run
        self._write(self._batches.remaining(self._next_drop), last=True)
        topic = Topic(
            f'/{ASPECT_DISTRIBUTIONS}/{run.part}', DISTRIBUTION_TYPE, offered_qos(LATCHED)
        )
        now = time.time_ns()
        if contacts is not None:
            distribution = dataclasses.replace(distribution, contacts=contacts.counted)
        message = distribution_msg(distribution, run, time_msg(now), complete=True)
        recorder.write(topic, serialize_message(message), now, now)
        recorder.run_is_over(whole=True)
        recorder.close()
        if recorder.error:
            raise LogError(recorder.problem())

    def _write(self, poses: RestingPoses, *, last: bool) -> None:
        now = time.time_ns()
        message = poses_msg(poses, self._run, time_msg(now), last)
        topic = Topic(f'/{RESTING_POSES}', POSES_TYPE, offered_qos(POSES))
        self._recorder.write_poses(topic, serialize_message(message), now, now, len(poses))

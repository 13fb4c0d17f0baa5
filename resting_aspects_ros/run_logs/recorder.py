"""Recording of a run in a log: with the messages of nodes, or in this process without nodes."""

import dataclasses
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import PartDescription, SurroundingsDescription

from resting_aspects_ros.api.conditions import scene_of
from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.bag import OUTCOME, LogOutcome, recorded_outcome
from resting_aspects_ros.logs.topics import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    SURROUNDINGS_TYPE,
    Topic,
)
from resting_aspects_ros.logs.writer import RunLog, run_folder_name
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.conversions import (
    MAX_POSES,
    NANOSECONDS,
    description_msg,
    part_msg,
    poses_msgs,
    time_msg,
)
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    LATCHED,
    PARTS,
    POSES,
    RESTING_POSES,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    offered_qos,
)
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import ContactCounts, Distribution
from resting_aspects_ros.statistics.poses import IndexRanges, RestingPoses


class RunRecorder:
    """The log of a run, and which of its messages have not arrived yet.

    No method raises LogError. When the log cannot be written, ``error`` has the reason and further
    messages are ignored. If earlier logs of the run are incomplete, a number is appended to the
    name of this one.

    Parameters
    ----------
    unit : str
        What the run consists of: drops, or actions, of which ``drops`` is then the number.
    failed : called once with the consequence of an error for the run

    Attributes
    ----------
    seen : IndexRanges
        The drops whose messages have arrived.
    heard : float
        Time of the last message, on the monotonic clock, s.
    """

    def __init__(
        self,
        folder: Path,
        run: RunDescription,
        unit: str = 'drops',
        failed: Callable[[str], object] = lambda _: None,
    ) -> None:
        self.run = run
        self.unit = unit
        self.error = ''
        self.has_part = False
        # Whether the surroundings were written, if they are not an infinite level plane.
        self.has_surroundings = run.conditions.surroundings is None
        self.drops = 0  # number of drops that were written
        self.seen = IndexRanges()
        self.heard = time.monotonic()
        self.ended = False  # whether the last message of the run has arrived
        self.folder = folder
        self._failed = failed
        self._log: RunLog | None = None
        with self._errors():
            name = _log_name(run)
            if earlier := _earlier_logs(folder, name):
                name += f'_{len(earlier) + 1}'
            self.folder = folder / name
            self._log = RunLog(folder, name)
            self._log.add_metadata('run', _as_text(run))

    @property
    def being_written(self) -> bool:
        """Whether messages are written to the log."""
        return self._log is not None

    def write(
        self,
        topic: Topic,
        data: bytes,
        log_time: int,
        publish_time: int,
        mesh: tuple[str, str, bytes] | None = None,
    ) -> bool:
        """Write a message, and flush it so that it survives the death of this process.

        mesh : (str, str, bytes), optional
            Name, media type and content of a file, which is attached after the message.

        Returns whether all was written.
        """
        self.heard = time.monotonic()
        with self._errors():
            if self._log is not None:
                # MCAP has no times before the epoch, but a stamp can be before it.
                self._log.write(topic, data, log_time, max(publish_time, 0))
                if mesh is not None:
                    self._log.attach(*mesh, log_time)
                self._log.flush()
        return self._log is not None

    def write_poses(
        self, topic: Topic, data: bytes, log_time: int, publish_time: int, first: int, end: int
    ) -> int:
        """Write the message with the drops ``first`` to ``end - 1``, if any are new.

        Returns how many new drops were written. A message without drops is always written.
        """
        new = sum(high - low for low, high in self.seen.add(first, end)) if first < end else 0
        if first < end and not new:
            return 0
        written = new if self.write(topic, data, log_time, publish_time) else 0
        self.drops += written
        return written

    def missing(self) -> list[tuple[int, int]]:
        """Return the ranges of drops before the last one whose messages have not arrived."""
        return self.seen.missing(self.run.first_drop, self.seen.end)

    def write_part(self, topic: Topic, data: bytes, part: PartDescription, log_time: int) -> None:
        """Write the part's description, and its mesh as an attachment."""
        mesh = f'{part.name}.{part.format}', f'model/{part.format}', bytes(part.mesh)
        self.has_part = self.write(topic, data, log_time, log_time, mesh)

    def write_surroundings(
        self, topic: Topic, data: bytes, surroundings: SurroundingsDescription, log_time: int
    ) -> None:
        """Write the description of the surroundings, and their mesh as an attachment."""
        mesh = None
        if surroundings.surroundings.mesh:
            name = Path(surroundings.surroundings.mesh).name
            media_type = f'model/{Path(name).suffix.lower().lstrip(".")}'
            mesh = name, media_type, bytes(surroundings.mesh)
        self.has_surroundings = self.write(topic, data, log_time, log_time, mesh)

    @property
    def is_described(self) -> bool:
        """Whether the part and the surroundings were written."""
        return self.has_part and self.has_surroundings

    def close(self, *, whole: bool) -> bool | None:
        """Finish the log; returns whether it is whole, or None if it cannot be finished.

        whole : all drops or actions of the run were written
        """
        whole = whole and self.is_described
        with self._errors():
            if self._log is not None:
                self._log.add_metadata(OUTCOME, LogOutcome(self.drops, whole).record())
                self._log.close()
                return whole
        return None

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Store an error and release the file, so that its content can be recovered."""
        try:
            yield
        except LogError as error:
            self.error = str(error)
            log, self._log = self._log, None
            if log is not None:
                with suppress(LogError):
                    log.close()
            run = f'run {self.run.run_id} of {self.run.part}'
            self._failed(f'only {self.drops} {self.unit} of {run} are recorded: {self.error}')


def whole_log(folder: Path, run: RunDescription) -> Path | None:
    """Return an earlier log that has all of a run; None if there is none."""
    for log in _earlier_logs(folder, _log_name(run)):
        outcome = recorded_outcome(log)
        if outcome is not None and outcome.whole:
            return log
    return None


def _log_name(run: RunDescription) -> str:
    started = datetime.fromtimestamp(run.started / NANOSECONDS, timezone.utc)
    return run_folder_name(run.part, started, run.run_id)


def _earlier_logs(folder: Path, name: str) -> list[Path]:
    """Return the existing logs of the same run, in their order."""
    logs: list[Path] = []
    log = folder / name
    while os.path.lexists(log):
        logs.append(log)
        log = folder / f'{name}_{len(logs) + 1}'
    return logs


def _as_text(run: RunDescription) -> dict[str, str]:
    values, conditions = run.document(), run.conditions.document()
    del values['conditions']
    conditions['surroundings'] = run.conditions.surroundings_key
    return {key: str(value) for key, value in {**values, **conditions}.items()}


class LocalRunLog:
    """The log of a run that is simulated in this process, with the messages of nodes.

    The log is a folder in the given one, which is made if necessary. Topics are those of nodes in
    the root namespace. Raises LogError if the log cannot be written.
    """

    def __init__(self, folder: Path, part: Part, run: RunDescription) -> None:
        self._run = run
        self._waiting = RestingPoses.none(run.first_drop)
        self._recorder = recorder = RunRecorder(folder, run)
        if recorder.error:
            raise LogError(recorder.error)
        topic = _topic(f'{PARTS}/{part.name}', PART_TYPE, LATCHED)
        message = part_msg(part)
        recorder.write_part(topic, serialize_message(message), message, time.time_ns())
        scene = scene_of(part, run.conditions)
        if not scene.level:
            topic = _topic(f'{SURROUNDINGS}/{part.name}', SURROUNDINGS_TYPE, SURROUNDINGS_QOS)
            around = description_msg(run, scene)
            recorder.write_surroundings(topic, serialize_message(around), around, time.time_ns())

    @property
    def folder(self) -> Path:
        """The folder of the log."""
        return self._recorder.folder

    def add(self, poses: RestingPoses, _: npt.NDArray[np.int64]) -> None:
        """Write the messages that the poses complete; they follow those of the call before."""
        waiting = RestingPoses.join([self._waiting, poses])
        end = waiting.end - (waiting.end - waiting.first_drop) % MAX_POSES
        if end == waiting.end:  # the last message of a run is not empty
            end -= MAX_POSES
        if end > waiting.first_drop:
            self._write(waiting.between(waiting.first_drop, end), last=False)
        self._waiting = waiting.between(end, waiting.end)

    def close(self, distribution: Distribution, contacts: ContactCounts | None = None) -> None:
        """Write the remaining poses and the distribution, and finish the log.

        ``contacts`` are the same drops by what they touch.

        Raises LogError if the log does not have all of it.
        """
        recorder, run = self._recorder, self._run
        self._write(self._waiting, last=True)
        topic = _topic(f'{ASPECT_DISTRIBUTIONS}/{run.part}', DISTRIBUTION_TYPE, LATCHED)
        now = time.time_ns()
        if contacts is not None:
            distribution = dataclasses.replace(distribution, contacts=contacts.counted)
        message = distribution_msg(distribution, run, time_msg(now), complete=True)
        recorder.write(topic, serialize_message(message), now, now)
        recorder.close(whole=True)
        if recorder.error:
            raise LogError(recorder.error)

    def _write(self, poses: RestingPoses, *, last: bool) -> None:
        now = time.time_ns()
        topic = _topic(RESTING_POSES, POSES_TYPE, POSES)
        for message in poses_msgs(poses, self._run, time_msg(now), last=last):
            first, end = message.first_drop, message.first_drop + len(message.status)
            self._recorder.write_poses(topic, serialize_message(message), now, now, first, end)


def _topic(name: str, type_name: str, profile: QoSProfile) -> Topic:
    return Topic(f'/{name}', type_name, offered_qos(profile))

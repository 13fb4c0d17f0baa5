"""Recording of one run in a log."""

import time
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

from resting_aspects_interfaces.msg import PartDescription, SurroundingsDescription

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.bag_metadata import OUTCOME, LogOutcome, recorded_outcome
from resting_aspects_ros.logs.run_writer import RunLog, run_folder_name
from resting_aspects_ros.logs.topic_metadata import Topic
from resting_aspects_ros.ros.conversions import NANOSECONDS
from resting_aspects_ros.simulation.job import RunDescription

# Timeout for the part and the last distribution to arrive after the end of a run, s.
END_TIMEOUT = 10.0


class RunRecorder:
    """The log of a run, and which of its messages have not arrived yet.

    No method raises LogError. When the log cannot be written, ``error`` has the reason and further
    messages are ignored. If earlier logs of the run are incomplete, a new log is written, with a
    number appended to its name. If an earlier log is whole, no log is written, and ``earlier`` is
    the folder of the earlier one. ``folder`` is the folder of the log.

    unit : str
        What the run consists of: drops, or actions, of which ``drops`` is then the number.
    """

    def __init__(self, folder: Path, run: RunDescription, unit: str = 'drops') -> None:
        self.run = run
        self.unit = unit
        self.error = ''
        self.reported = False  # whether the error was reported
        self.has_part = False
        # Whether the surroundings were written, if they are not an infinite level plane.
        self.has_surroundings = run.conditions.surroundings is None
        self.has_distribution = False  # whether the one after the last drop was written
        self.drops = 0  # number of drops that were written
        self.closed_whole = False
        self.earlier: Path | None = None
        self._whole = False
        self._over_at: float | None = None
        self.folder = folder
        self._log: RunLog | None = None
        try:
            self._log = self._begin(folder)
            if self._log is not None:
                self._log.add_metadata('run', _as_text(run))
        except LogError as error:
            self._fail(error)

    def _begin(self, folder: Path) -> RunLog | None:
        """Create the log unless an earlier one is whole; may raise LogError."""
        run = self.run
        started = datetime.fromtimestamp(run.started / NANOSECONDS, timezone.utc)
        name = run_folder_name(run.part, started, run.run_id)
        earlier = _earlier_logs(folder, name)
        for log in earlier:
            outcome = recorded_outcome(log)
            if outcome is not None and outcome.whole:
                self.earlier = self.folder = log
                self.drops = outcome.drops
                return None
        name += f'_{len(earlier) + 1}' if earlier else ''
        self.folder = folder / name
        return RunLog(folder, name)

    @property
    def being_written(self) -> bool:
        """Whether messages are written to the log."""
        return self._log is not None and not self.error

    def write(self, topic: Topic, data: bytes, log_time: int, publish_time: int) -> None:
        """Write a message, and flush it so that it survives the death of this process."""
        if self._log is None or self.error:
            return
        try:
            # MCAP has no times before the epoch, but a stamp can be before it.
            self._log.write(topic, data, log_time, max(publish_time, 0))
            self._log.flush()
        except LogError as error:
            self._fail(error)

    def write_poses(
        self, topic: Topic, data: bytes, log_time: int, publish_time: int, drops: int
    ) -> int:
        """Write a batch with ``drops`` new drops; returns how many of these were written."""
        self.write(topic, data, log_time, publish_time)
        written = drops if self.being_written else 0
        self.drops += written
        return written

    def write_part(self, topic: Topic, data: bytes, part: PartDescription, log_time: int) -> None:
        """Write the part's description, and its mesh as an attachment."""
        self.write(topic, data, log_time, log_time)
        if self._log is None or self.error:
            return
        try:
            name = f'{part.name}.{part.format}'
            self._log.attach(name, f'model/{part.format}', bytes(part.mesh), log_time)
            self._log.flush()
            self.has_part = True
        except LogError as error:
            self._fail(error)

    def write_surroundings(
        self, topic: Topic, data: bytes, surroundings: SurroundingsDescription, log_time: int
    ) -> None:
        """Write the description of the surroundings, and their mesh as an attachment."""
        self.write(topic, data, log_time, log_time)
        if self._log is None or self.error:
            return
        try:
            if surroundings.mesh_file:
                name = Path(surroundings.mesh_file).name
                media_type = f'model/{Path(name).suffix.lower().lstrip(".")}'
                self._log.attach(name, media_type, bytes(surroundings.mesh), log_time)
                self._log.flush()
            self.has_surroundings = True
        except LogError as error:
            self._fail(error)

    def run_is_over(self, *, whole: bool) -> None:
        """Mark the end of the run; ``whole``: all published poses were written."""
        self._over_at = time.monotonic()
        self._whole = whole

    def problem(self) -> str:
        """Return a message with the consequence of the error for the run."""
        run = f'run {self.run.run_id} of {self.run.part}'
        if self._whole or self.drops >= self.run.drops:
            return (
                f'all {self.drops} {self.unit} of {run} are recorded, but the log has no end: '
                f'{self.error}'
            )
        if self.drops:
            return f'only {self.drops} {self.unit} of {run} are recorded: {self.error}'
        return f'{run} is not recorded: {self.error}'

    @property
    def run_over(self) -> bool:
        """Whether the run has ended."""
        return self._over_at is not None

    @property
    def done(self) -> bool:
        """Whether the log can be closed: all messages were written, or the timeout is over."""
        if self._over_at is None:
            return False
        waited = time.monotonic() - self._over_at > END_TIMEOUT
        return (
            waited
            or not self.being_written
            or (self.has_part and self.has_surroundings and self.has_distribution)
        )

    def close(self) -> Path | None:
        """Finish the log; returns its folder, or None if it cannot be finished."""
        if self._log is None or self.error:
            return None
        whole = self._whole and self.has_part and self.has_surroundings
        try:
            self._log.add_metadata(OUTCOME, LogOutcome(self.drops, whole).record())
            folder = self._log.close()
        except LogError as error:
            self._fail(error)
            return None
        self.closed_whole = whole
        return folder

    def _fail(self, error: LogError) -> None:
        """Store the error and release the file, so that its content can be recovered."""
        self.error = str(error)
        if self._log is not None:
            with suppress(LogError):
                self._log.close()


def _earlier_logs(folder: Path, name: str) -> list[Path]:
    """Return the existing logs of the same run, in their order; may raise LogError."""
    logs = []
    log = folder / name
    try:
        while log.exists() or log.is_symlink():  # a broken link also occupies the name
            logs.append(log)
            log = folder / f'{name}_{len(logs) + 1}'
    except OSError as error:  # a name that is too long, a disk that was removed
        raise LogError(f'log {log} cannot be written: {error.strerror}') from None
    return logs


def _as_text(run: RunDescription) -> dict[str, str]:
    values, conditions = run.document(), run.conditions.document()
    del values['conditions']
    conditions['surroundings'] = run.conditions.surroundings_key
    return {key: str(value) for key, value in {**values, **conditions}.items()}

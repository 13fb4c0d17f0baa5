"""Record one run in a log."""

import dataclasses
import time
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

from resting_aspects_interfaces.msg import PartDescription

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.logs.bag_metadata import OUTCOME, Outcome, recorded_outcome
from resting_aspects_ros.logs.run_writer import RunLog, run_folder_name
from resting_aspects_ros.logs.topic_metadata import Topic
from resting_aspects_ros.ros.conversions import NANOSECONDS
from resting_aspects_ros.simulation.run_description import RunDescription

# When a run is over, its part and its last distribution have so long to arrive, s.
END_TIMEOUT = 10.0


class RunRecorder:
    """The log of a run and what it still waits for.

    A log that cannot be written takes nothing more; ``error`` says why. Nothing here raises.
    A run of which earlier logs hold only a part gets one of its own beside them, with a number
    after its name. One that an earlier log holds whole gets none, and ``earlier`` is the folder of
    that. ``folder`` is that of the log.
    """

    def __init__(self, folder: Path, run: RunDescription) -> None:
        self.run = run
        self.error = ''
        self.reported = False  # the error was told
        self.has_part = False
        self.has_distribution = False  # the one after the last drop
        self.drops = 0  # that are written
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
        """A log beside those that are there, unless one of them is whole; may raise LogError."""
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
        """Whether it takes what comes."""
        return self._log is not None and not self.error

    def write(self, topic: Topic, data: bytes, log_time: int, publish_time: int) -> None:
        """Write a message so that it survives the death of this process."""
        if self._log is None or self.error:
            return
        try:
            # MCAP has no time before the epoch; a stamp can say one.
            self._log.write(topic, data, log_time, max(publish_time, 0))
            self._log.flush()
        except LogError as error:
            self._fail(error)

    def write_poses(
        self, topic: Topic, data: bytes, log_time: int, publish_time: int, drops: int
    ) -> int:
        """Write a batch, in which so many drops are new; how many were written."""
        self.write(topic, data, log_time, publish_time)
        written = drops if self.being_written else 0
        self.drops += written
        return written

    def write_part(self, topic: Topic, data: bytes, part: PartDescription, log_time: int) -> None:
        """Write the part's description, and its mesh as a file."""
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

    def run_is_over(self, *, whole: bool) -> None:
        """No poses come any more; whether all that were published are here."""
        self._over_at = time.monotonic()
        self._whole = whole

    def problem(self) -> str:
        """What an error means for the run, in words."""
        run = f'run {self.run.run_id} of {self.run.part}'
        if self._whole or self.drops >= self.run.drops:
            return f'all {self.drops} drops of {run} are recorded, but not the end: {self.error}'
        if self.drops:
            return f'only {self.drops} drops of {run} are recorded: {self.error}'
        return f'{run} is not recorded: {self.error}'

    @property
    def run_over(self) -> bool:
        """Whether no poses come any more."""
        return self._over_at is not None

    @property
    def done(self) -> bool:
        """All is there, or has been waited for long enough."""
        if self._over_at is None:
            return False
        waited = time.monotonic() - self._over_at > END_TIMEOUT
        return waited or not self.being_written or (self.has_part and self.has_distribution)

    def close(self) -> Path | None:
        """Finish the log; the run's folder, or None if there is no whole log."""
        if self._log is None or self.error:
            return None
        whole = self._whole and self.has_part
        try:
            self._log.add_metadata(OUTCOME, Outcome(self.drops, whole).record())
            folder = self._log.close()
        except LogError as error:
            self._fail(error)
            return None
        self.closed_whole = whole
        return folder

    def _fail(self, error: LogError) -> None:
        """Let go of the file, so that what is in it can be recovered."""
        self.error = str(error)
        if self._log is not None:
            with suppress(LogError):
                self._log.close()


def _earlier_logs(folder: Path, name: str) -> list[Path]:
    """The logs of the same run that are there already, in their order; may raise LogError."""
    found = []
    log = folder / name
    try:
        while log.exists() or log.is_symlink():  # one that leads nowhere is in the way, too
            found.append(log)
            log = folder / f'{name}_{len(found) + 1}'
    except OSError as error:  # a name that is too long, a disk that is gone
        raise LogError(f'log {log} cannot be written: {error.strerror}') from None
    return found


def _as_text(run: RunDescription) -> dict[str, str]:
    values = dataclasses.asdict(run)
    conditions = values.pop('conditions')
    conditions['height_of'] = run.conditions.height_of.name
    return {key: str(value) for key, value in {**values, **conditions}.items()}

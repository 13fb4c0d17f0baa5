"""One log that the recorder is writing."""

import dataclasses
import time
from datetime import datetime, timezone
from pathlib import Path

from resting_aspects_interfaces.msg import PartDescription

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.run_log import RunLog, run_folder_name
from resting_aspects_ros.logs.topics import Topic
from resting_aspects_ros.nodes.convert import NANOSECONDS

# When a run is over, its part and its last distribution have so long to arrive, s.
END_TIMEOUT = 10.0


class OpenLog:
    """The log of a run and what it still waits for.

    A log that cannot be written takes nothing more; ``error`` says why. Nothing here raises.
    """

    def __init__(self, folder: Path, run: RunDescription) -> None:
        self.run = run
        self.error = ''
        self.reported = False  # the error was told
        self.has_part = False
        self.has_distribution = False  # the one after the last drop
        self._over_at: float | None = None
        self._log: RunLog | None = None
        started = datetime.fromtimestamp(run.started / NANOSECONDS, timezone.utc)
        try:
            self._log = RunLog(folder, run_folder_name(run.part, started, run.run_id))
            self._log.add_metadata('run', _as_text(run))
        except LogError as error:
            self.error = str(error)

    def write(self, topic: Topic, data: bytes, log_time: int, publish_time: int) -> None:
        """Write a message so that it survives the death of this process."""
        if self._log is None or self.error:
            return
        try:
            self._log.write(topic, data, log_time, publish_time)
            self._log.flush()
        except LogError as error:
            self.error = str(error)

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
            self.error = str(error)

    def run_is_over(self) -> None:
        """No poses come any more."""
        self._over_at = time.monotonic()

    @property
    def done(self) -> bool:
        """All is there, or has been waited for long enough."""
        if self._over_at is None:
            return False
        waited = time.monotonic() - self._over_at > END_TIMEOUT
        return waited or bool(self.error) or (self.has_part and self.has_distribution)

    def close(self) -> Path | None:
        """Finish the log; the run's folder, or None if there is no whole log."""
        if self._log is None:
            return None
        try:
            folder = self._log.close()
        except LogError as error:
            self.error = self.error or str(error)
        return None if self.error else folder


def _as_text(run: RunDescription) -> dict[str, str]:
    values = dataclasses.asdict(run)
    conditions = values.pop('conditions')
    conditions['height_of'] = run.conditions.height_of.name
    return {key: str(value) for key, value in {**values, **conditions}.items()}

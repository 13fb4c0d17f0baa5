"""Reports the state of a recorder's logs in the log of the node."""

from pathlib import Path

from rclpy.node import Node

from resting_aspects_ros.ros.formatting import progress_text
from resting_aspects_ros.run_logs.recorder import RunRecorder


class StatusLog:
    """Logs what happens to the logs of runs.

    error : text of the last error; empty again after the next complete log
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self.error = ''

    def started(self, log: RunRecorder) -> None:
        """Report that a log was opened, or that an earlier log contains the run."""
        self.written(log)
        if log.earlier is not None:
            run = log.run
            self._logger.info(f'run {run.run_id} of {run.part} is already in {log.earlier}')

    def written(self, log: RunRecorder) -> None:
        """Report each error of a log once."""
        self._logger.debug(f'{log.drops} {log.unit} are in {log.folder}')
        if log.error and not log.reported:
            log.reported = True
            self.error = log.problem()
            self._logger.error(self.error)
        elif log.closed_whole:
            self.error = ''  # writing works again

    def closed(self, log: RunRecorder, folder: Path | None) -> None:
        """Report that a log was closed; folder : None if that failed, or no log was open."""
        self.written(log)
        if folder is None:
            return
        text = f'is in {folder}'
        if not log.closed_whole:
            state = 'is incomplete' if log.ended else 'was interrupted'
            progress = progress_text(log.run, log.drops, log.unit)
            text = f'{state}: the closed log {folder} has {progress}'
        self._logger.info(f'run {log.run.run_id} of {log.run.part} {text}')

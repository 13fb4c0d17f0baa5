"""Reports the state of a recorder's logs on recorded_runs and in the log of the node."""

from pathlib import Path

from rclpy.node import Node
from resting_aspects_interfaces.msg import RecordedRun

from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.formatting import progress_text
from resting_aspects_ros.ros.interface import ALL_LATCHED, RECORDED_RUNS
from resting_aspects_ros.run_logs.recorder import RunRecorder


class RecordedRunsPublisher:
    """Publishes recorded_runs.

    error : text of the last error; empty again after the next complete log
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._recorded = advertise(node, RecordedRun, RECORDED_RUNS, ALL_LATCHED)
        self.error = ''

    def started(self, log: RunRecorder) -> None:
        """Report that a log was opened, or that an earlier log contains the run."""
        self.written(log, always=True)
        if log.earlier is not None:
            run = log.run
            self._logger.info(f'run {run.run_id} of {run.part} is already in {log.earlier}')

    def written(self, log: RunRecorder, *, always: bool = False) -> None:
        """Report the progress of a log if ``always``, and each error once."""
        self._logger.debug(f'{log.drops} {log.unit} are in {log.folder}')
        new_error = bool(log.error) and not log.reported
        if new_error:
            log.reported = True
            self.error = log.problem()
            self._logger.error(self.error)
        elif log.closed_whole:
            self.error = ''  # writing works again
        if new_error or always:
            self._recorded.publish(_message(log))

    def closed(self, log: RunRecorder, folder: Path | None) -> None:
        """Report that a log was closed; folder : None if that failed, or no log was open."""
        self.written(log, always=True)
        if folder is None:
            return
        text = f'is in {folder}'
        if not log.closed_whole:
            state = 'is incomplete' if log.run_over else 'was interrupted'
            progress = progress_text(log.run, log.drops, log.unit)
            text = f'{state}: the closed log {folder} has {progress}'
        self._logger.info(f'run {log.run.run_id} of {log.run.part} {text}')


def _message(log: RunRecorder) -> RecordedRun:
    return RecordedRun(
        run_id=log.run.run_id,
        log=str(log.folder),
        drops=log.drops,
        whole=log.closed_whole or log.earlier is not None,
        error=log.error,
    )

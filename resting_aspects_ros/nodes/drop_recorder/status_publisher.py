"""What a recorder reports of its logs: recorded_runs, and lines in its own log."""

from pathlib import Path

from rclpy.node import Node
from resting_aspects_interfaces.msg import RecordedRun

from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.formatting import progress_text
from resting_aspects_ros.ros.interface import ALL_LATCHED, RECORDED_RUNS
from resting_aspects_ros.run_logs.run_recorder import RunRecorder


class RecordedRunsPublisher:
    """Publishes recorded_runs.

    error : what went wrong last, in words, until a log is whole again; else empty
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._recorded = advertise(node, RecordedRun, RECORDED_RUNS, ALL_LATCHED)
        self.error = ''

    def begun(self, log: RunRecorder) -> None:
        """A log is begun, or found to be there already."""
        self.written(log, always=True)
        if log.earlier is not None:
            run = log.run
            self._logger.info(f'run {run.run_id} of {run.part} is in {log.earlier} already')

    def written(self, log: RunRecorder, *, always: bool = False) -> None:
        """Tell how far the log is, at its turning points; and once what went wrong."""
        self._logger.debug(f'{log.drops} drops are in {log.folder}')
        new_error = bool(log.error) and not log.reported
        if new_error:
            log.reported = True
            self.error = log.problem()
            self._logger.error(self.error)
        elif log.closed_whole:
            self.error = ''  # it works again
        if new_error or always:
            self._recorded.publish(_message(log))

    def closed(self, log: RunRecorder, folder: Path | None) -> None:
        """A log is closed; folder : None if that went wrong, or there was none to close."""
        self.written(log, always=True)
        if folder is None:
            return
        words = f'is in {folder}'
        if not log.closed_whole:
            what = 'is not whole' if log.run_over else 'was broken off'
            words = f'{what}: {progress_text(log.run, log.drops)} are in {folder}, which is closed'
        self._logger.info(f'run {log.run.run_id} of {log.run.part} {words}')


def _message(log: RunRecorder) -> RecordedRun:
    return RecordedRun(
        run_id=log.run.run_id,
        log=str(log.folder),
        drops=log.drops,
        whole=log.closed_whole or log.earlier is not None,
        error=log.error,
    )

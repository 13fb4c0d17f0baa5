"""What the actions of the simulator share: the offered parts, workers, goals, surroundings."""

import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Sized
from concurrent.futures import Future as PoolFuture
from contextlib import closing
from pathlib import Path
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import PartDescription, Status

from resting_aspects_ros.errors import PartError, RestingAspectsError
from resting_aspects_ros.part.library import PartLibrary, Stamp
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import (
    PartTopics,
    guarded_task,
    ros_future,
    steady_timer,
    wait_for,
)
from resting_aspects_ros.ros.conversions import description_msg, part_msg
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker
from resting_aspects_ros.ros.interface import ACTION_SERVICES, LATCHED, PARTS
from resting_aspects_ros.ros.requests import (
    BusyError,
    CanceledError,
    NotAvailableError,
    error_status,
)
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import DropJob, RunDescription
from resting_aspects_ros.simulation.scene import Scene
from resting_aspects_ros.simulation.workers import LocalWorkers, drop_chunks
from resting_aspects_ros.statistics.poses import RestingPoses

# -- The offered parts ----------------------------------------------------------------------------


# Interval of scans for new, changed and removed parts, s.
SCAN_PERIOD = 2.0
# Maximum time that a request waits until changed files are read, s. After it, the request uses the
# part as it was offered before.
READ_TIMEOUT = 2.0
# Time after which the node is ready although slow files of the folder are still to be read, s.
READY_TIMEOUT = 60.0


def scan(folder: Path) -> tuple[dict[str, Stamp], dict[str, str], list[str]]:
    """Return the stamps of the parts of a folder, what is not registered, and problems.

    Runs in a FileWorker.
    """
    library = PartLibrary(folder)
    return library.stamps(), library.not_registered(), library.problems()


def load(folder: Path, name: str) -> Part:
    """Return one part of a folder; runs in a FileWorker."""
    return PartLibrary(folder).load(name)


class PartPublisher:
    """Publishes parts/<part> for every part of a folder, and updates them when files change.

    ready : future that is done when the folder has been read once
    not_offered : reasons by part, or by file if the file does not name a part

    Parameters
    ----------
    files : reads the folder, so that a file cannot block the node
    """

    def __init__(self, node: Node, folder: Path, files: FileWorker) -> None:
        self._node = node
        self._folder = folder
        self._files = files
        self._stamps: dict[str, Stamp] = {}  # of the files that were read last
        self._parts: dict[str, Part] = {}
        self._topics = PartTopics(node, PartDescription, PARTS, LATCHED)
        self._failed: dict[str, RestingAspectsError] = {}
        self._logged: set[str] = set()
        self._scan: Future | None = None  # done when the active scan ends
        self.not_offered: dict[str, str] = {}
        self.ready = Future()
        self._guarded_scan = guarded_task(node, 'scan of parts_folder failed', self._scan_folder)
        self._timer = steady_timer(node, 0.0, self._start_scan)

    def __len__(self) -> int:
        return len(self._parts)

    async def get(self, name: str) -> Part:
        """Return a part by name, as its files are now.

        Raises NotAvailableError while its files are being read, or the error of the part.
        """
        if not self.ready.done():
            raise NotAvailableError('the files of parts_folder are still being read, try again')
        end = time.monotonic() + READ_TIMEOUT
        # An active scan may have passed a file that was changed after that.
        for _ in range(1 if self._scan is None else 2):
            self._start_scan()
            assert self._scan is not None
            done = await wait_for(self._node, self._scan, end - time.monotonic())
        if name in self._parts:
            return self._parts[name]
        if name in self._failed:
            raise type(self._failed[name])(str(self._failed[name]))
        if not done:
            raise NotAvailableError(
                f'part {name!r} is not available: files of parts_folder are still being read'
            )
        part: Part = await self._files.run(load, self._folder, name)  # the error lists known parts
        return part

    def _start_scan(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = steady_timer(self._node, SCAN_PERIOD, self._start_scan)
        if self._scan is None:
            assert self._node.executor is not None  # this is called by it
            self._scan = Future(executor=self._node.executor)
            self._node.executor.create_task(self._run_scan, self._scan)

    async def _run_scan(self, finished: Future) -> None:
        await self._guarded_scan()
        self._scan = None
        finished.set_result(None)
        self._set_ready()

    def _set_ready(self) -> None:
        if not self.ready.done():
            self.ready.set_result(None)

    async def _scan_folder(self) -> None:
        try:
            stamps, not_registered, problems = await self._files.run(scan, self._folder)
        except RestingAspectsError as error:
            self._warn_once(f'parts_folder {str(self._folder)!r}: {error}')
            return
        for problem in problems:
            self._warn_once(problem)
        for name in set(self._stamps) - set(stamps):
            self._remove(name)
        start = time.monotonic()
        for name, stamp in stamps.items():
            if time.monotonic() - start > READY_TIMEOUT:
                self._set_ready()
            if self._stamps.get(name) != stamp:
                await self._read(name, stamp)
        failed = {name: str(error) for name, error in self._failed.items()}
        self.not_offered = not_registered | failed

    async def _read(self, name: str, stamp: Stamp) -> None:
        """Read the files of one part; an error in them does not affect other parts."""
        try:
            part: Part = await self._files.run(load, self._folder, name)
        except RestingAspectsError as error:
            self._remove(name)
            if isinstance(error, FileLimitError):
                error = PartError(f'part {name!r} is not offered: {error}')
            self._failed[name] = error
            self._warn_once(str(self._failed[name]))
        else:
            self._failed.pop(name, None)
            self._offer(part)
        self._stamps[name] = stamp

    def _remove(self, name: str) -> None:
        self._stamps.pop(name, None)
        self._failed.pop(name, None)
        self._parts.pop(name, None)
        self._topics.remove(name)

    def _offer(self, part: Part) -> None:
        known = self._parts.get(part.name)
        self._parts[part.name] = part
        if known is not None and known.part_sha256 == part.part_sha256:
            return
        for warning in part.warnings:
            self._warn_once(warning)
        self._topics.publish(part.name, part_msg(part))

    def _warn_once(self, problem: str) -> None:
        if problem not in self._logged:
            self._logged.add(problem)
            self._node.get_logger().warning(problem)


# -- Goals ----------------------------------------------------------------------------------------


# Maximum number of concurrent goals of an action; all goals share the workers chunk by chunk.
MAX_GOALS = 16
# Time for which a result is kept for a client that requests it late, s.
RESULT_TIMEOUT = 300
# Interval at which a goal that waits checks whether it was canceled, s.
CANCEL_PERIOD = 0.5


class GoalServer:
    """Serves an action; goals of all actions share the workers chunk by chunk.

    Parameters
    ----------
    kind, name : type and name of the action
    files : computes what could block the node, such as the aspects of a large mesh
    conditions : returns the conditions that a goal requests
    surroundings : topics of the surroundings of new runs
    frame : frame of the published poses
    """

    def __init__(
        self,
        kind: Any,
        name: str,
        node: Node,
        parts: PartPublisher,
        workers: LocalWorkers,
        files: FileWorker,
        conditions: Callable[[Any], Awaitable[DropConditions]],
        surroundings: PartTopics,
        frame: str,
    ) -> None:
        self._kind, self._name = kind, name
        self._node = node
        self._parts = parts
        self._workers = workers
        self._files = files
        self._conditions = conditions
        self._surroundings = surroundings
        self._frame = frame
        self._server = ActionServer(
            node,
            kind,
            name,
            self._execute,
            # By default, rclpy rejects every cancel request.
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
            **ACTION_SERVICES,
        )

    def destroy(self) -> None:
        """Destroy the action server."""
        self._server.destroy()

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        """Return the result of a goal with its status, and set the state of the goal."""
        result = self._kind.Result()
        try:
            result, error = await self._answer(handle)
            if error is not None:
                raise error
            handle.succeed()
        except CanceledError as error:
            result.status = error_status(error)
            handle.canceled()
        except RestingAspectsError as error:
            result.status = error_status(error)
            handle.abort()
        except InvalidHandle:  # the result cannot be sent
            result.status = Status(code=Status.FAILED, message='the node has stopped')
        except Exception as error:  # noqa: BLE001 - a defect must not look like an answer
            self._node.get_logger().error(f'{self._name} failed: {error!r}')
            result.status = Status(code=Status.FAILED, message=f'unexpected error {error!r}')
            handle.abort()
        return result

    async def _answer(self, handle: ServerGoalHandle) -> tuple[Any, Exception | None]:
        """Return the result of a goal, and the error that ended it early, if any."""
        raise NotImplementedError

    async def _chunks(
        self, job: DropJob, requested: RunDescription, stopped: Callable[[], bool]
    ) -> AsyncGenerator[RestingPoses, None]:
        """Yield chunks of drops in order; raises EngineError if the workers fail or die.

        Ends early if ``stopped`` returns True, also while a chunk is simulated.
        """
        with closing(drop_chunks(job, requested, self._workers)) as steps:
            for step in steps:
                if not isinstance(step, PoolFuture):
                    yield step
                    continue
                done = ros_future(self._node, step)  # drop_chunks handles its exception
                while not (stopped() or await wait_for(self._node, done, CANCEL_PERIOD)):
                    pass
                if stopped():
                    return

    def _publish_surroundings(self, run: RunDescription, scene: Scene) -> None:
        """Publish the surroundings of a new run; nothing for the infinite level plane."""
        if not scene.level:
            self._surroundings.publish(run.part, description_msg(run, scene, self._frame))

    def _check_number(self, active: Sized) -> None:
        """Raise BusyError if as many goals are active as the action allows."""
        if len(active) >= MAX_GOALS:
            raise BusyError(f'{MAX_GOALS} {self._name} goals are active, try again later')

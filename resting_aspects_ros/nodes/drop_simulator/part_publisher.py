"""The parts that the simulator offers: one latched description for each mesh of the folder."""

import time
from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from resting_aspects_interfaces.msg import PartDescription

from resting_aspects_ros.core.errors import PartError, RestingAspectsError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.ros.callbacks import advertise, guarded_task, steady_timer, wait_for
from resting_aspects_ros.ros.conversions import part_msg
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker
from resting_aspects_ros.ros.interface import LATCHED, PARTS
from resting_aspects_ros.ros.status import NotAvailableError
from resting_aspects_ros.simulation.part_library import PartLibrary, Stamp

# How often the folder is looked at for parts that are new, changed or gone, s.
SCAN_PERIOD = 2.0
# A request waits so long for files that changed to be read, s; then a part that is offered already
# is taken as it was.
READ_TIMEOUT = 2.0
# So long after it began to read a folder of slow files the node is ready with what it has read, s.
READY_TIMEOUT = 60.0


@dataclass(frozen=True)
class PartsFolder:
    """What a folder of parts holds, without the parts themselves."""

    stamps: dict[str, Stamp]
    not_registered: dict[str, str]
    problems: list[str]


def look_at(folder: Path) -> PartsFolder:
    """Return what is in a folder of parts; for a FileWorker."""
    library = PartLibrary(folder)
    return PartsFolder(library.stamps(), library.not_registered(), library.problems())


def load(folder: Path, name: str) -> Part:
    """Load one part of a folder; for a FileWorker."""
    return PartLibrary(folder).load(name)


class PartPublisher:
    """Publishes parts/<part> for every part of a folder, now and when the folder changes.

    ready : whether the folder has been read once
    not_offered : by part, or by file if that names none: why it is not offered

    Parameters
    ----------
    files : reads the folder, so that no file can block the node
    """

    def __init__(self, node: Node, folder: Path, files: FileWorker) -> None:
        self._node = node
        self._folder = folder
        self._files = files
        self._stamps: dict[str, Stamp] = {}  # of what was read last
        self._parts: dict[str, Part] = {}
        self._publishers: dict[str, Publisher] = {}
        self._failed: dict[str, RestingAspectsError] = {}
        self._complaints: set[str] = set()
        self._scan: Future | None = None  # done when the scan under way is over
        self.not_offered: dict[str, str] = {}
        self.ready = Future()
        self._look = guarded_task(node, 'parts are not looked for', self._scan_folder)
        self._timer = steady_timer(node, 0.0, self._begin)

    def __len__(self) -> int:
        return len(self._parts)

    async def get(self, name: str) -> Part:
        """Return the part of a name, as its files are now.

        Raises NotAvailableError while its files are being read, else the error of the part.
        """
        if not self.ready.done():
            raise NotAvailableError('the files of parts_folder are still being read, ask again')
        end = time.monotonic() + READ_TIMEOUT
        # One that is under way may have come past a file that was changed since.
        for _ in range(1 if self._scan is None else 2):
            self._begin()
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
        found: Part = await self._files.run(load, self._folder, name)  # says what is known
        return found

    def _begin(self) -> None:
        """Scan the folder, unless a scan is under way."""
        self._node.destroy_timer(self._timer)
        self._timer = steady_timer(self._node, SCAN_PERIOD, self._begin)
        if self._scan is None:
            assert self._node.executor is not None  # this is called by it
            self._scan = Future(executor=self._node.executor)
            self._node.executor.create_task(self._scan_and_tell, self._scan)

    async def _scan_and_tell(self, over: Future) -> None:
        await self._look()
        self._scan = None
        over.set_result(None)
        self._be_ready()

    def _be_ready(self) -> None:
        if not self.ready.done():
            self.ready.set_result(None)

    async def _scan_folder(self) -> None:
        try:
            found: PartsFolder = await self._files.run(look_at, self._folder)
        except RestingAspectsError as error:
            self._complain(f'folder of parts {str(self._folder)!r}: {error}')
            return
        for problem in found.problems:
            self._complain(problem)
        for name in set(self._stamps) - set(found.stamps):
            self._remove(name)
        begun = time.monotonic()
        for name, stamp in found.stamps.items():
            if time.monotonic() - begun > READY_TIMEOUT:
                self._be_ready()
            if self._stamps.get(name) != stamp:
                await self._read(name, stamp)
        failed = {name: str(error) for name, error in self._failed.items()}
        self.not_offered = found.not_registered | failed

    async def _read(self, name: str, stamp: Stamp) -> None:
        """Read the files of one part; what is wrong with them costs no other part."""
        try:
            part: Part = await self._files.run(load, self._folder, name)
        except RestingAspectsError as error:
            self._remove(name)
            if isinstance(error, FileLimitError):
                error = PartError(f'part {name!r} is not offered: {error}')
            self._failed[name] = error
            self._complain(str(self._failed[name]))
        else:
            self._failed.pop(name, None)
            self._offer(part)
        self._stamps[name] = stamp

    def _remove(self, name: str) -> None:
        self._stamps.pop(name, None)
        self._failed.pop(name, None)
        self._parts.pop(name, None)
        if (publisher := self._publishers.pop(name, None)) is not None:
            self._node.destroy_publisher(publisher)

    def _offer(self, part: Part) -> None:
        """Publish the part's description if it is not the one published last."""
        known = self._parts.get(part.name)
        self._parts[part.name] = part
        if known is not None and known.part_sha256 == part.part_sha256:
            return
        for warning in part.warnings:
            self._complain(warning)
        if part.name not in self._publishers:
            topic = f'{PARTS}/{part.name}'
            publisher = advertise(self._node, PartDescription, topic, LATCHED)
            self._publishers[part.name] = publisher
        self._publishers[part.name].publish(part_msg(part))

    def _complain(self, problem: str) -> None:
        """Log it once."""
        if problem not in self._complaints:
            self._complaints.add(problem)
            self._node.get_logger().warning(problem)

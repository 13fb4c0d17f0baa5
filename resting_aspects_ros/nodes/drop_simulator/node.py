"""The drop_simulator node: offers parts, drops them and publishes their resting poses."""

import sys
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import PartDescription, SurroundingsDescription

from resting_aspects_ros.errors import InvalidValueError, PartError, RestingAspectsError
from resting_aspects_ros.input_files import is_folder
from resting_aspects_ros.nodes.drop_simulator.actions import DropServer, ReorientServer, Resources
from resting_aspects_ros.part.library import PartLibrary, Stamp
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import PartTopics, start_task, steady_timer
from resting_aspects_ros.ros.conversions import part_msg
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker
from resting_aspects_ros.ros.health import (
    Diagnosis,
    DuplicateNodeDetector,
    count_text,
    publish_diagnostics,
    truncated,
)
from resting_aspects_ros.ros.interface import (
    DROP_SIMULATOR,
    LATCHED,
    PARTS,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
)
from resting_aspects_ros.ros.program import FRAME_ID, Parameter, check_frame, declare, run_node
from resting_aspects_ros.ros.requests import (
    SURFACE,
    SURROUNDINGS_FOLDER,
    DefaultConditionsPublisher,
    NotAvailableError,
    RequestedSurroundings,
)
from resting_aspects_ros.simulation.conditions import DropConditions, all_surfaces
from resting_aspects_ros.simulation.workers import MAX_WORKERS, LocalWorkers
from resting_aspects_ros.system import available_cores, parts_folder

# Interval of scans for new, changed and removed parts, s.
SCAN_PERIOD = 2.0


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

    files : reads the folder, so that a file cannot block the node
    """

    def __init__(self, node: Node, folder: Path, files: FileWorker) -> None:
        self._node = node
        self._folder = folder
        self._files = files
        self._stamps: dict[str, Stamp] = {}  # of the files that were read last
        self._parts: dict[str, Part] = {}
        self._failed: dict[str, RestingAspectsError] = {}
        self._topics = PartTopics(node, PartDescription, PARTS, LATCHED)
        self._logged: set[str] = set()
        self._scanning = False
        self.not_offered: dict[str, str] = {}
        self.ready = Future()
        self._timer = steady_timer(node, 0.0, self._start_scan)

    def __len__(self) -> int:
        return len(self._parts)

    async def get(self, name: str) -> Part:
        """Return an offered part by name.

        Raises NotAvailableError before the folder has been read, or the error of the part.
        """
        if not self.ready.done():
            raise NotAvailableError('the files of parts_folder are still being read, try again')
        if name in self._failed:
            raise type(self._failed[name])(str(self._failed[name]))
        if name not in self._parts:  # a new file, or an error that lists the known parts
            self._offer(await self._files.run(load, self._folder, name))
        return self._parts[name]

    def _start_scan(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = steady_timer(self._node, SCAN_PERIOD, self._start_scan)
        if not self._scanning:
            self._scanning = True
            start_task(self._node, 'scan of parts_folder failed', self._scan_folder)

    async def _scan_folder(self) -> None:
        try:
            await self._update()
        finally:
            self._scanning = False
            if not self.ready.done():
                self.ready.set_result(None)

    async def _update(self) -> None:
        try:
            stamps, not_registered, problems = await self._files.run(scan, self._folder)
        except RestingAspectsError as error:
            self._warn_once(f'parts_folder {str(self._folder)!r}: {error}')
            return
        for problem in problems:
            self._warn_once(problem)
        # A part that was requested at once can be gone before a scan has found it.
        for name in (set(self._stamps) | set(self._parts)) - set(stamps):
            self._remove(name)
        for name, stamp in stamps.items():
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


PARAMETERS = (
    Parameter('parts_folder', '', 'folder of meshes that are offered; empty: the examples'),
    Parameter('surfaces_file', '', 'YAML file of surfaces beside those of the suite'),
    SURROUNDINGS_FOLDER,
    SURFACE,
    FRAME_ID,
    Parameter('workers', 0, 'threads, or processes of Bullet; 0: one per core', (0, MAX_WORKERS)),
)


class DropSimulator(Node):
    """Serves drop_part and reorient_part.

    Publishes parts/<part>, surroundings/<part>, resting_poses, transitions/<part> and
    default_conditions.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(DROP_SIMULATOR, **options)
        values = declare(self, PARAMETERS)
        folder = _folder(values['parts_folder'] or parts_folder())
        self._surfaces = all_surfaces(values['surfaces_file'])
        frame = check_frame(values[FRAME_ID.name])
        self._default = DefaultConditionsPublisher(self, self._surfaces)
        self._workers = LocalWorkers(values['workers'] or available_cores())
        self._files = FileWorker(self)
        self._surroundings = RequestedSurroundings(
            self, values[SURROUNDINGS_FOLDER.name], self._files
        )
        self._parts = PartPublisher(self, folder, self._files)
        resources = Resources(
            self,
            self._parts.get,
            self._conditions,
            self._workers,
            self._files,
            PartTopics(self, SurroundingsDescription, SURROUNDINGS, SURROUNDINGS_QOS),
            frame,
        )
        self._drops = DropServer(resources)
        self._reorient = ReorientServer(resources)
        self._parts.ready.add_done_callback(self._on_parts_read)

    def close(self) -> None:
        """End the workers, and abandon their drops."""
        self._workers.stop()
        self._files.stop()
        self._drops.destroy()
        self._reorient.destroy()

    def _on_parts_read(self, _: Future) -> None:
        publish_diagnostics(self, self._diagnose, DuplicateNodeDetector(self, DROP_SIMULATOR))
        parts = count_text(len(self._parts), 'part', 'parts')
        workers = count_text(self._workers.count, 'worker', 'workers')
        self.get_logger().info(f'ready: {parts}, {workers}')

    def _diagnose(self) -> Diagnosis:
        not_offered = self._parts.not_offered
        values = {
            'workers': self._workers.count,
            'workers that died': self._workers.replaced,
            'parts offered': len(self._parts),
            'drops made': self._drops.drops.total,
            'drops per second': self._drops.drops.rate(),
            'active runs': self._drops.active,
            'actions made': self._reorient.actions.total,
            'actions per second': self._reorient.actions.rate(),
            'active reorientations': self._reorient.active,
            **truncated({f'not offered: {name}': why for name, why in not_offered.items()}),
        }
        warning = count_text(len(not_offered), 'mesh is not offered', 'meshes are not offered')
        state = self._drops.state or self._reorient.state
        return Diagnosis(state, values, [warning] if not_offered else [])

    async def _conditions(self, goal: DropPart.Goal | ReorientPart.Goal) -> DropConditions:
        return await self._surroundings.conditions(self._surfaces, goal, self._default.conditions)


def _folder(path: str | Path) -> Path:
    if not is_folder(Path(path)):
        raise InvalidValueError(f'invalid parts_folder {str(path)!r}: expected an existing folder')
    return Path(path)


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(DropSimulator, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())

"""The drop_simulator node: offers parts, drops them and publishes their resting poses."""

import sys
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import SurroundingsDescription

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import is_folder
from resting_aspects_ros.nodes.drop_simulator.actions import DropServer, ReorientServer
from resting_aspects_ros.nodes.drop_simulator.goals import PartPublisher
from resting_aspects_ros.ros.callbacks import PartTopics
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.health import (
    Diagnosis,
    DuplicateNodeDetector,
    count_text,
    publish_diagnostics,
    truncated,
)
from resting_aspects_ros.ros.interface import (
    DROP_SIMULATOR,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
)
from resting_aspects_ros.ros.program import FRAME_ID, Parameter, check_frame, declare, run_node
from resting_aspects_ros.ros.requests import (
    SURFACE,
    SURROUNDINGS_FOLDER,
    DefaultConditionsPublisher,
    RequestedSurroundings,
)
from resting_aspects_ros.simulation.conditions import DropConditions, all_surfaces
from resting_aspects_ros.simulation.workers import MAX_WORKERS, LocalWorkers
from resting_aspects_ros.system import available_cores, parts_folder

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

    Parameters
    ----------
    options : of rclpy.node.Node, such as the namespace and the context
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
        shared = (
            *(self._parts, self._workers, self._files, self._conditions),
            *(PartTopics(self, SurroundingsDescription, SURROUNDINGS, SURROUNDINGS_QOS), frame),
        )
        self._drops = DropServer(self, *shared)
        self._reorient = ReorientServer(self, *shared)
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
            **self._drops.values(),
            **self._reorient.values(),
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

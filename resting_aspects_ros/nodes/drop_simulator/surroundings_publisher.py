"""Publisher of the surroundings of runs, and the planning of drops in them."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import SurroundingsDescription

from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.interface import SURROUNDINGS, SURROUNDINGS_QOS
from resting_aspects_ros.ros.requested_surroundings import RequestedSurroundings
from resting_aspects_ros.ros.surroundings_conversions import surroundings_msg
from resting_aspects_ros.simulation.run_description import RunDescription
from resting_aspects_ros.simulation.surroundings.mesh_surface import MeshFile, remember_mesh
from resting_aspects_ros.simulation.surroundings.scene import Scene

T = TypeVar('T')


def plan_with_meshes(plan: Callable[[], T], meshes: Sequence[MeshFile]) -> T:
    """Return what ``plan`` returns, with meshes made known before; runs in a FileWorker."""
    for mesh in meshes:
        remember_mesh(mesh)
    return plan()


class SurroundingsPublisher:
    """Publishes surroundings/<part> before the first drop of each run in surroundings.

    Parameters
    ----------
    requested : knows the names of surroundings
    frame : frame of the published poses
    """

    def __init__(self, node: Node, requested: RequestedSurroundings, frame: str) -> None:
        self._node = node
        self._requested = requested
        self._frame = frame
        self._publishers: dict[str, Publisher] = {}

    def meshes(self) -> list[MeshFile]:
        """Return the known meshes of surroundings; see plan_with_meshes."""
        return self._requested.meshes()

    def publish(self, run: RunDescription, scene: Scene | None) -> None:
        """Publish the surroundings of a new run; nothing for the infinite level plane."""
        if scene is None:
            return
        name = self._requested.name(run.conditions.surroundings)
        if run.part not in self._publishers:
            topic = f'{SURROUNDINGS}/{run.part}'
            self._publishers[run.part] = advertise(
                self._node, SurroundingsDescription, topic, SURROUNDINGS_QOS
            )
        self._publishers[run.part].publish(surroundings_msg(run, scene, name, self._frame))

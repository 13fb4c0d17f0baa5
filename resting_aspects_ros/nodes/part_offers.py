"""The parts that the simulator offers: one latched description for each mesh of the folder."""

from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import PartDescription

from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.drops.part_library import PartLibrary
from resting_aspects_ros.nodes.callbacks import advertise, guarded, steady_timer
from resting_aspects_ros.nodes.convert import part_msg
from resting_aspects_ros.nodes.interface import LATCHED, PARTS

# How often the folder is looked at for parts that are new, changed or gone, s.
SCAN_PERIOD = 2.0


class PartOffers:
    """Publishes parts/<part> for every part of a library, now and when the folder changes.

    not_offered : dict
        Why not, of each mesh of which no part can be made: by part, or by file if that names none.
    """

    def __init__(self, node: Node, library: PartLibrary) -> None:
        self._node = node
        self._library = library
        self._offered: dict[str, tuple[str, Publisher]] = {}
        self._complaints: set[str] = set()
        self.not_offered: dict[str, str] = {}
        self._scan()
        steady_timer(node, SCAN_PERIOD, guarded(node, 'parts are not looked for', self._scan))

    def __len__(self) -> int:
        return len(self._offered)

    def offer(self, part: Part) -> None:
        """Publish the part's description if it is not the one published last."""
        sha, publisher = self._offered.get(part.name, ('', None))
        if sha == part.part_sha256:
            return
        for warning in part.warnings:
            self._complain(warning)
        if publisher is None:
            topic = f'{PARTS}/{part.name}'
            publisher = advertise(self._node, PartDescription, topic, LATCHED)
        publisher.publish(part_msg(part))
        self._offered[part.name] = (part.part_sha256, publisher)

    def _scan(self) -> None:
        names = self._library.names()
        not_offered = self._library.not_registered()
        for problem in self._library.problems():
            self._complain(problem)
        for name in names:
            try:
                self.offer(self._library.load(name))
            except RestingAspectsError as error:
                not_offered[name] = str(error)
                self._complain(str(error))
        self.not_offered = not_offered
        for name in set(self._offered) - set(names):
            self._node.destroy_publisher(self._offered.pop(name)[1])

    def _complain(self, problem: str) -> None:
        """Say it once."""
        if problem not in self._complaints:
            self._complaints.add(problem)
            self._node.get_logger().warning(problem)

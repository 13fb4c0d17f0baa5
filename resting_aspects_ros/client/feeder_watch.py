"""What a run of the feeder demo has done, from the messages of its nodes."""

import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

from resting_aspects_ros.client.connection import new_context
from resting_aspects_ros.ros.conversions import nanoseconds
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    CHOICES,
    DETECTIONS,
    FEEDER_ADVICE,
    PICK_RESULT,
)

IMAGE = 'camera/image_raw'
# Results and images of a run in simulated time arrive in quick succession.
MANY = QoSProfile(depth=1000)


@dataclass(frozen=True, eq=False)
class Moment:
    """An image with what was seen in it and what was advised."""

    image: Image
    detections: DetectionArray
    advice: FeederAdvice


class FeederWatch:
    """Counts what happens in the first minutes of simulated time.

    Parameters
    ----------
    node : Node
    part : str
    minutes : float

    Attributes
    ----------
    done : Future
        Done with the first image after these minutes.
    images : int
    on_tray : int
        Parts in the newest image; parts that touch count as one.
    advice : FeederAdvice or None
        The newest one for a new image.
    best : Moment or None
        The image with the most picks.
    """

    def __init__(self, node: Node, part: str, minutes: float) -> None:
        self.done = Future()
        self.images = self.on_tray = 0
        self.advice: FeederAdvice | None = None
        self.best: Moment | None = None
        self._topic = f'{FEEDER_ADVICE}/{part}'
        self._length = round(60e9 * minutes)
        self._begin, self._now = 0, 0  # time of the first image, and newest time until the end
        self._images: dict[int, Image] = {}  # the newest ones, by time
        self._seen: DetectionArray | None = None
        # Time, image and result of each pick, also before the begin and after the end: the results
        # of an image can arrive before the image.
        self._results: list[tuple[int, int, int]] = []
        self._exposed: list[tuple[int, int]] = []  # time and number of each image
        self._advised: dict[int, tuple[str, int]] = {}  # move and supply for each image
        self._moves: list[int] = []  # times of moves
        self._hears_controller = False
        self._clock, self._clock_changed = 0, time.monotonic()
        self._node = node
        # An intermediate result would be lost with a queue that is too short.
        self._cycle = [
            node.create_subscription(DetectionArray, DETECTIONS, self._on_detections, MANY),
            node.create_subscription(Image, IMAGE, self._on_image, MANY),
            node.create_subscription(FeederAdvice, self._topic, self._on_advice, ALL_LATCHED),
        ]
        node.create_subscription(Clock, 'clock', self._on_clock, QoSProfile(depth=1))
        self._hears_results = False

    def connect(self) -> None:
        """Subscribe to the picks once all that belongs to a cycle can be heard; call repeatedly.

        camera_simulator can wait for this subscription before it begins, so it is the last one.
        Otherwise, what was seen and advised for the first images could be lost.
        """
        if not self._hears_results and all(each.get_publisher_count() for each in self._cycle):
            self._hears_results = True
            self._node.create_subscription(PickResult, PICK_RESULT, self._on_result, MANY)

    @property
    def picks(self) -> int:
        """Number of parts that the robot picked."""
        return sum(result == PickResult.PICKED for _, result in self._picks())

    @property
    def missed(self) -> int:
        """Number of picks that failed."""
        return sum(result == PickResult.MISSED for _, result in self._picks())

    @property
    def choices(self) -> dict[str, int]:
        """How often the robot picked after an image, and the feeder only moved or supplied."""
        moves = [move for move, _ in self._moved()]
        picks = len({image for image, _ in self._picks()})
        return {
            'pick': picks,
            **{each: moves.count(each) for each in ('flip', 'spread', 'supply')},
        }

    @property
    def supplied(self) -> int:
        """Number of parts that the feeder supplied."""
        return sum(supply for _, supply in self._moved())

    @property
    def minutes(self) -> float:
        """Simulated time since the first image, min."""
        return (self._now - self._begin) / 60e9 if self._begin else 0.0

    @property
    def rate(self) -> float:
        """Parts per minute so far; 0 before the first action is over."""
        return self.picks / self.minutes if self.minutes > 0 else 0.0

    @property
    def silence(self) -> float:
        """Real time for which simulated time has stood still, s."""
        return time.monotonic() - self._clock_changed

    @property
    def silent(self) -> tuple[str, str]:
        """The node for which the others wait, and what it does not publish."""
        seen = self._seen
        if not self._images:
            if self._hears_controller:
                return 'camera_simulator', IMAGE
            return 'feeder_controller', self._topic
        if seen is None or nanoseconds(seen.header.stamp) < max(self._images):
            return 'vision_example', f'{DETECTIONS} for the newest image'
        if seen.image not in self._advised:
            return 'feeder_controller', f'advice for the newest image on {self._topic}'
        return 'camera_simulator', f'{PICK_RESULT} or new image after the advice'

    def fields(self) -> dict[str, Any]:
        """Return the counts for a document."""
        return {
            'minutes': self.minutes,
            'picks': self.picks,
            'parts_per_minute': self.rate,
            'missed': self.missed,
            'images': self.images,
            'supplied': self.supplied,
            'choices': self.choices,
        }

    def _on_clock(self, message: Clock) -> None:
        if (now := nanoseconds(message.clock)) != self._clock:
            self._clock, self._clock_changed = now, time.monotonic()

    def _on_image(self, message: Image) -> None:
        stamp = nanoseconds(message.header.stamp)
        self._begin = min(self._begin or stamp, stamp)
        self._images[stamp] = message
        while len(self._images) > 3:
            del self._images[next(iter(self._images))]

    def _on_detections(self, message: DetectionArray) -> None:
        stamp = nanoseconds(message.header.stamp)
        if self.done.done() or (self._seen is not None and message.image == self._seen.image):
            return
        self._seen = message
        self._begin = self._begin or stamp
        self._now = max(self._now, stamp)
        self._exposed.append((stamp, message.image))
        if stamp - self._begin >= self._length:
            self._now = stamp
            self.done.set_result(None)
            return
        self.images += 1
        self.on_tray = len(message.detections)

    def _on_result(self, message: PickResult) -> None:
        stamp = nanoseconds(message.header.stamp)
        if not self.done.done():
            self._now = max(self._now, stamp)
        if message.result == PickResult.MOVED:
            self._moves.append(stamp)
        else:
            self._results.append((stamp, message.image, message.result))

    def _on_advice(self, message: FeederAdvice) -> None:
        self._hears_controller = True
        if message.choice == FeederAdvice.WAIT or message.image in self._advised:
            return
        is_pick = message.choice == FeederAdvice.PICK
        move = message.then if is_pick else message.choice
        self._advised[message.image] = CHOICES.get(move, ''), message.supply
        seen = self._seen
        if self.done.done() or seen is None or message.image != seen.image:
            return
        self.advice = message
        image = self._images.get(nanoseconds(seen.header.stamp))
        if image is not None and (
            self.best is None or len(message.picks) > len(self.best.advice.picks)
        ):
            self.best = Moment(image, seen, message)

    def _picks(self) -> list[tuple[int, int]]:
        """Return image and result of each pick between the first image and the end."""
        if not self._begin:
            return []
        return [(k, result) for t, k, result in self._results if self._begin < t <= self._now]

    def _moved(self) -> list[tuple[str, int]]:
        """Return move and supply of each move between two images: what was advised for the first.

        Messages on different topics arrive in any order: a move may be counted later.
        """
        places = (bisect_left(self._exposed, (stamp,)) for stamp in self._moves)
        before = [self._exposed[k - 1][1] for k in places if 0 < k < len(self._exposed)]
        return [self._advised[image] for image in before if image in self._advised]


@contextmanager
def spun_node(ros_args: list[str]) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """Context manager of a node in a ROS context of its own, and its executor."""
    context = new_context(ros_args)
    node = Node('feeder_demo', context=context, enable_rosout=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()

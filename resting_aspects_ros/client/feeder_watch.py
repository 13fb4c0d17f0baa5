"""What a run of the feeder demo has done, from the messages of its nodes."""

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from sensor_msgs.msg import Image

from resting_aspects_ros.ros.conversions import nanoseconds
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    DETECTIONS,
    FEEDER_ADVICE,
    PICK_RESULT,
)

CHOICES = {
    FeederAdvice.WAIT: 'wait',
    FeederAdvice.PICK: 'pick',
    FeederAdvice.FLIP: 'flip',
    FeederAdvice.SPREAD: 'spread',
    FeederAdvice.SUPPLY: 'supply',
}
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
    picks, missed, images, supplied : int
    choices : dict of str to int
        How often each choice was advised, also as what follows after picks.
    on_tray : int
        Parts in the newest image; parts that touch count as one.
    advice : FeederAdvice or None
        The newest one for a new image.
    best : Moment or None
        The image with the most picks.
    """

    def __init__(self, node: Node, part: str, minutes: float) -> None:
        self.done = Future()
        self.picks = self.missed = self.images = self.supplied = self.on_tray = 0
        self.choices = dict.fromkeys(CHOICES.values(), 0)
        self.advice: FeederAdvice | None = None
        self.best: Moment | None = None
        self._length = round(60e9 * minutes)
        self._begin, self._now = 0, 0
        self._images: dict[int, Image] = {}  # the newest ones, by time
        self._seen: DetectionArray | None = None
        self._advised = 0  # image of the newest advice that was counted
        # An intermediate result would be lost with a queue that is too short.
        node.create_subscription(DetectionArray, DETECTIONS, self._on_detections, MANY)
        node.create_subscription(PickResult, PICK_RESULT, self._on_result, MANY)
        topic = f'{FEEDER_ADVICE}/{part}'
        node.create_subscription(FeederAdvice, topic, self._on_advice, ALL_LATCHED)
        node.create_subscription(Image, 'camera/image_raw', self._on_image, MANY)

    @property
    def minutes(self) -> float:
        """Simulated time since the first image, min."""
        return (self._now - self._begin) / 60e9

    @property
    def rate(self) -> float:
        """Parts per minute so far; 0 before the first action is over."""
        return self.picks / self.minutes if self._now > self._begin else 0.0

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

    def _on_image(self, message: Image) -> None:
        self._images[nanoseconds(message.header.stamp)] = message
        while len(self._images) > 3:
            del self._images[next(iter(self._images))]

    def _on_detections(self, message: DetectionArray) -> None:
        stamp = nanoseconds(message.header.stamp)
        if self.done.done() or (self._seen is not None and message.image == self._seen.image):
            return
        self._seen = message
        self._begin = self._begin or stamp
        self._now = stamp
        if stamp - self._begin >= self._length:
            self.done.set_result(None)
            return
        self.images += 1
        self.on_tray = len(message.detections)

    def _on_result(self, message: PickResult) -> None:
        stamp = nanoseconds(message.stamp)
        if not self._begin or (self.done.done() and stamp > self._now):
            return
        self._now = max(self._now, stamp)
        self.picks += message.result == PickResult.PICKED
        self.missed += message.result == PickResult.MISSED

    def _on_advice(self, message: FeederAdvice) -> None:
        seen = self._seen
        is_new = seen is not None and message.image == seen.image != self._advised
        if self.done.done() or not is_new or message.choice == FeederAdvice.WAIT:
            return
        assert seen is not None
        self.advice, self._advised = message, message.image
        self.supplied += message.supply
        for choice in {message.choice, message.then} - {FeederAdvice.WAIT}:
            self.choices[CHOICES[choice]] += 1
        image = self._images.get(nanoseconds(seen.header.stamp))
        if image is not None and (
            self.best is None or len(message.picks) > len(self.best.advice.picks)
        ):
            self.best = Moment(image, seen, message)

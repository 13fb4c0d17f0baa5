"""What a run of the feeder demo has done, from the messages of its nodes, and how it is shown."""

import time
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from rich.table import Table
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

from resting_aspects_ros.feeding.tray_simulation import ControlledRuns
from resting_aspects_ros.report.format import minutes_text, number_text
from resting_aspects_ros.ros.conversions import nanoseconds
from resting_aspects_ros.ros.interface import ALL_LATCHED, DETECTIONS, FEEDER_ADVICE, PICK_RESULT

IMAGE = 'camera/image_raw'
# Results and images of a run in simulated time arrive in quick succession.
MANY = QoSProfile(depth=1000)
# What a run that agrees with its forecast proves, and what it does not.
SHARED = (
    'The run draws its drops and flips from the probabilities of the forecast, mixes the parts '
    'in each flip, and places them without overlap. Agreement shows that images, identification, '
    'decisions and messages work as the forecast assumes. It does not show that a machine does.'
)


@dataclass(frozen=True, eq=False)
class Moment:
    """An image with what was seen in it and what was advised."""

    image: Image
    detections: DetectionArray
    advice: FeederAdvice


class FeederWatch:
    """Counts what happens in the first minutes of simulated time.

    Attributes
    ----------
    total : float
        These minutes.
    done : Future
        Done with the first image after these minutes.
    on_tray : int
        Parts in the newest image; parts that touch count as one.
    advice : FeederAdvice or None
        The newest one for a new image.
    best : Moment or None
        The image with the most picks.
    """

    def __init__(self, node: Node, part: str, total: float) -> None:
        self.done = Future()
        self.images = self.on_tray = 0
        self.advice: FeederAdvice | None = None
        self.best: Moment | None = None
        self.total = total
        self._begin, self._now = 0, 0  # time of the first image, and newest time until the end
        self._images: dict[int, Image] = {}  # the newest ones, by time
        self._seen: DetectionArray | None = None
        # Time and result of each pick, also before the begin and after the end: the results of an
        # image can arrive before the image.
        self._results: list[tuple[int, int]] = []
        self._clock, self._clock_changed = 0, time.monotonic()
        self._node = node
        # An intermediate result would be lost with a queue that is too short.
        self._cycle = [
            node.create_subscription(DetectionArray, DETECTIONS, self._on_detections, MANY),
            node.create_subscription(Image, IMAGE, self._on_image, MANY),
            node.create_subscription(
                FeederAdvice, f'{FEEDER_ADVICE}/{part}', self._on_advice, ALL_LATCHED
            ),
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
        return self._counted(PickResult.PICKED)

    @property
    def missed(self) -> int:
        """Number of picks that failed."""
        return self._counted(PickResult.MISSED)

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

    def fields(self) -> dict[str, Any]:
        """Return the counts for a document."""
        return {
            'minutes': self.minutes,
            'picks': self.picks,
            'parts_per_minute': self.rate,
            'missed': self.missed,
            'images': self.images,
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
        if stamp - self._begin >= round(60e9 * self.total):
            self._now = stamp
            self.done.set_result(None)
            return
        self.images += 1
        self.on_tray = len(message.detections)

    def _on_result(self, message: PickResult) -> None:
        stamp = nanoseconds(message.header.stamp)
        if not self.done.done():
            self._now = max(self._now, stamp)
        self._results.append((stamp, message.result))

    def _on_advice(self, message: FeederAdvice) -> None:
        seen = self._seen
        if self.done.done() or seen is None or message.image != seen.image:
            return
        if message.choice == FeederAdvice.WAIT:
            return
        self.advice = message
        image = self._images.get(nanoseconds(seen.header.stamp))
        most = -1 if self.best is None else len(self.best.advice.picks)
        if image is not None and len(message.picks) > most:
            self.best = Moment(image, seen, message)

    def _counted(self, result: int) -> int:
        """Return the number of picks with a result between the first image and the end."""
        if not self._begin:
            return 0
        return sum(self._begin < t <= self._now and found == result for t, found in self._results)


# -- What is shown --------------------------------------------------------------------------------


def feeder_table(watch: FeederWatch, forecast: ControlledRuns) -> Table:
    """Return the table of a running feeder beside its forecast."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style='dim', no_wrap=True)
    table.add_column()
    minutes, seconds = divmod(round(60 * watch.minutes), 60)
    lower, upper = map(number_text, forecast.prediction)
    interval = f'{number_text(forecast.rate)} ({lower} to {upper})'
    rows = {
        'simulated time': f'{minutes}:{seconds:02d} of {watch.total:g} min',
        'parts in the image': str(watch.on_tray),
        'advice': watch.advice.reason if watch.advice is not None else '',
        'images': str(watch.images),
        'picks': f'{watch.picks}' + (f' ({watch.missed} missed)' if watch.missed else ''),
        'parts per minute': number_text(watch.rate),
        'forecast': f'{interval}, 95 % of runs of {watch.total:g} min',
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def feeder_sentence(watch: FeederWatch, forecast: ControlledRuns) -> str:
    """Return what a run has shown, in plain sentences."""
    lower, upper = forecast.prediction
    text = (
        f'In {watch.minutes:.1f} minutes of simulated time, the robot picked {watch.picks} '
        f'parts: {number_text(watch.rate)} per minute. The forecast is '
        f'{number_text(forecast.rate)}, and {number_text(lower)} to {number_text(upper)} for 95 % '
        f'of the runs of {minutes_text(watch.total)}'
    )
    if watch.minutes < watch.total:
        return f'{text}; this run was shorter.'
    inside = lower <= watch.rate <= upper
    return f'{text}; this run lies {"within" if inside else "outside"} that interval.\n{SHARED}'

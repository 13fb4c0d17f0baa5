"""What the camera simulator follows and sends: the truth of the part, answers and messages."""

import array
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from resting_aspects_interfaces.msg import Detection, DetectionArray, FeederAdvice
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from resting_aspects_ros.arrays import Bytes
from resting_aspects_ros.feeding.tray_simulation import VirtualFeeder
from resting_aspects_ros.nodes.feeder_controller.messages import PARAMETERS as OF_CONTROLLER
from resting_aspects_ros.nodes.feeder_controller.messages import settings_from
from resting_aspects_ros.nodes.feeder_controller.model_updates import ModelUpdates
from resting_aspects_ros.ros.callbacks import advertise, subscribe, wait_for
from resting_aspects_ros.ros.interface import CELL, DETECTIONS, FEEDER_ADVICE, LATCHED
from resting_aspects_ros.ros.parameters import FRAME_ID, Parameter
from resting_aspects_ros.vision.outline import Outline
from resting_aspects_ros.vision.tray_image import TrayCamera

# Parameters of feeder_controller that this node has, too.
SHARED = (
    'part',
    'tray',
    'robot_time',
    'place_time',
    'vibrate_time',
    'settle_time',
    'image_time',
    'supply_time',
    'spread_time',
    'action',
)
CELL_PARAMETERS = tuple(each for each in OF_CONTROLLER if each.name in SHARED)


class Truth(ModelUpdates):
    """The model whose moves and times are true of the virtual parts.

    Parameters
    ----------
    values : dict
        Parameters of the node by name. With `evidence`, the virtual feeder begins when complete
        runs of drops and flips are known, and waits until the controller knows the same.
    changed : called when `current` has changed
    """

    def __init__(self, node: Node, values: dict[str, Any], changed: Callable[[], None]) -> None:
        given = {each.name: each.default for each in OF_CONTROLLER} | values
        super().__init__(node, settings_from(given), changed)
        self._needs_evidence = values['evidence']
        self._has_begun = False

    def is_ready(self, advice: FeederAdvice | None) -> bool:
        """Return whether the virtual feeder can run with the newest advice of the controller."""
        if self.current is None or not self._needs_evidence:
            return self.current is not None
        self._has_begun = self._has_begun or self.is_complete
        is_known = advice is not None and (advice.drops, advice.actions) == self.counts
        return self._has_begun and is_known

    @property
    def state(self) -> str:
        """What is missing, in words."""
        if self.current is None:
            return super().state
        if self._needs_evidence and not self._has_begun:
            return f'waiting for complete runs of drops and flips of {self.part.known.part.name}'
        return 'begins'


PARAMETERS = (
    *CELL_PARAMETERS,
    Parameter('px_per_mm', 5.0, 'pixels per millimetre of the tray', (0.1, 100.0)),
    Parameter('noise', 4.0, 'standard deviation of the noise of a pixel, grey values', (0, 100)),
    Parameter('blur', 0.7, 'standard deviation of the blur, pixels', (0, 50)),
    Parameter('speed', 0.0, 'simulated time per real time; 0: as fast as possible', (0, 1000)),
    Parameter(
        'evidence', False, 'whether to begin only when complete runs of drops and flips are known'
    ),
    Parameter(
        'subscribers',
        0,
        'number of subscribers of pick_result for which it waits before it begins',
        (0, 100),
    ),
    Parameter('seed', 1, 'the same seed and advice give the same images', (0, 1_000_000)),
    FRAME_ID,
    Parameter(
        'camera_frame',
        'camera_optical_frame',
        'frame of the images: x to the right, y down in the image, z forward',
        allowed=FRAME_ID.allowed,
    ),
)


Found = TypeVar('Found')


class Answers:
    """The newest detections and the newest advice for a part.

    advice : FeederAdvice or None
    """

    def __init__(self, node: Node, part: str) -> None:
        self._node = node
        self._topic = f'{FEEDER_ADVICE}/{part}'
        self.advice: FeederAdvice | None = None
        self._detections: DetectionArray | None = None
        self._news = Future()
        subscribe(node, DetectionArray, DETECTIONS, self._on_detections, CELL)
        subscribe(node, FeederAdvice, self._topic, self._on_advice, LATCHED)

    def to(
        self, stamp: Time, least: int, *, waits: bool = False
    ) -> tuple[DetectionArray, FeederAdvice] | None:
        """Return detections and advice for an image, if they have arrived.

        stamp : exposure of the image
        least : minimum epoch of the advice
        waits : whether the advice may be to wait
        """
        seen, advice = self._detections, self.advice
        if seen is None or seen.header.stamp != stamp:
            return None
        if advice is None or advice.image != seen.image or advice.epoch < least:
            return None
        return None if advice.choice == FeederAdvice.WAIT and not waits else (seen, advice)

    async def reach(self, epoch: int, seconds: float) -> None:
        """Wait until the controller has counted results up to an epoch, at most a real time."""

        def known() -> bool | None:
            return True if self.advice is not None and self.advice.epoch >= epoch else None

        await self.until(known, seconds)

    async def until(self, found: Callable[[], Found | None], seconds: float) -> Found | None:
        """Return what a function finds after a message; None after a real time."""
        end = time.monotonic() + seconds
        while (result := found()) is None:
            left = end - time.monotonic()
            if left <= 0:
                return None
            self._news = Future(executor=self._node.executor)
            await wait_for(self._node, self._news, left)
        return result

    def hint(self, now: int) -> str:
        """Return why there is no advice for the image of a time, ns."""
        seen = self._detections
        if not self._node.count_publishers(DETECTIONS):
            return f'no advice: {DETECTIONS} has no publisher, start vision_example'
        if seen is None or seen.header.stamp.sec < now // 10**9:
            return f'no advice: the newest image has no {DETECTIONS}, check the vision system'
        return (
            f'no advice for the newest image on {self._topic}: check '
            'feeder_controller, and that it runs with use_sim_time'
        )

    def _on_detections(self, message: DetectionArray) -> None:
        self._detections = message
        self._notify()

    def _on_advice(self, message: FeederAdvice) -> None:
        self.advice = message
        self._notify()

    def _notify(self) -> None:
        if not self._news.done():
            self._news.set_result(None)


# Absolute: tf2 expects this name.
STATIC_TRANSFORMS = '/tf_static'


def image_msg(image: Bytes, header: Header) -> Image:
    """Return the message for a grey image (height, width)."""
    height, width = image.shape
    message = Image(header=header, height=height, width=width, encoding='mono8', step=width)
    message.data = array.array('B', image.tobytes())
    return message


def camera_info_msg(camera: TrayCamera, header: Header) -> CameraInfo:
    """Return the message for a camera.

    A telecentric camera has no centre of projection. The message is that of a pinhole camera 1 m
    above the surface, which has the same image of the surface.
    """
    (width, height), (u, v), scale = camera.size, camera.centre, camera.scale
    matrix = [scale, 0.0, u, 0.0, scale, v, 0.0, 0.0, 1.0]
    return CameraInfo(
        header=header,
        width=width,
        height=height,
        distortion_model='plumb_bob',
        d=[0.0] * 5,
        k=matrix,
        r=np.eye(3).ravel().tolist(),
        p=[scale, 0.0, u, 0.0, 0.0, scale, v, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def camera_transform(tray: str, camera: str) -> TransformStamped:
    """Return the pose of the optical frame of the camera, 1 m above the centre of the tray.

    z points down to the tray, x is that of the tray, and y of the tray points up in the image.
    """
    transform = TransformStamped(header=Header(frame_id=tray), child_frame_id=camera)
    transform.transform.translation.z = 1.0
    transform.transform.rotation = Quaternion(x=1.0, y=0.0, z=0.0, w=0.0)
    return transform


def publish_static_transform(node: Node, transform: TransformStamped) -> Publisher | None:
    """Publish a transform on /tf_static for late subscribers, too; return its publisher.

    Returns None if tf2 is not installed, so that there can be no listener on this machine.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        node.get_logger().info(f'tf2_msgs is not installed: {STATIC_TRANSFORMS} is not published')
        return None
    output = advertise(node, TFMessage, STATIC_TRANSFORMS, LATCHED)
    output.publish(TFMessage(transforms=[transform]))
    return output


def seen_centre(detection: Detection, outline: Outline) -> tuple[float, float]:
    """Return where a detection has the centroid of its outline, tray frame, m."""
    cos, sin = np.cos(detection.yaw), np.sin(detection.yaw)
    x, y = outline.centroid
    return float(detection.x + cos * x - sin * y), float(detection.y + sin * x + cos * y)


def missing_text(output: Publisher, needed: int) -> str:
    """Return how many subscribers of a publisher there are, if more are needed; else ''."""
    found = output.get_subscription_count()
    return (
        '' if found >= needed else f'waiting for {needed} subscribers of {output.topic}: {found}'
    )


def feeder_values(feeder: VirtualFeeder) -> dict[str, object]:
    """Return the values of a feeder for the diagnostics."""
    return {
        'simulated seconds': f'{feeder.seconds:.1f}',
        'parts on the tray': len(feeder.tray.classes),
        'picks': feeder.picks,
        'supplied': feeder.supplied,
    }

"""The camera_simulator node: virtual parts on a tray, for development without hardware."""

import array
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.task import Future
from resting_aspects_interfaces.msg import Detection, DetectionArray, FeederAdvice, PickResult
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from resting_aspects_ros.arrays import Bytes
from resting_aspects_ros.feeding.control import Choice
from resting_aspects_ros.feeding.tray_simulation import VirtualFeeder
from resting_aspects_ros.nodes.feeder_controller.model_updates import PARAMETERS as OF_CONTROLLER
from resting_aspects_ros.nodes.feeder_controller.model_updates import ModelUpdates, settings_from
from resting_aspects_ros.ros.callbacks import (
    advertise,
    guarded,
    guarded_task,
    sleep_for,
    steady_timer,
    subscribe,
    wait_for,
)
from resting_aspects_ros.ros.conversions import time_msg
from resting_aspects_ros.ros.health import (
    CLOCK,
    Diagnosis,
    DuplicateNodeDetector,
    clock_conflicts,
    publish_diagnostics,
)
from resting_aspects_ros.ros.interface import (
    CELL,
    CHOICES,
    DETECTIONS,
    FEEDER_ADVICE,
    LATCHED,
    PICK_RESULT,
)
from resting_aspects_ros.ros.program import FRAME_ID, Parameter, check_frame, declare, run_node
from resting_aspects_ros.vision.outline import Outline
from resting_aspects_ros.vision.rolling import KnownPart
from resting_aspects_ros.vision.tray_image import OutlinePlaces, TrayCamera, render_tray

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


class Answers:
    """The newest detections, and the newest advice for a part."""

    def __init__(self, node: Node, part: str) -> None:
        self._node = node
        self.advice: FeederAdvice | None = None
        self._detections: DetectionArray | None = None
        self._news = Future()
        subscribe(node, DetectionArray, DETECTIONS, self._on_detections, CELL)
        subscribe(node, FeederAdvice, f'{FEEDER_ADVICE}/{part}', self._on_advice, LATCHED)

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

    async def arrived(self, condition: Callable[[], object], seconds: float) -> None:
        """Wait until a condition holds after a message, at most a real time."""
        end = time.monotonic() + seconds
        while not condition() and (left := end - time.monotonic()) > 0:
            self._news = Future(executor=self._node.executor)
            await wait_for(self._node, self._news, left)

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


CAMERA_SIMULATOR = 'camera_simulator'
IMAGE, CAMERA_INFO = 'camera/image_raw', 'camera/camera_info'
IMAGES = QoSProfile(depth=2)
# Simulated time at which the node begins, ns: ROS takes 0 as unknown.
START = 1_000_000_000
# An image without advice is published again after this real time, s.
RETRY = 1.0
# Without advice for this real time there is a warning, s.
PATIENCE = 5.0
NO_ADVICE = (
    'no advice for the newest image: check vision_example, and feeder_controller, which runs with '
    'use_sim_time'
)
# Real time between messages on /clock while simulated time stands still, s.
CLOCK_PERIOD = 0.1
# Step of simulated time with a limited speed, in real time, s.
STEP = 0.02


class CameraSimulator(Node):
    """Publishes camera/image_raw, camera/camera_info, pick_result, /clock and /tf_static.

    Shows virtual parts on a tray and obeys the advice on feeder_advice/<part>. Simulated time
    stands still while vision system and controller work: run them with use_sim_time.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(CAMERA_SIMULATOR, **options)
        values = declare(self, PARAMETERS)
        self._part, self._values = values['part'], values
        self._frame, self._camera_frame = (
            check_frame(values[name]) for name in ('frame_id', 'camera_frame')
        )
        self._camera = TrayCamera(tuple(values['tray']), values['px_per_mm'])
        self._truth = Truth(self, values, self._on_truth)
        self._tray_generator, self._noise_generator = (
            np.random.default_rng([values['seed'], k]) for k in range(2)
        )
        self._feeder: VirtualFeeder | None = None
        self._known: KnownPart | None = None
        self._places: OutlinePlaces | None = None
        self._now = START
        self._answers = Answers(self, self._part)
        self._epoch = 0  # of the controller, after all results that were sent
        self._images, self._missed, self._silent = 0, 0, False
        self._loop: object = None
        self._closed = False
        self._image_output = advertise(self, Image, IMAGE, IMAGES, overridable=True)
        self._info_output = advertise(self, CameraInfo, CAMERA_INFO, IMAGES, overridable=True)
        self._result_output = advertise(self, PickResult, PICK_RESULT, CELL, overridable=True)
        self._transform_output = publish_static_transform(
            self, camera_transform(self._frame, self._camera_frame)
        )
        self._clock_output = advertise(self, Clock, CLOCK, QoSProfile(depth=1))
        self._duplicates = DuplicateNodeDetector(self, CAMERA_SIMULATOR)
        publish_diagnostics(self, self._diagnose, self._duplicates)
        steady_timer(self, CLOCK_PERIOD, guarded(self, 'the clock stops', self._tick))
        self.get_logger().info('ready')

    def close(self) -> None:
        """End the cycle, and the process that builds models."""
        self._closed = True
        self._truth.stop()

    # Inputs

    def _on_truth(self) -> None:
        """Use the new model; parts of another version are put on an empty tray."""
        if (model := self._truth.current) is None:
            return
        part, known = self._truth.part.known, self._known
        if self._feeder and known and known.part.part_sha256 == part.part.part_sha256:
            self._feeder.use(model)
            return
        self._known = part
        places = OutlinePlaces(part.outlines, self._camera.tray, self._tray_generator)
        before = self._feeder.seconds if self._feeder is not None else 0.0
        self._feeder = VirtualFeeder(model, places, self._tray_generator)
        self._feeder.seconds, self._places = before, places

    def _tick(self) -> None:
        self._publish_clock()
        if self._loop is None and self.executor is not None:
            self._loop = self.executor.create_task(self._run)

    # The cycle

    async def _run(self) -> None:
        cycle = guarded_task(self, 'a cycle has failed', self._cycle)
        while not self._closed:
            images = self._images
            if self._may_run() and not self._duplicates.check():
                await cycle()
            if self._images == images:
                await sleep_for(self, CLOCK_PERIOD)

    def _may_run(self) -> bool:
        if self._feeder is None or not self._truth.is_ready(self._answers.advice):
            return False
        found = self._result_output.get_subscription_count()
        return self._images > 0 or found >= self._values['subscribers']

    async def _cycle(self) -> None:
        """Show the tray, and do what is advised."""
        feeder, places, known = self._feeder, self._places, self._known
        assert feeder is not None
        assert places is not None
        assert known is not None
        header = Header(stamp=time_msg(self._now), frame_id=self._camera_frame)
        look = {name: self._values[name] for name in ('blur', 'noise')}
        image = render_tray(places.polygons, self._camera, self._noise_generator, **look)
        info = camera_info_msg(self._camera, header)
        detections, advice = await self._ask(image_msg(image, header), info)
        if feeder is not self._feeder:
            return  # the part has changed
        self._images += 1
        self._epoch = advice.epoch
        feeder.take_image()
        await self._pass(feeder)
        action = Choice(CHOICES[advice.choice])
        if action is Choice.PICK:
            if not await self._pick(feeder, known.outlines, detections, advice):
                return
            action = Choice(CHOICES[advice.then])
            if action is Choice.WAIT:
                return
        feeder.move(action, advice.supply)
        await self._pass(feeder)
        if action is not Choice.WAIT:
            await self._report(PickResult.MOVED)

    async def _ask(self, image: Image, info: CameraInfo) -> tuple[DetectionArray, FeederAdvice]:
        """Publish an image until there is advice for it; messages may be lost."""
        begin, stamp = time.monotonic(), image.header.stamp
        least = self._epoch
        while True:
            self._info_output.publish(info)
            self._image_output.publish(image)
            asked = partial(self._answers.to, stamp, least)
            await self._answers.arrived(asked, RETRY)
            found = asked() or self._answers.to(stamp, 0, waits=True)
            if found is not None:
                self._silent = False
                return found
            least = 0  # a controller that was restarted counts epochs from 0
            if time.monotonic() - begin > PATIENCE:
                self._silent = True
                self.get_logger().warning(NO_ADVICE, throttle_duration_sec=2 * PATIENCE)

    async def _pick(
        self,
        feeder: VirtualFeeder,
        outlines: Sequence[Outline],
        detections: DetectionArray,
        advice: FeederAdvice,
    ) -> bool:
        """Pick the chosen parts; return whether all picks have succeeded."""
        for pick in advice.picks:
            seen = detections.detections[pick.detection]
            x, y = seen_centre(seen, outlines[pick.symmetry_class - 1])
            is_picked = feeder.pick(x, y, pick.symmetry_class)
            self._missed += not is_picked
            await self._pass(feeder)
            result = PickResult.PICKED if is_picked else PickResult.MISSED
            await self._report(result, detections.image, pick.detection)
            if not is_picked:
                return False
        return True

    async def _report(self, result: int, image: int = 0, detection: int = 0) -> None:
        """Publish what was done, and wait until the controller knows it."""
        self._epoch += 1
        where = {'image': image, 'detection': detection}
        header = Header(stamp=time_msg(self._now))
        self._result_output.publish(PickResult(header=header, result=result, **where))
        answers = self._answers
        await answers.arrived(
            lambda: answers.advice is not None and answers.advice.epoch >= self._epoch, RETRY
        )

    # Time

    async def _pass(self, feeder: VirtualFeeder) -> None:
        """Let simulated time advance to that of the feeder."""
        end = START + round(feeder.seconds * 1e9)
        speed = self._values['speed']
        begin, real = self._now, time.monotonic()
        while speed and (now := begin + round((time.monotonic() - real) * speed * 1e9)) < end:
            self._now = now
            self._publish_clock()
            await sleep_for(self, STEP)
        self._now = end
        self._publish_clock()

    def _publish_clock(self) -> None:
        self._clock_output.publish(Clock(clock=time_msg(self._now)))

    # Diagnostics

    def _diagnose(self) -> Diagnosis:
        feeder = self._feeder
        values: dict[str, object] = {
            'part': self._part,
            'images': self._images,
            'missed picks': self._missed,
        }
        if feeder is not None:
            values |= {
                'simulated seconds': f'{feeder.seconds:.1f}',
                'parts on the tray': len(feeder.tray.classes),
                'picks': feeder.picks,
                'supplied': feeder.supplied,
            }
        state = 'runs' if self._images else self._truth.state
        errors = [self._truth.error] if self._truth.error else []
        warnings = [NO_ADVICE] * self._silent + clock_conflicts(self)
        return Diagnosis(state, values, warnings, errors)


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(CameraSimulator, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())

"""The camera_simulator node: virtual parts on a tray, for development without hardware."""

import sys
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from resting_aspects_ros.feeding.control import Choice
from resting_aspects_ros.feeding.tray_simulation import VirtualFeeder
from resting_aspects_ros.nodes.camera_simulator.cell import (
    PARAMETERS,
    Answers,
    Truth,
    camera_info_msg,
    camera_transform,
    feeder_values,
    image_msg,
    missing_text,
    publish_static_transform,
    seen_centre,
)
from resting_aspects_ros.ros.callbacks import (
    advertise,
    guarded,
    guarded_task,
    sleep_for,
    steady_timer,
)
from resting_aspects_ros.ros.conversions import time_msg
from resting_aspects_ros.ros.diagnostics import Diagnosis, publish_diagnostics
from resting_aspects_ros.ros.discovery import CLOCK, DuplicateNodeDetector, clock_conflicts
from resting_aspects_ros.ros.interface import CELL, CHOICES, PICK_RESULT
from resting_aspects_ros.ros.parameters import check_frame, declare
from resting_aspects_ros.ros.spin import run_node
from resting_aspects_ros.vision.outline import Outline
from resting_aspects_ros.vision.rolling import KnownPart
from resting_aspects_ros.vision.tray_image import OutlinePlaces, TrayCamera, render_tray

CAMERA_SIMULATOR = 'camera_simulator'
IMAGE, CAMERA_INFO = 'camera/image_raw', 'camera/camera_info'
IMAGES = QoSProfile(depth=2)
# Simulated time at which the node begins, ns: ROS takes 0 as unknown.
START = 1_000_000_000
# An image without advice is published again after this real time, s.
RETRY = 1.0
# Without advice for this real time there is a warning, s.
PATIENCE = 5.0
# Real time between messages on /clock while simulated time stands still, s.
CLOCK_PERIOD = 0.1
# Step of simulated time with a limited speed, in real time, s.
STEP = 0.02


class CameraSimulator(Node):
    """Publishes camera/image_raw, camera/camera_info, pick_result, /clock and /tf_static.

    Shows virtual parts on a tray and obeys the advice on feeder_advice/<part>. Simulated time
    stands still while vision system and controller work: run them with use_sim_time.

    Parameters
    ----------
    options : of rclpy.node.Node, such as the namespace and the context
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
        self._images, self._missed, self._silent_since = 0, 0, 0.0
        self._loop: object = None
        self._image_output = advertise(self, Image, IMAGE, IMAGES, overridable=True)
        self._info_output = advertise(self, CameraInfo, CAMERA_INFO, IMAGES, overridable=True)
        self._result_output = advertise(self, PickResult, PICK_RESULT, CELL, overridable=True)
        self._transform_output = publish_static_transform(
            self, camera_transform(self._frame, self._camera_frame)
        )
        self._missing = partial(missing_text, self._result_output, values['subscribers'])
        self._clock_output = advertise(self, Clock, CLOCK, QoSProfile(depth=1))
        self._duplicates = DuplicateNodeDetector(self, CAMERA_SIMULATOR)
        publish_diagnostics(self, self._diagnose, self._duplicates)
        steady_timer(self, CLOCK_PERIOD, guarded(self, 'the clock stops', self._tick))
        self.get_logger().info('ready')

    def close(self) -> None:
        """End the process that builds models."""
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
        while True:
            images, is_ready = self._images, self._truth.is_ready(self._answers.advice)
            may_run = images > 0 or not self._missing()
            if self._feeder and is_ready and may_run and not self._duplicates.check():
                await cycle()
            if self._images == images:
                await sleep_for(self, CLOCK_PERIOD)

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
        is_first = True
        while True:
            self._info_output.publish(info)
            self._image_output.publish(image)
            # A controller that was restarted counts epochs from 0.
            least = self._epoch if is_first else 0
            found = await self._answers.until(partial(self._answers.to, stamp, least), RETRY)
            if found is not None:
                self._silent_since = 0.0
                return found
            if (waits := self._answers.to(stamp, 0, waits=True)) is not None:
                self._silent_since = 0.0
                return waits
            is_first = False
            if time.monotonic() - begin > PATIENCE:
                self._silent_since = begin
                self.get_logger().warning(
                    self._answers.hint(self._now), throttle_duration_sec=2 * PATIENCE
                )

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
        await self._answers.reach(self._epoch, RETRY)

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
        values = {'part': self._part, 'images': self._images, 'missed picks': self._missed}
        if feeder is not None:
            values |= feeder_values(feeder)
        state = 'runs' if self._images else self._missing() or self._truth.state
        errors = [self._truth.error] if self._truth.error else []
        warnings = [self._answers.hint(self._now)] if self._silent_since else []
        return Diagnosis(state, values, [*warnings, *clock_conflicts(self)], errors)


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(CameraSimulator, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())

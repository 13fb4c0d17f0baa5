"""The feeder_controller node: advises what to pick, and when to flip, spread or supply parts."""

import math
import sys
from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import Pose as PoseMsg
from rclpy.node import Node
from resting_aspects_interfaces.msg import (
    DetectionArray,
    FeederAdvice,
    FeederPick,
    PickResult,
)
from std_msgs.msg import Header

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.control import Choice
from resting_aspects_ros.feeding.grasps import Detection
from resting_aspects_ros.feeding.tray_state import (
    SECOND,
    ChosenPart,
    CurrentAdvice,
    Image,
    PickOutcome,
    TrayState,
    advise_image,
)
from resting_aspects_ros.nodes.feeder_controller.model_updates import (
    PARAMETERS,
    ModelUpdates,
    settings_from,
)
from resting_aspects_ros.ros.callbacks import advertise, guarded, steady_timer, subscribe
from resting_aspects_ros.ros.conversions import (
    nanoseconds,
    pose_msg,
)
from resting_aspects_ros.ros.health import Diagnosis, DuplicateNodeDetector, publish_diagnostics
from resting_aspects_ros.ros.interface import (
    CELL,
    DETECTIONS,
    FEEDER_ADVICE,
    FEEDER_CONTROLLER,
    LATCHED,
    PICK_RESULT,
    RESULTS,
)
from resting_aspects_ros.ros.interface import CHOICES as NAMED_CHOICES
from resting_aspects_ros.ros.program import declare, run_node
from resting_aspects_ros.vision.location import Pose
from resting_aspects_ros.vision.rolling import KnownPart

CHOICES = {Choice(name): number for number, name in NAMED_CHOICES.items()}
OUTCOMES = {number: PickOutcome(name) for number, name in RESULTS.items()}


def image_from(msg: DetectionArray) -> Image:
    """Return the image in a message; its values are checked by the tray state."""
    return Image(
        msg.image,
        nanoseconds(msg.header.stamp),
        msg.header.frame_id,
        tuple(
            Detection(k, d.part, d.class_id, d.score, d.x, d.y, d.yaw, d.clearance)
            for k, d in enumerate(msg.detections)
        ),
    )


def pick_msgs(picks: Sequence[ChosenPart], part: KnownPart) -> list[FeederPick]:
    """Return the messages for parts to be picked, with all poses."""
    return [
        FeederPick(
            detection=pick.detection.index,
            symmetry_class=pick.symmetry_class,
            score=pick.detection.score,
            poses=_pose_msgs(
                part.placements[pick.symmetry_class - 1].poses(
                    pick.detection.x, pick.detection.y, pick.detection.yaw
                )
            ),
            grasps=_pose_msgs(pick.grasps),
        )
        for pick in picks
    ]


def _pose_msgs(poses: Sequence[Pose]) -> list[PoseMsg]:
    return [pose_msg(pose.position, pose.orientation) for pose in poses]


# Without an image for longer than the advice takes and this time, the camera has stopped, s.
IMAGE_TIMEOUT = 5.0
CHECK_PERIOD = 0.5
# Minimum time between two log lines about problems, s.
LOG_PERIOD = 10.0
# Supplies after which no part was seen, until there is a warning.
MAX_EMPTY = 3


class FeederController(Node):
    """Publishes feeder_advice/<part>: pick, flip, spread, supply or wait.

    Subscribes to detections, pick_result, parts/<part>, aspect_distributions/<part> and
    transitions/<part>, and calls get_distribution if no drops are known.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(FEEDER_CONTROLLER, **options)
        self._settings = settings_from(declare(self, PARAMETERS))
        self._part = self._settings.part
        self._tray = TrayState()
        self._advice: CurrentAdvice | None = None  # for the newest image
        self._published: tuple[object, ...] = ()
        self._event = self._now()  # time of the last image or result, ns
        self._waits = False
        self._problem = ''
        self._used = self._refused = 0  # images
        self._empty, self._empty_epoch = 0, -1
        topic = f'{FEEDER_ADVICE}/{self._part}'
        self._output = advertise(self, FeederAdvice, topic, LATCHED, overridable=True)
        self._model = ModelUpdates(self, self._settings, self._on_model)
        self._input = subscribe(
            self, DetectionArray, DETECTIONS, self._on_detections, CELL, overridable=True
        )
        subscribe(self, PickResult, PICK_RESULT, self._on_result, CELL, overridable=True)
        steady_timer(self, CHECK_PERIOD, guarded(self, 'the advice is not updated', self._update))
        publish_diagnostics(
            self,
            self._diagnose,
            DuplicateNodeDetector(self, FEEDER_CONTROLLER, part=self._part),
        )
        self._update()
        self.get_logger().info(f'ready: waiting for {self._input.topic_name}')

    def close(self) -> None:
        """End the process that builds models."""
        self._model.stop()

    # Inputs

    def _on_detections(self, message: DetectionArray) -> None:
        now = self._now()
        try:
            is_used = self._tray.add_image(image_from(message), now)
        except InvalidValueError as error:
            self._refused += 1
            self._report(str(error))
            return
        if not is_used:
            return
        self._used += 1
        self._event, self._problem = now, ''
        self._advise()
        self._count_empty()
        self._update()

    def _on_result(self, message: PickResult) -> None:
        now = self._now()
        outcome = OUTCOMES.get(message.result)
        problem = self._tray.add_result(
            outcome, message.image, message.detection, nanoseconds(message.header.stamp), now
        )
        self._event = now
        if problem:
            self._report(problem)
        image = self._tray.image
        if image is not None and self._advice is not None:
            self._advice = self._advice.after_picks(image)
        self._update()

    def _on_model(self) -> None:
        if (model := self._model.current) is not None:
            drops, flips = self._model.counts
            self.get_logger().info(
                f'{self._model.share.probability:.1%} of {self._part} can be picked ({drops} '
                f'drops, {flips} flips): {60 * model.values.rate:.1f} parts per minute with '
                f'{model.best_number} parts on the tray'
            )
        # The picks of an image are worked off with the model with which they were chosen.
        is_untouched = self._tray.image == self._tray.newest
        if model is None or self._advice is None or is_untouched:
            self._advise()
        self._update()

    # Advice

    def _advise(self) -> None:
        image, model = self._tray.image, self._model.current
        if image is None or model is None:
            self._advice = None
            return
        self._advice = advise_image(image, self._model.part, model)
        for problem in self._advice.problems[:1]:
            self._report(problem)

    def _count_empty(self) -> None:
        """Count epochs in which no part was seen."""
        if self._advice is None or self._advice.parts:
            self._empty, self._empty_epoch = 0, -1
        elif self._tray.epoch != self._empty_epoch:
            self._empty, self._empty_epoch = self._empty + 1, self._tray.epoch

    def _current(self) -> CurrentAdvice:
        """Return the advice at this time; to wait if nothing else is certain."""
        if self._model.current is None:
            return CurrentAdvice(Choice.WAIT, f'Wait: {self._model.state}.')
        silent = (self._now() - self._event) / SECOND
        limit = IMAGE_TIMEOUT + (self._advice.seconds if self._advice is not None else 0.0)
        self._waits = silent > limit
        if self._waits:
            return CurrentAdvice(Choice.WAIT, self._hint(silent), image=self._image_number)
        if self._tray.newest is None:
            return CurrentAdvice(Choice.WAIT, 'Wait: no image has arrived yet.')
        if self._tray.image is None or self._advice is None:
            return CurrentAdvice(
                Choice.WAIT,
                f'Wait for an image: that of image {self._image_number} is stale, as parts may '
                'have moved since then.',
                image=self._image_number,
            )
        return self._advice

    def _hint(self, silent: float) -> str:
        """Return why there is no advice, and what would be tried."""
        topic = self._input.topic_name
        if not self.count_publishers(topic):
            why = f'{topic} has no publisher: start the vision system'
        elif self._tray.newest is None:
            why = f'no valid image has arrived on {topic}: check the camera'
        else:
            why = f'no valid image has arrived for {silent:.0f} s: check the camera'
        if self._advice is not None:
            return f'Wait: {why}. Before, the advice was to {self._advice.phrase}.'
        assert self._model.current is not None  # otherwise the advice is to wait for a model
        number = self._model.current.best_number
        return f'Wait: {why}. If the tray is empty, supply {number} parts.'

    def _update(self) -> None:
        advice = self._current()
        picks = [each.detection.index for each in advice.picks]
        # The time in a hint changes all the time.
        reason = self._waits or advice.reason
        changing = advice.choice, advice.supply, picks, advice.image, self._tray.epoch, reason
        if (*changing, self._model.current) == self._published:
            return
        self._published = (*changing, self._model.current)
        if self._waits:
            self.get_logger().warning(advice.reason, throttle_duration_sec=LOG_PERIOD)
        share, (drops, actions) = self._model.share, self._model.counts
        expected, now = advice.expected, advice.expected.get(advice.choice)
        self._output.publish(
            FeederAdvice(
                header=Header(stamp=self.get_clock().now().to_msg(), frame_id=advice.frame),
                part=self._part,
                epoch=self._tray.epoch,
                picks=pick_msgs(advice.picks, self._model.part.known) if advice.picks else [],
                pickable_share=share.probability,
                lower=share.lower,
                upper=share.upper,
                drops=drops,
                actions=actions,
                image=advice.image,
                choice=CHOICES[advice.choice],
                then=CHOICES[advice.then],
                supply=advice.supply,
                rate=math.nan if now is None else now.rate,
                reason=advice.reason,
                choices=[CHOICES[choice] for choice in expected],
                expected_picks=[each.picks for each in expected.values()],
                seconds=[each.seconds for each in expected.values()],
                rates=[each.rate for each in expected.values()],
            )
        )

    # Diagnostics

    def _diagnose(self) -> Diagnosis:
        advice = self._current()
        values = {
            'images used': self._used,
            'images refused': self._refused,
            'images stale': self._tray.stale,
        }
        warnings = [self._problem] if self._problem else []
        if self._waits:
            warnings.append(advice.reason)
        if self._empty >= MAX_EMPTY:
            warnings.append(
                f'no {self._part} was seen after {self._empty} actions: check the hopper and the '
                'vision system'
            )
        errors = [self._model.error] if self._model.error else []
        return Diagnosis(advice.phrase, values, [*warnings, *self._model.warnings], errors)

    def _report(self, problem: str) -> None:
        """Log a problem, and show it in the diagnostics until the next image."""
        self._problem = problem
        self.get_logger().warning(problem, throttle_duration_sec=LOG_PERIOD)

    @property
    def _image_number(self) -> int:
        return self._tray.newest.number if self._tray.newest is not None else 0

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)


def main() -> int:
    """Run the node in a process of its own."""
    return run_node(FeederController, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())

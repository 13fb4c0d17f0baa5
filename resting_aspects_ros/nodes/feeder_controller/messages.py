"""Conversions between the messages of the controller and its types."""

import math
from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMsg
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, FeederPick
from std_msgs.msg import Header

from resting_aspects_ros.feeding.control import Choice, Expected
from resting_aspects_ros.nodes.feeder_controller.advice import ChosenPart, CurrentAdvice
from resting_aspects_ros.nodes.feeder_controller.tray_state import Detection, Image, PickOutcome
from resting_aspects_ros.ros.conversions import nanoseconds, pose_msg
from resting_aspects_ros.ros.feeder_names import CHOICES as NAMED_CHOICES
from resting_aspects_ros.ros.feeder_names import RESULTS
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.vision.known_part import KnownPart
from resting_aspects_ros.vision.location import Pose

CHOICES = {Choice(name): number for number, name in NAMED_CHOICES.items()}
OUTCOMES = {number: PickOutcome(name) for number, name in RESULTS.items()}
UNKNOWN = Interval(math.nan, math.nan, math.nan)


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
    return [pose_msg(pose.position.tolist(), pose.orientation.tolist()) for pose in poses]


def advice_msg(
    advice: CurrentAdvice,
    part: str,
    epoch: int,
    stamp: Time,
    picks: Sequence[FeederPick] = (),
    share: Interval = UNKNOWN,
    drops: int = 0,
    actions: int = 0,
) -> FeederAdvice:
    """Return the message for an advice."""
    return FeederAdvice(
        header=Header(stamp=stamp, frame_id=advice.frame),
        part=part,
        epoch=epoch,
        image=advice.image,
        choice=CHOICES[advice.choice],
        picks=picks,
        then=CHOICES[advice.then],
        supply=advice.supply,
        reason=advice.reason,
        pickable_share=share.probability,
        lower=share.lower,
        upper=share.upper,
        drops=drops,
        actions=actions,
        **_expected_fields(advice.expected),
    )


def _expected_fields(expected: Mapping[Choice, Expected]) -> dict[str, list[float] | list[int]]:
    return {
        'choices': [CHOICES[choice] for choice in expected],
        'expected_picks': [each.picks for each in expected.values()],
        'seconds': [each.seconds for each in expected.values()],
        'rates': [each.rate for each in expected.values()],
    }

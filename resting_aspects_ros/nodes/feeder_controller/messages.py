"""Conversions between the messages of the controller and its types."""

import math
from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMsg
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    DetectionArray,
    FeederAdvice,
    FeederPick,
    PartDescription,
    RunDescription,
)
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg
from std_msgs.msg import Header

from resting_aspects_ros.api.forecast import footprints_of
from resting_aspects_ros.api.grasps import check_grasps
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.control import Choice, Expected
from resting_aspects_ros.feeding.evidence import FedPart, KnownDrops, KnownFlips, SimulatedRun
from resting_aspects_ros.feeding.image_advice import ChosenPart, CurrentAdvice
from resting_aspects_ros.feeding.tray_state import Detection, Image, PickOutcome
from resting_aspects_ros.ros.conversions import (
    check_description,
    nanoseconds,
    part_from,
    pose_msg,
)
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.feeder_names import CHOICES as NAMED_CHOICES
from resting_aspects_ros.ros.feeder_names import RESULTS
from resting_aspects_ros.ros.transition_conversions import (
    check_numbering,
    check_transitions,
    transition_matrix_from,
)
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.vision.grasp import Grasp
from resting_aspects_ros.vision.location import Pose
from resting_aspects_ros.vision.rolling import KnownPart

CHOICES = {Choice(name): number for number, name in NAMED_CHOICES.items()}
OUTCOMES = {number: PickOutcome(name) for number, name in RESULTS.items()}
UNKNOWN = Interval(math.nan, math.nan, math.nan)


def read_fed_part(data: bytes, name: str, grasps: tuple[Grasp, ...] = ()) -> FedPart:
    """Return the part in a serialized description on parts/<name>; runs in a FileWorker."""
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    part = part_from(message)
    known = known_part(part, {1: 1.0})  # the shares are not used: they are those of the drops
    check_grasps(grasps, known.placements, ())
    classes = known.aspects.classes()
    footprints = footprints_of(known.part, known.aspects, classes, grasps)
    return FedPart(known, footprints, grasps)


def drops_from(message: AspectDistribution) -> KnownDrops:
    """Return the drops in a message; raises InvalidValueError."""
    if message.aspect_numbering != ASPECT_NUMBERING:
        raise InvalidValueError(
            f'invalid aspect_numbering {message.aspect_numbering}: expected {ASPECT_NUMBERING}'
        )
    return KnownDrops(_run_from(message.run, message.complete), distribution_from(message))


def flips_from(message: TransitionMatrixMsg, part: str) -> KnownFlips:
    """Return the flips in a message on transitions/<part>; raises InvalidValueError."""
    check_transitions(message, part)
    check_numbering(message)
    name = message.action.name or message.action.kind
    run = _run_from(message.run, message.complete)
    return KnownFlips(run, name, transition_matrix_from(message))


def _run_from(run: RunDescription, complete: bool) -> SimulatedRun:
    return SimulatedRun(
        run.run_id, run.part, run.part_sha256, run.conditions, run.conditions.surface, complete
    )


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

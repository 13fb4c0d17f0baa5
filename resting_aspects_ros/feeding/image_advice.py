"""The advice for the newest image, as it changes while the robot works on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.control import Choice, ControllerModel, Expected, SeenPart, advise
from resting_aspects_ros.feeding.evidence import FedPart
from resting_aspects_ros.feeding.tray_state import (
    Detection,
    Image,
    known_class,
    other_parts,
)
from resting_aspects_ros.vision.grasp import free_grasps
from resting_aspects_ros.vision.location import Pose

PHRASES = {
    Choice.PICK: 'pick parts',
    Choice.FLIP: 'flip the parts',
    Choice.SPREAD: 'spread the parts',
    Choice.WAIT: 'wait',
}


@dataclass(frozen=True, eq=False)
class ChosenPart:
    """A part to be picked.

    grasps : tuple of Pose
        Poses of the gripper in the frame of the image, best first; empty if no grasps are given.
    """

    detection: Detection
    symmetry_class: int
    grasps: tuple[Pose, ...] = ()


@dataclass(frozen=True, eq=False)
class CurrentAdvice:
    """What to do now.

    picks : tuple of ChosenPart
        Parts to be picked, best first.
    then : Choice
        After the picks; WAIT: only the next image.
    image, frame : the image that the advice follows from
    parts : int
        Parts of the own kind in the image, and those that are not recognised.
    problems : tuple of str
        What is wrong with detections of the image.
    """

    choice: Choice
    reason: str
    picks: tuple[ChosenPart, ...] = ()
    then: Choice = Choice.WAIT
    supply: int = 0
    expected: Mapping[Choice, Expected] = field(default_factory=dict)
    image: int = 0
    frame: str = ''
    parts: int = 0
    problems: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """Expected time until the next image and its picks are over, s."""
        each = self.expected.get(self.choice)
        return each.seconds if each is not None else 0.0

    @property
    def phrase(self) -> str:
        """What to do, as part of a sentence."""
        if self.choice is Choice.SUPPLY:
            return f'supply {self.supply} parts' if self.supply != 1 else 'supply 1 part'
        return PHRASES[self.choice]

    def after_picks(self, image: Image) -> 'CurrentAdvice':
        """Return the advice for an image from which parts have been picked since then."""
        left = {each.index for each in image.detections}
        picks = tuple(pick for pick in self.picks if pick.detection.index in left)
        if self.choice is not Choice.PICK or picks:
            return replace(self, picks=picks)
        done = f'All chosen parts of image {self.image} are picked'
        if self.then is Choice.WAIT:
            return replace(self, choice=Choice.WAIT, picks=(), reason=f'{done}: take an image.')
        advice = replace(self, choice=self.then, picks=(), then=Choice.WAIT)
        return replace(advice, reason=f'{done}: {advice.phrase}.')


def advise_image(image: Image, fed: FedPart, model: ControllerModel) -> CurrentAdvice:
    """Return the advice for an image.

    Detections of other parts are left out; their places are in the clearances. Invalid ones count
    as parts that are not recognised. With grasps, a part is only picked if one of them is free.
    """
    part = fed.known.part.name
    own, classes, problems = [], [], []
    for each in image.detections:
        if each.part not in (part, ''):
            continue
        number = 0
        try:
            number = known_class(each, len(model.feeder.drop)) if each.part else 0
        except InvalidValueError as error:
            problems.append(f'{error} (image {image.number})')
        own.append(each)
        classes.append(number)
    seen = [
        SeenPart(number, each.clearance if number else 0.0, each.score if number else 0.0)
        for each, number in zip(own, classes, strict=True)
    ]
    grasps: list[tuple[Pose, ...]] = [()] * len(own)
    if fed.grasps:
        strange = [each for each in image.detections if each.part not in (part, '')]
        all_classes = [*classes, *([0] * len(strange))]
        grasps = free_grasps([*own, *strange], all_classes, fed.known, fed.grasps)[: len(own)]
        seen = [
            each if poses else replace(each, clearance=-1.0)
            for each, poses in zip(seen, grasps, strict=True)
        ]
    found = advise(seen, model)
    others = other_parts(image.detections, part)
    reason = found.reason
    if not own:
        reason = f'Image {image.number} shows no {part}{_beside(others)}. {reason}'
    return CurrentAdvice(
        choice=found.choice,
        reason=reason,
        picks=tuple(ChosenPart(own[i], classes[i], grasps[i]) for i in found.picks),
        then=found.then or Choice.WAIT,
        supply=found.supply,
        expected=found.expected,
        image=image.number,
        frame=image.frame,
        parts=len(own),
        problems=tuple(problems),
    )


def _beside(others: Sequence[str]) -> str:
    return f', but {", ".join(others[:3])}' if others else ''

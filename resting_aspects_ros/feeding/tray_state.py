"""The parts on the tray, by the newest image less what was picked since, and the advice for it.

Each result of the robot or the feeder begins a new epoch. A part that was picked leaves the others
where they are, because it was free. After anything else, detections are stale until an image
arrives that was exposed later. Times are in ns; no clock is read here.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.control import Choice, ControllerModel, Option, SeenPart, advise
from resting_aspects_ros.feeding.evidence import FedPart
from resting_aspects_ros.feeding.grasps import Detection, free_grasps
from resting_aspects_ros.vision.location import Pose

# -- The parts on the tray ------------------------------------------------------------------------


SECOND = 1_000_000_000
# Tolerance between the clocks of camera, robot and controller, ns.
CLOCK_TOLERANCE = SECOND // 2
# An older image is not used, ns. Its evaluation takes a part of this time.
MAX_AGE = 10 * SECOND
# Number of earlier images whose detections may still be reported as picked.
MAX_EARLIER = 100
# Largest coordinate, m: coordinates in mm or pixels are beyond it.
MAX_COORDINATE = 10.0


class PickOutcome(Enum):
    """What a robot or a feeder has done."""

    PICKED = 'picked'
    MISSED = 'missed'
    DROPPED = 'dropped'
    MOVED = 'moved'


@dataclass(frozen=True)
class Image:
    """The detections of one image.

    time : int
        Exposure, ns.
    """

    number: int
    time: int
    frame: str
    detections: tuple[Detection, ...] = field(default=(), repr=False)


class TrayState:
    """The newest image of the tray, and which of its detections are still there.

    epoch : int
        Number of results.
    stale : int
        Number of images that were not used because they were exposed before a result.
    """

    def __init__(self) -> None:
        self.epoch = 0
        self.stale = 0
        self._since = 0  # when the last result was over
        self._newest: Image | None = None
        self._earlier: dict[int, int] = {}  # number of an image before: number of its detections
        self._picked: set[int] = set()
        self._is_stale = True

    @property
    def newest(self) -> Image | None:
        """The newest image, even if its detections are stale."""
        return self._newest

    @property
    def image(self) -> Image | None:
        """The newest image without the parts that were picked; None if it is stale."""
        if self._newest is None or self._is_stale:
            return None
        left = tuple(d for d in self._newest.detections if d.index not in self._picked)
        return Image(self._newest.number, self._newest.time, self._newest.frame, left)

    def add_image(self, image: Image, now: int) -> bool:
        """Take an image and return whether it is used.

        It is not used if it was exposed before the last result, or if it arrives twice. Raises
        InvalidValueError if its number, time or frame is invalid; the state is then unchanged.
        """
        self._check_clock(now)
        _check_image(image, now)
        newest = self._newest
        if newest is not None:
            if (image.number, image.time) == (newest.number, newest.time):
                return False
            if image.time <= newest.time:
                raise InvalidValueError(
                    f'invalid time of image {image.number}: expected a later one than that of '
                    f'image {newest.number}, which has arrived before (out of order)'
                )
            if image.number == newest.number:
                raise InvalidValueError(
                    f'invalid number of image {image.number}: expected another one than that of '
                    'the previous image'
                )
        if image.time < self._since:
            self.stale += 1
            return False
        if newest is not None:
            self._earlier.pop(newest.number, None)
            self._earlier[newest.number] = len(newest.detections)
            while len(self._earlier) > MAX_EARLIER:
                del self._earlier[next(iter(self._earlier))]
        self._newest, self._picked, self._is_stale = image, set(), False
        return True

    def add_result(
        self, outcome: PickOutcome | None, number: int, index: int, time: int, now: int
    ) -> str:
        """Begin a new epoch after a result; return what is wrong with it, or ''.

        A result that is not understood makes all detections stale, because something has moved. A
        result about something else than the newest image that was over before the exposure of this
        image has no effect on it: messages on two topics may arrive in any order.

        Parameters
        ----------
        outcome : PickOutcome or None
            None: not known.
        number, index : int
            The image and the detection; ignored for MOVED.
        time : int
            When it was over, ns; 0: now.
        now : int
        """
        self._check_clock(now)
        self.epoch += 1
        problem = self._problem(outcome, number, index)
        if time > now + CLOCK_TOLERANCE:
            problem = problem or (
                f'invalid time of a pick result: expected none in the future; it is '
                f'{(time - now) / SECOND:.1f} s ahead of the clock of this node'
            )
            time = now
        time = time or now
        self._since = max(self._since, time)
        newest = self._newest
        is_of_newest = newest is not None and newest.number == number
        if outcome is PickOutcome.PICKED and is_of_newest and not problem:
            self._picked.add(index)
        elif (
            newest is None or newest.time < time or (is_of_newest and outcome != PickOutcome.MOVED)
        ):
            self._is_stale = True
        return problem

    def _problem(self, outcome: PickOutcome | None, number: int, index: int) -> str:
        if outcome is None:
            return 'invalid result of a pick: expected PICKED, MISSED, DROPPED or MOVED'
        if outcome is PickOutcome.MOVED:
            return ''
        image = self._newest
        expected = 'none before the first image'
        if image is not None and image.number == number:
            if index < len(image.detections) and index not in self._picked:
                return ''
            expected = 'a detection that was not picked before'
        elif image is not None:
            if index < self._earlier.get(number, 0):
                return ''
            expected = f'one of image {image.number}'
        return f'invalid detection {index} of image {number} in a pick result: expected {expected}'

    def _check_clock(self, now: int) -> None:
        """Forget everything if the clock was set back, as when simulated time begins again."""
        newest = self._newest.time if self._newest is not None else 0
        if max(newest, self._since) > now + CLOCK_TOLERANCE:
            self._newest, self._since, self._is_stale = None, 0, True


def known_class(detection: Detection, classes: int) -> int:
    """Return the symmetry class of a detection of the part; 0 if it is not recognised.

    Raises InvalidValueError for a value that is not valid: such a part cannot be picked either.
    """
    each, numbers = detection, {'': 0, **{str(k): k for k in range(1, classes + 1)}}
    for name, is_valid, expected in (
        ('x', abs(each.x) <= MAX_COORDINATE, f'at most {MAX_COORDINATE:g} m'),
        ('y', abs(each.y) <= MAX_COORDINATE, f'at most {MAX_COORDINATE:g} m'),
        ('yaw', math.isfinite(each.yaw), 'a finite number'),
        ('score', 0 <= each.score <= 1, '0 to 1'),
        ('clearance', each.clearance >= 0, '0 m or more'),
        ('class_id', each.class_id in numbers, f'a symmetry class, "1" to "{classes}", or ""'),
    ):
        if not is_valid:
            raise InvalidValueError(
                f'invalid {name} {shown(getattr(each, name))} of detection {each.index}: '
                f'expected {expected}'
            )
    return numbers[each.class_id]


def _check_image(image: Image, now: int) -> None:
    """Raise InvalidValueError if the time or the frame of an image is not valid."""
    if image.time > now + CLOCK_TOLERANCE:
        raise InvalidValueError(
            f'invalid time of image {image.number}: expected none in the future; it is '
            f'{(image.time - now) / SECOND:.1f} s ahead of the clock of this node'
        )
    if now - image.time > MAX_AGE:
        raise InvalidValueError(
            f'invalid time of image {image.number}: expected that of its exposure, at most '
            f'{MAX_AGE // SECOND} s ago; it is {(now - image.time) / SECOND:.1f} s ago'
        )
    if not image.frame or image.frame.startswith('/') or not image.frame.isprintable():
        raise InvalidValueError(
            f'invalid frame_id {shown(image.frame)} of image {image.number}: expected the name of '
            'a frame, without a leading slash'
        )


# -- The advice for the newest image --------------------------------------------------------------


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
    expected: Mapping[Choice, Option] = field(default_factory=dict)
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
        if self.choice is Choice.WAIT:
            return 'wait'
        return f'{self.choice.value} {"" if self.choice is Choice.PICK else "the "}parts'

    def after_picks(self, image: Image) -> 'CurrentAdvice':
        """Return the advice for an image from which parts have been picked since then."""
        left = {each.index for each in image.detections}
        picks = tuple(pick for pick in self.picks if pick.detection.index in left)
        if self.choice is not Choice.PICK or len(picks) == len(self.picks):
            return replace(self, picks=picks)
        if picks:
            number = len(picks)
            what = f'{number} parts that are' if number > 1 else 'part that is'
            reason = f'Pick the {what} left of those chosen in image {self.image}.'
            return replace(self, picks=picks, reason=reason)
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
    others = sorted({each.part for each in image.detections} - {part, ''})
    reason = found.reason
    if not own:
        beside = f', but {", ".join(others[:3])}' if others else ''
        reason = f'Image {image.number} shows no {part}{beside}. {reason}'
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

"""What a feeder controller knows of its part, and the model of its decisions from that.

The evidence is the newest drops and the newest flips that fit the part. `feeding.control` has the
decisions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.control import ControllerModel, controller_model
from resting_aspects_ros.feeding.footprint import Footprint, Tray
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.grasps import Grasp
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.transitions import TransitionMatrix
from resting_aspects_ros.vision.rolling import KnownPart

# If there are fewer flips of a class, the missing ones have the result of a drop.
MIN_FLIPS = 20
# While a run is in progress, evidence is new when there are more drops by this factor.
GROWTH = 1.2


@dataclass(frozen=True)
class Settings:
    """What a user states of the cell; None: the model finds it, or there is no limit.

    grasps : tuple of Grasp
        The preferred ones first; empty: only the clearance matters.
    """

    part: str
    pickable: tuple[int, ...]
    action: str
    grasps: tuple[Grasp, ...]
    tray: Tray
    times: CycleTimes
    spread: float | None
    best_number: int | None
    max_picks: int | None
    max_supply: int | None
    min_score: float


@dataclass(frozen=True, eq=False)
class FedPart:
    """The part in a feeder, with the footprints of its classes, and the grasps of the robot."""

    known: KnownPart
    footprints: tuple[Footprint, ...]
    grasps: tuple[Grasp, ...] = ()

    @property
    def version(self) -> str:
        """Hash of the part."""
        return self.known.part.part_sha256


Found = TypeVar('Found', Distribution, TransitionMatrix)


@dataclass(frozen=True, eq=False)
class Simulated(Generic[Found]):
    """The drops or the flips of a run.

    conditions : object
        Only compared: runs under equal conditions continue each other.
    action : str or None
        Name of the action of flips.
    """

    found: Found
    run_id: str
    part: str
    part_sha256: str
    conditions: object
    complete: bool
    action: str | None = None


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of the classes of a part.

    drops : Distribution
        Over the aspects of the part; at least one drop came to rest in an aspect.
    flips : TransitionMatrix or None
    """

    drops: Distribution
    flips: TransitionMatrix | None = None

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of drops that came to rest in an aspect, and of flips."""
        flips = int(self.flips.counts.sum()) if self.flips is not None else 0
        return int(self.drops.counts.sum()), flips


class PartEvidence:
    """The evidence of the part in a feeder, from the newest runs of it.

    Parameters
    ----------
    action : str
        Name of the action whose transitions are those of a flip.
    warn : called with the text of each warning

    fed : FedPart or None
        The part, once it has been read.
    """

    def __init__(self, action: str, warn: Callable[[str], object]) -> None:
        self._action = action
        self._warn = warn
        self._ids: tuple[int, ...] = ()  # of the pickable aspects
        # The newest ones, even if they do not fit.
        self._drops: Simulated[Distribution] | None = None
        self._flips: Simulated[TransitionMatrix] | None = None
        self._used: tuple[int, int] | None = None  # drops and flips of the model
        self._ignored = {'drops': '', 'flips': ''}
        self.fed: FedPart | None = None
        self._counted: Distribution | None = None
        self._transitions: TransitionMatrix | None = None

    @property
    def ignored(self) -> list[str]:
        """Why drops or flips are not used."""
        return [text for text in self._ignored.values() if text]

    @property
    def current(self) -> Evidence | None:
        """The evidence; None while no drop is known that came to rest in an aspect."""
        if self._counted is None or not self._counted.counts.any():
            return None
        return Evidence(self._counted, self._transitions)

    @property
    def lacks_drops(self) -> bool:
        """Whether the part has been read, and no drops of it are known."""
        return self.fed is not None and self._counted is None

    @property
    def is_complete(self) -> bool:
        """Whether the newest drops and the newest flips are those of complete runs."""
        newest = self._drops, self._flips
        return all(each is not None and each.complete for each in newest)

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of drops and of flips in the evidence; 0 without evidence."""
        return self.current.counts if self.current is not None else (0, 0)

    def set_part(self, fed: FedPart, ids: tuple[int, ...]) -> None:
        """Begin again with a part, the ids of its pickable aspects, and what is known of it."""
        self._ids = ids
        self.fed, self._used = fed, None
        self._counted = self._fitting('drops', self._drops)
        self._transitions = self._fitting('flips', self._flips)

    def forget_part(self) -> None:
        """Forget a part that cannot be used."""
        self.fed = self._counted = self._transitions = None

    def add_drops(self, new: Simulated[Distribution]) -> bool:
        """Take a distribution; return whether it changes the evidence enough for a new model."""
        old = self._drops
        if new.found.drops == 0:
            return False
        if old is not None and (old.part_sha256, old.conditions) == (
            new.part_sha256,
            new.conditions,
        ):
            if new.found.drops < old.found.drops:  # of another run that overlaps or begins
                return False
        else:
            self._used = None
        self._drops = new
        fitting = self._fitting('drops', new)
        self._counted = fitting or self._counted
        return fitting is not None and self._is_new(new.complete)

    def add_flips(self, new: Simulated[TransitionMatrix]) -> bool:
        """Take a transition matrix; return whether it changes the evidence enough."""
        if not new.found.counts.any():
            return False
        self._flips = new
        fitting = self._fitting('flips', new)
        self._transitions = fitting or self._transitions
        return fitting is not None and self._is_new(new.complete)

    def ignore(self, kind: str, error: InvalidValueError) -> None:
        """Report that the newest 'drops' or 'flips' are not used, once for the same reason."""
        what = {'drops': 'a distribution', 'flips': 'a transition matrix'}[kind]
        text = f'ignored {what}: {error}'
        if self._ignored[kind] != text:
            self._warn(text)
        self._ignored[kind] = text

    def use(self) -> Evidence:
        """Return the evidence for a model."""
        found = self.current
        assert found is not None
        self._used = self.counts
        return found

    def share(self, evidence: Evidence) -> Interval:
        """Return the probability that a supplied part is pickable."""
        return evidence.drops.combined_interval(self._ids)

    def _fitting(self, kind: str, new: Simulated[Found] | None) -> Found | None:
        """Return drops or flips of the part and the action; report why others are not used."""
        if self.fed is None or new is None:
            return None
        try:
            if new.action not in (None, self._action):
                if self._transitions is not None:
                    return None  # the topic has the newest action of any name
                raise InvalidValueError(
                    f'invalid action {new.action}: expected {self._action}, as the parameter '
                    'action states'
                )
            _check_fit(self.fed.known, new)
        except InvalidValueError as error:
            self.ignore(kind, error)
            return None
        self._ignored[kind] = ''
        return new.found

    def _is_new(self, complete: bool) -> bool:
        """Return whether the evidence differs enough from that of the model."""
        if self.current is None:
            return False
        now = self.counts
        if self._used is None or complete:
            return now != self._used
        return any(b >= GROWTH * a and b > a for a, b in zip(self._used, now, strict=True))


def build_model(
    evidence: Evidence, footprints: Sequence[Footprint], settings: Settings
) -> ControllerModel:
    """Return the model of the decisions; takes about a second.

    Raises InvalidValueError if a setting does not fit the part.
    """
    drops = evidence.drops.by_class().counts
    flips = np.zeros((len(drops), len(drops)), dtype=np.int64)
    if evidence.flips is not None:
        flips = evidence.flips.by_class().counts
    feeder = FeederModel(
        drops,
        _filled(flips, drops),
        np.isin(np.arange(1, len(drops) + 1), settings.pickable),
        footprints,
        settings.tray,
        settings.times,
        settings.max_picks,
    )
    model = controller_model(
        feeder,
        spread=settings.spread,
        max_supply=settings.max_supply,
        min_score=settings.min_score,
        number=settings.best_number,
    )
    _ = model.values  # computed now: the model may be built in another process
    return model


def _filled(flips: Counts, drops: Counts) -> Counts:
    """Return flips (k, m), to which the missing ones are added with the shares of drops (k,).

    The rows with missing flips are multiplied by the number of drops, so that counts remain exact.
    """
    missing = np.maximum(MIN_FLIPS - flips.sum(axis=1, keepdims=True), 0)
    filled = flips * drops.sum()
    filled[:, : len(drops)] += missing * drops
    return np.where(missing > 0, filled, flips)


def _check_fit(part: KnownPart, run: Simulated[Found]) -> None:
    """Raise InvalidValueError if drops or flips are of another part or version."""
    if (run.part, run.part_sha256) != (part.part.name, part.part.part_sha256):
        raise InvalidValueError(
            f'invalid part {shown(run.part)} (part_sha256 {shown(run.part_sha256)}): expected '
            f'{part.part.name} (part_sha256 {part.part.part_sha256})'
        )
    if not part.aspects.matches(run.found.aspects):
        raise InvalidValueError(
            f'invalid aspects of run {shown(run.run_id)}: expected those of {part.part.name}'
        )

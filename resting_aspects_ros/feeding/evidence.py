"""What a feeder controller knows of its part, and the model of its decisions from that.

The evidence is the newest drops and the newest flips that fit the part. `feeding.control` has the
decisions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class SimulatedRun:
    """The run that drops or flips are from.

    conditions : object
        Only compared: runs under equal conditions continue each other.
    surface : str
        Name of the conditions for texts.
    """

    run_id: str
    part: str
    part_sha256: str
    conditions: object
    surface: str
    complete: bool


@dataclass(frozen=True, eq=False)
class KnownDrops:
    """The distribution of a run."""

    run: SimulatedRun
    distribution: Distribution


@dataclass(frozen=True, eq=False)
class KnownFlips:
    """The transitions of a run by an action, given by its name."""

    run: SimulatedRun
    action: str
    matrix: TransitionMatrix


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
    def drop_count(self) -> int:
        """Number of drops that came to rest in an aspect."""
        return int(self.drops.counts.sum())

    @property
    def flip_count(self) -> int:
        """Number of flips."""
        return int(self.flips.counts.sum()) if self.flips is not None else 0


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
        self._drops: KnownDrops | None = None  # the newest ones, even if they do not fit
        self._flips: KnownFlips | None = None
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
        return all(each is not None and each.run.complete for each in newest)

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of drops and of flips in the evidence; 0 without evidence."""
        found = self.current
        return (found.drop_count, found.flip_count) if found is not None else (0, 0)

    def set_part(self, fed: FedPart, ids: tuple[int, ...]) -> None:
        """Begin again with a part, the ids of its pickable aspects, and what is known of it."""
        self._ids = ids
        self.fed, self._used = fed, None
        self._counted = self._transitions = None
        self._use_drops()
        self._use_flips()

    def forget_part(self) -> None:
        """Forget a part that cannot be used."""
        self.fed = self._counted = self._transitions = None

    def add_drops(self, found: KnownDrops) -> bool:
        """Take a distribution; return whether it changes the evidence enough for a new model."""
        old = self._drops
        if found.distribution.drops == 0 or (old is not None and _has_fewer_drops(found, old)):
            return False
        self._drops = found
        if old is not None and old.run.conditions != found.run.conditions:
            self._used = None
            self._warn(
                f'the conditions of run {found.run.run_id} ({_surface(found)}) differ from those '
                f'of the previous run ({_surface(old)})'
            )
        return self._use_drops() and self._is_new(found.run.complete)

    def add_flips(self, found: KnownFlips) -> bool:
        """Take a transition matrix; return whether it changes the evidence enough."""
        if not found.matrix.counts.any():
            return False
        self._flips = found
        return self._use_flips() and self._is_new(found.run.complete)

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

    def _use_drops(self) -> bool:
        """Take the newest distribution as evidence; return whether it is valid."""
        known = self._drops
        if known is None or not self._fits('drops', known.run, known.distribution):
            return False
        self._counted = known.distribution
        return True

    def _use_flips(self) -> bool:
        """Take the newest transition matrix as evidence; return whether it is valid."""
        known = self._flips
        if known is None or not self._fits('flips', known.run, known.matrix, known.action):
            return False
        self._transitions = known.matrix
        return True

    def _fits(
        self,
        kind: str,
        run: SimulatedRun,
        found: Distribution | TransitionMatrix,
        action: str | None = None,
    ) -> bool:
        """Return whether drops or flips are of the part and of the action; report why not."""
        if self.fed is None:
            return False
        try:
            if action not in (None, self._action):
                raise InvalidValueError(
                    f'invalid action {action}: expected {self._action}, as the parameter action '
                    'states'
                )
            _check_fit(self.fed.known, run, found)
        except InvalidValueError as error:
            self.ignore(kind, error)
            return False
        self._ignored[kind] = ''
        return True

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


def _check_fit(part: KnownPart, run: SimulatedRun, found: Distribution | TransitionMatrix) -> None:
    """Raise InvalidValueError if drops or flips are of another part or version."""
    if (run.part, run.part_sha256) != (part.part.name, part.part.part_sha256):
        raise InvalidValueError(
            f'invalid part {shown(run.part)} (part_sha256 {shown(run.part_sha256)}): expected '
            f'{part.part.name} (part_sha256 {part.part.part_sha256})'
        )
    if not part.aspects.matches(found.aspects):
        raise InvalidValueError(
            f'invalid aspects of run {shown(run.run_id)}: expected those of {part.part.name}'
        )


def _has_fewer_drops(found: KnownDrops, known: KnownDrops) -> bool:
    """Return whether ``known`` has more drops of the same part under the same conditions.

    This happens when two runs overlap, or when a new run starts.
    """
    new, old = found.run, known.run
    same = (new.part_sha256, new.conditions) == (old.part_sha256, old.conditions)
    return bool(same and found.distribution.drops < known.distribution.drops)


def _surface(found: KnownDrops) -> str:
    return found.run.surface or 'own conditions'

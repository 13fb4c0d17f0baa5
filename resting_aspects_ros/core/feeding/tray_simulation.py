"""Simulation of the parts on a tray and of the time that each advice takes, for controllers."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.decision import Advice, Choice, SeenPart
from resting_aspects_ros.core.feeding.steady_state import Moves
from resting_aspects_ros.core.feeding.tray_places import DensityPlaces, Places, RandomPlaces
from resting_aspects_ros.core.reorientation.markov import Mask
from resting_aspects_ros.core.statistics.intervals import Array, Counts

WAITING = 1.0  # s, until a feeder that waits takes the next image


@dataclass(frozen=True, eq=False)
class TrayRun:
    """What happened in a simulated run.

    picks, images, supplied : int
    seconds : float
    picked : (picks,) float
        When each pick was over, s.
    choices : mapping from Choice to int
        How often each was chosen; after picks, the action that follows counts as well.
    """

    picks: int
    images: int
    supplied: int
    seconds: float
    picked: Array
    choices: Mapping[Choice, int]

    @property
    def rate(self) -> float:
        """Parts per minute."""
        return 60 * self.picks / self.seconds


class SimulatedTray:
    """Parts on a tray, each of them with a class, a place, and whether vision recognises it."""

    def __init__(
        self,
        model: ControllerModel,
        places: Places,
        generator: np.random.Generator,
        unrecognised: float = 0.0,
    ) -> None:
        self._places, self._generator, self._unrecognised = places, generator, unrecognised
        self.classes: Counts = np.zeros(0, dtype=np.int64)
        self._known: Mask = np.zeros(0, dtype=np.bool_)
        self.use(model.moves)

    def use(self, moves: Moves) -> None:
        """Take other shares of drops and flips of the same part from now on."""
        self._drop = np.cumsum(moves.drop)
        self._flips = np.cumsum(np.column_stack([moves.transitions, moves.left]), axis=1)

    def seen(self) -> list[SeenPart]:
        """Return what an image shows."""
        if not len(self.classes):
            return []
        shown_class = np.where(self._known, self.classes + 1, 0).tolist()
        clearance = self._places.clearance().tolist()
        return [SeenPart(c, d) for c, d in zip(shown_class, clearance, strict=True)]

    def remove(self, parts: Sequence[int]) -> None:
        """Remove the parts with these indices."""
        keep = np.ones(len(self.classes), dtype=np.bool_)
        keep[list(parts)] = False
        self._places.keep(keep)
        self.classes, self._known = self.classes[keep], self._known[keep]

    def flip(self) -> None:
        """Flip all parts; some may leave the tray."""
        rows = self._flips[self.classes]
        rolled = self._generator.random(len(rows))[:, None] * rows[:, -1:]
        moved = (rolled >= rows).sum(axis=1)
        self.classes = moved[moved < len(self._drop)]
        self.spread()

    def spread(self) -> None:
        """Give each part a new place."""
        self._places.shake(self.classes)
        self._known = self._recognised(len(self.classes))

    def supply(self, number: int) -> None:
        """Drop parts to random places."""
        rolled = self._generator.random(number) * self._drop[-1]
        self.classes = np.append(self.classes, np.searchsorted(self._drop, rolled, side='right'))
        self._places.add(self.classes)
        self._known = np.append(self._known, self._recognised(number))

    def _recognised(self, number: int) -> Mask:
        return np.asarray(self._generator.random(number) >= self._unrecognised)


def simulate(
    controller: Callable[[Sequence[SeenPart]], Advice],
    model: ControllerModel,
    seconds: float,
    generator: np.random.Generator,
    *,
    success: float = 1.0,
    unrecognised: float = 0.0,
    positions: bool = False,
    places: Places | None = None,
    moves: Moves | None = None,
) -> TrayRun:
    """Simulate a feeder that obeys a controller, beginning with an empty tray.

    The times are those of `cycle.cycle_time`, with an image after each advice.

    Parameters
    ----------
    controller : function of the seen parts
    model : ControllerModel
        The true moves, shares of free parts and times; the controller may have another one.
    seconds : float
        The run ends with the first image after this time.
    generator : Generator
    success : float
        Probability that a pick succeeds; otherwise, the part stays where it is.
    unrecognised : float
        Probability that a part is not recognised in its present place.
    positions : bool
        Whether parts have random positions without overlap (RandomPlaces). Otherwise, it is drawn
        from the table of the model whether they are free (DensityPlaces).
    places : Places, optional
        Empty places to be used instead.
    moves : Moves, optional
        True moves that differ from those of the model.
    """
    if not seconds > 0:
        raise InvalidValueError(f'invalid seconds {shown(seconds)}: expected more than 0')
    places = places or (RandomPlaces if positions else DensityPlaces)(model, generator)
    tray = SimulatedTray(model, places, generator, unrecognised)
    if moves is not None:
        tray.use(moves)
    clock, images, supplied = 0.0, 0, 0
    done: list[float] = []
    choices: Counter[Choice] = Counter()
    while clock < seconds:
        images += 1
        advice = controller(tray.seen())
        action = advice.then if advice.choice is Choice.PICK else advice.choice
        choices.update({advice.choice, action or advice.choice})
        hits = [success >= 1 or bool(generator.random() < success) for _ in advice.picks]
        done += [clock + k * model.times.robot for k, hit in enumerate(hits, 1) if hit]
        tray.remove([i for i, hit in zip(advice.picks, hits, strict=True) if hit])
        if action is Choice.FLIP:
            tray.flip()
        elif action is Choice.SPREAD:
            tray.spread()
        tray.supply(advice.supply)
        supplied += advice.supply
        clock += _duration(model, action, len(advice.picks)) + model.times.supply * advice.supply
    return TrayRun(len(done), images, supplied, clock, np.array(done), dict(choices))


def _duration(model: ControllerModel, action: Choice | None, picks: int) -> float:
    """Return the time of picks and of an action of the feeder with the image, s."""
    times = model.times
    seconds = times.image
    if action is Choice.WAIT:
        seconds += WAITING
    elif action is not None:
        seconds += times.settle
    if action is Choice.FLIP:
        seconds += times.vibrate
    elif action is Choice.SPREAD:
        seconds += model.spread or 0.0
    return seconds + picks * times.robot - (min(times.place, seconds) if picks else 0.0)

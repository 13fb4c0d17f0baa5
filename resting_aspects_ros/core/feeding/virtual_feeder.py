"""A feeder with parts at known places that obeys advice, and the time that this takes."""

from typing import Protocol

import numpy as np

from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.options import Choice
from resting_aspects_ros.core.feeding.tray_places import Places
from resting_aspects_ros.core.feeding.tray_simulation import WAITING, SimulatedTray
from resting_aspects_ros.core.statistics.intervals import Array

# The robot picks a part if the centroid of its outline is so close to where it was seen, m.
REACH = 2e-3


class SeenPlaces(Places, Protocol):
    """Places of outlines."""

    @property
    def centres(self) -> Array:
        """(n, 2) float: centroids of the outlines, m."""


class VirtualFeeder:
    """A tray of parts, a robot and the clock of both.

    Parameters
    ----------
    model : ControllerModel
        The true shares of drops and flips, and the times.
    places : SeenPlaces
    generator : Generator

    Attributes
    ----------
    tray : SimulatedTray
    seconds : float
        Simulated time since the beginning, s.
    picks, supplied : int
    """

    def __init__(
        self, model: ControllerModel, places: SeenPlaces, generator: np.random.Generator
    ) -> None:
        self.tray = SimulatedTray(model, places, generator)
        self._places = places
        self._model = model
        self.seconds = self._robot_ready = 0.0
        self.picks = self.supplied = 0

    def use(self, model: ControllerModel) -> None:
        """Take the true moves and the times from another model of the same part from now on."""
        self._model = model
        self.tray.use(model.moves)

    def take_image(self) -> None:
        """Let the time of an image and its evaluation pass."""
        self.seconds += self._model.times.image

    def pick(self, x: float, y: float, symmetry_class: int) -> bool:
        """Let the robot pick a part; return whether it has.

        It picks the part whose outline has its centroid at (x, y), tray frame, m, if that is of
        the symmetry class for which the robot grasps it. Other than the centre of mass, the
        centroid is the same for all poses with the same outline.
        """
        times = self._model.times
        begin = max(self.seconds, self._robot_ready)
        # The robot then places the part, while the feeder may vibrate.
        self.seconds, self._robot_ready = begin + times.robot - times.place, begin + times.robot
        if not len(self.tray.classes):
            return False
        apart = np.linalg.norm(self._places.centres - (x, y), axis=1)
        nearest = int(apart.argmin())
        is_there = bool(apart[nearest] <= REACH)
        if not is_there or self.tray.classes[nearest] + 1 != symmetry_class:
            return False
        self.tray.remove([nearest])
        self.picks += 1
        return True

    def move(self, action: Choice, supply: int = 0) -> None:
        """Flip, spread or supply parts, or wait; after that, the parts are at rest."""
        times = self._model.times
        if action is Choice.FLIP:
            self.tray.flip()
            self.seconds += times.vibrate
        elif action is Choice.SPREAD:
            self.tray.spread()
            self.seconds += self._model.spread or 0.0
        self.seconds += WAITING if action is Choice.WAIT else times.settle
        if supply:
            self.tray.supply(supply)
            self.supplied += supply
            self.seconds += times.supply * supply

"""What the kernel is given: a part, the planes, numerical parameters, and arrays to work with.

See kernel.py for units and frames. This module does not import Numba.
"""

from typing import NamedTuple

import numpy as np

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.simulation.job import CONTACT_STEPS

# Position, velocity, spin (n, 3) and orientation (n, 4) of drops; see kernel.simulate.
States = tuple[Array, Array, Array, Array]

# Corners closer to a plane than this touch it.
GAP = 1e-5
# Maximum rotation, rad, in a step of flight, and in one of lasting contact.
TURN, SWING = 0.25, 0.1
# Maximum number of contacts of a plane; of more corners, those that span the largest area.
CONTACTS = 4
# Number of columns of a contact; see kernel.py.
COLUMNS = 40


class Body(NamedTuple):
    """What the simulation needs to know of a part.

    points : (3, v) float
    starts, near : (v + 1,) and (k,) int
        Around corner i of the convex hull of the points are ``near[starts[i]:starts[i + 1]]``.
    fans, edges : (v + 1,) and (2 e,) int
        The edges of corner i between facets are ``edges[fans[i]:fans[i + 1]]``. A facet is flat
        only within a tolerance, so that a path along them need not lead to the lowest corner.
    ends, sides, feet : (e, 2) int, (e, 2) int and (e,) float
    normals : (f, 3) float
        See Polyhedron.
    minima : (f,) int
        The minimum to which the part rolls from each facet.
    directions : (m, 3) float
        Directions of gravity in the minima.
    exits, margins, heights : (m,) float
        Energies below which the part stays in an aspect, distances of the point below the centre
        of mass from the nearest edge of the flat side, or from the nearest end of the line on
        which the part rolls, and heights of the centre of mass.
    rollers : (m, 3) float
        Axes of the round sides on which the part can roll for ever; zero for a flat side.
    moments : (3,) float
    """

    points: Array
    starts: Indices
    near: Indices
    fans: Indices
    edges: Indices
    ends: Indices
    sides: Indices
    feet: Array
    normals: Array
    minima: Indices
    directions: Array
    exits: Array
    margins: Array
    heights: Array
    rollers: Array
    moments: Array


# Columns of a plane: normal and tangents, offset along the normal, restitution, friction, rolling
# and spinning friction (a length), and the velocity of its surface.
NORMAL, TANGENT, ACROSS, OFFSET, RESTITUTION = 0, 3, 6, 9, 10
FRICTION, ROLL, SPIN, CARRIES = 11, 12, 13, 14
# For planes that move: their origin, velocity, angular velocity and the derivatives of these.
ORIGIN, VELOCITY, ANGULAR, PULL, TWIST = 17, 20, 23, 26, 29
PLANE = 32
# Numbers of a motion: angular frequency, duration of a ramp and of all, phases of the second
# translation and of the rotation, size of the plate (0: infinite), and the vectors of the
# amplitudes of both translations and of the rotation.
RATE, RAMP, DURATION, SHIFT_PHASE, ROCK_PHASE, SIZE = range(6)
LIFT, SHIFT, ROCK = 6, 9, 12
MOTION = 15
# Minimum number of time steps per period of a motion.
PER_PERIOD = 40


class Ground(NamedTuple):
    """What a part can touch.

    planes : (n, PLANE) float
        Half-spaces; the part is where ``normal @ x >= offset``.
    gravity : (3,) float
        Unit vector.
    carriers : (k, 3) float
        Velocities with which surfaces can carry a part for ever; the first is zero.
    motion : (MOTION,) float
        Motion of all planes together; zero without one.
    level : bool
        Whether there is only a level plane at rest, or one that comes to rest, on which the energy
        of a part decides its aspect.
    endless : int
        In how many directions the surroundings are the same everywhere.
    driven : bool
        Whether a surface moves for ever.
    fastest : float
        A part that is faster slides for ever.
    """

    planes: Array
    gravity: Array
    carriers: Array
    motion: Array
    level: bool
    endless: int
    driven: bool
    fastest: float


class Numerics(NamedTuple):
    """Numerical parameters; see the constants. Without ``decides``, all parts come to rest."""

    steps: float = float(CONTACT_STEPS)
    gap: float = GAP
    turn: float = TURN
    swing: float = SWING
    decides: bool = True

    def refined(self, factor: float, decides: bool) -> 'Numerics':
        """Return finer parameters."""
        return Numerics(
            self.steps * factor,
            self.gap / factor,
            self.turn / factor,
            self.swing / factor,
            decides,
        )


class Work(NamedTuple):
    """Arrays that a thread uses for one drop after the other."""

    planes: Array
    axes: Array
    found: Array
    values: Array
    touching: Array
    lowest: Array
    mark: Array
    picked: Array
    con: Array
    corner: Array
    plane: Array
    roll: Array
    old: Array
    old_corner: Array
    old_roll: Array
    track: Array
    counts: Array


def work_of(body: Body, ground: Ground) -> Work:
    """Return the arrays of a thread."""
    corners, planes = body.points.shape[1], len(ground.planes)
    count = planes * CONTACTS
    return Work(
        planes=np.zeros((planes, PLANE)),
        axes=np.zeros((planes, 9)),
        found=np.tile(np.arange(corners), (planes, 1)),
        values=np.zeros((planes, 3, corners)),
        touching=np.zeros((planes, corners + 1), np.int64),
        lowest=np.zeros(planes, np.int64),
        mark=np.zeros(corners, np.int64),
        picked=np.zeros(CONTACTS, np.int64),
        con=np.zeros((count, COLUMNS)),
        corner=np.zeros(count, np.int64),
        plane=np.zeros(count, np.int64),
        roll=np.zeros((planes, 6)),
        old=np.zeros((count, 3)),
        old_corner=np.zeros((count, 2), np.int64),
        old_roll=np.zeros((planes, 6)),
        track=np.zeros(15),
        counts=np.zeros(3, np.int64),
    )

"""Parts that run over a trap at a speed, simulated in Bullet with their real shape.

Statics assumes that a part moves so slowly that gravity decides at every place. A fast part flies
over a gap that would reject it, a nose that dips is caught by the far edge, and whether a blade
pushes a part off is a question of friction. Here, parts start before the trap on a track whose
surface moves, and pass it one beside the other, without touching each other.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import convex_pieces
from resting_aspects_ros.rotations import rotate, turned_about_vertical
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import BULLET, DropJob, make_job
from resting_aspects_ros.simulation.scene import (
    Block,
    HalfSpace,
    MeshBody,
    PairValues,
    Scene,
    SceneBody,
    X,
    Y,
    Z,
)
from resting_aspects_ros.simulation.starts import GivenStarts, GivenStates, Noise, States
from resting_aspects_ros.simulation.surroundings_kinds import tray_from_scene
from resting_aspects_ros.track.description import Track
from resting_aspects_ros.track.orientations import Orientation
from resting_aspects_ros.track.support import FAR
from resting_aspects_ros.track.traps import Cut, HoldDown, Trap, Wiper

# Thickness of the track and of blades, m; parts fall past the thickness.
THICK = 2e-3
# Angle of a blade to the conveying direction, rad: it pushes parts outwards.
BLADE = math.radians(30)
# Strips of the track beside a round or oblique cut.
STRIPS = 48
# Spreads of the parts at the start: yaw, rad, distance from the wall, m, and place, as a share of
# the length of the part.
YAW, CLEARANCE, PLACE = math.radians(1.0), 2e-4, 0.25
# Lengths of the part between its start and the trap, and behind the trap.
BEFORE, AFTER = 0.3, 0.6
# A part that turned by more than this, rad, has left its orientation.
TURNED = math.radians(10.0)
# A part that takes this many times as long as at the speed of the track is caught.
PATIENCE = 3.0

OUTCOMES = ('pass', 'turn', 'reject', 'caught')


@dataclass(frozen=True, eq=False)
class TrapRuns:
    """What became of parts that ran over a trap.

    counts : (n, 4) int
        For each row, parts that passed, turned, were rejected or caught; columns as OUTCOMES.
    """

    counts: npt.NDArray[np.int64]

    @property
    def passed(self) -> Array:
        """Share (n,) of the parts that passed."""
        return np.asarray(self.counts[:, 0] / np.maximum(self.counts.sum(axis=1), 1))


def run_over(
    part: Part,
    rows: Sequence[Orientation],
    trap: Trap,
    track: Track,
    conditions: DropConditions,
    count: int,
    seed: int,
) -> TrapRuns:
    """Let parts run over a trap, ``count`` of each row, and count what becomes of them.

    Friction, rolling friction and gravity are those of the conditions; parts do not bounce.

    Raises
    ------
    InvalidValueError
        If the trap cannot be simulated.
    """
    length = max(row.length for row in rows)
    start, end = _extent(trap, length)
    scene = _scene(trap, track, conditions, start, end)
    job = _job(part, conditions, scene, seed)
    random = np.random.default_rng((seed, 9))
    counts = np.zeros((len(rows), len(OUTCOMES)), dtype=np.int64)
    for k, row in enumerate(rows):
        states = _starts(row, start, count, random)
        last = _run(job, states, part, end + AFTER * row.length, track.speed)
        ends = _ends(job, states, last, part, end + AFTER * row.length)
        counts[k] = [int((ends == code).sum()) for code in range(len(OUTCOMES))]
    return TrapRuns(counts)


def _extent(trap: Trap, length: float) -> tuple[float, float]:
    """Return where the trap begins and ends along the track, m."""
    if isinstance(trap, Cut):
        span = trap.span()
        return (0.0, 1.5 * length) if span is None else span
    if isinstance(trap, Wiper | HoldDown):
        return 0.0, 2 * length
    raise InvalidValueError(
        f'invalid trap {trap.kind}: expected a cut-out, a wiper or a cover to simulate'
    )


def _scene(
    trap: Trap, track: Track, conditions: DropConditions, start: float, end: float
) -> Scene:
    surface = track.surface
    floor = PairValues(surface.friction, 0.0, conditions.rolling_friction, speed=track.speed)
    still = PairValues(track.wall.friction, 0.0, conditions.rolling_friction)
    bodies: list[SceneBody] = []
    area = surface.area
    if isinstance(trap, Cut):
        area = area.difference(
            trap.removed()
            if trap.span() is not None
            else trap.removed().intersection(shapely.box(start, -FAR, end, FAR))
        )
    for low, high in _rectangles(area, start, end):
        bodies.append(
            Block('track', floor, X, np.array([*low, -THICK]), np.array([*high, 0.0]), Z)
        )
    bodies.append(HalfSpace('wall', still, X, Y))
    if isinstance(trap, HoldDown):
        cover = np.array([[start, 0, trap.height], [end, surface.width, 1.0]])
        bodies.append(Block('cover', still, X, cover[0], cover[1], -Z))
    if isinstance(trap, Wiper):
        bodies.append(_blade(trap, surface.width, still))
    return Scene(
        bodies=tuple(bodies),
        tray_from_scene=tray_from_scene(surface.roll, surface.pitch),
        free=0,
        region=(np.zeros(2), np.zeros(2)),
    )


def _blade(trap: Wiper, width: float, contact: PairValues) -> MeshBody:
    """Return a blade that begins at the wall and leads parts outwards."""
    long = width / math.sin(BLADE) + 0.05
    along = np.array([math.cos(BLADE), math.sin(BLADE), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    corners = np.array(
        [
            a * along + b * across + [0.0, 0.0, c]
            for a in (-0.02, long)
            for b in (0.0, THICK)
            for c in (trap.height, trap.height + 0.1)
        ]
    )
    none = np.zeros((0, 3, 3))
    return MeshBody(
        'blade', contact, X, np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), (corners,), none
    )


def _rectangles(
    area: shapely.Geometry, start: float, end: float
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return rectangles that fill an area, as lowest and highest x and y; FAR stays far."""
    x = shapely.get_coordinates(area)[:, 0]
    inside = np.unique(np.round(x[(x > start - 1e-9) & (x < end + 1e-9)], 9))
    if len(inside) > 8:
        inside = np.linspace(start, end, STRIPS + 1)
    cuts = np.unique(np.concatenate([[-1.0], inside, [start, end, 1.0]]))
    found = []
    for low, high in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        if high - low < 1e-7:
            continue
        middle = (low + high) / 2
        line = area.intersection(shapely.LineString([(middle, -FAR), (middle, FAR)]))
        for piece in shapely.get_parts(line):
            y = shapely.get_coordinates(piece)[:, 1]
            if len(y) and np.ptp(y) > 1e-6:
                found.append(((low, float(y.min())), (high, float(y.max()))))
    return found


def _job(part: Part, conditions: DropConditions, scene: Scene, seed: int) -> DropJob:
    plane = conditions.changed(surroundings=None) if conditions.surroundings else conditions
    rest = GivenStates(np.array([[0.0, 0.0, 2 * part.hull_radius]]), np.array([[0.0, 0, 0, 1]]))
    starts = GivenStarts(rest, Noise(), plane.gravity, part.hull_radius)
    job = make_job(part, plane, seed, starts=starts, engine=BULLET)
    pieces = convex_pieces(part).corners
    return dataclasses.replace(
        job,
        starts=None,
        scene=scene,
        pieces=tuple(
            (c - part.centre_of_mass) @ part.principal_axes / part.hull_radius for c in pieces
        ),
    )


def _starts(row: Orientation, start: float, count: int, random: np.random.Generator) -> States:
    """Return parts (n) in a row before the trap, scene frame: centre of mass in m, from part."""
    front = float(row.corners[:, 0].max())
    x = start - front - row.length * (BEFORE + PLACE * random.random(count))
    y = row.yaw.distance + CLEARANCE * (1 + random.random(count))
    yaw = YAW * random.standard_normal(count)
    # A turned part needs more room at the wall.
    y += np.abs(yaw) * row.length / 2
    position = np.stack([x, y, np.full(count, row.com_height + 1e-5)], axis=1)
    turned = np.array([turned_about_vertical(row.orientation, each) for each in yaw.tolist()])
    return States(position, turned, np.zeros((count, 3)), np.zeros((count, 3)))


def _run(job: DropJob, states: States, part: Part, far: float, speed: float) -> States:
    """Return the last states, m and from part, of parts that run until they are past ``far``."""
    # Bullet is imported only where it is needed.
    from resting_aspects_ros.simulation.bullet_world import World

    radius, unit = job.radius, job.time_unit
    body = _body_from_part(job, states.orientation)
    scaled = States(
        states.position / radius,
        body,
        np.tile(speed * unit / radius * X, (len(body), 1)),
        states.spin * unit,
    )
    below = -(THICK + 0.5 * part.hull_radius) / radius

    def ended(here: States) -> npt.NDArray[np.bool_]:
        return np.asarray((here.position[:, 0] * radius > far) | (here.position[:, 2] < below))

    way = far - float(states.position[:, 0].min())
    limit = PATIENCE * way / speed / unit
    last = World(job).follow(scaled, ended, limit)
    return dataclasses.replace(last, position=last.position * radius)


def _body_from_part(job: DropJob, orientation: Array) -> Array:
    """Return orientations of the body axes, from those of the part."""
    from resting_aspects_ros.rotations import composed

    return composed(orientation, job.axes)


def _ends(
    job: DropJob, first: States, last: States, part: Part, far: float
) -> npt.NDArray[np.int64]:
    """Return what became of each part (n,), as an index of OUTCOMES."""
    before = _body_from_part(job, first.orientation)
    down = np.tile(-Z, (len(before), 1))
    inverse = np.array([-1.0, -1.0, -1.0, 1.0])
    one = rotate(before * inverse, down)
    other = rotate(last.orientation * inverse, down)
    turned = (one * other).sum(axis=1) < math.cos(TURNED)
    gone = last.position[:, 2] < -THICK
    passed = last.position[:, 0] > far
    del part
    return np.select([gone, passed & ~turned, passed], [2, 0, 1], 3).astype(np.int64)

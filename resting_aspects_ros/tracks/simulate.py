"""Parts that run over the traps at a speed, simulated in Bullet with their real shape.

Statics assumes that a part moves so slowly that gravity decides at every place. A fast part flies
over a gap that would reject it, a nose that dips is caught by the far edge, and whether a blade
pushes a part off is a question of friction. Here, parts start before a trap on a track whose
surface moves, and pass it without touching each other. Those that pass start before the next one.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from scipy.special import ndtri

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import composed, rotate, turned_about_vertical
from resting_aspects_ros.simulation.conditions import BULLET, DropConditions, Noise
from resting_aspects_ros.simulation.job import DropJob, make_job, pieces_of
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
from resting_aspects_ros.simulation.settling import CHECK_INTERVAL
from resting_aspects_ros.simulation.starts import GivenStarts, GivenStates, States
from resting_aspects_ros.simulation.surroundings_kinds import tray_from_scene
from resting_aspects_ros.statistics.intervals import Interval, intervals
from resting_aspects_ros.tracks.description import Track
from resting_aspects_ros.tracks.design import Band
from resting_aspects_ros.tracks.orientations import Orientation
from resting_aspects_ros.tracks.rate import Passage
from resting_aspects_ros.tracks.support import FAR
from resting_aspects_ros.tracks.traps import (
    AirJet,
    Cut,
    CutOut,
    Groove,
    HoldDown,
    Projection,
    Riser,
    Scallop,
    Sensor,
    Trap,
    Wiper,
)

# Thickness of the track and of blades, m; parts fall past the thickness.
THICK = 2e-3
# The surface of the track moves, but the faces at which pieces of it begin must not: a face that
# moved away would never catch a nose. A still face stands this far before and below the surface,
# m, as if the edge were broken by as much.
FACE = 2e-5
# Contacts persist until their points are this far apart, R. With Bullet's default of 0.02, a box
# of 30 mm is carried or dropped up to 0.4 mm away from the edge of a gap.
BREAKING = 0.004
# Distance that the track moves in one time step at most, m; a step of 0.1 mm at 400 mm/s makes
# half of the parts catch at a gap that they bridge.
TRAVEL = 3e-5
# Angles of a blade, and of the start of a projection or riser, to the conveying direction, rad.
BLADE, RAMP = math.radians(30), math.radians(20)
# Strips of the track beside a round or oblique cut.
STRIPS = 48
# Length of the track before and behind the trap, m.
LONG = 1.0
# Spreads of the parts at the start: yaw, rad, distance from the wall, m, and place, as a share of
# the length of the part.
YAW, CLEARANCE, PLACE = math.radians(1.0), 2e-4, 0.25
# Lengths of the part between its start and the trap, in a trap without an end, and behind it.
BEFORE, WITHIN, AFTER = 0.3, 1.5, 0.6
# A part that turned by more than this, rad, has left its orientation.
TURNED = math.radians(10.0)
# A part is caught if it is slower than this share of the speed of the track while the track moves
# by this many lengths of the part, or if it takes PATIENCE times as long as at that speed.
SLOW, STALLED, PATIENCE = 0.1, 0.5, 3.0

OUTCOMES = ('pass', 'turn', 'reject', 'jam')
# Number of parts that run beside each other. They do not touch, but the motion of each depends on
# the others by some 0.1 mm.
CHUNK = 5
# Calls `run_parts` with each of some arguments, for example in other processes.
Run = Callable[[Sequence[tuple[Any, ...]]], Sequence[States]]
# Traps that only statics or vision tells.
NOT_SIMULATED = (AirJet, Sensor)


@dataclass(frozen=True, eq=False)
class TrackRuns:
    """What became of parts that ran through the traps of a track.

    counts : (t, n, 4) int
        For each trap and row, parts that passed, turned, were rejected or jammed; columns as
        OUTCOMES. The parts of a trap are those that passed the trap before it.
    parts : int
        Parts of each row that started.
    simulated : tuple of bool
        Whether each trap was simulated; of the others, statics decides for all parts.
    """

    counts: Counts
    parts: int
    simulated: tuple[bool, ...]

    @property
    def passed(self) -> Counts:
        """Parts (n,) of each row that passed all traps."""
        return np.asarray(self.counts[-1, :, 0])

    @property
    def jams(self) -> Counts:
        """Parts (n,) of each row that jammed in a trap."""
        return np.asarray(self.counts[:, :, 3].sum(axis=0))

    @property
    def shares(self) -> list[Interval]:
        """Share of each row that passes all traps, with its Wilson interval."""
        return [intervals([count], self.parts)[0] for count in self.passed.tolist()]

    def share(self, trap: int, row: int) -> Interval | None:
        """Return the share of a row that passes one trap; None if no part arrived."""
        started = int(self.counts[trap, row].sum())
        return intervals([self.counts[trap, row, 0]], started)[0] if started else None

    def agrees(self, trap: int, row: int, outcome: str) -> bool | None:
        """Return whether the static outcome is that of most parts.

        None if the interval of the share contains one half, no part arrived, the trap was not
        simulated, or statics does not tell the outcome.
        """
        share = self.share(trap, row)
        if share is None or not self.simulated[trap] or outcome not in ('pass', 'reject', 'jam'):
            return None
        if share.lower <= 0.5 <= share.upper:
            return None
        return (share.lower > 0.5) == (outcome == 'pass')


def run_track(
    found: Passage,
    conditions: DropConditions,
    parts: int,
    seed: int,
    run: Run | None = None,
) -> TrackRuns:
    """Let parts of each row run through the traps, and count what becomes of them.

    Rolling friction and gravity are those of the conditions; parts do not bounce.
    """
    traps, rows = found.track.traps, found.rows
    counts = np.zeros((len(traps), len(rows), len(OUTCOMES)), dtype=np.int64)
    left = np.full(len(rows), parts)
    for t, trap in enumerate(traps):
        for k, row in enumerate(rows):
            if isinstance(trap, NOT_SIMULATED):
                static = found.outcomes[t][k].outcome
                known = OUTCOMES.index(static) if static in OUTCOMES else OUTCOMES.index('turn')
                counts[t, k, known] = left[k]
            elif left[k]:
                here = row, trap, found.track, conditions, int(left[k]), (seed, t, row.id)
                counts[t, k] = run_over(found.part, *here, run)
        left = counts[t, :, 0]
    return TrackRuns(counts, parts, tuple(not isinstance(trap, NOT_SIMULATED) for trap in traps))


def run_over(
    part: Part,
    row: Orientation,
    trap: Trap,
    track: Track,
    conditions: DropConditions,
    count: int,
    seed: Sequence[int],
    run: Run | None = None,
) -> Counts:
    """Let parts in a row run over a trap, and return how many had each of OUTCOMES.

    The first of them are the same for every ``count``.
    """
    scene, start, end = _scene(trap, track, conditions, row.length)
    job = _job(part, conditions, scene, track.speed)
    states = _starts(row, start, count, np.random.default_rng((*seed, 9)))
    far = end + AFTER * row.length
    depth = THICK + (trap.depth if isinstance(trap, Groove) else 0.0)
    front = float(row.corners[:, 0].max())
    way = far - start + front + row.length * (BEFORE + PLACE)
    calls = [
        (job, states.select(slice(first, first + CHUNK)), row.length, far, depth, track.speed, way)
        for first in range(0, count, CHUNK)
    ]
    found = [run_parts(*each) for each in calls] if run is None else run(calls)
    last = States(*map(np.concatenate, zip(*(each.arrays for each in found), strict=True)))
    ends = _ends(job, states, last, far, depth)
    return np.asarray([int((ends == code).sum()) for code in range(len(OUTCOMES))])


# -- Grey bands -----------------------------------------------------------------------------------


# Distances from the critical value at which parts run, m, and parts at each.
OFFSETS = (1e-4, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3)
PARTS = 20
# Share of the parts that must pass, or be rejected.
ENOUGH = 0.95


def measured_band(
    part: Part,
    row: Orientation,
    trap: Any,
    dimension: str,
    critical: float,
    wanted: bool,
    track: Track,
    conditions: DropConditions,
    seed: int,
    run: Run | None = None,
) -> Band:
    """Return the end of the grey band of a row and a trap that matters.

    Parts run over the trap with dimensions farther and farther away from the critical value, until
    at least 95 % of them pass if the row is wanted, and otherwise until at least 95 % of them fall
    off. The end is infinite if it is not within 16 mm.

    critical : the critical value of the dimension by statics, m
    """
    more_pass = dimension in ('height', 'width')
    direction = 1.0 if more_pass == wanted else -1.0
    outcome = OUTCOMES.index('pass' if wanted else 'reject')
    end = math.inf
    for offset in OFFSETS:
        value = critical + direction * offset
        if value <= getattr(trap, 'start', 0.0):
            break
        tried = dataclasses.replace(trap, **{dimension: value})
        counts = run_over(part, row, tried, track, conditions, PARTS, (seed, 13, row.id), run)
        if counts[outcome] >= ENOUGH * PARTS:
            end = value
            break
    return Band(end, math.nan) if wanted else Band(math.nan, end)


# -- Scene ----------------------------------------------------------------------------------------


def _scene(
    trap: Trap, track: Track, conditions: DropConditions, length: float
) -> tuple[Scene, float, float]:
    """Return the scene of a trap, and where the trap begins and ends along the track, m."""
    surface = track.surface
    floor = PairValues(surface.friction, 0.0, conditions.rolling_friction, speed=track.speed)
    still = PairValues(track.wall.friction, 0.0, conditions.rolling_friction)
    start, end = 0.0, WITHIN * length
    area, extra = surface.area, list[SceneBody]()
    if isinstance(trap, Cut):
        piece, span = trap.removed(), trap.span()
        start, end = span or (start, end)
        area = area.difference(
            piece if span else piece.intersection(shapely.box(0, -FAR, FAR, FAR))
        )
        if isinstance(trap, Groove):
            low = np.array([0.0, trap.start, -trap.depth - THICK])
            extra = [Block('groove', floor, X, low, np.array([LONG, trap.end, -trap.depth]), Z)]
    elif isinstance(trap, HoldDown):
        high = np.array([end, surface.width, LONG])
        extra = [Block('cover', still, X, np.array([start, 0.0, trap.height]), high, -Z)]
    elif isinstance(trap, Wiper):
        end = max(end, surface.width / math.tan(BLADE) + length)
        extra = [_blade(trap, surface.width, still)]
    elif isinstance(trap, Projection | Riser):
        rise = trap.depth if isinstance(trap, Projection) else trap.height
        lead = rise / math.tan(RAMP)
        end = lead + WITHIN * length
        profile = np.array([[0, 0], [lead, rise], [LONG, rise], [LONG, 0]])
        if isinstance(trap, Projection):
            extra = [_prism('projection', still, profile, (trap.low, trap.high), (0, 1, 2))]
        else:
            extra = [_prism('riser', floor, profile, (trap.start, surface.width), (0, 2, 1))]
    return (
        Scene(
            bodies=(
                *_pieces(area, start, end, isinstance(trap, Scallop | CutOut), floor, still),
                HalfSpace('wall', still, X, Y),
                *extra,
            ),
            tray_from_scene=tray_from_scene(surface.roll, surface.pitch),
            free=0,
            region=(np.zeros(2), np.zeros(2)),
        ),
        start,
        end,
    )


def _pieces(
    area: shapely.Geometry,
    start: float,
    end: float,
    oblique: bool,
    floor: PairValues,
    still: PairValues,
) -> list[SceneBody]:
    """Return the track as blocks, with a still face where each of them begins; see FACE."""
    bodies: list[SceneBody] = []
    for (x0, y0), (x1, y1) in _rectangles(area, start, end, oblique):
        low, high = np.array([x0, y0, -THICK]), np.array([x1, y1, 0.0])
        bodies.append(Block('track', floor, X, low, high, Z))
        if x0 > start:
            low, high = np.array([x0 - FACE, y0, -THICK]), np.array([x0 + 9 * FACE, y1, -FACE])
            bodies.append(Block('edge', still, X, low, high, Z))
    return bodies


def _rectangles(
    area: shapely.Geometry, start: float, end: float, oblique: bool
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return rectangles that fill an area, as lowest and highest x and y."""
    x = shapely.get_coordinates(area)[:, 0]
    inside = np.unique(np.round(x[(x > start - 1e-9) & (x < end + 1e-9)], 9))
    if oblique:
        inside = np.linspace(start, end, STRIPS + 1)
    cuts = np.unique(np.concatenate([[-LONG], inside, [start, end, LONG]]))
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


def _blade(trap: Wiper, width: float, contact: PairValues) -> MeshBody:
    """Return a blade that begins at the wall and leads parts outwards."""
    long = width / math.sin(BLADE) + 0.05
    along = np.array([math.cos(BLADE), math.sin(BLADE)])
    across = np.array([-along[1], along[0]])
    corners = [a * along + b * across for a in (-0.02, long) for b in (0.0, THICK)]
    return _prism('blade', contact, np.array(corners), (trap.height, trap.height + 0.1), (0, 1, 2))


def _prism(
    name: str,
    contact: PairValues,
    profile: Array,
    extent: tuple[float, float],
    axes: tuple[int, int, int],
) -> MeshBody:
    """Return a prism with a convex profile (n, 2), whose axes and extrusion are ``axes``."""
    corners = np.zeros((2 * len(profile), 3))
    corners[:, axes[:2]] = np.concatenate([profile, profile])
    corners[:, axes[2]] = np.repeat(extent, len(profile))
    none, triangles = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return MeshBody(name, contact, X, none, triangles, (corners,), np.zeros((0, 3, 3)))


# -- Runs -----------------------------------------------------------------------------------------


def _job(part: Part, conditions: DropConditions, scene: Scene, speed: float) -> DropJob:
    plane = conditions.changed(surroundings=None) if conditions.surroundings else conditions
    rest = GivenStates(np.array([[0.0, 0.0, 2 * part.hull_radius]]), np.array([[0.0, 0, 0, 1]]))
    starts = GivenStarts(rest, Noise(), plane.gravity, part.hull_radius)
    job = make_job(part, plane, 0, starts=starts, engine=BULLET)
    job = dataclasses.replace(job, starts=None, scene=scene, pieces=pieces_of(part))
    finer = math.ceil(speed * job.time_step / TRAVEL)
    return dataclasses.replace(job, refinement=max(finer, 1))


def _starts(row: Orientation, start: float, count: int, random: np.random.Generator) -> States:
    """Return parts (n) in a row before the trap, scene frame: centre of mass in m, from part."""
    place, apart, turn = random.random((count, 3)).T
    yaw = YAW * ndtri(turn)
    front = float(row.corners[:, 0].max())
    x = start - front - row.length * (BEFORE + PLACE * place)
    # A turned part needs more room at the wall.
    y = row.yaw.distance + CLEARANCE * (1 + apart) + np.abs(yaw) * row.length / 2
    position = np.stack([x, y, np.full(count, row.com_height + 1e-5)], axis=1)
    turned = np.array([turned_about_vertical(row.orientation, each) for each in yaw.tolist()])
    return States(position, turned, np.zeros((count, 3)), np.zeros((count, 3)))


class _Ending:
    """Tells which parts have passed, fallen or stalled."""

    def __init__(self, count: int, far: float, depth: float, slow: float, checks: int) -> None:
        self._stalled = np.zeros(count, dtype=np.int64)
        self._far, self._depth, self._slow, self._checks = far, depth, slow, checks

    def __call__(self, here: States) -> npt.NDArray[np.bool_]:
        """Return which of the parts that still run have ended; lengths in R, speeds in R / T."""
        self._stalled = np.where(here.velocity[:, 0] < self._slow, self._stalled + 1, 0)
        over = (
            (here.position[:, 0] > self._far)
            | (here.position[:, 2] < -self._depth)
            | (self._stalled > self._checks)
        )
        self._stalled = self._stalled[~over]
        return np.asarray(over)


def run_parts(
    job: DropJob, states: States, length: float, far: float, depth: float, speed: float, way: float
) -> States:
    """Return the last states, m and from body axes, of parts that run until they are past far.

    way : longest distance that a part runs, m; it limits the time
    """
    # Bullet is imported only where it is needed.
    from resting_aspects_ros.simulation.bullet_world import World

    radius, unit = job.radius, job.time_unit
    body = composed(states.orientation, job.axes)
    fast = speed * unit / radius
    scaled = States(
        states.position / radius, body, np.tile(fast * X, (len(body), 1)), states.spin * unit
    )
    stalled = math.ceil(STALLED * length / speed / unit / CHECK_INTERVAL)
    # The centre of mass of a part that falls is below the surface by about R at last.
    ending = _Ending(len(body), far / radius, depth / radius + 0.5, SLOW * fast, stalled)
    limit = PATIENCE * way / speed / unit
    last = World(job, breaking=BREAKING).follow(scaled, ending, limit)
    return dataclasses.replace(last, position=last.position * radius)


def _ends(
    job: DropJob, first: States, last: States, far: float, depth: float
) -> npt.NDArray[np.int64]:
    """Return what became of each part (n,), as an index of OUTCOMES."""
    before = composed(first.orientation, job.axes)
    down = np.tile(-Z, (len(before), 1))
    inverse = np.array([-1.0, -1.0, -1.0, 1.0])
    cosine = (rotate(before * inverse, down) * rotate(last.orientation * inverse, down)).sum(
        axis=1
    )
    # A part that dropped into a groove goes on in another way.
    lower = first.position[:, 2] - last.position[:, 2] > max((depth - THICK) / 2, THICK)
    turned = (cosine < math.cos(TURNED)) | lower
    gone = last.position[:, 2] < -depth
    passed = last.position[:, 0] > far
    return np.select([gone, passed & ~turned, passed], [2, 0, 1], 3).astype(np.int64)

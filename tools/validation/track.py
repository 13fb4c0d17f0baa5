"""Validation of tracks: statics against Bullet, speed over a gap, yaw at the wall, designs.

`python -m validation.track statics gap yaw designs` prints some of its tables, each as soon as it
is made.
"""

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import composed, product, rotate, turned_about_vertical
from resting_aspects_ros.simulation.bullet_world import World
from resting_aspects_ros.simulation.starts import States
from resting_aspects_ros.simulation.surroundings_kinds import tray_from_scene
from resting_aspects_ros.statistics.intervals import intervals
from resting_aspects_ros.tracks.description import Track, read_track
from resting_aspects_ros.tracks.design import design_traps
from resting_aspects_ros.tracks.orientations import (
    Orientation,
    PushedOutline,
    orientations_on,
)
from resting_aspects_ros.tracks.simulate import BREAKING, OUTCOMES, _job, _scene, run_over
from resting_aspects_ros.tracks.support import is_line
from resting_aspects_ros.tracks.traps import Arrival, Balcony, Gap
from validation.dropper import SEED, Dropper

Array = npt.NDArray[np.float64]

STATIC_PARTS = ('hex_nut', 'l_bracket', 'u_bracket', 'angle_45x30x8', 't_prism', 'box_10x20x30')
STATIC_TRIALS, OFF, ROLLS = 300, 1e-3, (2.0, 5.0, 15.0)
# Time that a part has to fall, T.
REST = 60.0
CONDITIONS = shipped_surfaces().get()
GAPS, SPEEDS = (14.5, 15.5, 16.0, 17.0, 18.0, 20.0, 23.0), (50, 100, 200, 400)
GAP_PARTS = 20
PUSHES, PUSHED = 2000, ('l_bracket', 'u_bracket', 'hex_nut')
PUSH_ROLL, PUSH_PITCH, PUSH_FLOOR, PUSH_WALL = 10.0, 10.0, 0.02, 0.2
# Part, wanted row, and how it lies.
DESIGNS = (
    ('hex_nut', 1, 'flat'),
    ('hex_nut', 2, 'standing, hexagon at the wall'),
    ('u_bracket', 1, 'on its side, back at the wall'),
)
DESIGN_PARTS, DESIGN_SPEED = 200, 0.1


def track(_: Dropper | None = None) -> Iterator[str]:
    """Compare statics, yaws and designs with simulated parts."""
    yield '## Tracks and traps'
    yield ''
    for each in (statics, gap, yaw, designs):
        yield from each()
        yield ''


def _rows(part: Part, wall_friction: float = 0.0) -> list[Orientation]:
    aspects = find_aspects(part)
    shares = np.full(len(aspects), 1 / len(aspects))
    return orientations_on(part, aspects, shares.tolist(), wall_friction=wall_friction)


# -- Statics --------------------------------------------------------------------------------------


def statics() -> Iterator[str]:
    """Compare parts at rest on balconies 1 mm off the critical width with statics."""
    yield '### Balconies 1 mm off the critical width'
    yield ''
    yield (
        'Each row of a part lies at rest on a track of the critical width of statics, less or '
        'more 1 mm, rolled towards the wall by 2, 5 or 15 degrees (friction 0.3), and is '
        'simulated in Bullet. *Agree*: it falls off the narrower track, and stays on the wider '
        'one.'
    )
    yield ''
    yield '| part | contact | trials | agree | falls although wider | stays although narrower |'
    yield '|---|---|---|---|---|---|'
    total = np.zeros(4, dtype=np.int64)
    for name in STATIC_PARTS:
        part = ra.load_part(name)
        counts: dict[str, npt.NDArray[np.int64]] = {}
        for row in _rows(part):
            for roll in ROLLS:
                if row.rolls or total[0] + sum(c[0] for c in counts.values()) >= STATIC_TRIALS:
                    continue
                kind = _contact(row)
                counts.setdefault(kind, np.zeros(4, dtype=np.int64))
                counts[kind] += _balcony_trials(part, row, roll)
        for kind, found in sorted(counts.items()):
            total += found
            yield f'| {part.name} | {kind} | ' + ' | '.join(map(str, found.tolist())) + ' |'
    share = intervals([int(total[1])], int(total[0]))[0]
    yield '| all | | ' + ' | '.join(map(str, total.tolist())) + ' |'
    yield ''
    yield (
        f'{100 * share.probability:.1f} % agree ({100 * share.lower:.1f} to '
        f'{100 * share.upper:.1f} %).'
    )


def _contact(row: Orientation) -> str:
    if is_line(row):
        return 'edges'
    hull = row.contact.convex_hull.area
    return 'convex' if row.contact.area > 0.99 * hull else 'not convex'


def _balcony_trials(part: Part, row: Orientation, roll: float) -> npt.NDArray[np.int64]:
    """Return the numbers of trials, of agreements, and of both kinds of disagreement."""
    angle = math.radians(roll)
    track = read_track({'width': 0.2, 'roll': angle})
    critical = Balcony(0.01).critical(Arrival(row, track.surface, part), 'width')
    found = np.zeros(4, dtype=np.int64)
    for off in (-OFF, OFF):
        if not 0 < critical + off < 1:
            continue
        stays = _stays(part, row, critical + off, angle)
        found += [1, stays == (off > 0), off > 0 and not stays, off < 0 and stays]
    return found


def _stays(part: Part, row: Orientation, width: float, roll: float) -> bool:
    """Return whether a part at rest stays as it is on a track of this width."""
    track = read_track({'width': 0.2, 'roll': roll, 'speed': 1e-9, 'wall': {'friction': 0.0}})
    scene, *_ = _scene(Balcony(width), track, CONDITIONS, row.length)
    job = _job(part, CONDITIONS, scene, track.speed)
    # Behind the start of the balcony, so that the wide track before it carries nothing.
    place = np.array([[row.length, row.yaw.distance + 5e-5, row.com_height + 2e-5]])
    body = composed(row.orientation[None], job.axes)
    still = np.zeros((1, 3))

    def fallen(here: States) -> npt.NDArray[np.bool_]:
        return np.asarray(here.position[:, 2] < -1.0)

    start = States(place / job.radius, body, still, still)
    last = World(job, breaking=BREAKING).follow(start, fallen, REST)
    inverse = np.array([-1.0, -1.0, -1.0, 1.0])
    down = np.array([[0.0, 0.0, -1.0]])
    one, other = (rotate(q * inverse, down)[0] for q in (body, last.orientation))
    return bool(last.position[0, 2] > 0 and one @ other > math.cos(math.radians(3)))


# -- Speed over a gap -----------------------------------------------------------------------------


def gap() -> Iterator[str]:
    """Let a box run over gaps at several speeds."""
    mesh = trimesh.creation.box((30, 20, 10))
    part = part_from_bytes(mesh.export(file_type='stl'), 'stl', 'box')
    row = next(each for each in _rows(part) if each.height < 0.011 and each.length > 0.029)
    yield '### Speed over a gap'
    yield ''
    yield (
        f'A box of 30 x 20 x 10 mm, whose critical gap is 15 mm, {GAP_PARTS} parts in each cell, '
        'without friction and roll: parts that pass, turn, fall and are caught.'
    )
    yield ''
    yield '| gap (mm) | ' + ' | '.join(f'{speed} mm/s' for speed in SPEEDS) + ' |'
    yield '|---|' + '---|' * len(SPEEDS)
    for length in GAPS:
        cells = []
        for speed in SPEEDS:
            track = read_track(
                {'width': 0.04, 'speed': speed / 1e3, 'friction': 0.0, 'wall': {'friction': 0.0}}
            )
            trap = Gap(length / 1e3)
            counts = run_over(part, row, trap, track, CONDITIONS, GAP_PARTS, (SEED, 0)).tolist()
            cells.append(', '.join(f'{n} {o}' for n, o in zip(counts, OUTCOMES, strict=True) if n))
        yield f'| {length:g} | ' + ' | '.join(cells) + ' |'


# -- Yaw at the wall ------------------------------------------------------------------------------


def yaw() -> Iterator[str]:
    """Compare the shares of the edges at the wall with simulated pushes."""
    yield '### Yaw at the wall'
    yield ''
    yield (
        f'{PUSHES} parts of each kind at uniform yaws before the wall, in the aspects with '
        f'several rows; the track is rolled by {PUSH_ROLL:g} and pitched by {PUSH_PITCH:g} '
        f'degrees, friction {PUSH_FLOOR} on the track and {PUSH_WALL} at the wall, along '
        'which the parts slide. *Bounds*: the stated ones for this friction. *Within*: the '
        '95 % interval of the simulated share overlaps them. Parts that stop on a corner or '
        'leave the aspect are left out of the shares.'
    )
    yield ''
    yield '| part | aspect | distance (mm) | stated | bounds | simulated | left out | within |'
    yield '|---|---|---|---|---|---|---|---|'
    inside = total = 0
    for name in PUSHED:
        part = ra.load_part(name)
        for line, good in _push_lines(part):
            inside, total = inside + good, total + 1
            yield line
    yield ''
    yield f'{inside} of {total} rows are within the bounds.'


def _push_lines(part: Part) -> Iterator[tuple[str, bool]]:
    aspects = find_aspects(part)
    chosen = []
    for aspect in aspects.aspects:
        corners = rotate(aspect.orientation, part.vertices - part.centre_of_mass)
        outline = PushedOutline(corners[:, :2])
        yaws = outline.yaws(PUSH_WALL)
        if not aspect.sweep.curved and len(yaws) > 1:
            chosen.append((aspect, corners, yaws))
    chosen = chosen[:2]
    for aspect, corners, yaws in chosen:
        number = PUSHES // len(chosen)
        starts = (np.arange(number) + 0.5) / number * 2 * np.pi
        ends, same = _pushed(part, aspect, corners, starts)
        off = np.abs(np.angle(np.exp(1j * (ends[:, None] - [each.angle for each in yaws]))))
        edge = np.where(same & (off.min(axis=1) < math.radians(3)), off.argmin(axis=1), -1)
        reached = int((edge >= 0).sum())
        for k, each in enumerate(yaws):
            share = intervals([int((edge == k).sum())], reached)[0]
            good = share.lower <= each.high and share.upper >= each.low
            cells = (
                part.name,
                str(aspect.id),
                f'{1e3 * each.distance:.2f}',
                f'{each.share:.3f}',
                f'{each.low:.3f} to {each.high:.3f}',
                f'{share.probability:.3f} ({share.lower:.3f} to {share.upper:.3f})',
                f'{number - reached} of {number}',
                'yes' if good else 'no',
            )
            yield f'| {" | ".join(cells)} |', good


def _pushed(
    part: Part, aspect: Any, corners: Array, starts: Array
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return yaws (n,) after pushing, and whether the parts are still in the aspect."""
    n = len(starts)
    turned = np.array([turned_about_vertical(aspect.orientation, each) for each in starts])
    y = np.array(
        [-(corners[:, :2] @ [math.sin(each), math.cos(each)]).min() + 5e-4 for each in starts]
    )
    height = -float(corners[:, 2].min()) + 2e-5
    roll, pitch = math.radians(PUSH_ROLL), math.radians(PUSH_PITCH)
    turn = tray_from_scene(roll, pitch)
    places = np.stack([0 * y, y, np.full(n, height)], axis=1)
    many = np.tile(turn, (n, 1))
    states = ra.GivenStates(rotate(many, places), product(many, turned))
    surroundings = ra.surroundings(
        'chute',
        roll=roll,
        pitch=pitch,
        belt={'friction': PUSH_FLOOR, 'speed': 0.0, 'restitution': 0.0},
        wall={'friction': PUSH_WALL, 'restitution': 0.0},
    )
    result = ra.drop(
        part,
        initial_states=states,
        surroundings=surroundings,
        rolling_friction=0.0,
        seed=SEED,
        workers=1,
    )
    inverse = np.array([-1.0, -1.0, -1.0, 1.0])
    ends = product(many * inverse, result.poses.orientation)
    down = rotate(ends * inverse, np.tile([0.0, 0.0, -1.0], (n, 1)))
    same = down @ aspect.down_in_part > math.cos(math.radians(3))
    first = rotate((aspect.orientation * inverse)[None], np.array([[1.0, 0.0, 0.0]]))
    now = rotate(ends, np.tile(first, (n, 1)))
    return np.arctan2(now[:, 1], now[:, 0]), np.asarray(same)


# -- Designs --------------------------------------------------------------------------------------


def designs(chosen: Sequence[tuple[str, int, str]] = DESIGNS) -> Iterator[str]:
    """Design traps with simulated bands, and let other parts run through them."""
    yield '### Designs'
    yield ''
    yield (
        f'The best design of `--design --simulate` at {1e3 * DESIGN_SPEED:g} mm/s, roll 5 '
        f'degrees, and {DESIGN_PARTS} other parts of each row that run through it. *Statics*: CPU '
        'time of the static design.'
    )
    yield ''
    yield (
        '| part, wanted row | rows | statics (s) | traps | margin (mm) | wanted pass | others '
        'pass | jam |'
    )
    yield '|---|---|---|---|---|---|---|---|'
    for name, want, text in chosen:
        yield _design_line(name, want, text)


def _design_line(name: str, want: int, text: str) -> str:
    part = ra.load_part(name)
    width = round(2 * part.hull_radius + 0.01, 3)
    described = {'width': width, 'roll': '5deg', 'speed': DESIGN_SPEED}
    dropped = ra.track(part, described, want)
    start = time.process_time()
    design_traps(part, dropped.rows, _track(described), want)
    seconds = time.process_time() - start
    found = ra.design_track(part, want, described, simulate=1)
    if not found.designs:
        return f'| {name}, {text} | {len(dropped.rows)} | {seconds:.2f} | none | | | | |'
    best = found.best
    # Other parts than those that measured the bands.
    again = ra.track(part, best.passage.track, best.alike, simulate=DESIGN_PARTS, seed=SEED + 1)
    runs = again.runs
    assert runs is not None
    mask = np.array([row.id in best.alike for row in again.rows])
    cells = [
        f'{int(runs.passed[each].sum())} of {int(each.sum()) * runs.parts}'
        for each in (mask, ~mask)
    ]
    return (
        f'| {name}, {text} | {len(again.rows)} | {seconds:.2f} | {"; ".join(best.trap_names)} '
        f'| {1e3 * (best.margin or 0):.2f} | {cells[0]} | {cells[1]} | {int(runs.jams.sum())} |'
    )


def _track(described: dict[str, Any]) -> Track:
    return read_track(described)


TABLES: dict[str, Callable[[], Iterator[str]]] = {
    'statics': statics,
    'gap': gap,
    'yaw': yaw,
    'designs': designs,
}

if __name__ == '__main__':
    for name in sys.argv[1:] or TABLES:
        for line in TABLES[name]():
            sys.stdout.write(f'{line}\n')
            sys.stdout.flush()

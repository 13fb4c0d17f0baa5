"""Validation of tracks: statics against Bullet, and designs."""

import math
import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import composed, rotate
from resting_aspects_ros.simulation.bullet_world import World
from resting_aspects_ros.simulation.starts import States
from resting_aspects_ros.statistics.intervals import intervals
from resting_aspects_ros.tracks.description import read_track
from resting_aspects_ros.tracks.design import design_traps
from resting_aspects_ros.tracks.orientations import Orientation, orientations_on
from resting_aspects_ros.tracks.simulate import BREAKING, _job, _scene
from resting_aspects_ros.tracks.support import is_line
from resting_aspects_ros.tracks.traps import Arrival, Balcony
from validation.document import paragraphs
from validation.dropper import SEED

Array = npt.NDArray[np.float64]

STATIC_PARTS = ('hex_nut', 'l_bracket', 'u_bracket', 'angle_45x30x8', 't_prism', 'box_10x20x30')
STATIC_TRIALS, OFF, ROLLS = 300, 1e-3, (2.0, 5.0, 15.0)
# Time that a part has to fall, T.
REST = 60.0
CONDITIONS = shipped_surfaces().get()
# Part, wanted row, and how it lies.
DESIGNS = (
    ('hex_nut', 1, 'flat'),
    ('hex_nut', 2, 'standing, hexagon at the wall'),
    ('u_bracket', 1, 'on its side, back at the wall'),
    ('box_10x20x30', 1, 'flat, its side of 30 mm at the wall'),
    ('t_prism', 1, 'flat, an oblique side at the wall'),
    ('l_bracket', 3, 'flat, its leg of 40 mm at the wall'),
)
DESIGN_PARTS, DESIGN_SPEED = 200, 0.1


def track() -> Iterator[str]:
    """Compare statics and designs with simulated parts."""
    yield from paragraphs('## Tracks and traps')
    yield from statics()
    yield ''
    yield from designs()


def _rows(part: Part, wall_friction: float = 0.0) -> list[Orientation]:
    aspects = find_aspects(part)
    shares = np.full(len(aspects), 1 / len(aspects))
    return orientations_on(part, aspects, shares.tolist(), wall_friction=wall_friction)


# -- Statics --------------------------------------------------------------------------------------


def statics() -> Iterator[str]:
    """Compare parts at rest on balconies 1 mm off the critical width with statics."""
    yield from paragraphs(
        '### Balconies 1 mm off the critical width',
        'Each row of a part lies at rest on a track of the critical width of statics, less or '
        'more 1 mm, rolled towards the wall by 2, 5 or 15 degrees (friction 0.3), and is '
        'simulated in Bullet. *Agree*: it falls off the narrower track, and stays on the wider '
        'one.',
    )
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


# -- Designs --------------------------------------------------------------------------------------


def designs() -> Iterator[str]:
    """Design traps with simulated bands, and let other parts run through them."""
    yield from paragraphs(
        '### Designs',
        f'The best design of `--design --simulate` at {1e3 * DESIGN_SPEED:g} mm/s, roll 5 '
        f'degrees, and {DESIGN_PARTS} other parts of each row that run through it. *Statics*: CPU '
        'time of the static design.',
    )
    yield (
        '| part, wanted row | rows | statics (s) | traps | margin (mm) | wanted pass | others '
        'pass | jam |'
    )
    yield '|---|---|---|---|---|---|---|---|'
    for name, want, text in DESIGNS:
        yield _design_line(name, want, text)


def _design_line(name: str, want: int, text: str) -> str:
    part = ra.load_part(name)
    width = round(2 * part.hull_radius + 0.01, 3)
    described = {'width': width, 'roll': '5deg', 'speed': DESIGN_SPEED}
    dropped = ra.track(part, described, want)
    start = time.process_time()
    design_traps(dropped.passage)
    seconds = time.process_time() - start
    found = ra.design_track(part, want, described, simulate=1)
    if found.design is None or not found.design.designs:
        return f'| {name}, {text} | {len(dropped.rows)} | {seconds:.2f} | none | | | | |'
    # Other parts than those that measured the bands.
    again = ra.track(part, found.passage.track, want, simulate=DESIGN_PARTS, seed=SEED + 1)
    runs = again.runs
    assert runs is not None
    mask = np.array([row.id in found.alike for row in again.rows])
    margin = 1e3 * found.design.designs[0].margin
    cells = [
        f'{int(runs.passed[each].sum())} of {int(each.sum()) * runs.parts}'
        for each in (mask, ~mask)
    ]
    return (
        f'| {name}, {text} | {len(again.rows)} | {seconds:.2f} | {"; ".join(found.trap_names)} '
        f'| {margin:.2f} | {cells[0]} | {cells[1]} | {int(runs.jams.sum())} |'
    )

"""Bodies in surroundings against formulas: thresholds, paths, forces and belts."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import CONTACT_STEPS
from resting_aspects_ros.simulation.scene import X
from resting_aspects_ros.simulation.surroundings_kinds import Corner, Slope, VGroove
from resting_aspects_ros.statistics.poses import RestStatus
from validation.placed_bodies import flat_on, groove_height, in_groove, job_in, point_path

Row = tuple[str, int, str, str]

YAWS = np.radians(np.arange(0, 91, 15))
# Angles from a threshold at which the behaviour is tested, degrees.
OFFSETS = (0.1, 0.2, 0.3, 0.5)
CREEP = 1e-3  # R in 10 T: less is "stays"


def solid(mesh: trimesh.Trimesh) -> Part:
    """Return a mesh in mm as a part."""
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    return part_from_bytes(data, 'stl', 'body')


def mechanics(conditions: DropConditions) -> Iterator[Row]:
    """Yield what is compared, the number of bodies, the formula and what was found.

    ``conditions`` have no restitution and no rolling friction.
    """
    block = solid(trimesh.creation.box((30, 20, 10)))
    for friction in (0.25, 0.5):
        yield _friction_angle(block, conditions.changed(friction=friction))
    for yaw, width in ((0, 10), (90, 15)):
        yield _tipping(conditions.changed(friction=2.0), yaw, width)
    for refinement in (1, 4):
        yield _friction(block, conditions.changed(friction=0.5), refinement)
    for degrees in (0, 10):
        yield _sliding_distance(block, conditions.changed(friction=0.25), degrees)
    yield _directions(block, conditions.changed(friction=0.4))
    yield _box_in_groove(conditions.changed(friction=0.02))
    yield _cylinder_in_groove(conditions.changed(friction=0.2))
    for right, left in ((30, 60), (45, 45), (20, 50)):
        yield _normal_force(conditions.changed(friction=0.0), right, left)
    yield _belt(block, conditions.changed(friction=0.25))
    yield _belt_into_wall(block, conditions.changed(friction=0.25))


def _friction_angle(block: Part, conditions: DropConditions) -> Row:
    limit = math.degrees(math.atan(conditions.friction))

    def stays(offset: float) -> npt.NDArray[np.bool_]:
        slope = Slope(math.radians(limit + offset))
        placed = flat_on(job_in(block, conditions, slope), YAWS)
        before = placed.states.position
        return np.asarray(np.linalg.norm(placed.run(10).position - before, axis=1) < CREEP)

    name = f'block stays below the friction angle, {len(YAWS)} directions'
    n = 2 * len(OFFSETS) * len(YAWS)
    return name, n, f'{limit:.2f} deg', _threshold(limit, stays)


def _threshold(limit: float, holds: Callable[[float], npt.NDArray[np.bool_]]) -> str:
    """Return in words between which of the tested angles the behaviour of all bodies changes."""
    below = [offset for offset in OFFSETS if not holds(-offset).all()]
    above = [offset for offset in OFFSETS if holds(offset).any()]
    low = min((o for o in OFFSETS if o > max(below, default=0.0)), default=math.nan)
    high = min((o for o in OFFSETS if o > max(above, default=0.0)), default=math.nan)
    return f'{limit - low:.2f} to {limit + high:.2f} deg'


def _tipping(conditions: DropConditions, yaw: float, width: float) -> Row:
    column = solid(trimesh.creation.box((10, 15, 30)))
    limit = math.atan(width / 30)

    def stands(offset: float) -> npt.NDArray[np.bool_]:
        placed = flat_on(job_in(column, conditions, Slope(1e-9)), [math.radians(yaw)])
        before = Rotation.from_quat(placed.states.orientation)
        placed.tilt(limit + math.radians(offset))
        placed.settle()
        turned = Rotation.from_quat(placed.states.orientation) * before.inv()
        return np.asarray(turned.magnitude() < 0.5)

    name = f'column of 30 mm stands if {width} mm wide downhill'
    degrees = math.degrees(limit)
    return name, 2 * len(OFFSETS), f'{degrees:.2f} deg', _threshold(degrees, stands)


def _friction(block: Part, conditions: DropConditions, refinement: int) -> Row:
    angle = math.atan(conditions.friction) + math.radians(3)
    placed = flat_on(job_in(block, conditions, Slope(angle), refinement=refinement), YAWS)
    gained = placed.run(5).velocity[:, 0] / placed.time
    strength = conditions.friction * math.cos(angle)
    excess = (math.sin(angle) - gained) / strength - 1
    steps = CONTACT_STEPS * refinement
    name = f'friction 3 deg above the friction angle, {steps} steps per T'
    return name, len(YAWS), f'{strength:.4f} m g', f'{_percent(excess)} of it more'


def _sliding_distance(block: Part, conditions: DropConditions, degrees: float) -> Row:
    angle, speed = math.radians(degrees) + 1e-9, 0.5
    job = job_in(block, conditions, Slope(angle))
    placed = flat_on(job, YAWS, (speed, 0, 0))
    slowed = conditions.friction * math.cos(angle) - math.sin(angle)
    expected = speed**2 / 2 / slowed
    placed.settle()
    distance = placed.states.position[:, 0]
    name = f'sliding distance downhill, {degrees} deg, friction {conditions.friction:g}'
    return name, len(YAWS), f'{expected:.3f} R', f'{_percent(1 - distance / expected)} less'


def _directions(block: Part, conditions: DropConditions) -> Row:
    directions, angle, speed = np.radians(np.arange(0, 360, 30)), math.radians(10), 0.5
    velocity = speed * np.stack([np.cos(directions), np.sin(directions), 0 * directions], axis=1)
    placed = flat_on(job_in(block, conditions, Slope(angle)), 0 * directions, velocity)
    placed.settle()
    moved = placed.states.position[:, :2]
    expected = np.array([point_path(angle, conditions.friction, v[:2]) for v in velocity])
    longest = np.linalg.norm(expected, axis=1).max()
    apart = np.linalg.norm(moved - expected, axis=1) / longest
    name = 'end of a slide on a slope of 10 deg, 12 directions'
    return name, len(directions), 'path of a point mass', f'{_percent(apart)} of the longest off'


def _box_in_groove(conditions: DropConditions) -> Row:
    bar = solid(trimesh.creation.box((40, 12, 8)))
    job = job_in(bar, conditions, VGroove(math.radians(120)))
    corners = np.array([[y, z] for y in (-6, 6) for z in (-4, 4)]) / 1000 / job.radius
    rolls = np.radians(np.arange(-180, 180, 18) + 4.0)
    placed = in_groove(job, rolls, corners)
    placed.settle()
    turned = Rotation.from_quat(placed.states.orientation) * Rotation.from_quat(job.axes).inv()
    found = turned.as_euler('xyz')[:, 0]
    grid = np.radians(np.arange(0, 360, 0.02))
    height = groove_height(job, grid, corners)
    least = grid[(height < np.roll(height, 1)) & (height < np.roll(height, -1))]
    apart = np.abs((found[:, None] - least + math.pi) % (2 * math.pi) - math.pi).min(axis=1)
    name = 'roll of a box in a groove of 120 deg'
    off = f'{np.degrees(apart.max()):.2f} deg off at most'
    return name, len(rolls), f'{len(least)} minima of the energy', off


def _cylinder_in_groove(conditions: DropConditions) -> Row:
    roller = _along_x(trimesh.creation.cylinder(5, 30, sections=128))
    opening = math.radians(100)
    job = job_in(solid(roller), conditions, VGroove(opening))
    placed = flat_on(job, np.linspace(0.05, 0.5, 7), lift=1.0)
    settled = placed.settle() == RestStatus.SETTLED
    body = rotate(job.axes * [-1, -1, -1, 1], X[None])
    axis = rotate(placed.states.orientation, np.tile(body, (len(settled), 1)))
    tilted = np.degrees(np.arccos(np.minimum(np.abs(axis[:, 0]), 1)))
    expected = 0.005 / job.radius / math.sin(opening / 2)
    apart = np.abs(placed.states.position[:, 2] - expected)
    found = f'{apart.max():.4f} R and {tilted.max():.2f} deg off at most'
    name = 'height and axis of a cylinder in a groove of 100 deg'
    return name, int(settled.sum()), f'{expected:.4f} R, 0 deg', found


def _normal_force(conditions: DropConditions, right: float, left: float) -> Row:
    """Of each plane from the friction on a roller that slides along, if only it has friction."""
    b1, b2 = np.radians([right, left])
    groove = VGroove(math.pi - b1 - b2, roll=(b2 - b1) / 2)
    roller = solid(_along_x(trimesh.creation.cylinder(5, 40, sections=64)))
    forces = []
    for rough in groove.body_names:
        job = job_in(roller, conditions, groove, {rough: {'friction': 0.1}})
        placed = flat_on(job, [0.0], (1.0, 0.0, 0.0))
        placed.states.position[:, 2] = 0.005 / job.radius / math.sin(groove.opening / 2)
        forces.append((1 - placed.run(4).velocity[0, 0]) / placed.time[0] / 0.1)
    a1, a2 = (math.acos(-float(body.normal @ job.scene.down)) for body in job.scene.half_spaces)
    expected = np.sin([a2, a1]) / math.sin(a1 + a2)
    name = f'forces of a roller between planes of {right} and {left} deg'
    text, found = (' and '.join(f'{f:.4f}' for f in x) for x in (expected, forces))
    return name, 1, f'{text} m g', f'{found} m g'


def _along_x(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, [0, 1, 0]))


def _belt(block: Part, conditions: DropConditions) -> Row:
    speed = 0.4
    unit = math.sqrt(block.hull_radius * conditions.gravity)  # R / T
    job = job_in(block, conditions, Slope(0.0), {'floor': {'speed': speed * unit}})
    placed = flat_on(job, YAWS)
    gained = placed.run(0.5).velocity[:, 0] / placed.time
    expected = conditions.friction
    settled = int((placed.settle() == RestStatus.SETTLED).sum())
    found = f'{_percent(gained / expected - 1)} more; {settled} at rest with it'
    return 'acceleration of a block on a belt', len(YAWS), f'{expected:g} g', found


def _belt_into_wall(block: Part, conditions: DropConditions) -> Row:
    release = {'x_min': -0.05, 'x_max': -0.05, 'y_min': 0.05, 'y_max': 0.05}
    job = job_in(block, conditions, Corner(), {'floor': {'speed': 0.1}}, release)
    placed = flat_on(job, [0.0], x=-2.0, y=3.0)
    at_rest = placed.settle()[0] == RestStatus.SETTLED
    half = 15 / 1000 / job.radius
    found = f'{-placed.states.position[0, 0]:.4f} R, ' + ('at rest' if at_rest else 'moves')
    name = 'distance of a block from a wall into which its belt runs'
    return name, 1, f'{half:.4f} R, at rest', found


def _percent(values: Array) -> str:
    return f'{100 * values.min():.2f} to {100 * values.max():.2f} %'

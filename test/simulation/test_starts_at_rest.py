"""Parts at rest start where their aspect rests: at its height, and in no way beside it."""

import numpy as np
import pytest
import shapely
import trimesh

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.rotations import down_in_part
from resting_aspects_ros.simulation.actions import Kick, disturbance_starts
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.starts import rest_starts
from resting_aspects_ros.simulation.workers import drop_range

# Depth of the flats of the coarsest round side, of 24 sides, as a share of its radius.
FLATS = 1 - np.cos(np.pi / 24)
EXAMPLES = (
    *('angle_45x30x8', 'box_10x20x30', 'cylinder_d20_h20', 'hex_nut', 'l_bracket', 't_prism'),
    *('tetrahedron', 'u_bracket', 'washer'),
)


def circle(n, radius):
    angle = 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def washer(outer, inner, thickness):
    return trimesh.creation.annulus(inner / 2, outer / 2, thickness, sections=48)


def gear(teeth):
    angle = 2 * np.pi * np.arange(4 * teeth) / (4 * teeth)
    radius = np.where(np.arange(4 * teeth) % 4 < 2, 10.0, 8.0)
    outline = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return trimesh.creation.extrude_polygon(shapely.Polygon(outline), 4.0)


def rounded_box(sides, fillet, steps=6):
    core = np.array(sides) / 2 - fillet
    angle = np.linspace(0, np.pi / 2, steps + 1)
    a, b = (x.ravel() for x in np.meshgrid(angle, angle))
    corner = core + fillet * np.stack(
        [np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=1
    )
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    return trimesh.convex.convex_hull(np.concatenate([corner * sign for sign in signs]))


def filleted_bracket():
    legs = shapely.Polygon([(0, 0), (40, 0), (40, 10), (10, 10), (10, 30), (0, 30)])
    rounded = legs.buffer(-3).buffer(3, quad_segs=6)  # all outer corners
    return trimesh.creation.extrude_polygon(rounded, 20.0)


def ball_with_flat(level):
    ball = trimesh.creation.icosphere(3, radius=10)
    plane = [0, 0, 1], [0, 0, -level]
    return trimesh.convex.convex_hull(
        trimesh.intersections.slice_mesh_plane(ball, *plane).vertices
    )


def d_shaft(level):
    outline = circle(64, 10.0)
    half = np.sqrt(100 - level**2)
    outline = [*outline[outline[:, 1] < level], (half, level), (-half, level)]
    return trimesh.convex.convex_hull([(x, y, z) for x, y in outline for z in (-20, 20)])


def ellipsoid(*axes):
    return trimesh.convex.convex_hull(
        trimesh.creation.icosphere(3).vertices * np.array(axes, dtype=float)
    )


MADE = {
    'sheet 50x30x1': lambda: trimesh.creation.box([50, 30, 1]),
    'shim': lambda: washer(20, 10, 0.5),
    'thin washer': lambda: washer(20, 10, 0.8),
    'bar': lambda: trimesh.creation.box([200, 5, 5]),
    'needle': lambda: trimesh.creation.cylinder(0.5, 100, sections=24),
    'gear': lambda: gear(12),
    'cube with fillets': lambda: rounded_box((20, 20, 20), 1.0),
    'box with fillets': lambda: rounded_box((20, 24, 40), 4.0),
    'bracket with fillets': filleted_bracket,
    'ball with a flat': lambda: ball_with_flat(9.2),
    'ball with a small flat': lambda: ball_with_flat(9.8),
    'D shaft': lambda: d_shaft(9.5),
    'capsule': lambda: trimesh.creation.capsule(20, 5, count=[24, 24]),
    'cone': lambda: trimesh.creation.cone(10, 20, sections=48),
    'oblate': lambda: ellipsoid(10, 10, 6),
    'prolate': lambda: ellipsoid(10, 10, 15),
    'ball': lambda: trimesh.creation.icosphere(2, radius=10),
}


@pytest.mark.quick_cases(12)
@pytest.mark.parametrize('name', [*EXAMPLES, *MADE])
def test_every_start_has_the_height_of_its_aspect(part, solid, mat, name):
    shape = part(name) if name in EXAMPLES else solid(MADE[name]())
    corners = shape.hull_vertices - shape.centre_of_mass
    aspects = find_aspects(shape).aspects
    starts = rest_starts(shape, aspects, Kick(speed=0.1), mat)
    noise = 1e-6 * shape.hull_radius
    for aspect, orientations, weights in zip(
        aspects, starts.orientations, starts.weights, strict=True
    ):
        heights = (down_in_part(orientations) @ corners.T).max(axis=1)
        assert weights.sum() == pytest.approx(1)
        assert heights.max() <= aspect.com_height + noise
        if aspect.sweep.curved:
            # The flats of the mesh are below its edges, which are on the true surface.
            assert heights.min() >= (1 - FLATS) * aspect.com_height - noise
        else:
            assert heights.min() >= aspect.com_height - noise
            lowest = (aspect.directions @ corners.T).max(axis=1).min()
            assert heights.max() == pytest.approx(lowest, abs=noise)


def stays(job, count, rows, aspects):
    """Return how many of the parts of each row stay in their aspect."""
    poses = drop_range(job, 0, count * rows)
    ids = aspects.classify(poses.orientation)
    start = np.array([a.id for a in aspects.aspects])[:rows]
    return (ids.reshape(count, rows) == start).sum(axis=0)


@pytest.mark.parametrize('name', ['sheet 50x30x1', 'shim'])
def test_both_faces_of_a_sheet_stay_after_a_tap(solid, mat, name):
    """The centre of mass would have to rise by 14 and 9 mm; a tap lifts it by 0.1 mm."""
    shape = solid(MADE[name]())
    aspects = find_aspects(shape)
    starts = rest_starts(shape, aspects.aspects[:2], Kick(speed=0.05, spin=2.0), mat)
    job = make_job(shape, mat, 1, starts=starts)
    assert stays(job, 30, 2, aspects).tolist() == [30, 30]


@pytest.mark.parametrize('name', ['cube with fillets', 'bracket with fillets', 'washer', 'gear'])
def test_disturbance_below_the_barrier_leaves_no_aspect(part, solid, mat, name):
    """Simulated until the parts are still, because the energy rule would decide at once."""
    shape, each = part(name) if name in EXAMPLES else solid(MADE[name]()), 50
    aspects = find_aspects(shape)
    kept = [a for a in aspects.aspects if a.min_barrier > 0.1 * shape.hull_radius]
    assert kept
    lift = np.array([[0.98 * a.min_barrier] for a in kept])
    starts = disturbance_starts(shape, kept, lift, mat)
    job = make_job(shape, mat, 1, until_still=True, starts=starts)
    poses = drop_range(job, 0, each * len(kept))
    ids = aspects.classify(poses.orientation).reshape(each, len(kept))
    assert (ids == [a.id for a in kept]).all()

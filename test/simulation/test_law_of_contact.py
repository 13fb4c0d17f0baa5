"""The law of contact, held to closed forms: single impacts, and motions that can be integrated."""

import importlib.util

import numba
import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from resting_aspects_ros.rotations import random_orientations
from resting_aspects_ros.simulation import kernel, kernel_data
from resting_aspects_ros.simulation.job import CONTACT_STEPS, make_job
from resting_aspects_ros.simulation.kernel_engine import body_of, ground_of, simulate
from resting_aspects_ros.simulation.scene import depth_of

# The kernel as Python, in which a single impact needs no compilation.
SPEC = importlib.util.find_spec(kernel.__name__)
PLAIN = importlib.util.module_from_spec(SPEC)
with pytest.MonkeyPatch.context() as patch:
    patch.setattr(numba.config, 'DISABLE_JIT', True)
    SPEC.loader.exec_module(PLAIN)

UPRIGHT = np.array([[0.0, 0.0, 0.0, 1.0]])
NONE = np.zeros((1, 3))


class Lab:
    """A part on a level plane; lengths in R, times in T."""

    def __init__(self, part, conditions):
        self.job = make_job(part, conditions, 1)
        self.body, self.ground = body_of(self.job), ground_of(self.job)
        self.moments = self.job.moments

    def depth(self, orientation):
        return depth_of(orientation, self.job.hull)

    def put(self, orientation, above=0.0):
        """Positions with the lowest corner at a height."""
        position = np.zeros((len(orientation), 3))
        position[:, 2] = self.depth(orientation) + above
        return position

    def collide(self, position, velocity, spin, orientation):
        """Velocities and spins after an impact of all corners that touch the plane."""
        work, inverse = kernel_data.work_of(self.body, self.ground), 1 / self.moments
        work.planes[:] = self.ground.planes
        found = np.concatenate([velocity, spin], axis=1)
        for k in range(len(position)):
            axes = Rotation.from_quat(orientation[k]).as_matrix()
            c, v, w = position[k], velocity[k], axes.T @ spin[k]
            spun = np.cross(self.moments * w, w) * inverse
            given = self.body, self.ground, work, False, axes, c, v, w, spun, 0.0, 1e-6
            if PLAIN._look(*given)[1] < 0:
                count = PLAIN._contacts(self.body, work, False, True, axes, c, inverse)
                of_body = axes.T @ v, w
                after = PLAIN._impact(work, count, True, self.moments, inverse, *of_body)
                found[k] = (axes @ np.transpose(after)).T.ravel()
        return found[:, :3], found[:, 3:]

    def run(self, position, velocity, spin, orientation, limit, **numerics):
        n = len(position)
        ends, codes = np.empty((n, 15)), np.empty((n, 2), dtype=np.int64)
        given = kernel_data.Numerics(**{'decides': False, **numerics})
        states = position, velocity, spin, orientation
        simulate(self.body, self.ground, given, limit, states, ends, codes)
        return ends, codes

    def energy(self, position, velocity, spin, orientation):
        of_body = Rotation.from_quat(orientation).inv().apply(spin)
        kinetic = (velocity**2).sum(axis=1) + (self.moments * of_body**2).sum(axis=1)
        return kinetic / 2 + position[:, 2]


@pytest.fixture
def lab(solid, mat):
    given = {'restitution': 0.5, 'friction': 0.3, 'rolling_friction': 0.0}
    return lambda mesh, **values: Lab(solid(mesh), mat.changed(**given | values))


def box(*size):
    return trimesh.creation.box(size)


def upright(part):
    """Orientation in which the axes of the mesh are those of the world."""
    return (Rotation.from_quat(part.job.axes)).as_quat()[None]


@pytest.mark.parametrize('restitution', [0.0, 0.3, 0.9])
def test_a_box_that_lands_flat_bounces_to_the_square_of_the_restitution(lab, restitution):
    part = lab(box(10, 20, 30), restitution=restitution, friction=0.5)
    q, fall = upright(part), 0.8
    at = part.put(q, fall)
    ends, _ = part.run(at, NONE, NONE, q, 1.5)
    # The drop is looked at before its second impact, and the closed form gives where it is then.
    t, first = ends[0, 7], np.sqrt(2 * fall)
    speed, since = restitution * first, t - first
    assert 0 < since < (2 * speed if restitution else 0.5)
    expected = speed * since - since**2 / 2 if restitution else 0.0
    assert ends[0, 2] - at[0, 2] + fall == pytest.approx(expected, abs=2e-5)
    # It does not begin to turn, within the accuracy of the solver.
    assert np.abs(ends[0, 12:]).max() < 3 * kernel.RESIDUAL


@pytest.mark.parametrize('speed', [0.1, 1.0, 5.0])
def test_oblique_impact_of_a_ball(lab, speed):
    """It sticks and rolls, or slides, as in textbooks."""
    part = lab(trimesh.creation.icosphere(3, 10), restitution=0.6, friction=0.2)
    rotation = Rotation.align_vectors([[0, 0, -1]], [part.body.points[:, 0]])[0]
    q = rotation.as_quat()[None]
    v, w = part.collide(part.put(q), np.array([[speed, 0.0, -1.0]]), NONE, q)
    share = part.moments.mean()  # I / (m r^2)
    stick, slide = speed / (1 + 1 / share), 0.2 * 1.6
    assert v[0] == pytest.approx([speed - min(stick, slide), 0, 0.6], abs=2e-3)
    assert w[0, 1] == pytest.approx(min(stick, slide) / share, abs=2e-3)


@pytest.mark.parametrize('angle', [20.0, 45.0, 70.0])
def test_impact_of_a_rod_without_friction(lab, angle):
    """A thin rod at an angle to the plane (Goldsmith 1960): v' + e v = 0 at the tip."""
    part = lab(box(100, 1, 1), restitution=0.7, friction=0.0)
    turn = Rotation.from_euler('y', angle, degrees=True) * Rotation.from_quat(part.job.axes)
    q = turn.as_quat()[None]
    v, w = part.collide(part.put(q), np.array([[0.3, 0.0, -1.0]]), NONE, q)
    arm = np.cos(np.radians(angle)) - np.sin(np.radians(angle)) / 100
    arm *= 50 / np.hypot(50, np.hypot(0.5, 0.5))
    inertia = (100**2 + 1) / 12 / (50**2 + 0.5)
    impulse = 1.7 / (1 + arm**2 / inertia)
    # Two corners of the tip touch.
    assert v[0] == pytest.approx([0.3, 0.0, impulse - 1], abs=kernel.RESIDUAL)
    assert abs(w[0, 1]) == pytest.approx(impulse * arm / inertia, abs=2 * kernel.RESIDUAL)


@pytest.mark.parametrize(('friction', 'speed'), [(0.1, 1.0), (0.3, 2.0), (0.8, 0.5)])
def test_sliding_distance(lab, friction, speed):
    part = lab(box(30, 30, 6), friction=friction)
    q = upright(part)
    ends, codes = part.run(part.put(q), np.array([[speed, 0.0, 0.0]]), NONE, q, 500.0)
    assert codes[0, 0] == kernel.SETTLED
    # A time step of friction at the end, at most.
    step = friction / CONTACT_STEPS
    assert ends[0, 0] == pytest.approx(speed**2 / (2 * friction), abs=speed * step / friction)


@pytest.mark.parametrize('sides', [60, 200])
def test_a_prism_rolls_as_far_as_its_edges_and_rolling_friction_let_it(lab, sides):
    """Of each edge it loses a share of its energy, without restitution; of each radian a moment.

    McGeer 1990, rimless wheel: w' / w = (cos d + k) / (1 + k) for an angle d between edges, with
    k = I / (m r^2).
    """
    share, speed = 0.01, 0.5  # slow enough to stay on the plane: v^2 < g r
    part = lab(
        trimesh.creation.cylinder(10, 12, sections=sides),
        friction=0.5,
        restitution=0.0,
        rolling_friction=share,
    )
    turn = Rotation.from_euler('x', 90, degrees=True) * Rotation.from_quat(part.job.axes)
    q = turn.as_quat()[None]
    radius = part.depth(q)[0]
    spin = np.array([[0.0, speed / radius, 0.0]])
    ends, codes = part.run(part.put(q), np.array([[speed, 0.0, 0.0]]), spin, q, 500.0)
    assert codes[0, 0] == kernel.SETTLED
    inertia = part.moments[np.argmax(np.abs(part.moments - np.median(part.moments)))]
    ratio, step = inertia / radius**2, 2 * np.pi / sides
    energy = (1 + ratio) * speed**2 / 2
    loss = (1 - ((np.cos(step) + ratio) / (1 + ratio)) ** 2) / step  # of each radian
    moment = share * part.job.rolling_length
    angle = np.log(1 + loss * energy / moment) / loss
    # It stops between edges over which it cannot roll any more: a hump is step^2 / 8 high.
    assert ends[0, 0] == pytest.approx(angle * radius, rel=0.04, abs=step)


def test_free_rotation_is_that_of_euler_and_newton(lab):
    """Of three different moments, against an accurate integration."""
    part = lab(box(10, 20, 30))
    moments = part.moments
    spin = np.array([0.3, 1.1, 0.4])

    def rates(_, y):
        w, q = y[:3], y[3:]
        dw = np.cross(moments * w, w) / moments
        a, b, c, d = q
        dq = [
            -(b * w[0] + c * w[1] + d * w[2]),
            a * w[0] + c * w[2] - d * w[1],
            a * w[1] + d * w[0] - b * w[2],
            a * w[2] + b * w[1] - c * w[0],
        ]
        return [*dw, *(0.5 * np.array(dq))]

    start = np.concatenate([spin, [1, 0, 0, 0]])
    # From high above the plane.
    position = np.array([[0.0, 0.0, 1e4]])
    ends, _ = part.run(position, NONE, spin[None], UPRIGHT, 20.0)
    exact = solve_ivp(rates, (0, ends[0, 7]), start, rtol=1e-11, atol=1e-12).y[:, -1]
    found = np.array([ends[0, 6], *ends[0, 3:6]])
    assert np.abs(found @ exact[3:]) == pytest.approx(1, abs=1e-7)
    momentum = Rotation.from_quat(ends[0, 3:7]).apply(
        moments * Rotation.from_quat(ends[0, 3:7]).inv().apply(ends[0, 12:])
    )
    assert momentum == pytest.approx(moments * spin, abs=1e-5)


@pytest.mark.parametrize('slender', [2.0, 4.0, 8.0])
def test_a_rocking_block_loses_speed_as_housner_found(lab, slender):
    """After an impact without restitution it turns about the other edge (Housner 1963)."""
    part = lab(box(10, 100, 10 * slender), restitution=0.0, friction=10.0)
    q = upright(part)
    alpha = np.arctan(1 / slender)
    arm = part.depth(q)[0] / np.cos(alpha)
    spin = -0.3
    # It turns about the edge at +x and lands flat.
    velocity = np.cross([0, spin, 0], [-arm * np.sin(alpha), 0, arm * np.cos(alpha)])
    v, w = part.collide(part.put(q), velocity[None], np.array([[0.0, spin, 0.0]]), q)
    ratio = 1 - 1.5 * np.sin(alpha) ** 2
    assert w[0] == pytest.approx([0, ratio * spin, 0], abs=2 * kernel.RESIDUAL)
    turning = np.cross(w[0], [arm * np.sin(alpha), 0, arm * np.cos(alpha)])
    assert v[0] == pytest.approx(turning, abs=2 * kernel.RESIDUAL)


SHAPES = {
    'box': box(10, 20, 30),
    'rod': box(100, 4, 4),
    'disc': trimesh.creation.cylinder(10, 2, sections=32),
    'tetrahedron': trimesh.convex.convex_hull([(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 20)]),
}


def thrown(part, n, seed):
    """States close above the plane, fast and spinning."""
    random = np.random.default_rng(seed)
    q = random_orientations(random, n)
    velocity, spin = random.standard_normal((2, n, 3))
    velocity[:, 2] = -np.abs(velocity[:, 2])
    return part.put(q, 1e-7), velocity, spin, q


@pytest.mark.parametrize(
    ('restitution', 'friction'), [(0.0, 0.3), (0.5, 0.3), (1.0, 0.0), (1.0, 1.0)]
)
@pytest.mark.parametrize('name', SHAPES)
def test_no_impact_adds_energy(lab, name, restitution, friction):
    """Newton's law with friction would, without a limit (Kane and Levinson 1985)."""
    part = lab(SHAPES[name], restitution=restitution, friction=friction)
    position, velocity, spin, q = thrown(part, 100, 1)
    before = part.energy(position, velocity, spin, q)
    v, w = part.collide(position, velocity, spin, q)
    gain = part.energy(position, v, w, q) - before
    assert gain.max() < 1e-9
    if restitution == 1 and friction == 0:
        # Corners that approach slowly do not bounce.
        assert gain.min() > -kernel.BOUNCE


@pytest.mark.parametrize('name', SHAPES)
def test_energy_never_grows_on_the_way(lab, name):
    part = lab(SHAPES[name], restitution=0.8, friction=0.6, rolling_friction=0.01)
    position, velocity, spin, q = thrown(part, 200, 4)
    position[:, 2] += 1.0
    ends, codes = part.run(position, velocity, spin, q, 500.0)
    assert (codes[:, 0] == kernel.SETTLED).all()
    # Between impacts, the error of steps of lasting contact is of second order.
    assert ends[:, 8].max() < 1e-4


@pytest.mark.parametrize('name', SHAPES)
def test_friction_opposes_the_slip_that_remains(lab, name):
    """Of one corner: within the cone, and opposite to the slip on its surface."""
    part = lab(SHAPES[name], restitution=0.5, friction=0.3)
    position, velocity, spin, q = thrown(part, 100, 2)
    v, w = part.collide(position, velocity, spin, q)
    hull = part.job.hull
    for i in range(len(q)):
        corners = Rotation.from_quat(q[i]).apply(hull)
        r = corners[corners[:, 2].argmin()]
        impulse = v[i] - velocity[i]
        slip = v[i] + np.cross(w[i], r)
        assert np.hypot(*impulse[:2]) <= 0.3 * impulse[2] + 1e-9
        if np.hypot(*slip[:2]) > 1e-4 and impulse[2] > 1e-4:
            assert np.hypot(*impulse[:2]) == pytest.approx(0.3 * impulse[2], rel=1e-5)
            cosine = -(impulse[:2] @ slip[:2]) / np.hypot(*impulse[:2]) / np.hypot(*slip[:2])
            assert cosine == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize('name', SHAPES)
def test_without_friction_momentum_is_kept(lab, name):
    """The horizontal momentum, and the angular momentum about the vertical."""
    part = lab(SHAPES[name], restitution=0.6, friction=0.0)
    position, velocity, spin, q = thrown(part, 50, 3)
    position[:, 2] += 0.5
    ends, _ = part.run(position, velocity, spin, q, 5.0)
    assert ends[:, 9:11] == pytest.approx(velocity[:, :2], abs=1e-6)

    def about_the_vertical(orientation, spin):
        turn = Rotation.from_quat(orientation)
        return turn.apply(part.moments * turn.inv().apply(spin))[:, 2]

    after = about_the_vertical(ends[:, 3:7], ends[:, 12:])
    assert after == pytest.approx(about_the_vertical(q, spin), abs=1e-3)

"""The compiled simulation of one convex hull against half-spaces: flight, impacts and contact.

The law is described in docs/explanation/law_of_contact.md. Lengths are in units of the hull radius
R, times in units of T = sqrt(R / g), and the mass is 1, so g is 1. Body axes are the principal
axes of inertia, with the centre of mass as origin; quaternions are wxyz, world from body. The
module has more than 600 lines because it is compiled as one unit; see kernel_engine.py.
"""

from math import acos, atan2, cos, inf, pi, sin, sqrt
from typing import Any

from numba import njit

from resting_aspects_ros.simulation.kernel_data import (
    ACROSS,
    ANGULAR,
    CARRIES,
    CONTACTS,
    DURATION,
    FRICTION,
    LIFT,
    NORMAL,
    OFFSET,
    ORIGIN,
    PER_PERIOD,
    PLANE,
    PULL,
    RAMP,
    RATE,
    RESTITUTION,
    ROCK,
    ROCK_PHASE,
    ROLL,
    SHIFT,
    SHIFT_PHASE,
    SIZE,
    SPIN,
    TANGENT,
    TWIST,
    VELOCITY,
)
from resting_aspects_ros.statistics.poses import RestStatus

# Impacts slower than this do not bounce; corners that leave a plane faster than the second number
# do not touch it any more.
BOUNCE, LEAVE = 0.05, 5e-4
# Corners that approach faster than this are stopped, or bounce, before a step of lasting contact.
TOUCHING = 5e-4
# Maximum duration of a step of flight.
FLIGHT = 0.5
# Time in which a penetration is removed.
RECOVERY = 0.25
# The solver iterates until no speed changes by more than this, or until the maximum. Impacts have
# the second accuracy: a part that lands flat shall leave the plane flat, within GAP.
RESIDUAL, IMPACT_RESIDUAL, ITERATIONS = 1e-5, 1e-7, 500
# Share of them below which a change ends the iteration, too.
CREEP = 0.01
# Where changes become less by a ratio between these two, the same within the share STEADY of what
# it differs from 1, and the square of the cosine between two of them is COLLINEAR, the iteration
# goes on from the limit of their series.
SLOWLY, HARDLY, STEADY, COLLINEAR = 0.5, 0.99, 0.1, 0.999
# Steps of Newton's method for the direction of a slip, and its accuracy, R / T.
NEWTON, SLIP = 12, 1e-6
# Where it does not converge, directions between which a root is searched, and its bisections.
DIRECTIONS, BISECTIONS = 24, 40
# Hulls of at most this number of corners are searched completely for those that touch.
FEW = 24
# Heights of corners are equal within this.
ABOUT = 1e-9
# A part that is further below a plane than this has failed.
DEEP = 0.5
# Required distance below a barrier, m g R, of the energy that decides an aspect.
MARGIN = 0.01
# Maximum cosine between the axis of a round side on which a part rolls and the vertical.
ROLLING = 0.1
# Time between checks.
CHECK = 0.5
# A part is at rest if no point of it moves faster than SLOW relative to some surface for QUIET. In
# surroundings, where several planes push, it can tremble a little more. A tilt about an edge grows
# by a factor of e in about T, so that only a tilt of this size could be mistaken for rest.
SLOW, SLOW_IN_SCENE, QUIET = 2e-4, 1e-3, 0.25
# In surroundings, it is also at rest if at two checks in a row no coordinate and no component of
# its quaternion has changed by more than STILL, or beside a belt, which makes it tremble, by the
# second number.
STILL, STILL_AT_BELT = 1e-4, 1e-3
# A part slides for ever if for SLIDE_WINDOW it turns by at most SLIDE_TURN and becomes slower by
# at most the share SLOWER, or if it has come down by MAX_FALL.
SLIDE_WINDOW, SLIDE_TURN, SLOWER, MAX_FALL = 10.0, 1e-3, 1e-4, 50.0
# Steps of lasting contact between attempts to decide the aspect.
ATTEMPTS = 4
# Maximum number of impacts at a time: where friction pulls a part into a plane (Painleve), no
# impulse may solve an impact.
AT_ONCE = 50
# Maximum number of steps between two checks: a drop in which time stands still has not settled.
MAX_STEPS = 100_000

SETTLED, UNSETTLED, FAILED = (
    int(RestStatus.SETTLED),
    int(RestStatus.UNSETTLED),
    int(RestStatus.FAILED),
)
LOST, SLIDING = int(RestStatus.LOST), int(RestStatus.SLIDING)
GOING = -1  # a drop that has not ended


FLAGS: Any = {
    'error_model': 'numpy',
    'fastmath': {'contract', 'nsz', 'arcp'},
    'nogil': True,
    '_nrt': False,
}
jit = njit(**FLAGS)
once = njit(**FLAGS, forceinline=True)


@jit
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def _cross(a, b):
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@jit
def _plus(a, s, b):
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@jit
def _times(a, b):
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@jit
def _scaled(s, a):
    return s * a[0], s * a[1], s * a[2]


@jit
def _axes(q):
    """Return the axes of the world in body axes: the rows of the rotation matrix."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@jit
def _world(axes, a):
    return _dot(axes[0], a), _dot(axes[1], a), _dot(axes[2], a)


@jit
def _body(axes, a):
    x, y, z = axes
    return (
        x[0] * a[0] + y[0] * a[1] + z[0] * a[2],
        x[1] * a[0] + y[1] * a[1] + z[1] * a[2],
        x[2] * a[0] + y[2] * a[1] + z[2] * a[2],
    )


@jit
def _torque_free(moments, inverse, w):
    """Return the angular acceleration without a moment (Euler's equations)."""
    return _times(inverse, _cross(_times(moments, w), w))


@jit
def _unit4(q):
    s = 1 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


@jit
def _rotated(q, w, moments, inverse, dt):
    """Return orientation and spin after a torque-free rotation.

    The spin by the classical Runge-Kutta method, the orientation by the Magnus expansion of
    fourth order with Simpson's rule.
    """
    k1 = _torque_free(moments, inverse, w)
    k2 = _torque_free(moments, inverse, _plus(w, dt / 2, k1))
    k3 = _torque_free(moments, inverse, _plus(w, dt / 2, k2))
    k4 = _torque_free(moments, inverse, _plus(w, dt, k3))
    g = dt / 6
    last = _plus(_plus(_plus(_plus(w, g, k1), 2 * g, k2), 2 * g, k3), g, k4)
    slope = _torque_free(moments, inverse, last)
    # Hermite's mean of spin, and the moments of the Magnus expansion from the values at both ends.
    mean = _plus(_plus(_scaled(0.5, w), 0.5, last), dt / 12, _plus(k1, -1.0, slope))
    mean = _plus(mean, dt / 12, _cross(w, last))
    return _turned(q, mean, dt), last


@jit
def _turned(q, w, dt):
    """Return the orientation after a rotation with a constant spin, body axes."""
    x, y, z = w[0] * dt / 2, w[1] * dt / 2, w[2] * dt / 2
    h = x * x + y * y + z * z
    c = 1 - h / 2 * (1 - h / 12 * (1 - h / 30))
    s = 1 - h / 6 * (1 - h / 20 * (1 - h / 42))
    x, y, z = x * s, y * s, z * s
    a, b, e, d = q
    return _unit4(
        (
            a * c - b * x - e * y - d * z,
            b * c + a * x + e * z - d * y,
            e * c + a * y - b * z + d * x,
            d * c + a * z + b * y - e * x,
        )
    )


@jit
def _touch(h, d, q, gap, before):
    """Return when a corner touches, from height, speed and acceleration, or else ``before``."""
    inside = h < gap
    if inside and d <= LEAVE:
        return before
    g = 0.0 if inside else h - gap / 2
    end = g + (d + q * before / 2) * before
    if end >= 0 and (q <= 0 or d >= 0 or -d >= q * before):
        return before
    disc = d * d - 2 * q * g
    if disc < 0:
        return before
    root = sqrt(disc)
    if d < 0:
        return min(before, 2 * g / (root - d))
    return min(before, (d + root) / -q) if q < 0 else before


@jit
def _scan(p, starts, near, found, values, mark, epoch, low, n, a, b, z, vz, g, most, gap):
    """Find the corners that touch a plane, or can touch it within the time ``most``.

    Of a corner r, the height is z + n r, its rate vz + a r, and its acceleration g + b r. They are
    written to the rows of ``values``.

    Returns
    -------
    number of corners in ``found``, the lowest corner, its height, the time of the next touch, and
    the lowest rate of those that touch
    """
    lowest, slowest, first = inf, inf, most
    total = p.shape[1]
    if total <= FEW:
        for k in range(total):
            x, y, zz = p[0, k], p[1, k], p[2, k]
            values[0, k] = z + n[0] * x + n[1] * y + n[2] * zz
            values[1, k] = vz + a[0] * x + a[1] * y + a[2] * zz
            values[2, k] = g + b[0] * x + b[1] * y + b[2] * zz
        for k in range(total):
            h = values[0, k]
            if h < lowest:
                lowest, low = h, k
            d = values[1, k]
            if h < gap:
                slowest = min(slowest, d)
            first = _touch(h, d, values[2, k], gap, first)
        return total, low, lowest, first, slowest
    best = n[0] * p[0, low] + n[1] * p[1, low] + n[2] * p[2, low]
    moved = True
    while moved:
        moved = False
        for i in range(starts[low], starts[low + 1]):
            k = near[i]
            h = n[0] * p[0, k] + n[1] * p[1, k] + n[2] * p[2, k]
            if h < best:
                best, low, moved = h, k, True
    lowest = z + best
    # Rate and acceleration of the lowest corner, which the others have to overtake.
    rate = vz + a[0] * p[0, low] + a[1] * p[1, low] + a[2] * p[2, low]
    pull = g + b[0] * p[0, low] + b[1] * p[1, low] + b[2] * p[2, low]
    count, done = 1, 0
    found[0] = low
    mark[low] = epoch
    while done < count:
        k = found[done]
        x, y, zz = p[0, k], p[1, k], p[2, k]
        h = z + n[0] * x + n[1] * y + n[2] * zz
        d = vz + a[0] * x + a[1] * y + a[2] * zz
        q = g + b[0] * x + b[1] * y + b[2] * zz
        values[0, done], values[1, done], values[2, done] = h, d, q
        done += 1
        if h < gap:
            slowest = min(slowest, d)
        first = _touch(h, d, q, gap, first)
        # Beyond a corner that can come neither below the gap nor below the lowest one, none can.
        closer = (max(0.0, rate - d) + max(0.0, pull - q) * first / 2) * first
        falls = (max(0.0, -d) + max(0.0, -q) * first / 2) * first
        if h > max(gap + falls, lowest + closer + ABOUT):
            continue
        for i in range(starts[k], starts[k + 1]):
            j = near[i]
            if mark[j] != epoch:
                mark[j] = epoch
                found[count] = j
                count += 1
    return count, low, lowest, first, slowest


# Columns of a contact: arms of the normal and of both tangents, the same times the inverse
# inertia, stiffnesses and what follows from them, impulses, the normal speed that is required, the
# velocity of the surface, and height, speed and acceleration of the corner.
RN, RX, RY, JN, JX, JY = 0, 3, 6, 9, 12, 15
KN, KXX, KXY, KYY, KNX, KNY, DET, AX, AY, STICK, PN, PX, PY, AIM, SX, SY, HEIGHT, FALL, BEND = (
    range(18, 37)
)
# The impulses of the iteration before.
BEFORE = 37


@jit
def _at(con, i, first):
    return con[i, first], con[i, first + 1], con[i, first + 2]


@jit
def _put(con, i, first, a):
    con[i, first], con[i, first + 1], con[i, first + 2] = a


@jit
def _set_contact(con, i, r, n, x, y, inverse):
    """Set the columns of a contact at a corner r of a plane with normal and tangents."""
    rn, rx, ry = _cross(r, n), _cross(r, x), _cross(r, y)
    jn, jx, jy = _times(inverse, rn), _times(inverse, rx), _times(inverse, ry)
    _put(con, i, RN, rn)
    _put(con, i, RX, rx)
    _put(con, i, RY, ry)
    _put(con, i, JN, jn)
    _put(con, i, JX, jx)
    _put(con, i, JY, jy)
    kn, kxx, kxy = 1 + _dot(rn, jn), 1 + _dot(rx, jx), _dot(rx, jy)
    kyy, nx, ny = 1 + _dot(ry, jy), _dot(rn, jx), _dot(rn, jy)
    det = 1 / (kxx * kyy - kxy * kxy)
    ax, ay = det * (kyy * nx - kxy * ny), det * (kxx * ny - kxy * nx)
    con[i, KN], con[i, KXX], con[i, KXY], con[i, KYY] = kn, kxx, kxy, kyy
    con[i, KNX], con[i, KNY], con[i, DET], con[i, AX], con[i, AY] = nx, ny, det, ax, ay
    con[i, STICK] = 1 / (kn - nx * ax - ny * ay)
    con[i, PN] = con[i, PX] = con[i, PY] = con[i, AIM] = 0.0


@jit
def _disk(kxx, kxy, kyy, ux, uy, limit, px, py):
    """Return the friction impulse that stops a slip, or that of the limit against the slip."""
    det = 1 / (kxx * kyy - kxy * kxy)
    sx, sy = px - det * (kyy * ux - kxy * uy), py - det * (kxx * uy - kxy * ux)
    if sx * sx + sy * sy > limit * limit:
        half, diff = (kxx + kyy) / 2, (kxx - kyy) / 2
        g = 1 / (half + sqrt(diff * diff + kxy * kxy))
        sx, sy = px - g * ux, py - g * uy
        s2 = sx * sx + sy * sy
        if s2 > limit * limit:
            f = limit / sqrt(s2)
            sx, sy = sx * f, sy * f
    return sx, sy


@jit
def _impulse(con, i, un, ux, uy, mu):
    """Return the impulse of a contact whose velocity without it is given, relative to the aim.

    No impulse if it opens; the one that stops it, if friction suffices; otherwise friction is at
    its limit and opposite to the slip that remains, whose direction Newton's method finds.
    """
    if un >= 0:
        return 0.0, 0.0, 0.0
    kn, nx, ny = con[i, KN], con[i, KNX], con[i, KNY]
    if mu == 0:
        return -un / kn, 0.0, 0.0
    kxx, kxy, kyy, det = con[i, KXX], con[i, KXY], con[i, KYY], con[i, DET]
    bx, by = det * (kyy * ux - kxy * uy), det * (kxx * uy - kxy * ux)
    pn = (nx * bx + ny * by - un) * con[i, STICK]
    px, py = -bx - con[i, AX] * pn, -by - con[i, AY] * pn
    if pn > 0 and px * px + py * py <= mu * mu * pn * pn:
        return pn, px, py
    # The direction of the friction impulse before, or of the slip.
    sx, sy = -con[i, PX], -con[i, PY]
    square = sx * sx + sy * sy
    if square == 0:
        sx, sy = ux, uy
        square = sx * sx + sy * sy
    if square == 0:
        sx, sy, square = -px, -py, px * px + py * py
    length = 1 / sqrt(square)
    sx, sy = sx * length, sy * length
    found = False
    for _ in range(NEWTON):
        pn, tx, ty, inverse = _slipping(con, i, un, ux, uy, mu, sx, sy)
        along, across = sx * tx + sy * ty, sx * ty - sy * tx
        if abs(across) <= SLIP:
            found = along >= 0
            break
        limit = mu * pn
        gx = nx - mu * (kxx * sx + kxy * sy)
        gy = ny - mu * (kxy * sx + kyy * sy)
        rate = limit * (ny * sx - nx * sy) * inverse
        dx = gx * rate + limit * (kxx * sy - kxy * sx)
        dy = gy * rate + limit * (kxy * sy - kyy * sx)
        slope = sx * dy - sy * dx - along
        # Towards the slip, by at most half a radian.
        step = 0.5 if across > 0 else -0.5
        if slope < 0 and abs(across) < -0.5 * slope:
            step = -across / slope
        sx, sy = sx - step * sy, sy + step * sx
        unit = 1.5 - 0.5 * (sx * sx + sy * sy)
        sx, sy = sx * unit, sy * unit
    if not found:
        sx, sy = _searched(con, i, un, ux, uy, mu, sx, sy)
        pn = _slipping(con, i, un, ux, uy, mu, sx, sy)[0]
    limit = mu * pn / sqrt(sx * sx + sy * sy)
    return pn, -limit * sx, -limit * sy


@jit
def _slipping(con, i, un, ux, uy, mu, sx, sy):
    """Return the normal impulse of a contact that slips in a direction, and the slip after it."""
    kn, nx, ny = con[i, KN], con[i, KNX], con[i, KNY]
    # The denominator of a part that friction pulls into the plane could be negative.
    inverse = 1 / max(kn - mu * (nx * sx + ny * sy), 0.05 * kn)
    pn = -un * inverse
    px, py = -mu * pn * sx, -mu * pn * sy
    tx = ux + nx * pn + con[i, KXX] * px + con[i, KXY] * py
    ty = uy + ny * pn + con[i, KXY] * px + con[i, KYY] * py
    return pn, tx, ty, inverse


@jit
def _searched(con, i, un, ux, uy, mu, sx, sy):
    """Return a direction of slip by bisection, if there is one; otherwise the given one."""
    best, nearest = 0.0, -2.0
    for k in range(DIRECTIONS):
        low, high = 2 * pi * k / DIRECTIONS, 2 * pi * (k + 1) / DIRECTIONS
        if not (_across(con, i, un, ux, uy, mu, low) >= 0 > _across(con, i, un, ux, uy, mu, high)):
            continue
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            if _across(con, i, un, ux, uy, mu, middle) >= 0:
                low = middle
            else:
                high = middle
        cosine = cos(low) * sx + sin(low) * sy
        _, tx, ty, _ = _slipping(con, i, un, ux, uy, mu, cos(low), sin(low))
        if cos(low) * tx + sin(low) * ty >= 0 and cosine > nearest:
            best, nearest = low, cosine
    return (cos(best), sin(best)) if nearest > -2 else (sx, sy)


@jit
def _across(con, i, un, ux, uy, mu, angle):
    """Return how far the slip turns from a direction: positive to the left."""
    sx, sy = cos(angle), sin(angle)
    _, tx, ty, _ = _slipping(con, i, un, ux, uy, mu, sx, sy)
    return sx * ty - sy * tx


@jit
def _solve(con, of, planes, axes, roll, count, residual, inverse, v, w):
    """Return velocity and spin after the impulses of the contacts, body axes.

    Gauss-Seidel: each contact is solved exactly with the impulses of the others, until no speed
    changes by more than ``residual``. Then follow rolling and spinning friction of each plane.
    """
    rolls = False
    for i in range(len(planes)):
        if _resists(of, planes, i, count):
            rolls = True
            for j in range(3):
                jj = _times(inverse, _at(axes, i, 3 * j))
                w = _plus(w, roll[i, j], jj)
    for i in range(count):
        n, x, y = _at(axes, of[i], 0), _at(axes, of[i], 3), _at(axes, of[i], 6)
        pn, px, py = con[i, PN], con[i, PX], con[i, PY]
        v = _plus(_plus(_plus(v, pn, n), px, x), py, y)
        w = _plus(_plus(_plus(w, pn, _at(con, i, JN)), px, _at(con, i, JX)), py, _at(con, i, JY))
    before, last = inf, 1.0
    dv = dw = (0.0, 0.0, 0.0)
    for _ in range(ITERATIONS):
        v_before, w_before, dv_before, dw_before = v, w, dv, dw
        for i in range(count):
            _put(con, i, BEFORE, _at(con, i, PN))
        if rolls:
            for i in range(len(planes)):
                _put(roll, i, 3, _at(roll, i, 0))
        for i in range(count):
            n, x, y = _at(axes, of[i], 0), _at(axes, of[i], 3), _at(axes, of[i], 6)
            pn, px, py = con[i, PN], con[i, PX], con[i, PY]
            un = _dot(n, v) + _dot(_at(con, i, RN), w) - con[i, AIM]
            ux = _dot(x, v) + _dot(_at(con, i, RX), w) - con[i, SX]
            uy = _dot(y, v) + _dot(_at(con, i, RY), w) - con[i, SY]
            kn, kxx, kxy = con[i, KN], con[i, KXX], con[i, KXY]
            kyy, nx, ny = con[i, KYY], con[i, KNX], con[i, KNY]
            qn, qx, qy = _impulse(
                con,
                i,
                un - kn * pn - nx * px - ny * py,
                ux - nx * pn - kxx * px - kxy * py,
                uy - ny * pn - kxy * px - kyy * py,
                planes[of[i], FRICTION],
            )
            dn, dx, dy = qn - pn, qx - px, qy - py
            con[i, PN], con[i, PX], con[i, PY] = qn, qx, qy
            v = _plus(_plus(_plus(v, dn, n), dx, x), dy, y)
            w = _plus(
                _plus(_plus(w, dn, _at(con, i, JN)), dx, _at(con, i, JX)), dy, _at(con, i, JY)
            )
        if rolls:
            for i in range(len(planes)):
                if _resists(of, planes, i, count):
                    w = _resisted(con, of, planes, axes, roll, i, count, inverse, w)
        elif count == 1:
            break
        # Not that of single impulses: those of a part between two planes can grow against each
        # other. The changes that remain are those of a geometric series with the larger one of
        # the last two ratios.
        dv, dw = _plus(v, -1.0, v_before), _plus(w, -1.0, w_before)
        change = sqrt(_dot(dv, dv)) + sqrt(_dot(dw, dw))
        ratio = change / before if before < inf else 1.0
        most = max(ratio, last)
        if change < CREEP * residual or change * most < residual * (1 - most):
            break
        alike = abs(ratio - last) < STEADY * (1 - ratio)
        if SLOWLY < ratio < HARDLY and alike and _collinear(dv, dw, dv_before, dw_before):
            # The limit of the series.
            rest = ratio / (1 - ratio)
            v, w = _plus(v, rest, dv), _plus(w, rest, dw)
            for i in range(count):
                p = _at(con, i, PN)
                _put(con, i, PN, _plus(p, rest, _plus(p, -1.0, _at(con, i, BEFORE))))
            if rolls:
                for i in range(len(planes)):
                    r = _at(roll, i, 0)
                    _put(roll, i, 0, _plus(r, rest, _plus(r, -1.0, _at(roll, i, 3))))
            change, ratio = inf, 1.0
        before, last = change, ratio
    return v, w


@jit
def _collinear(v, w, v_before, w_before):
    product = _dot(v, v_before) + _dot(w, w_before)
    squares = (_dot(v, v) + _dot(w, w)) * (_dot(v_before, v_before) + _dot(w_before, w_before))
    return product > 0 and product * product > COLLINEAR * squares


@jit
def _resists(of, planes, i, count):
    """Return whether a plane that a part touches has rolling or spinning friction."""
    if planes[i, ROLL] > 0 or planes[i, SPIN] > 0:
        for k in range(count):
            if of[k] == i:
                return True
    return False


@jit
def _resisted(con, of, planes, axes, roll, i, count, inverse, w):
    """Return the spin after rolling and spinning friction of a plane."""
    total = 0.0
    for k in range(count):
        if of[k] == i:
            total += con[k, PN]
    n, x, y = _at(axes, i, 0), _at(axes, i, 3), _at(axes, i, 6)
    jn, jx, jy = _times(inverse, n), _times(inverse, x), _times(inverse, y)
    turn = _at(planes, i, ANGULAR)
    if planes[i, ROLL] > 0:
        rxx, rxy, ryy = _dot(x, jx), _dot(x, jy), _dot(y, jy)
        wx = _dot(x, w) - _dot(turn, _at(planes, i, TANGENT))
        wy = _dot(y, w) - _dot(turn, _at(planes, i, ACROSS))
        qx, qy = roll[i, 1], roll[i, 2]
        sx, sy = _disk(rxx, rxy, ryy, wx, wy, planes[i, ROLL] * total, qx, qy)
        w = _plus(_plus(w, sx - qx, jx), sy - qy, jy)
        roll[i, 1], roll[i, 2] = sx, sy
    if planes[i, SPIN] > 0:
        rnn, limit, qn = _dot(n, jn), planes[i, SPIN] * total, roll[i, 0]
        wn = _dot(n, w) - _dot(turn, _at(planes, i, NORMAL))
        s = min(limit, max(-limit, qn - wn / rnn))
        w = _plus(w, s - qn, jn)
        roll[i, 0] = s
    return w


@jit
def _descended(body, d, corner):
    """Return the minimum to which a part rolls whose lowest corner is known; see Descent."""
    p, fans, ends = body.points, body.fans, body.ends
    sides, normals, feet = body.sides, body.normals, body.feet
    for _ in range(4 * p.shape[1]):
        c = (p[0, corner], p[1, corner], p[2, corner])
        along = _dot(c, d)
        away = (d[0] * along - c[0], d[1] * along - c[1], d[2] * along - c[2])
        length = sqrt(_dot(away, away))
        if length > 1e-6:
            away = _scaled(1 / length, away)
        else:
            away = _cross(d, (1.0, 0.0, 0.0) if abs(d[0]) < 0.6 else (0.0, 1.0, 0.0))
            away = _scaled(1 / sqrt(_dot(away, away)), away)
        best, now, rate = -1, 0.0, 0.0
        for i in range(fans[corner], fans[corner + 1]):
            e = body.edges[i]
            o = ends[e, 0] + ends[e, 1] - corner
            gap = (c[0] - p[0, o], c[1] - p[1, o], c[2] - p[2, o])
            h, s = max(_dot(gap, d), 1e-12), -_dot(gap, away)
            # The angle atan2(h, s) is less; both are in [0, pi].
            if best < 0 or h * rate - s * now < 0:
                best, now, rate = e, h, s
        s = 1 / sqrt(now * now + rate * rate)
        d = _plus(_scaled(rate * s, d), now * s, away)
        d = _scaled(1 / sqrt(_dot(d, d)), d)
        second = ends[best, 1] == corner
        foot = 1 - feet[best] if second else feet[best]
        if foot >= 1:
            corner = ends[best, 0] if second else ends[best, 1]
            continue
        i, j = ends[best, 0], ends[best, 1]
        a = (p[0, i], p[1, i], p[2, i])
        ab = (p[0, j] - a[0], p[1, j] - a[1], p[2, j] - a[2])
        turn = _cross(_plus(a, feet[best], ab), ab)
        f, g = sides[best, 0], sides[best, 1]
        towards = (
            (normals[g, 0] - normals[f, 0]) * turn[0]
            + (normals[g, 1] - normals[f, 1]) * turn[1]
            + (normals[g, 2] - normals[f, 2]) * turn[2]
        )
        return body.minima[g if (_dot(d, turn) > 0) == (towards > 0) else f]
    return -1


@jit
def _moved(planes, at_rest, motion, t):
    """Set the poses of the planes at a time of their motion, their velocity and acceleration."""
    rate, duration = motion[RATE], motion[DURATION]
    at = (1.0 if t < duration / 2 else -1.0) / motion[RAMP]
    u = min(1.0, max(0.0, min(t, duration - t) / motion[RAMP]))
    # The ramp and its derivatives: a polynomial with zero slope and curvature at both ends.
    ramp = u * u * u * (10 - 15 * u + 6 * u * u)
    rise = 30 * u * u * (1 - u) * (1 - u) * at
    bend = 60 * u * (1 - u) * (1 - 2 * u) * at * at
    z, z1, z2 = _wave(rate * t, rate, ramp, rise, bend)
    x, x1, x2 = _wave(rate * t + motion[SHIFT_PHASE], rate, ramp, rise, bend)
    a, a1, a2 = _wave(rate * t + motion[ROCK_PHASE], rate, ramp, rise, bend)
    lift, shift, rock = _from(motion, LIFT), _from(motion, SHIFT), _from(motion, ROCK)
    size = sqrt(_dot(rock, rock))
    axis = _scaled(1 / size, rock) if size > 0 else rock
    c, s = cos(size * a), sin(size * a)
    origin = _plus(_scaled(z, lift), x, shift)
    for i in range(len(planes)):
        for first in (NORMAL, TANGENT, ACROSS, CARRIES):
            before = _at(at_rest, i, first)
            turned = _plus(_scaled(c, before), s, _cross(axis, before))
            _put(planes, i, first, _plus(turned, (1 - c) * _dot(axis, before), axis))
        _put(planes, i, ORIGIN, origin)
        planes[i, OFFSET] = at_rest[i, OFFSET] + _dot(origin, _at(planes, i, NORMAL))
        _put(planes, i, VELOCITY, _plus(_scaled(z1, lift), x1, shift))
        _put(planes, i, PULL, _plus(_scaled(z2, lift), x2, shift))
        _put(planes, i, ANGULAR, _scaled(a1, rock))
        _put(planes, i, TWIST, _scaled(a2, rock))


@jit
def _from(a, first):
    return a[first], a[first + 1], a[first + 2]


@jit
def _wave(phase, rate, ramp, rise, bend):
    """Return a sine with a varying amplitude, and its first and second derivative."""
    s, c = sin(phase), cos(phase)
    return (
        ramp * s,
        rise * s + ramp * rate * c,
        bend * s + 2 * rise * rate * c - ramp * rate * rate * s,
    )


@once
def _look(body, ground, work, moving, axes, c, v, w, spun, most, gap):
    """Find the corners that touch the planes, and when the next one does.

    Returns the time until then, at most ``most``, the lowest speed of those that touch, and the
    lowest height.
    """
    p, planes = body.points, work.planes
    first, slowest, deepest = most, inf, inf
    w2 = _dot(w, w)
    for i in range(len(planes)):
        normal = _at(planes, i, NORMAL)
        n = _body(axes, normal)
        _put(work.axes, i, 0, n)
        z, vz = _dot(normal, c) - planes[i, OFFSET], _dot(normal, v)
        g, spin = _dot(normal, ground.gravity), w
        if moving:
            arm, turn = _plus(c, -1.0, _at(planes, i, ORIGIN)), _at(planes, i, ANGULAR)
            vz -= _dot(normal, _plus(_at(planes, i, VELOCITY), 1.0, _cross(turn, arm)))
            twist = _cross(_at(planes, i, TWIST), arm)
            g -= _dot(normal, _plus(_at(planes, i, PULL), 1.0, twist))
            spin = _plus(w, -1.0, _body(axes, turn))
        a = _cross(n, spin)
        b = _plus(_plus(_cross(n, spun), _dot(w, n), w), -w2, n)
        work.counts[0] += 1
        values = work.values[i]
        count, low, lowest, first, rate = _scan(
            p,
            body.starts,
            body.near,
            work.found[i],
            values,
            work.mark,
            work.counts[0],
            work.lowest[i],
            n,
            a,
            b,
            z,
            vz,
            g,
            first,
            gap,
        )
        work.lowest[i] = low
        slowest, deepest = min(slowest, rate), min(deepest, lowest)
        m = 0
        if rate < inf:
            for k in range(count):
                if values[0, k] < gap:
                    work.touching[i, m + 1] = work.found[i, k]
                    for j in range(3):
                        values[j, m] = values[j, k]
                    m += 1
        work.touching[i, 0] = m
    return first, slowest, deepest


@jit
def _picked(p, keys, values, n, row, picked):
    """Choose at most CONTACTS of the corners ``keys[1:]``; returns their number.

    The first has the lowest value in a row, the second is the most distant from it, and the others
    are the most distant ones on both sides of the line between them.
    """
    m = keys[0]
    if m <= CONTACTS:
        for i in range(m):
            picked[i] = i
        return m
    one = 0
    for i in range(1, m):
        if values[row, i] < values[row, one]:
            one = i
    c = keys[one + 1]
    two, most = one, -1.0
    for i in range(m):
        k = keys[i + 1]
        e = (p[0, k] - p[0, c], p[1, k] - p[1, c], p[2, k] - p[2, c])
        if _dot(e, e) > most:
            two, most = i, _dot(e, e)
    k = keys[two + 1]
    side = _cross(n, (p[0, k] - p[0, c], p[1, k] - p[1, c], p[2, k] - p[2, c]))
    high, least = 0.0, 0.0
    three = four = -1
    for i in range(m):
        k = keys[i + 1]
        s = _dot(side, (p[0, k] - p[0, c], p[1, k] - p[1, c], p[2, k] - p[2, c]))
        if s > high:
            three, high = i, s
        if s < least:
            four, least = i, s
    picked[0], picked[1] = one, two
    m = 2
    if three >= 0:
        picked[m] = three
        m += 1
    if four >= 0:
        picked[m] = four
        m += 1
    return m


@once
def _contacts(body, work, moving, impact, axes, c, inverse):
    """Set the contacts of the corners that touch; returns their number."""
    p, planes, con = body.points, work.planes, work.con
    count = 0
    for i in range(len(planes)):
        if work.touching[i, 0] == 0:
            continue
        n = _body(axes, _at(planes, i, NORMAL))
        _put(work.axes, i, 0, n)
        x, y = _body(axes, _at(planes, i, TANGENT)), _body(axes, _at(planes, i, ACROSS))
        _put(work.axes, i, 3, x)
        _put(work.axes, i, 6, y)
        values = work.values[i]
        row = 1 if impact else 0
        m = _picked(p, work.touching[i], values, n, row, work.picked)
        for j in range(m):
            at = work.picked[j]
            k = work.touching[i, at + 1]
            r = (p[0, k], p[1, k], p[2, k])
            _set_contact(con, count, r, n, x, y, inverse)
            work.corner[count], work.plane[count] = k, i
            con[count, HEIGHT], con[count, FALL] = values[0, at], values[1, at]
            con[count, BEND] = values[2, at]
            surface = _at(planes, i, CARRIES)
            if moving:
                arm = _plus(_plus(_world(axes, r), 1.0, c), -1.0, _at(planes, i, ORIGIN))
                turned = _cross(_at(planes, i, ANGULAR), arm)
                surface = _plus(_plus(surface, 1.0, _at(planes, i, VELOCITY)), 1.0, turned)
            con[count, SX] = _dot(surface, _at(planes, i, TANGENT))
            con[count, SY] = _dot(surface, _at(planes, i, ACROSS))
            count += 1
    return count


@once
def _impact(work, count, still, moments, inverse, v, w):
    """Return velocity and spin after an impact, body axes.

    Newton's law with friction can add energy (Kane and Levinson 1985). Then the impulses are those
    between this and an impact without restitution that keep the energy.
    """
    con, planes = work.con, work.planes
    for i in range(count):
        n = _at(work.axes, work.plane[i], 0)
        # Of the surface, which can move.
        normal = _dot(n, v) + _dot(_at(con, i, RN), w) - con[i, FALL]
        e = planes[work.plane[i], RESTITUTION]
        fall = con[i, FALL]
        con[i, AIM] = normal + (-e * fall if fall < -BOUNCE else 0.0)
    work.roll[:] = 0.0
    vn, wn = _solve(
        con,
        work.plane,
        planes,
        work.axes,
        work.roll,
        count,
        IMPACT_RESIDUAL,
        inverse,
        v,
        w,
    )
    if not still:
        return vn, wn
    before = _dot(v, v) + _dot(w, _times(moments, w))
    after = _dot(vn, vn) + _dot(wn, _times(moments, wn))
    if after <= before:
        return vn, wn
    for i in range(count):
        con[i, AIM] = con[i, PN] = con[i, PX] = con[i, PY] = 0.0
    work.roll[:] = 0.0
    vp, wp = _solve(
        con,
        work.plane,
        planes,
        work.axes,
        work.roll,
        count,
        IMPACT_RESIDUAL,
        inverse,
        v,
        w,
    )
    dv, dw = _plus(vn, -1.0, vp), _plus(wn, -1.0, wp)
    # The energy is quadratic in the share of Newton's impulses.
    a = _dot(dv, dv) + _dot(dw, _times(moments, dw))
    b = _dot(vp, dv) + _dot(wp, _times(moments, dw))
    rest = before - _dot(vp, vp) - _dot(wp, _times(moments, wp))
    share = (sqrt(max(0.0, b * b + a * max(0.0, rest))) - b) / a
    return _plus(vp, share, dv), _plus(wp, share, dw)


@once
def _pressed(body, ground, work, count, moving, gap, axes, c, dt, inverse, spun, v, w):
    """Return velocity and spin after a time step of lasting contact, body axes.

    If the surfaces move, the planes are already those at the end of the step.
    """
    con, planes = work.con, work.planes
    v = _plus(v, dt, _body(axes, _from(ground.gravity, 0)))
    for i in range(count):
        k, pl, h = work.corner[i], work.plane[i], con[i, HEIGHT]
        n, r = _at(work.axes, pl, 0), (body.points[0, k], body.points[1, k], body.points[2, k])
        # Of the middle of the step, in which the corner turns towards its velocity at the end.
        bend = _plus(_plus(_cross(spun, r), _dot(w, r), w), -_dot(w, w), r)
        con[i, AIM] = -max(0.0, h) / dt + max(0.0, -gap - h) / max(dt, RECOVERY)
        con[i, AIM] -= _dot(n, bend) * dt / 2
        con[i, SX] -= _dot(_at(work.axes, pl, 3), bend) * dt / 2
        con[i, SY] -= _dot(_at(work.axes, pl, 6), bend) * dt / 2
        if moving:
            arm = _plus(_plus(_world(axes, r), 1.0, c), -1.0, _at(planes, pl, ORIGIN))
            surface = _plus(_at(planes, pl, VELOCITY), 1.0, _cross(_at(planes, pl, ANGULAR), arm))
            con[i, AIM] += _dot(_at(planes, pl, NORMAL), surface)
        for j in range(work.counts[1]):
            if work.old_corner[j, 0] == k and work.old_corner[j, 1] == pl:
                con[i, PN], con[i, PX] = work.old[j, 0] * dt, work.old[j, 1] * dt
                con[i, PY] = work.old[j, 2] * dt
    lasting = work.counts[1] > 0
    for i in range(len(planes)):
        for j in range(3):
            work.roll[i, j] = work.old_roll[i, j] * dt if lasting else 0.0
    v, w = _solve(
        con,
        work.plane,
        planes,
        work.axes,
        work.roll,
        count,
        RESIDUAL,
        inverse,
        v,
        w,
    )
    work.counts[1] = count
    for i in range(count):
        work.old_corner[i, 0], work.old_corner[i, 1] = work.corner[i], work.plane[i]
        work.old[i, 0], work.old[i, 1] = con[i, PN] / dt, con[i, PX] / dt
        work.old[i, 2] = con[i, PY] / dt
    for i in range(len(planes)):
        for j in range(3):
            work.old_roll[i, j] = work.roll[i, j] / dt
    return v, w


@jit
def _is_calm(body, k, z, vz, w, n, moments, mu):
    """Return whether a part stays in the aspect of a minimum although it slides, spins or rolls.

    Sliding, the spin about the vertical and rolling about the axis of a round side turn the part
    over only with a moment: friction pulls on it at the height of the centre of mass, and the spin
    acts through the products of inertia and as a gyroscope. With a constant moment, the part must
    still be lifted over an edge by a barrier; the energy of all other motion must be less.
    """
    h, r = body.heights[k], body.margins[k]
    up = _dot(w, n)
    momentum = _times(moments, n)
    product = _cross(n, momentum)
    pull = mu * h + up * up * sqrt(_dot(product, product))
    across = _plus(w, -up, n)
    axis = _at(body.rollers, k, 0)
    if _dot(axis, axis) > 0:
        if abs(_dot(axis, n)) > ROLLING:
            return False
        roll = _dot(across, axis)
        across = _plus(across, -roll, axis)
        pull += abs(up * roll) * _dot(axis, _times(moments, axis))
    if pull >= r:
        return False
    energy = z - h + (vz * vz + _dot(across, _times(moments, across))) / 2
    energy += up * up / 2 * (max(moments) - _dot(n, momentum))
    arm = sqrt(r * r + h * h)
    barrier = sqrt(arm * arm - pull * pull) - h
    barrier -= pull * (acos(pull / arm) - atan2(h, r))
    return energy + MARGIN < min(barrier, body.exits[k] + MARGIN - h)


@once
def _decided(body, corner, mu, moments, c, v, w, q, energy):
    """Return the minimum to which the part will roll on a level plane, or -1."""
    n = _axes(q)[2]
    k = _descended(body, _scaled(-1.0, n), corner)
    if k >= 0 and (energy < body.exits[k] or _is_calm(body, k, c[2], v[2], w, n, moments, mu)):
        return k
    return -1


@once
def _check(ground, track, t, limit, fallen, c, v, q):
    """Return the status of a drop that slides for ever or timed out, else GOING.

    ``track`` is what was seen when it last turned: time, speed, and where it pointed.
    """
    if ground.level:
        return UNSETTLED if t >= limit else GOING
    passed, moved = t - track[6], inf
    for i in range(len(ground.carriers)):
        d = _plus(_plus(c, -1.0, _from(track, 7)), -passed, _at(ground.carriers, i, 0))
        moved = min(moved, max(abs(d[0]), abs(d[1]), abs(d[2])))
    most = STILL_AT_BELT if ground.driven else STILL
    still = moved < most and _change(q, track, 10) < most and passed < 2 * CHECK
    track[14] = track[14] + 1 if still else 0.0
    track[6] = t
    for i in range(3):
        track[7 + i] = c[i]
    for i in range(4):
        track[10 + i] = q[i]
    if track[14] >= 2:
        return SETTLED
    if ground.endless == 2:
        n = _body(_axes(q), _at(ground.planes, 0, NORMAL))
        pointing = (n[0], n[1], n[2], 0.0)
    else:
        pointing = q
    speed = _slip(ground, v)
    over = t - track[0] >= SLIDE_WINDOW
    turned = _change(pointing, track, 2)
    steady = turned <= SLIDE_TURN and speed >= track[1] * (1 - SLOWER)
    # Towards a wall, it does not slide for ever.
    across = 0.0 if ground.endless == 2 else sqrt(v[1] * v[1] + v[2] * v[2])
    if over and steady and ground.endless > 0 and across < SLOW < speed:
        return SLIDING
    if over or turned > SLIDE_TURN:
        track[0], track[1] = t, speed
        for i in range(4):
            track[2 + i] = pointing[i]
    if ground.endless > 0 and (speed > ground.fastest or fallen > MAX_FALL):
        return SLIDING
    if t >= limit:
        return SLIDING if speed > SLOW else UNSETTLED
    return GOING


@jit
def _slip(ground, v):
    """Return the speed relative to the surface that moves most nearly alike."""
    least = inf
    for i in range(len(ground.carriers)):
        d = _plus(v, -1.0, _at(ground.carriers, i, 0))
        least = min(least, _dot(d, d))
    return sqrt(least)


@jit
def _change(q, track, first):
    """Return the largest change of a component; q and -q are the same orientation."""
    one = other = 0.0
    for i in range(4):
        one = max(one, abs(q[i] - track[first + i]))
        other = max(other, abs(q[i] + track[first + i]))
    return min(one, other)


@once
def _left(work, motion, c):
    """Return whether a part has left a plate that moves."""
    arm = _plus(c, -1.0, _at(work.planes, 0, ORIGIN))
    x, y = _dot(arm, _at(work.planes, 0, TANGENT)), _dot(arm, _at(work.planes, 0, ACROSS))
    return max(abs(x), abs(y)) > motion[SIZE] / 2


@jit
def simulate_taken(body, ground, numerics, work, limit, states, ends, codes, taken, take):
    """Simulate the drops whose indices ``take(taken, i, ended)`` returns; see simulate.

    Each pass of the loop is a step of a drop, and the next drop begins in the pass after the end
    of the one before. So threads of a GPU, which make their passes together, do not wait until
    the slowest of their drops has ended.
    """
    position, velocity, spin, orientation = states
    moments, gravity = _from(body.moments, 0), _from(ground.gravity, 0)
    inverse = (1 / moments[0], 1 / moments[1], 1 / moments[2])
    motion, track, gap = ground.motion, work.track, numerics.gap
    mu = ground.planes[0, FRICTION]
    slow = SLOW if ground.level else SLOW_IN_SCENE
    i, status = -1, SETTLED
    c = v = w = c0 = v0 = w0 = (0.0, 0.0, 0.0)
    q = q0 = (1.0, 0.0, 0.0, 0.0)
    t = t0 = dt = growth = since = quiet = start = check = 0.0
    before = inf  # energy at the impact before
    flying, moving, still, contacts, at_once, steps = False, False, False, 0, 0, 0
    while True:
        i = take(taken, i, status != GOING)
        if i >= len(position):
            break
        if status != GOING:
            status = GOING
            c, v = _at(position, i, 0), _at(velocity, i, 0)
            q = (orientation[i, 3], orientation[i, 0], orientation[i, 1], orientation[i, 2])
            w = _body(_axes(q), _at(spin, i, 0))
            c0, v0, w0, q0 = c, v, w, q
            t = t0 = dt = growth = since = quiet = 0.0
            before, start, check = inf, _dot(gravity, c), CHECK
            flying, contacts, at_once, steps = False, 0, 0, 0
            moving = motion[DURATION] > 0
            still = not (moving or ground.driven)
            for k in range(len(ground.planes)):
                work.lowest[k] = body.near[0]
                for j in range(PLANE):
                    work.planes[k, j] = ground.planes[k, j]
            work.counts[1] = 0
            track[:] = 0.0
            track[0] = track[6] = -inf
        steps += 1
        if moving:
            _moved(work.planes, ground.planes, motion, t)
            if t >= motion[DURATION]:
                moving = False
                before = inf
        axes = _axes(q)
        spun = _torque_free(moments, inverse, w)
        most = min(FLIGHT, numerics.turn / sqrt(_dot(w, w) + 1e-12))
        if moving:
            most = min(most, 2 * pi / (PER_PERIOD * motion[RATE]))
        first, slowest, deepest = _look(body, ground, work, moving, axes, c, v, w, spun, most, gap)
        if flying and deepest < -gap and deepest < since and dt > 1e-6:
            t -= dt  # the last step went below the plane: half of it
            dt /= 2
        elif slowest > LEAVE:
            c0, v0, w0, q0, t0 = c, v, w, q, t
            since, flying = deepest, True
            dt = max(1e-6, first)
            work.counts[1] = 0
        else:
            flying = False
        decide, minimum, rested = False, -1, t
        if flying:
            q, w = _rotated(q0, w0, moments, inverse, dt)
            c = _plus(_plus(c0, dt, v0), dt * dt / 2, gravity)
            v = _plus(v0, dt, gravity)
            t += dt
            at_once = 0
        elif deepest < -DEEP:
            status = FAILED
        else:
            impact = slowest < -TOUCHING and at_once < AT_ONCE
            if not impact:
                dt = min(1 / numerics.steps, numerics.swing / sqrt(_dot(w, w) + 1e-12))
                if moving:
                    dt = min(dt, 2 * pi / (PER_PERIOD * motion[RATE]))
                if first < dt:
                    dt = max(first, dt / 32)
                # The forces act in the middle of the step, where they do no work.
                q, w = _rotated(q, w, moments, inverse, dt / 2)
                axes, spun = _axes(q), _torque_free(moments, inverse, w)
                if moving:
                    # A velocity is that at the end of a step.
                    _moved(work.planes, ground.planes, motion, t + dt)
            count = _contacts(body, work, moving, impact, axes, c, inverse)
            vb = _body(axes, v)
            if impact:
                vb, w = _impact(work, count, still, moments, inverse, vb, w)
                v = _world(axes, vb)
                work.counts[1] = 0
                at_once += 1
                decide = True
            else:
                at_once = 0
                v1, w = _pressed(
                    body, ground, work, count, moving, gap, axes, c, dt, inverse, spun, vb, w
                )
                v1 = _world(axes, v1)
                c, v = _plus(_plus(c, dt / 2, v), dt / 2, v1), v1
                q, w = _rotated(q, w, moments, inverse, dt / 2)
                t += dt
                contacts += 1
                decide = contacts % ATTEMPTS == 0
                quiet += dt
            if still and (impact or decide):
                energy = (_dot(v, v) + _dot(w, _times(moments, w))) / 2 - _dot(gravity, c)
                if impact and before < inf:
                    growth = max(growth, energy - before)
                before = energy
        if status == GOING:
            if moving or _slip(ground, v) + sqrt(_dot(w, w)) > slow:
                quiet = 0.0
            elif quiet > QUIET:
                status = LOST if motion[SIZE] > 0 and _left(work, motion, c) else SETTLED
                rested = t - quiet
        if status == GOING:
            rested = t
            if decide and ground.level and numerics.decides and not moving:
                energy = (_dot(v, v) + _dot(w, _times(moments, w))) / 2 + c[2] - min(deepest, 0.0)
                k = _decided(body, work.lowest[0], mu, moments, c, v, w, q, energy)
                if k >= 0:
                    lost = motion[SIZE] > 0 and _left(work, motion, c)
                    status, minimum = (LOST, -1) if lost else (SETTLED, k)
        if status == GOING and t >= check:
            check, steps = t + CHECK, 0
            if motion[SIZE] > 0 and _left(work, motion, c):
                status = LOST
            elif moving:
                track[0] = track[6] = -inf
            else:
                fallen = _dot(gravity, c) - start
                status = _check(ground, track, t, limit[i], fallen, c, v, q)
        if status == GOING:
            if c[2] != c[2]:
                status, rested, c, v, w, q = FAILED, t0, c0, v0, w0, q0
            elif steps >= MAX_STEPS:
                status = UNSETTLED
        if status != GOING:
            codes[i, 0], codes[i, 1] = status, minimum
            _put(ends, i, 0, c)
            ends[i, 3], ends[i, 4], ends[i, 5], ends[i, 6] = q[1], q[2], q[3], q[0]
            ends[i, 7], ends[i, 8] = rested, growth
            _put(ends, i, 9, v)
            _put(ends, i, 12, _world(_axes(q), w))


@jit
def _take(taken, i, ended):
    """Return the drop i, or the next one that no thread has taken if it has ended."""
    if not ended:
        return i
    taken[0] += 1
    return taken[0] - 1


@jit
def simulate(body, ground, numerics, work, limit, states, ends, codes):
    """Simulate drops from their states until each has ended.

    Parameters
    ----------
    limit : (n,) float
        Times at which drops that still move are unsettled.
    states : States
        Position and velocity (n, 3) of the centre of mass, spin (n, 3) in the axes of the world,
        and orientation (n, 4), xyzw, world from body.
    ends : (n, 15) float
        Where position, orientation xyzw, time, growth of the energy, velocity and spin at the end
        are written.
    codes : (n, 2) int
        Where the codes of RestStatus and the minima, or -1, are written.
    """
    work.counts[2] = 0
    taken = work.counts[2:]
    simulate_taken(body, ground, numerics, work, limit, states, ends, codes, taken, _take)

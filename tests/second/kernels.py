"""What is computed thousands of times for small vectors, compiled by numba.

Numba keeps what it compiled under the name of this module: tests import it as `tests.second`, as `make nightly` does.
"""

import numpy as np
from numba import njit

from .quantities import Vector


@njit(cache=True)
def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def matrix(q: Vector) -> Vector:
    """The rotation matrix of a quaternion (w, x, y, z) of about unit length."""
    w, x, y, z = q / np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    out = np.empty((3, 3))
    out[0] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


@njit(cache=True)
def bodies(y: Vector, n: int):
    """Places of the centres of mass, matrices, velocities and turning of n bodies, and of the ground."""
    place, rotation = np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3))
    velocity, turning = np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
    for i in range(n):
        place[i] = y[3 * i : 3 * i + 3]
        rotation[i] = matrix(y[3 * n + 4 * i : 3 * n + 4 * i + 4])
        velocity[i] = y[7 * n + 3 * i : 7 * n + 3 * i + 3]
        turning[i] = y[10 * n + 3 * i : 10 * n + 3 * i + 3]
    rotation[n] = np.eye(3)
    return place, rotation, velocity, turning


@njit(cache=True)
def quaternion_rates(y: Vector, n: int) -> Vector:
    """Rates of n quaternions: half of the product of (0, w) and q."""
    out = np.empty(4 * n)
    for i in range(n):
        q, w = y[3 * n + 4 * i : 3 * n + 4 * i + 4], y[10 * n + 3 * i : 10 * n + 3 * i + 3]
        out[4 * i] = -0.5 * (w[0] * q[1] + w[1] * q[2] + w[2] * q[3])
        out[4 * i + 1 : 4 * i + 4] = 0.5 * (q[0] * w + cross(w, q[1:]))
    return out


@njit(cache=True)
def pose(place, rotation, velocity, turning, a: int, b: int, on_parent, on_child, axes_parent, axes_child):
    """The relative motion of the child b in the axes of a joint on the parent a: place, matrix, velocity, spin."""
    frame = rotation[a] @ axes_parent
    arm_a, arm_b = rotation[a] @ on_parent, rotation[b] @ on_child
    apart = place[b] + arm_b - place[a] - arm_a
    fast = velocity[b] + cross(turning[b], arm_b) - velocity[a] - cross(turning[a], arm_a + apart)
    back = np.ascontiguousarray(frame.T)
    return back @ apart, back @ (rotation[b] @ axes_child), back @ fast, back @ (turning[b] - turning[a])


@njit(cache=True)
def jacobian(place, rotation, velocity, turning, parent, child, axis, on_parent, on_child, turns, pin):
    """Of every row (a slide along, or a turn about, an axis of the parent) its dependence on all velocities, and the
    bias of its second rate. A turn of a `pin` (its axis in the child, or zero) that tilts is about the bisector.
    """
    rows, n = len(parent), len(place)
    out, bias = np.zeros((rows, 6 * n)), np.zeros(rows)
    for i in range(rows):
        a, b = parent[i], child[i]
        d = rotation[a] @ axis[i]
        turned = cross(turning[a], d)
        if turns[i] and pin[i].any():
            # Its rate is (z + p) . (w_b - w_a) / (1 + z . p).
            p = rotation[b] @ pin[i]
            tilting = cross(turning[b], p)
            whole = 1 + d @ p
            about = (d + p) / whole
            moved = (turned + tilting) / whole - about * (turned @ p + d @ tilting) / whole
            out[i, 6 * b + 3 : 6 * b + 6] += about
            out[i, 6 * a + 3 : 6 * a + 6] -= about
            bias[i] = moved @ (turning[b] - turning[a])
            continue
        if turns[i]:
            out[i, 6 * b + 3 : 6 * b + 6] += d
            out[i, 6 * a + 3 : 6 * a + 6] -= d
            bias[i] = turned @ (turning[b] - turning[a])
            continue
        arm_a, arm_b = rotation[a] @ on_parent[i], rotation[b] @ on_child[i]
        apart = place[b] + arm_b - place[a] - arm_a
        fast_a, fast_b = cross(turning[a], arm_a), cross(turning[b], arm_b)
        out[i, 6 * b : 6 * b + 3] += d
        out[i, 6 * a : 6 * a + 3] -= d
        out[i, 6 * b + 3 : 6 * b + 6] += cross(arm_b, d)
        out[i, 6 * a + 3 : 6 * a + 6] -= cross(apart + arm_a, d)
        bias[i] = d @ (cross(turning[b], fast_b) - cross(turning[a], fast_a))
        bias[i] += 2 * turned @ (velocity[b] + fast_b - velocity[a] - fast_a) + cross(turning[a], turned) @ apart
    return out, bias


@njit(cache=True)
def mass_and_weight(rotation, turning, mass, inertia, gravity):
    """The mass matrix, and weights and gyroscopic moments (with a last row for the ground)."""
    n = len(mass)
    out, force = np.zeros((6 * n, 6 * n)), np.zeros((n + 1, 6))
    for i in range(n):
        tensor = rotation[i] @ inertia[i] @ np.ascontiguousarray(rotation[i].T)
        for k in range(3):
            out[6 * i + k, 6 * i + k] = mass[i]
        out[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = tensor
        force[i, :3] = mass[i] * gravity
        force[i, 3:] = -cross(turning[i], tensor @ turning[i])
    return out, force


@njit(cache=True)
def saddle(mass, held, force, wanted, keep):
    """Matrix and right side of the equations for the kept accelerations and the multipliers."""
    m, k = len(keep), len(held)
    out, right = np.zeros((m + k, m + k)), np.zeros(m + k)
    for i in range(m):
        for j in range(m):
            out[i, j] = mass[keep[i], keep[j]]
        for j in range(k):
            out[m + j, i] = held[j, keep[i]]
            out[i, m + j] = -held[j, keep[i]]
        right[i] = force[keep[i]]
    right[m:] = wanted
    return out, right


@njit(cache=True)
def solve(matrix, right):
    """The solution of linear equations; not a number where they hold infinite ones."""
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
        return np.full(len(right), np.nan)
    return np.linalg.solve(matrix, right)


@njit(cache=True)
def slips(gradient, place, tangents, p, velocity, spin):
    """Of contact points: the arm from the pin's centre, the rate of the penetration, the slip along the tangents."""
    arm, rate, slip = np.empty(place.shape), np.empty(len(place)), np.empty(tangents.shape[:2])
    for i in range(len(place)):
        arm[i] = place[i] - p
        fast = velocity + cross(spin, arm[i])
        rate[i] = gradient[i, 0] * fast[0] + gradient[i, 1] * fast[1] + gradient[i, 2] * fast[2]
        for k in range(tangents.shape[1]):
            slip[i, k] = tangents[i, k, 0] * fast[0] + tangents[i, k, 1] * fast[1] + tangents[i, k, 2] * fast[2]
    return arm, rate, slip


@njit(cache=True)
def sums(normal, gradient, traction, tangents, arm):
    """The force of contact points, its moment about the pin's centre, and the part of friction in the force."""
    force, moment, rubbing = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(len(normal)):
        own = np.zeros(3)
        for k in range(traction.shape[1]):
            own += traction[i, k] * tangents[i, k]
        rubbing += own
        own -= normal[i] * gradient[i]
        force += own
        moment += cross(arm[i], own)
    return force, moment, rubbing


@njit(cache=True, error_model="numpy")
def line_force(d, modulus: float, c: float, offset: float):
    """The F' of d = F'/m (ln(4 m c / F') + B), of every depth."""
    out = np.empty(len(d))
    for i in range(len(d)):
        # From below Newton's steps on the concave d(F') fall short, and so converge evenly.
        f = 1e-3 * modulus * d[i]
        for _ in range(200):
            grown = np.log(4 * modulus * c / f) + offset
            step = (modulus * d[i] - f * grown) / (grown - 1)
            f += step
            if abs(step) <= 1e-15 * f:
                break
        out[i] = f
    return out


@njit(cache=True, error_model="numpy")
def wall(x: float, y: float, cosines, sines, worn, orders, waves):
    """The angle t at which e . n(t) - h(t) is largest, for e = (x, y) and depths h at even angles, and h there; in
    between h is its Fourier series.
    """
    best = 0
    for k in range(1, len(worn)):
        if x * cosines[k] + y * sines[k] - worn[k] > x * cosines[best] + y * sines[best] - worn[best]:
            best = k
    t, depth = 2 * np.pi * best / len(worn), 0.0
    for _ in range(5):
        slope, bend, depth = -x * np.sin(t) + y * np.cos(t), -x * np.cos(t) - y * np.sin(t), 0.0
        for k in range(len(orders)):
            c, s = np.cos(orders[k] * t), np.sin(orders[k] * t)
            depth += waves[k].real * c - waves[k].imag * s
            slope += orders[k] * (waves[k].real * s + waves[k].imag * c)
            bend += orders[k] ** 2 * (waves[k].real * c - waves[k].imag * s)
        t -= slope / bend
    return t, depth

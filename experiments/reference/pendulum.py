"""A pendulum on a pin with play, by equations of its own: nothing of the library's physics is used.

The pin's centre is e from the sleeve's, the arm is turned by a, and its centre of mass lies c(a) from the pin's centre:

    m (e'' + a'' k x c - a'^2 c) = f + m g,    I a'' = (R n - e - c) x f.

In contact, at the penetration d = |e| - play, f = -N n + T t with Hunt and Crossley's N = K d^(3/2) (1 + lambda d') and
the traction T = -mu N tanh(v / v_t) of the slip v = n x e' + a' (R - |e|), as docs/laws.md and docs/joints.md state.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp


class Pendulum(NamedTuple):
    """An arm that falls from the horizontal, its pin at rest in the middle of the sleeve. All numbers are in SI."""

    play: float
    friction: float
    transition_speed: float = 0.01
    stiffness: float = 1e9
    damping_factor: float = 1.0
    pin_radius: float = 0.01
    mass: float = 2.0
    inertia: float = 0.03
    centre: float = 0.2
    tip: float = 0.4
    gravity: float = 9.81

    def rates(self, _: float, y: np.ndarray) -> tuple[float, ...]:
        """The derivatives of ex, ey, a and of their rates."""
        ex, ey, angle, vx, vy, turn = y
        cx, cy = self.centre * math.cos(angle), self.centre * math.sin(angle)
        far, fx, fy, moment = math.hypot(ex, ey), 0.0, 0.0, 0.0
        if far > self.play:
            nx, ny, depth, radius = ex / far, ey / far, far - self.play, self.pin_radius + self.play
            normal = max(0.0, self.stiffness * depth**1.5 * (1 + self.damping_factor * (nx * vx + ny * vy)))
            slip = nx * vy - ny * vx + turn * (radius - far)
            traction = -self.friction * normal * math.tanh(slip / self.transition_speed)
            fx, fy = -normal * nx - traction * ny, -normal * ny + traction * nx
            moment = (radius * nx - ex - cx) * fy - (radius * ny - ey - cy) * fx
        spin = moment / self.inertia
        ax = fx / self.mass + spin * cy + turn**2 * cx
        ay = fy / self.mass - self.gravity - spin * cx + turn**2 * cy
        return vx, vy, turn, ax, ay, spin

    def tip_at(self, times: np.ndarray, rtol: float = 1e-9) -> np.ndarray:
        """Where the tip of the arm is, shape (times, 2) [m]."""
        # A longer step could pass over a touch.
        found = solve_ivp(
            self.rates, (times[0], times[-1]), np.zeros(6), "DOP853", times, rtol=rtol, atol=1e-13, max_step=2e-4
        )
        ex, ey, angle = found.y[:3]
        return np.stack([ex + self.tip * np.cos(angle), ey + self.tip * np.sin(angle)], axis=1)

"""The slider-crank whose slider has play in its guide, before it touches: the rows that Siconos publishes.

Flores, Leine, Glocker (2010), Multibody System Dynamics 23, 165-190, as github.com/siconos/siconos has it
(Examples/Mechanics/SliderCrank, `SliderCrankMoreauJeanDirectProjectionOSI.ref`): crank, rod and slider, hung up at the
ground only, thrown at 150 rad/s. The published rows come from steps of 1e-4 s of a scheme of first order. `scheme` is
such a scheme (theta = 1/2, the mass matrix of the new position) for equations written by hand; as it reproduces the
rows, the equations are theirs, and what is left is their step. Nothing here imports the library.
"""

import numpy as np

L1, L2 = 0.153, 0.306
M1, M2, M3 = 0.038, 0.038, 0.076
J1, J2, J3 = 7.4e-5, 5.9e-4, 2.7e-6
GRAVITY = 9.81
CLEARANCE = 1e-3
START = np.array([150.0, -75.0])
STEP = 1e-4
# By the time [s]: turns of the crank, angle of the rod [rad], their rates [rad/s], height of the slider over the play.
PUBLISHED = {
    1e-3: (2.325413078945e-2, -7.260707501270e-2, 1.392303073380e2, -6.834327962299e1, 7.712895695792e-2),
    2e-3: (4.393515068368e-2, -1.350981746860e-1, 1.208160507179e2, -5.667554027560e1, 4.872654100848e-1),
}


def mass(q: np.ndarray) -> np.ndarray:
    """The mass matrix of the two angles [kg m^2]; the slider only translates."""
    across = (M2 / 2 + M3) * L1 * L2 * np.cos(q[1] - q[0])
    return np.array([[J1 + (M1 / 4 + M2 + M3) * L1**2, across], [across, J2 + (M2 / 4 + M3) * L2**2]])


def load(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The generalised forces: gravity and centrifugal terms [N m]."""
    across = (M2 / 2 + M3) * L1 * L2 * np.sin(q[1] - q[0])
    weight = GRAVITY * np.cos(q) * np.array([L1 * (M1 / 2 + M2 + M3), L2 * (M2 / 2 + M3)])
    return across * np.array([v[1] ** 2, -(v[0] ** 2)]) - weight


def scheme(t1: float, step: float) -> np.ndarray:
    """The quantities of `PUBLISHED` at `t1`, by steps of the scheme."""
    q, v = np.zeros(2), START.copy()
    for _ in range(round(t1 / step)):
        before, new = load(q, v), v
        for _ in range(20):
            at = q + step * (v + new) / 2
            new = v + step * np.linalg.solve(mass(at), (before + load(at, new)) / 2)
        q, v = q + step * (v + new) / 2, new
    height = (L1 * np.sin(q[0]) + L2 * np.sin(q[1])) / CLEARANCE
    return np.array([q[0] / (2 * np.pi), q[1], *v, height])


def without_step(t1: float) -> np.ndarray:
    """The same in the limit of small steps."""
    return 2 * scheme(t1, 5e-6) - scheme(t1, 1e-5)

"""The wrench of every joint with clearance against a second implementation, which is written from the docs alone.

`test_sleeve_reference` compares whole motions without friction; here are single poses with friction, spin and every
number of the joints' own.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import joints_from_docs as docs
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.field import slope
from clearance_jax.joints import Relative

POSES = 240
TANH, BROWN = (0.1, 0.01), (0.3, 0.2, 0.01)
RADIAL, RADIUS, LENGTH, AXIAL = 1e-4, 0.01, 0.04, 5e-5
SMOOTH = docs.Laws(docs.hunt_crossley(1e9, 0.5), docs.tanh(*TANH))
ADAMS = docs.Laws(docs.adams_impact(1e9, 2e3, 1e-5), docs.brown_mcphee(*BROWN))


class Case(NamedTuple):
    """A joint of the library, its contact points by the docs, their laws, and the size of its poses [m, rad]."""

    joint: Any
    contacts: Any
    laws: docs.Laws
    place: tuple[float, float, float]
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)


def sleeve(pin, stations, ring, collar, axial, own):
    numbers = docs.Sleeve(RADIAL, RADIUS, LENGTH, pin, stations, axial, collar or 1.5 * RADIUS, ring)
    normal, friction = laws.HuntCrossley(1e9, 0.5), laws.TanhCoulomb(*TANH)
    if own is ADAMS:
        normal, friction = laws.AdamsImpact(1e9, 2e3, 1e-5), laws.BrownMcPhee(*BROWN)
    names = {"axial_clearance": axial, "stations": stations, "pin": pin, "collar_radius": collar, "ring": ring}
    joint = cj.SleeveClearance(RADIAL, RADIUS, LENGTH, normal, friction, **names)
    # The pin reaches over both edges, both faces and beyond; it has turned about its axis by any angle.
    tilt = 2 * RADIAL / LENGTH
    size = (RADIAL, RADIAL, AXIAL if axial else 0.1 * LENGTH), (tilt, tilt, 2.0)
    return Case(joint, lambda m: docs.pin_in_a_sleeve(numbers, m), own, *size)


def contact(kind, *numbers, **names):
    return kind(*numbers, laws.HuntCrossley(1e9, 0.5), laws.TanhCoulomb(*TANH), **names)


CASES = {
    "through, held axially": lambda: sleeve("through", 8, 8, None, None, SMOOTH),
    "through, faces": lambda: sleeve("through", 5, 6, 0.013, AXIAL, ADAMS),
    "inside, faces": lambda: sleeve("inside", 8, 8, None, AXIAL, SMOOTH),
    "plane": lambda: Case(
        contact(cj.RevoluteClearance, RADIAL, RADIUS),
        lambda m: docs.pin_in_the_plane(RADIAL, RADIUS, m),
        SMOOTH,
        (RADIAL, RADIAL, 0.0),
    ),
    "ball": lambda: Case(
        contact(cj.SphericalClearance, RADIAL, RADIUS),
        lambda m: docs.ball_in_a_socket(RADIAL, RADIUS, m),
        SMOOTH,
        (RADIAL, RADIAL, RADIAL),
        (1.0, 1.0, 1.0),
    ),
    "guide": lambda: Case(
        contact(cj.GuideClearance, RADIAL, LENGTH, 0.03, width=0.02),
        lambda m: docs.block_in_a_guide(RADIAL, (0.03, 0.02, LENGTH), m),
        SMOOTH,
        (RADIAL, RADIAL, 0.1),
        (5e-3, 5e-3, 5e-3),
    ),
    "guide in the plane": lambda: Case(
        contact(cj.GuideClearance, RADIAL, LENGTH, 0.03),
        lambda m: docs.block_in_a_guide(RADIAL, (0.03, 0.0, LENGTH), m),
        SMOOTH,
        (RADIAL, 0.0, 0.1),
        (0.0, 5e-3, 0.0),
    ),
}


def motions(case):
    """Random places, tilts and velocities: those of slow creep and of fast impacts."""
    rng = np.random.default_rng(32)
    for _ in range(POSES):
        place, tilt = (rng.normal(size=3) * np.array(size) for size in (case.place, case.tilt))
        # First the turn about the axis, then the tilt.
        turned = Rotation.from_rotvec([*tilt[:2], 0.0]) * Rotation.from_rotvec([0.0, 0.0, tilt[2]])
        speed = 10.0 ** rng.uniform(-4, 0)
        flat = case.tilt == (0.0, 0.0, 0.0)
        velocity, spin = speed * rng.normal(size=3), 30 * speed * rng.normal(size=3)
        if flat:
            velocity[2], spin[:2] = 0.0, 0.0
        yield docs.Motion(place, turned.as_matrix(), velocity, spin)


def library_wrenches(joint, all_motions):
    def wrench(place, rotation, velocity, spin):
        at = Relative(tuple(place), 0.0, tuple(velocity), tuple(spin), tuple(tuple(row) for row in rotation))
        action = joint.prepare().act(at, ())
        return jnp.stack([jnp.asarray(x, float) for x in (*action.force, *action.torque)])

    return np.asarray(jax.jit(jax.vmap(wrench))(*(jnp.asarray(np.stack(x)) for x in zip(*all_motions, strict=True))))


@pytest.mark.parametrize("name", CASES)
def test_a_joint_exerts_the_wrench_that_the_docs_say(name):
    case = CASES[name]()
    given = list(motions(case))
    ours = library_wrenches(case.joint, given)
    theirs = np.stack([docs.wrench(case.contacts(m), m, case.laws) for m in given])
    touching = np.linalg.norm(theirs, axis=1) > 1e-6
    assert touching.sum() > POSES / 3
    for part in (slice(0, 3), slice(3, 6)):
        size = np.linalg.norm(theirs[:, part], axis=1)
        off = np.linalg.norm(ours[:, part] - theirs[:, part], axis=1)
        assert np.all(off <= 1e-9 * size + 1e-12)


FILLING = docs.Filling((2e7, 1e7, 800.0), (300.0, 200.0, 0.8), 1e-5)


def test_a_preloaded_bearing_exerts_the_wrench_that_the_docs_say():
    case = CASES["inside, faces"]()
    element = cj.joints.PreloadedBearing(*FILLING.stiffness, *FILLING.preload, FILLING.damping_time)
    given = list(motions(case))
    # Of the joint without contact: its walls are far away.
    joint = cj.SleeveClearance(0.005, RADIUS, LENGTH, laws.Hertz(1e9), None, 0.005, element)
    ours = library_wrenches(joint, given)
    theirs = np.stack([docs.preloaded_bearing(FILLING, m) for m in given])
    for part in (slice(0, 3), slice(3, 6)):
        size = np.linalg.norm(theirs[:, part], axis=1)
        assert np.all(np.linalg.norm(ours[:, part] - theirs[:, part], axis=1) <= 1e-9 * size)


MASSES, INERTIAS = (1.5, 0.4), (np.array([2e-3, 3e-3, 4e-3]), np.array([5e-4, 8e-4, 6e-4]))
AT_SLEEVE, AT_PIN = np.array([0.1, -0.05, 0.2]), np.array([0.02, 0.03, -0.04])
TURNED_SLEEVE, TURNED_PIN = (0.4, -0.7, 1.1), (-0.3, 0.9, 0.5)


def two_bodies(clearance):
    """A body with a sleeve and a body with a pin, both free in space."""
    bodies = tuple(
        cj.Body(name, mass, cj.Inertia(*inertia))
        for name, mass, inertia in zip(("sleeve", "pin"), MASSES, INERTIAS, strict=True)
    )
    loop = cj.Revolute(
        "hip",
        "sleeve",
        "pin",
        cj.Position(*AT_SLEEVE),
        cj.Position(*AT_PIN),
        orientation=cj.Orientation(*TURNED_SLEEVE),
        child_orientation=cj.Orientation(*TURNED_PIN),
        clearance=clearance,
    )
    free = tuple(cj.Free(f"free_{name}", "ground", name) for name in ("sleeve", "pin"))
    return cj.Mechanism(bodies, free, (loop,))


def accelerations(wrench, turns, spins, centre, origins, axes):
    """Newton and Euler for both bodies: of their origins, and of their spins in their own axes."""
    force, moment = axes.apply(wrench[:3]), axes.apply(wrench[3:])
    found = []
    for sign, mass, inertia, turn, spin, origin in zip((-1, 1), MASSES, INERTIAS, turns, spins, origins, strict=True):
        torque = turn.inv().apply(sign * (moment + np.cross(centre - origin, force)))
        found += [*(sign * force / mass), *((torque - np.cross(spin, inertia * spin)) / inertia)]
    return np.array(found)


def test_bodies_accelerate_as_the_docs_say():
    """Pin and sleeve are on two free bodies, at any place and turned: the opposite force acts on the sleeve."""
    case, rng = CASES["through, faces"](), np.random.default_rng(7)
    held_sleeve, held_pin = (Rotation.from_euler("xyz", a) for a in (TURNED_SLEEVE, TURNED_PIN))
    states, wanted = [], []
    for motion in list(motions(case))[:40]:
        turn, origin = Rotation.from_rotvec(rng.normal(size=3)), rng.normal(size=3)
        spin, velocity = 3 * rng.normal(size=3), rng.normal(size=3)
        axes = turn * held_sleeve
        middle = turn.apply(AT_SLEEVE)
        pin_turn = axes * Rotation.from_matrix(motion.rotation) * held_pin.inv()
        centre = origin + middle + axes.apply(motion.place)
        pin_origin = centre - pin_turn.apply(AT_PIN)
        # What an observer on the sleeve sees, and what the sleeve carries along.
        world = turn.apply(spin)
        pin_world = world + axes.apply(motion.spin)
        pin_centre = velocity + np.cross(world, centre - origin) + axes.apply(motion.velocity)
        pin_velocity = pin_centre - np.cross(pin_world, centre - pin_origin)
        pin_spin = pin_turn.inv().apply(pin_world)
        places = [[*o, *np.roll(t.as_quat(), 1)] for o, t in ((origin, turn), (pin_origin, pin_turn))]
        states.append(np.concatenate([*places, velocity, spin, pin_velocity, pin_spin]))
        wrench = docs.wrench(case.contacts(motion), motion, case.laws)
        wanted.append(accelerations(wrench, (turn, pin_turn), (spin, pin_spin), centre, (origin, pin_origin), axes))
    ready = two_bodies(case.joint).prepare()
    found = np.asarray(jax.jit(jax.vmap(lambda y: slope(jnp.zeros(()), y, ready)))(jnp.asarray(np.stack(states))))
    sizes = np.linalg.norm(wanted, axis=1)
    assert (sizes > 1).sum() > 30
    assert np.all(np.linalg.norm(found[:, 14:] - wanted, axis=1) <= 1e-9 * sizes + 1e-9)

"""The mass matrix factored joint by joint, written out and in loops: against the Hessian of an independent kinetic
energy; its growth; its choice.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lagrangian import mass_matrix, random_state
from places import refused
from sleeves import FRICTION, HERTZ, sleeve
from spatial import body, zoo

import clearance_jax as cj
from clearance_jax.dynamics.equations import balance
from clearance_jax.dynamics.field import rate
from clearance_jax.dynamics.forms.articulated import Loose, Stepwise
from clearance_jax.dynamics.forms.table import TabledFrames
from clearance_jax.dynamics.forms.written_out import write_out
from clearance_jax.dynamics.reactions import reactions
from clearance_jax.mechanism.form import columns_of, is_less_by_blocks
from clearance_jax.mechanism.state import layout, parts
from clearance_jax.spatial import as_array


def turned(rng):
    return cj.Orientation(*rng.normal(size=3))


def played():
    """Play of every kind in a branching tree: it takes up all forces, or not all; driven, free and fixed beside it."""
    rng = np.random.default_rng(3)
    names = ["base", "upper", "lower", "hand", "load", "knob", "block", "wheel", "finger"]
    bodies = tuple(body(name, rng, 1.0 + 0.3 * i) for i, name in enumerate(names))

    def at():
        return cj.Position(*(0.2 * rng.normal(size=3)))

    driven = cj.Motion(cj.drives.Harmonic(0.7, 3.0))
    ball = cj.SphericalClearance(1e-4, 0.01, HERTZ, FRICTION)
    guide = cj.GuideClearance(1e-4, 0.05, 0.02, HERTZ, FRICTION, width=0.02)
    joints = (
        cj.Free("air", "ground", "base", at(), at(), orientation=turned(rng)),
        cj.Revolute("shoulder", "base", "upper", at(), at(), motion=driven, clearance=sleeve(), axis="y"),
        cj.Revolute("elbow", "upper", "lower", at(), at(), motion=driven, clearance=sleeve(axial=None)),
        cj.Revolute("wrist", "lower", "hand", at(), at(), clearance=sleeve(), orientation=turned(rng)),
        cj.Fixed("grip", "hand", "load", at(), at(), orientation=turned(rng)),
        cj.Spherical("socket", "upper", "knob", at(), at(), clearance=ball),
        cj.Prismatic("rail", "base", "block", at(), at(), clearance=guide, axis="y"),
        cj.Revolute("hinge", "hand", "wheel", at(), at(), axis=(0.3, 0.2, 1.0)),
        cj.Revolute("knuckle", "upper", "finger", at(), at(), motion=driven, clearance=sleeve(), axis="x"),
    )
    return cj.Mechanism(bodies, joints, gravity=cj.Gravity(0.3, -1.0, -9.81))


def pins(count):
    """A chain of bars in the plane, each on a pin with play."""
    rng = np.random.default_rng(4)
    play = cj.RevoluteClearance(1e-4, 0.01, HERTZ, FRICTION)
    bars = [
        cj.Body(f"bar{i}", 1.0 + i, 0.01 + 0.01 * i, cj.Position(*(0.1 * rng.normal(size=2)))) for i in range(count)
    ]
    joints = [
        cj.Revolute(
            f"pin{i}", f"bar{i - 1}" if i else "ground", f"bar{i}", cj.Position(0.3 if i else 0.0), clearance=play
        )
        for i in range(count)
    ]
    return cj.Mechanism(tuple(bars), tuple(joints), gravity=cj.Gravity(y=-9.81))


def motion(mechanism, time, y):
    ready, time = mechanism.prepare(), jnp.asarray(time, float)
    return write_out(ready.at(time), time, layout(ready).split(y), (0.0,) * layout(ready).free)


def factors(mechanism, time, y):
    return motion(mechanism, time, y)._articulated()


def loops(mechanism, time, y, firm=None):
    ready, time = mechanism.prepare().as_table(), jnp.asarray(time, float)
    still = (0.0,) * layout(ready).free
    return TabledFrames(ready.at(time), time, layout(ready).split(y), still).mass_matrix(firm)


@pytest.mark.parametrize(
    ("make", "factors"),
    [(zoo, factors), (played, factors), (lambda: pins(5), factors), (zoo, loops), (played, loops)],
    ids=["zoo", "played", "pins", "zoo in loops", "played in loops"],
)
def test_factors_solve_the_mass_matrix(make, factors):
    mechanism = make()
    plan, rng = layout(mechanism), np.random.default_rng(5)
    states = jnp.asarray([random_state(mechanism, rng) for _ in range(20)])[:, : plan.v.stop]
    states = jnp.concatenate([states, jnp.zeros((20, plan.remembered))], axis=1)
    right = jnp.asarray(rng.normal(size=(20, plan.free)))

    def solve(y, right):
        return as_array(factors(mechanism, 0.3, y).solve([right[i] for i in range(plan.free)]))

    ours = jax.jit(jax.vmap(solve))(states, right)
    matrices = jax.jit(jax.vmap(lambda y: mass_matrix(mechanism, 0.3, y)))(states)
    theirs = np.linalg.solve(matrices, np.asarray(right)[..., None])[..., 0]
    error = np.max(np.abs(np.asarray(ours) - theirs), axis=1) / np.max(np.abs(theirs), axis=1)
    assert np.max(error / np.linalg.cond(matrices)) < 20 * np.finfo(float).eps


def test_loops_with_firm_coordinates():
    """What is firm has so many times its inertia."""
    mechanism, firm = played(), {0: 1e3, 7: 20.0}
    y = jnp.asarray(random_state(mechanism, np.random.default_rng(8)))
    matrix = np.array(mass_matrix(mechanism, 0.3, y))
    right = np.random.default_rng(9).normal(size=len(matrix))
    ours = as_array(jax.jit(lambda y: loops(mechanism, 0.3, y, firm).solve([*jnp.asarray(right)]))(y))
    for i, times in firm.items():
        matrix[i, i] *= times
    np.testing.assert_allclose(ours, np.linalg.solve(matrix, right), rtol=1e-9)


@pytest.mark.parametrize("make", [zoo, played])
def test_both_forms_give_the_same_rates(make):
    """Accelerations, driving work, losses and exchanged energy, written out and in loops."""
    mechanism = make()
    plan = layout(mechanism)

    def rates(ready):
        def of(y):
            return jnp.stack([jnp.asarray(x) for x in rate(jnp.asarray(0.3), (*y,), ready, energy_balance=True)])

        return jax.jit(of)

    written, looped = rates(mechanism.prepare()), rates(mechanism.prepare().as_table())
    rng = np.random.default_rng(10)
    for _ in range(5):
        y = jnp.concatenate([random_state(mechanism, rng)[: plan.v.stop], jnp.zeros(plan.remembered)])
        first, second = np.asarray(written(y)), np.asarray(looped(y))
        np.testing.assert_allclose(second, first, rtol=1e-10, atol=1e-12 * np.max(np.abs(first)))


def test_a_joint_that_slides_along_all_axes_passes_on_no_force():
    mechanism = played()
    y = jnp.asarray(random_state(mechanism, np.random.default_rng(6)))
    kinds = [type(link.joint) for link in factors(mechanism, 0.3, y).links]
    # An ideal pin and a sleeve without axial play pass a force on, and then what carries them does too.
    assert kinds == [Stepwise, Stepwise, Stepwise, Stepwise, type(None), Loose, Loose, Stepwise, Loose]


def test_factors_know_rotors():
    """A joint with a rotor, then one that is elastic in a sleeve: its motor turns the link through a spring."""
    rng = np.random.default_rng(7)
    geared = cj.Revolute("geared", "ground", "a", motion=cj.Motion(rotor_inertia=0.3), axis="y")
    effort = cj.actuators.ConstantEffort(1.0)
    elastic = cj.Revolute(
        "elastic", "a", "b", cj.Position(0.3), motion=cj.Motion(actuators=(effort,)), clearance=sleeve()
    )
    mechanism = cj.Mechanism((body("a", rng), body("b", rng)), (geared, elastic))
    mechanism = cj.with_compliance(mechanism, "elastic", cj.Compliance(1e3, 1.0, 0.2))
    plan = layout(mechanism)
    y = jnp.asarray(random_state(mechanism, rng))
    right = jnp.asarray(rng.normal(size=plan.free))
    rotors = [{"geared": 0.3, "elastic_motor": 0.2}.get(name, 0.0) for name in plan.velocities]
    assert np.count_nonzero(rotors) == 2
    matrix = np.asarray(mass_matrix(mechanism, 0.0, y)) + np.diag(rotors)
    ours = as_array(jax.jit(lambda y: factors(mechanism, 0.0, y).solve([right[i] for i in range(plan.free)]))(y))
    np.testing.assert_allclose(ours, np.linalg.solve(matrix, right), rtol=1e-9)


def test_a_free_motor_without_inertia_is_refused():
    motor = cj.Motion(cj.drives.Harmonic(0.1, 3.0))
    slide = cj.Prismatic("slide", "ground", "a", motion=motor)
    mechanism = cj.with_compliance(cj.Mechanism((cj.Body("a", 1.0, 0.1),), (slide,)), "slide", cj.Compliance(1e3, 1.0))
    freed = mechanism.without_drives(["slide_motor"])
    with refused("slide_motor"):
        cj.simulate(freed, 1e-3)


def test_forces_pass_through_driven_and_fixed_joints():
    """A sleeve takes up all forces only if nothing beyond it passes one on."""
    columns = played().columns
    loose = {name for name, joint in columns.items() if joint.is_loose}
    assert loose == {"socket", "rail", "knuckle"}


def test_work_grows_with_the_number_of_bodies():
    def operations(count):
        mechanism = pins(count)
        plan = layout(mechanism)
        solve = lambda y: factors(mechanism, 0.0, y).solve([y[i] for i in range(plan.free)])  # noqa: E731
        kinematics = lambda y: motion(mechanism, 0.0, y)  # noqa: E731
        return sum(
            sign * len(jax.make_jaxpr(f)(jnp.zeros(plan.size)).eqns) for sign, f in ((1, solve), (-1, kinematics))
        )

    ten, twenty = operations(10), operations(20)
    assert twenty < 2.2 * ten


def test_the_smaller_of_two_ways_is_chosen():
    sleeves, arm = played(), zoo()
    assert sleeves.form.by_blocks
    assert "joint by joint" in str(sleeves.form)
    assert not is_less_by_blocks(columns_of(arm.joints[:3], False).values(), False)
    assert pins(2).form.by_blocks
    assert pins(12).form.loose == 36


def test_a_joint_that_moves_no_inertia_is_refused():
    play = cj.RevoluteClearance(1e-4, 0.01, HERTZ, FRICTION)
    bodies = cj.Body("rim", None, 0.01), cj.Body("bar", 1.0, 0.01)
    joints = (
        cj.Revolute("loose", "ground", "rim", clearance=play),
        cj.Revolute("pin", "rim", "bar", cj.Position(0.1), clearance=play),
    )
    mechanism = cj.Mechanism(bodies, joints)
    assert mechanism.form.by_blocks
    with refused("loose.play_x"):
        cj.simulate(mechanism, 1e-3)


@pytest.mark.parametrize("make", [zoo, played])
def test_both_forms_give_the_same_reactions(make):
    """In every joint, or in those that are asked for."""
    mechanism = make()
    plan, names = layout(mechanism), [joint.name for joint in mechanism.all_joints()]

    def loads(ready, asked=None):
        def of(y):
            ready_now = ready.at(jnp.asarray(0.3))
            found = reactions(ready_now, balance(ready_now, jnp.asarray(0.3), plan.split(y)), asked)
            return {name: as_array((*load.force, *load.moment)) for name, load in found.items()}

        return jax.jit(of)

    y = random_state(mechanism, np.random.default_rng(11))[: plan.v.stop].copy()
    for part in parts(mechanism):  # pins about at their walls: forces of contact hide no others
        y[part.q] *= 1.0 if part.coordinate.play is None else 1e-4
    y = jnp.concatenate([y, jnp.zeros(plan.remembered)])
    written, looped = loads(mechanism.prepare())(y), loads(mechanism.prepare().as_table())(y)
    assert sorted(written) == sorted(looped) == sorted(names)
    largest = max(float(np.max(np.abs(load))) for load in written.values())
    some = loads(mechanism.prepare().as_table(), names[1::3])(y)
    assert sorted(some) == sorted(names[1::3])
    for name in names:
        np.testing.assert_allclose(looped[name], written[name], rtol=1e-9, atol=1e-13 * largest)
        if name in some:
            np.testing.assert_allclose(some[name], looped[name], rtol=1e-9, atol=1e-13 * largest)

"""One attempt: whatever drives it takes the same steps; its program stays small; each half alone."""

from typing import Any, ClassVar

import catalogue
import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax._compile import alike
from clearance_jax._compile.alike import stack_trees
from clearance_jax._compile.barriers import BARRIER
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.dynamics.quantities import observe
from clearance_jax.joints import AbstractClearance, AbstractElement
from clearance_jax.joints.checks import ImplausibleWarning
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.codes import Result, code_of, words
from clearance_jax.solve.flow import Inputs, problem_of
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.steps import events
from clearance_jax.solve.steps.attempt import means_of
from clearance_jax.solve.steps.control import Control, factor, judge, on_grid, scaled_error
from clearance_jax.solve.steps.events import EventJoints, StepCurve, first_of
from clearance_jax.solve.steps.problem import basis
from clearance_jax.solve.steps.step import Trial, _weighted_sum, tableau_of
from clearance_jax.spatial import ZERO, scale


def playful(normal, friction=None, drive=None):
    """A pin that falls and bounces in the sleeve of a driven arm."""
    play = cj.RevoluteClearance(1e-4, 0.01, normal, friction)
    return cj.Mechanism(
        bodies=(cj.Body("arm", 1.0, 0.01, cj.Position(0.1)),),
        joints=(
            cj.Revolute(
                "hip", "ground", "arm", motion=cj.Motion(drive or cj.drives.ConstantSpeed(20.0)), clearance=play
            ),
        ),
        gravity=cj.Gravity(y=-9.81),
    )


CASES = {
    "contact in a loop": (catalogue.slider_crank(), 6e-3),
    "memory of a normal law, breaks of a drive": (
        playful(laws.flores(1e9, 0.6), None, cj.drives.StepSum([0.0, 0.013], [0.013, 0.031], [0.4, -0.3])),
        0.03,
    ),
    "memory of friction": (playful(laws.HuntCrossley(1e9, 0.5), catalogue.FRICTION["lugre"]), 0.01),
    "ideal closures": (catalogue.slider_crank().ideal(), 6e-3),
}


@pytest.mark.parametrize("case", CASES)
def test_diffrax_and_blocks_take_the_same_steps(case):
    mechanism, end = CASES[case]
    times = np.linspace(0, end, 11)
    alone = cj.simulate(mechanism, end, save_at=times, rtol=1e-7)
    blocks = cj.trace(mechanism, end, save_at=11, rtol=1e-7).solution
    assert (int(alone.steps), int(alone.rejected)) == (int(blocks.steps), int(blocks.rejected))
    samples, expected = np.asarray(blocks.y), np.asarray(alone.y)
    scale = np.maximum(np.abs(expected).max(0), 1e-300)
    np.testing.assert_allclose(samples / scale, expected / scale, rtol=0, atol=1e-8)


def count(jaxpr, name: str = "") -> int:
    """Operations of a traced program, of every program inside it too; those of a name alone, if one is given."""
    total = 0
    for equation in jaxpr.eqns:
        inner = [
            part.jaxpr if hasattr(part, "jaxpr") else part
            for value in equation.params.values()
            for part in (value if isinstance(value, tuple | list) else [value])
            if hasattr(part, "jaxpr") or hasattr(part, "eqns")
        ]
        total += sum(count(part, name) for part in inner) if inner else name in ("", equation.primitive.name)
    return total


def operations(mechanism, t1, **options) -> tuple[int, int]:
    """Of a solve: operations of the mechanism's own, and barriers between them."""
    numbers, rest = eqx.partition(mechanism, eqx.is_array)

    def solved(numbers):
        return cj.simulate(eqx.combine(numbers, rest), t1, save_at=201, **options).final

    program = jax.make_jaxpr(solved)(numbers).jaxpr
    barriers = count(program, BARRIER)
    return count(program) - barriers, barriers


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["tsit5", "dopri8"])
def test_programs_stay_small(solver):
    """With samples and energy balance; 10 900 and 43 600 operations before stages, assembly and samples were loops.
    157 of them pack the arguments of the one function into vectors, outside of the loop.
    """
    for scene, t1, most in (("slider_crank.toml", 0.012, 4_100), ("squeezer.toml", 0.03, 12_000)):
        own, barriers = operations(cj.load(SCENES / scene), t1, solver=solver)
        assert own <= most
        assert barriers <= 0.2 * own


def test_slopes_of_long_states_are_added_by_one_operation():
    """Those of short ones one by one: of 24 components and 8 derivatives a compiler took over 10 GB for that."""

    def program(components):
        slopes = jax.ShapeDtypeStruct((13, 9, components), float)
        return jax.make_jaxpr(_weighted_sum)(jnp.ones(13), slopes, 0.0).jaxpr

    assert count(program(24), "reduce_sum") == 1
    assert count(program(8), "reduce_sum") == 0
    assert count(program(24)) < 6 < count(program(8))


def with_a_derivative(m):
    """The problem of a motion and its derivative by one number; its start, tolerances and options."""
    inputs = Inputs(m, jnp.zeros(()), jnp.asarray(0.01), None, jnp.asarray(1e-6), None, None)
    leaves = jax.tree.leaves(inputs.varied, is_leaf=lambda x: x is None)
    first = next(i for i, leaf in enumerate(leaves) if eqx.is_inexact_array(leaf))
    options = Settings(solver=diffrax.Tsit5(), max_steps=100)
    directions = basis(jax.tree.unflatten(
        jax.tree.structure(inputs.varied, is_leaf=lambda x: x is None),
        [leaf if i == first else None for i, leaf in enumerate(leaves)],
    ))  # fmt: skip
    problem, start, allowed, _ = problem_of(inputs, options, directions)
    return problem, start, allowed, options


def test_a_step_of_a_round_off_excuses_the_derivative_of_a_memory():
    """That of a memory begins at a touch. The motion has no excuse, its derivative hardly one, a longer step none."""
    problem, start, allowed, options = with_a_derivative(playful(laws.StandardLinearSolid(1e9, 0.5, 1e-4)))
    means, plan = means_of(options, allowed), layout(problem.mechanism)
    zeros, time = jnp.zeros_like(start), jnp.asarray(1e-3)

    @jax.jit
    def error(length, row, place):
        off = zeros.at[row, place].set(allowed.unit[place])
        trial = Trial(start, start, off, zeros, zeros, zeros)
        return judge(problem, trial, (time, time + length), means, Control.begin(jnp.zeros(()))).error

    brief, longer = 16 * float(jnp.spacing(time)), 1e-9
    assert float(error(brief, 1, plan.v.stop)) < 1 < float(error(longer, 1, plan.v.stop))
    assert float(error(brief, 1, plan.v.start)) > 1
    assert float(error(brief, 0, plan.v.start)) > 1
    assert float(error(brief, 0, plan.v.stop)) > 1


def test_what_a_law_remembers_hides_no_derivative():
    """A bristle's own column, a million times its length, measures the bristle's error, and nothing else's."""
    m = playful(laws.HuntCrossley(1e9, 0.5), catalogue.FRICTION["lugre"])
    problem, start, allowed, options = with_a_derivative(m)
    plan, unit, zeros = layout(problem.mechanism), allowed.unit, jnp.zeros_like(start)
    speed, bristle = plan.v.start, plan.v.stop

    def found(place, column):
        end = zeros.at[1, speed].set(unit[speed]).at[1, bristle].set(column * unit[bristle])
        error = zeros.at[1, place].set(unit[place])
        trial = Trial(zeros, end, error, zeros, zeros, zeros)
        return float(scaled_error(problem, trial, means_of(options, allowed), jnp.zeros(()))[0])

    assert found(speed, 1e6) == found(speed, 0.0) > 1.0
    assert found(bristle, 1e6) < 1e-4 * found(bristle, 0.0)
    assert found(bristle, 0.0) > 1.0


def test_operations_are_counted():
    def inner(x):
        return jnp.sin(x) + 1.0

    def outer(x):
        return jax.lax.fori_loop(0, 3, lambda _, x: jax.jit(inner)(x) * x, x)

    # In the loop: an addition to the counter, sine, addition, product.
    assert count(jax.make_jaxpr(outer)(1.0).jaxpr) == 4


@pytest.mark.parametrize(
    "solver", [diffrax.Tsit5(), diffrax.Dopri5(), diffrax.Dopri8(), diffrax.Bosh3(), diffrax.Heun()]
)
def test_tableaus_end_with_the_end_of_the_step(solver):
    tableau = tableau_of(solver)
    np.testing.assert_allclose(tableau.lower.sum(1), tableau.nodes, atol=1e-13)
    np.testing.assert_allclose(tableau.lower[-1], tableau.weights, atol=1e-15)
    assert tableau.nodes[-1] == 1
    assert abs(tableau.errors.sum()) < 1e-13


@pytest.mark.slow
def test_any_explicit_solver_serves():
    m = catalogue.slider_crank()
    fine = cj.simulate(m, 2e-3, rtol=1e-9)
    for solver in (diffrax.Bosh3(), diffrax.Dopri5()):
        coarse = cj.simulate(m, 2e-3, rtol=1e-6, solver=solver)
        np.testing.assert_allclose(coarse.final[:4], fine.final[:4], rtol=1e-4)


def test_step_sizes():
    accurate, not_accurate = jnp.asarray(True), jnp.asarray(False)
    assert float(factor(jnp.asarray(0.85**5), accurate, 5.0)) == pytest.approx(1.0)
    assert float(factor(jnp.asarray(0.0), accurate, 5.0)) == 3.0
    assert float(factor(jnp.asarray(jnp.inf), not_accurate, 5.0)) == pytest.approx(0.2)
    step = on_grid(jnp.asarray(3e-5))
    assert 3e-5 / 2**0.125 <= float(step) <= 3e-5
    assert float(on_grid(step)) == float(step)


def test_codes_have_words():
    assert words(Result.REACHED_END) == ""
    assert all(words(code) for code in Result if code is not Result.REACHED_END)
    assert int(code_of(diffrax.RESULTS.successful)) == Result.REACHED_END
    assert int(code_of(diffrax.RESULTS.max_steps_reached)) == Result.MAX_STEPS
    assert int(code_of(diffrax.RESULTS.dt_min_reached)) == Result.STEP_COLLAPSED


def straight(start, end):
    """The curve of a pin that goes straight from one place to another in a step of 1 ms."""
    start, end = np.array([*start, 0.0]), np.array([*end, 0.0])
    return StepCurve.of(list(jnp.asarray([start, end - start, *np.zeros((4, 3))])), jnp.asarray(1e-3))


def test_first_switch_of_a_known_motion():
    """The place at which a straight motion touches, by hand."""
    joint = cj.RevoluteClearance(1e-3, 0.01, laws.Hertz(1e9)).prepare()
    begin = jnp.asarray(1e-8)
    first = jax.jit(lambda curve: first_of(EventJoints(joint, curve, ()), begin))
    touch = first(straight((0.0, 0.0), (2e-3, 0.0)))
    assert 0.5 < float(touch) < 0.5 + 1e-7
    assert float(first(straight((0.0, 0.0), (0.9e-3, 0.0)))) == np.inf


def first_by_lane(sizes, joint, poses, begin):
    """The first change of joints of these sizes along poses (powers, numbers, joints, lanes), alone and as lanes."""
    joints, lanes = stack_trees([joint(size).prepare() for size in sizes]), poses.shape[-1]

    def first(poses, h):
        return first_of(EventJoints(joints, StepCurve.of(list(poses), h), ()), jnp.full(h.shape, begin))

    of_lanes = jax.tree.map(lambda x: jnp.broadcast_to(x[..., None], (*x.shape, lanes)), joints)
    curve = StepCurve.of(list(jnp.asarray(poses)), jnp.full(lanes, 1e-3))
    with jax.numpy_rank_promotion("allow"):
        together = jax.jit(first_of)(EventJoints(of_lanes, curve, ()), jnp.full(lanes, begin))
    alone = jax.jit(first)
    return np.array([alone(jnp.asarray(poses[..., i]), jnp.asarray(1e-3)) for i in range(lanes)]), np.array(together)


def a_sleeve(size):
    return cj.SleeveClearance(size, 0.01, 0.04, laws.Hertz(1e9))


def a_pin(size):
    return cj.RevoluteClearance(size, 0.01, laws.Hertz(1e9))


@pytest.mark.parametrize("joint", [a_sleeve, a_pin])
def test_the_first_of_several_joints_is_found_alone_and_by_lane(joint):
    """Pins that go off at once as powers of time, by hand: in each lane others touch, in another order, or none. A lane
    is as it is alone, to the bit, however many joints touch in the others.
    """
    sizes, begin, rng = np.array([1e-3, 2e-3, 0.5e-3]), 1e-8, np.random.default_rng(3)
    touches, powers = rng.uniform(0.05, 1.3, (3, 60)), rng.integers(1, 4, (3, 60))
    touches[:, :3], touches[:, 3] = [[0.6, 0.7, 0.63], [0.63, 0.6, 0.7], [0.7, 0.63, 0.6]], np.inf
    touches[1:, 4], touches[:2, 5] = np.inf, np.inf
    poses = np.zeros((6, 12 if joint is a_sleeve else 3, 3, 60))
    if joint is a_sleeve:
        poses[0, [3, 7, 11]] = 1.0
    for power in (1, 2, 3):
        poses[power, 0] = np.where(powers == power, sizes[:, None] / touches**power, 0.0)
    expected = touches.min(axis=0)
    expected[expected > 1] = np.inf
    alone, lanes = first_by_lane(sizes, joint, poses, begin)
    np.testing.assert_array_equal(lanes, alone)
    np.testing.assert_array_equal(np.isfinite(alone), np.isfinite(expected))
    off = alone[np.isfinite(expected)] - expected[np.isfinite(expected)]
    assert off.min() > -1e-15
    assert off.max() < 2 * begin


@pytest.mark.parametrize("joint", [a_sleeve, a_pin])
def test_the_grazes_of_several_joints_are_those_of_each(joint):
    """One joint grazes before another touches; one that grazes twice (its likelier graze is the later one) does not
    change where another touches, whatever the other lanes do.
    """
    sizes, begin = np.array([1e-3, 2e-3, 1e-3]), 1e-8
    s = np.polynomial.Polynomial([0.0, 1.0])
    once = 2e-3 * (1 + 1e-5) - 6e-3 * (s - 0.55) ** 2
    twice = 1e-3 + 1e-8 + 2.8e-6 * (s - 0.55) - 6e-3 * ((s - 0.55) * (s - 0.9)) ** 2
    touch, nothing = [1e-3 * s / t for t in (0.6, 0.7)], 0 * s
    paths = [[nothing, once, touch[1]], [twice, nothing, touch[0]], [1e-3 * s / 0.65, 2e-3 * s / 0.62, touch[0]]]
    poses = np.zeros((6, 12 if joint is a_sleeve else 3, 3, 3))
    if joint is a_sleeve:
        poses[0, [3, 7, 11]] = 1.0
    for lane, path in enumerate(paths):
        for k, polynomial in enumerate(path):
            poses[: len(polynomial.coef), 0, k, lane] = polynomial.coef
    alone, lanes = first_by_lane(sizes, joint, poses, begin)
    np.testing.assert_array_equal(lanes, alone)
    enters = 0.55 - np.sqrt(2e-8 / 6e-3)
    np.testing.assert_allclose(alone, [enters, 0.6, 0.6], rtol=0, atol=2 * begin)


@pytest.mark.slow
def test_many_alike_joints_move_and_vary_as_if_each_were_alone(monkeypatch):
    """A chain of six pins with friction that remembers: stacked in one program, and written out one by one."""
    count = alike.MANY

    def chain(name):
        play = cj.RevoluteClearance(
            1e-4, 0.01, laws.HuntCrossley(1e9, 0.5), laws.LuGre(0.1, 0.2, 0.01, 1e5, 100.0, 0.0)
        )
        joints = [
            cj.Revolute(f"j{i}", f"b{i - 1}" if i else "ground", f"b{i}", cj.Position(0.2 * (i > 0)), clearance=play)
            for i in range(count)
        ]
        bodies = [cj.Body(joint.child, 1.0, 0.01, cj.Position(0.1)) for joint in joints]
        return cj.Mechanism(tuple(bodies), tuple(joints), gravity=cj.Gravity(y=-9.81), name=name)

    def moved(mechanism):
        def final(clearance):
            return cj.simulate(cj.replace(mechanism, {"j0.radial_clearance": clearance}), 0.015, rtol=1e-8).final

        return jax.jvp(final, (1e-4,), (1e-4,))

    together = moved(chain("together"))
    assert float(jnp.abs(together[1]).max()) > 1e-5
    for module in (alike, events):
        monkeypatch.setattr(module, "MANY", count + 1)
    for here, there in zip(together, moved(chain("apart")), strict=True):
        np.testing.assert_allclose(here, there, rtol=0, atol=1e-6 * float(jnp.abs(there).max()))


@pytest.mark.slow
def test_a_graze_between_two_samples_is_found():
    """A parabola whose top is inside the wall for a thousandth of the step, between two samples."""
    joint = cj.RevoluteClearance(1e-3, 0.01, laws.Hertz(1e9)).prepare()
    c, top, s0 = 1e-3, 1e-3 * (1 + 1e-9), 0.453
    k = 4e-3  # along x: top - k (s - s0)^2
    zero = np.zeros(3)
    rows = [np.array([top - k * s0**2, 0, 0]), np.array([2 * k * s0, 0, 0]), np.array([-k, 0, 0]), zero, zero, zero]
    curve = StepCurve.of(list(jnp.asarray(rows)), jnp.asarray(1e-3))
    first = first_of(EventJoints(joint, curve, ()), jnp.asarray(1e-8))
    enters = s0 - np.sqrt((top - c) / k)
    assert enters <= float(first) <= s0 + 1e-6


class Film(AbstractElement):
    """A linear film: it resists the pin's motion in the sleeve at any distance."""

    damping: jnp.ndarray

    def wrench(self, at, geometry):
        return scale(-self.damping, at.velocity), ZERO


def test_an_element_acts_without_touch():
    """A pin in a film, far from the sleeve: v = v0 exp(-b t / m), and its loss is counted."""
    with pytest.warns(ImplausibleWarning, match="as large as the pin's radius 10 mm. Check its unit"):
        play = cj.RevoluteClearance(1e-2, 0.01, laws.Hertz(1e9), None, Film(jnp.asarray(3.0)))
    m = cj.Mechanism(
        bodies=(cj.Body("pin", 0.5),),
        joints=(cj.Revolute("j", "ground", "pin", motion=cj.Motion(cj.drives.ConstantSpeed(0.0)), clearance=play),),
    )
    s = cj.simulate(m, 0.3, y0=jnp.array([0.0, 0.0, 0.02, 0.01]), rtol=1e-9)
    decay = np.exp(-3.0 * 0.3 / 0.5)
    np.testing.assert_allclose(s.final[2:4], decay * np.array([0.02, 0.01]), rtol=1e-8)
    np.testing.assert_allclose(s.final[5], 0.25 * (1 - decay**2) * (0.02**2 + 0.01**2), rtol=1e-7)
    assert float(s.energy_residual) < 1e-8


class Twin(AbstractClearance):
    """A joint kind of its own: a pin that two rims side by side hold, each with contact laws of its own."""

    radial_clearance: jnp.ndarray
    pin_radius: jnp.ndarray
    normal: Any = None
    friction: Any = None
    element: Any = None
    count: ClassVar[int] = 2
    tangents: ClassVar[int] = 1

    def single(self):
        return cj.RevoluteClearance(self.radial_clearance, self.pin_radius, self.normal, self.friction)

    def play(self):
        return self.single().play()

    def geometry(self):
        return self.single().geometry()

    def points(self, at):
        return jax.tree.map(lambda x: jnp.stack([jnp.asarray(x, float)] * 2), self.single().points(at))

    def travel(self, along):
        return self.radial_clearance


@pytest.mark.slow
def test_a_joint_kind_of_its_own_and_laws_mapped_over_its_points():
    """Two rims of half the stiffness are one rim; with memory at each point, in the tree and closing a loop."""
    law, half = (laws.flores(k, 0.6) for k in (2e9, 1e9))
    friction = catalogue.FRICTION["lugre"]
    one = cj.RevoluteClearance(1e-4, 0.01, law, friction)
    twin: Any = Twin
    two = twin(jnp.asarray(1e-4), jnp.asarray(0.01), half, friction)
    assert two.remembers == tuple(f"{name}_{i}" for i in (1, 2) for name in one.remembers)
    m = playful(law)
    ends = [cj.simulate(m.with_clearance("hip", c), 0.006, rtol=1e-8) for c in (one, two)]
    np.testing.assert_allclose(ends[1].final[:4], ends[0].final[:4], rtol=1e-6)
    assert float(ends[1].energy_residual) < 1e-7
    m = catalogue.slider_crank()
    ends = [cj.simulate(m.with_clearance("wrist", c), 2e-3, rtol=1e-8).final[:4] for c in (one, two)]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-6)


def test_of_several_points_the_joints_force_and_the_deepest_are_reported():
    law = laws.Hertz(1e9)
    twin: Any = Twin
    m = playful(law).with_clearance("hip", twin(jnp.asarray(1e-4), jnp.asarray(0.01), law)).prepare()
    pressed = jnp.zeros(4).at[1].set(-1.01e-4)
    seen = observe(jnp.zeros(()), pressed, m)
    assert float(seen["contact_force"][0]) == pytest.approx(2 * 1e9 * 1e-6**1.5)
    assert float(seen["penetration"][0]) == pytest.approx(1e-6)
    (joint,) = m.clearance_joints()
    action = joint.clearance.act(relative_motions(jnp.zeros(()), pressed, m)[0], ())
    first = action.points._replace(
        penetration=action.points.penetration.at[0].set(5e-7), slip=(action.points.slip[0].at[0].set(7.0),)
    )
    deepest = action._replace(points=first).deepest
    assert float(deepest.penetration) == pytest.approx(1e-6)
    assert float(deepest.slip[0]) == float(action.points.slip[0][1]) < 1.0

"""Derivatives in reverse mode: the controlled ones, by any number of numbers and through all that a solve has."""

from typing import Any, ClassVar

import catalogue
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES, refused
from test_many_numbers import HEIGHTS, Table

import clearance_jax as cj
from clearance_jax.ask.question import Question, answer
from clearance_jax.laws._friction import along_slip
from clearance_jax.solve.drivers import tape
from clearance_jax.solve.settings import settings_of
from experiments.learning import scenes

MODES = ("adjoint", "controlled")
METRICS = {
    "peak": cj.metrics.Peak(cj.metrics.PositionError("piston")),
    "mean": cj.metrics.Mean(cj.metrics.ContactForce("wrist")),
    "at": cj.metrics.At(cj.metrics.Quantity("piston.velocity.x"), (1e-3, 2e-3)),
}


def remembering(crank):
    """A crank whose laws of both kinds remember."""
    wrist, law = crank.joint("wrist"), cj.laws.exact_restitution(stiffness=1e9, restitution=0.6)
    return crank.with_joint(
        eqx.tree_at(lambda j: (j.clearance.normal, j.clearance.friction), wrist, (law, catalogue.FRICTION["dahl"]))
    )


@pytest.mark.parametrize("made", [lambda m: m, remembering])
def test_metrics_of_all_kinds_have_the_controlled_derivatives(made):
    crank = made(cj.load(SCENES / "slider_crank.toml"))
    names = ["wrist.radial_clearance", "conrod.mass", "drive.main.speed"]

    def solved(mode):
        settings = settings_of(crank, 3e-3, {"rtol": 1e-8, "derivatives": mode})
        return answer(Question(crank, METRICS, 3e-3, settings, names))

    right, found = solved("controlled"), solved("adjoint")
    sizes = np.array([float(cj.parameters(crank)[name].value) for name in names])
    for name in METRICS:
        np.testing.assert_allclose(found.values[name], right.values[name], rtol=1e-6)
        one, two = (np.asarray(x.slopes[name]) * sizes for x in (found, right))
        assert np.max(np.abs(two)) > 0
        # A peak's place has an error of its own, in both modes.
        np.testing.assert_allclose(one, two, atol=(3e-5 if name == "peak" else 1e-6) * np.max(np.abs(two)))


def test_metrics_without_derivatives_and_poses_beside_the_adjoint():
    """Whole numbers stand beside what is differentiated; poses have their own derivatives."""
    crank, names = cj.load(SCENES / "slider_crank.toml"), ("conrod.mass",)
    settings = settings_of(crank, 2e-3, {"rtol": 1e-7, "derivatives": "adjoint"})
    several = {"touches": cj.metrics.Impacts("wrist"), "at": METRICS["at"]}
    found = answer(Question(crank, several, 2e-3, settings, names, ("at",)))
    alone = answer(Question(crank, {"at": METRICS["at"]}, 2e-3, settings, names))
    assert int(found.values["touches"]) > 0
    np.testing.assert_allclose(found.slopes["at"], alone.slopes["at"], rtol=1e-9)
    poses = [
        cj.sensitivities(crank, METRICS["at"], names, 2e-3, mode=mode, fidelity="quasi-static").matrix()
        for mode in MODES
    ]
    np.testing.assert_array_equal(*poses)


def test_numbers_arrays_states_and_times_alone_and_in_a_batch():
    bar = cj.load(SCENES / "four_bar.toml")
    start = cj.simulate(bar, 1e-5).initial

    def number(mode, speed, y0, t1, times):
        moved = cj.replace(bar, {"drive.main.speed": speed})
        solution = cj.simulate(moved, t1, save_at=times, y0=y0, rtol=1e-8, derivatives=mode, solver="dopri8")
        weights = jnp.arange(1.0, 4.0)
        return jnp.sum(weights * solution["tip.velocity.y"]) + solution.final[0] + 10 * jnp.sum(solution.time)

    given = (jnp.asarray(60.0), start, jnp.asarray(4e-3), jnp.asarray([1e-3, 2e-3, 4e-3]))
    ones = [jax.jit(jax.grad(lambda *x, mode=mode: number(mode, *x), (0, 1, 2, 3)))(*given) for mode in MODES]
    for one, two in zip(*ones, strict=True):
        assert np.max(np.abs(two)) > 0
        np.testing.assert_allclose(one, two, atol=1e-5 * np.max(np.abs(two)))
    speeds = jnp.asarray([60.0, 55.0])
    batch = jax.jit(jax.vmap(jax.grad(lambda x: number("adjoint", x, *given[1:]))))(speeds)
    # With fewer numbers the random direction, and so the steps, are others.
    assert float(batch[0]) == pytest.approx(float(ones[0][0]), rel=1e-5)
    assert abs(float(batch[1] - batch[0])) > 1e-3 * abs(float(batch[0]))


def test_the_count_of_numbers_chooses():
    """One of the other two, to a round-off, by the entries of what is differentiated."""

    def place(heights, mode):
        return cj.simulate(rough_arm(heights), 0.02, rtol=1e-6, derivatives=mode)["tip.position.x"]

    many = jnp.interp(jnp.linspace(0, 1, 24), jnp.linspace(0, 1, len(HEIGHTS)), jnp.asarray(HEIGHTS))
    for heights, chosen in ((jnp.asarray(HEIGHTS)[:4], "controlled"), (many, "adjoint")):
        ones = {mode: jax.jit(jax.grad(place), static_argnums=1)(heights, mode) for mode in ("auto", *MODES)}
        assert np.max(np.abs(ones["controlled"] - ones["adjoint"])) > 0
        np.testing.assert_allclose(ones["auto"], ones[chosen], rtol=1e-13)
    arm = rough_arm(many)
    (name,) = (name for name in cj.parameters(arm) if name.endswith("heights"))
    for times, chosen in (((1e-3, 2e-3), "controlled"), ((1e-3,), "adjoint")):
        metric = cj.metrics.At(cj.metrics.Quantity("tip.position.x"), times)
        question = Question(arm, {"": metric}, 2e-3, settings_of(arm, 2e-3, {"derivatives": "auto"}), (name,))
        assert question.chosen().settings.derivatives == chosen


def test_a_break_that_moves_is_differentiated_forwards():
    """The slope jumps there: a drive that begins to turn later."""
    drive = cj.drives.Quintic([0.0, 0.02, 0.05], [0.0, 0.0, 0.4])
    play = cj.RevoluteClearance(1e-4, 0.01, catalogue.NORMAL["hunt-crossley"])
    arm = cj.Mechanism(
        (cj.Body("arm", 1.0, 0.01, cj.Position(0.1)),),
        (cj.Revolute("hip", "ground", "arm", motion=cj.Motion(drive), clearance=play),),
        gravity=cj.Gravity(y=-9.81),
    )
    name = next(name for name in cj.parameters(arm) if "times" in name)

    def place(times, mode):
        return cj.simulate(cj.replace(arm, {name: times}), 0.06, rtol=1e-7, derivatives=mode).final[0]

    times = cj.parameters(arm)[name].value
    ones = [jax.grad(place)(times, mode) for mode in MODES]
    assert np.max(np.abs(ones[1])) > 0
    np.testing.assert_allclose(*ones, rtol=1e-9)


def test_a_law_that_jumps_is_refused():
    crank = cj.load(SCENES / "slider_crank.toml")
    law: Any = catalogue.NORMAL["kelvin-voigt"]
    crank = crank.with_joint(eqx.tree_at(lambda j: j.clearance.normal, crank.joint("wrist"), law))
    with refused("wrist"):
        jax.grad(lambda m: cj.simulate(cj.replace(crank, {"conrod.mass": m}), 1e-3, derivatives="adjoint").final[0])(
            0.2
        )


def rough_arm(heights):
    arm = cj.load(SCENES / "arm.toml")
    name, law = arm.clearance_joints()[0].name, Table
    joint = eqx.tree_at(
        lambda j: j.clearance.friction,
        arm.joint(name),
        law(heights, jnp.asarray(0.04)),  # pyright: ignore[reportCallIssue]
        is_leaf=lambda x: x is None,
    )
    return arm.with_joint(joint)


def test_motions_of_more_steps_than_are_kept(monkeypatch):
    """Between the states that are kept steps are made again; a motion of more steps than have room is none."""

    def place(heights, mode, t1=0.02):
        options = {"rtol": 1e-8, "derivatives": mode, "throw": False, "save_at": None if t1 == 0.02 else 2}
        return jnp.ravel(cj.simulate(rough_arm(heights), t1, **options)["tip.position.x"])[-1]

    monkeypatch.setattr(tape, "TIMES", 2048)
    monkeypatch.setattr(tape, "STATES", 16)
    heights = jnp.asarray(HEIGHTS)
    steps = int(cj.simulate(rough_arm(heights), 0.02, rtol=1e-8).steps)
    assert 64 < steps < 1024
    one, two = (jax.grad(place)(heights, mode) for mode in MODES)
    assert np.max(np.abs(two)) > 1e-9
    np.testing.assert_allclose(one, two, atol=1e-5 * np.max(np.abs(two)))
    monkeypatch.setattr(tape, "TIMES", 64)
    far = jax.grad(lambda heights: place(heights, "adjoint", 0.0201))(heights)
    assert np.all(np.isnan(far))


def test_long_motions_keep_their_states_as_they_were():
    """A step that begins just past an event, where the slope of the force jumps, must not begin just before it when it
    is made again. Of more than 4096 steps all states were made anew once, from the start: round-off grows through the
    impacts, and these derivatives were off by 6e-7.
    """
    crank, values, t1 = scenes.variant("slider_crank", 0)

    def slopes(mode, rtol):
        options: Any = {"mode": mode, "rtol": rtol, "solver": "dopri8"}
        found = cj.sensitivities(crank, scenes.ends("piston"), list(values), t1, **options)
        return np.stack([np.asarray(found.jacobian[name])[0] * value for name, value in values.items()]), found.error

    assert int(cj.simulate(crank, t1, rtol=1e-9, solver="dopri8").steps) > 2048
    known, _ = slopes("controlled", 1e-11)
    # What is known is itself off by 1e-8; at the first tolerance the truth is 5e-8 to 6e-8 away.
    for rtol, most in ((1e-8, 7e-8), (1e-9, 5e-8), (1e-12, 5e-8)):
        found, error = slopes("adjoint", rtol)
        assert np.max(np.abs(found - known)) <= most * np.max(np.abs(known))
        assert error is not None
        assert all(np.all(np.isfinite(each)) for each in error.values())


class Learned(cj.laws.AbstractFrictionLaw):
    """A coefficient of friction by a network of the slip."""

    net: eqx.nn.MLP
    smoothness: ClassVar = "C2"

    def traction(self, constants, slip, normal_force, memory):
        def profile(v):
            learned = self.net(jnp.stack([v / 10, jnp.tanh(v / 0.5)]))
            return -normal_force * jnp.tanh(v / 0.1) * (0.03 + 0.01 * jnp.tanh(learned))

        return along_slip(profile, slip)

    def event_functions(self, constants, slip, normal_force, memory):
        return ()


def learned_crank():
    law: Any = Learned
    net = eqx.nn.MLP(2, "scalar", 6, 2, activation=jnp.tanh, key=jax.random.key(0))
    crank = cj.load(SCENES / "slider_crank.toml")
    return crank.with_joint(eqx.tree_at(lambda j: j.clearance.friction, crank.joint("wrist"), law(net)))


def test_a_network_in_a_law_is_trained_by_the_adjoint_and_its_error_is_stated():
    crank = learned_crank()
    names = [name for name in cj.parameters(crank) if ".net." in name]
    assert [name.removeprefix("wrist.friction.net.layers.") for name in names[:2]] == ["0.weight", "0.bias"]
    found = cj.sensitivities(crank, METRICS["at"], names, 3e-3, rtol=1e-6)
    assert found.error is not None  # 67 weights and 2 values: "auto" chose it
    right = cj.sensitivities(crank, METRICS["at"], names, 3e-3, rtol=1e-10, mode="controlled")
    assert right.error is None
    size = max(float(np.max(np.abs(right.jacobian[name]))) for name in names)
    for name in names:
        off = np.max(np.abs(found.jacobian[name] - right.jacobian[name]), tuple(range(1, found.jacobian[name].ndim)))
        assert np.all(off <= np.asarray(found.error[name]) + 1e-6 * size)
        assert np.max(off) < 3e-4 * size


def test_arrays_of_other_peoples_classes_are_numbers():
    crank, name = learned_crank(), "wrist.friction.net.layers.0.bias"
    place = jax.jit(lambda bias: cj.simulate(cj.replace(crank, {name: bias}), 2e-3, rtol=1e-7)["piston.position.x"])
    shifts = jnp.stack([jnp.zeros(6), 0.5 * jnp.ones(6)])
    np.testing.assert_allclose(jax.jit(jax.vmap(place))(shifts), [place(shift) for shift in shifts], rtol=1e-9)
    assert cj.parameters(crank)[name].unit == ""
    with refused(name, "(5,)"):
        cj.replace(crank, {name: jnp.zeros(5)})

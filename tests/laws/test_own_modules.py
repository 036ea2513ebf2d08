"""Parts that a user writes: what is wrong with them is said in a sentence, and modules of equinox stand in them."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax.joints import AbstractClearance
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, HuntCrossley, TanhCoulomb
from clearance_jax.mechanism.controllers import AbstractController
from clearance_jax.mechanism.motion.motion_laws import AbstractDrive
from clearance_jax.solve.simulate import EnergyWarning

END = 0.01


class Rim(AbstractClearance):
    """A joint kind of which only the fields matter; one is of any type, and still what the base class says."""

    tangents: ClassVar[int] = 1
    normal: Any = None
    friction: AbstractFrictionLaw | None = None
    element: Any = None
    others: tuple[AbstractNormalLaw, ...] = ()

    def play(self):
        return ()

    def geometry(self):
        raise NotImplementedError

    def points(self, at):
        raise NotImplementedError

    def travel(self, along):
        raise NotImplementedError


@pytest.mark.quick
def test_a_part_of_another_class_is_refused():
    law, friction = HuntCrossley(1e9, 1.0), TanhCoulomb(0.1, 0.01)
    assert Rim(law, friction, others=(law, law)).friction is friction
    for wrong in ({"normal": friction}, {"friction": law}, {"friction": 0.1}, {"others": (law, friction)}):
        with refused(next(iter(wrong))):
            Rim(**{"normal": law, **wrong})
    with refused("normal") as caught:
        Rim(HuntCrossley)
    assert "Give it its numbers: `HuntCrossley(...)`." in str(caught.value)


def crank_with(friction):
    crank = cj.load(SCENES / "slider_crank.toml")
    wrist = crank.joint("wrist")
    return crank.with_joint(eqx.tree_at(lambda j: j.clearance.friction, wrist, friction, is_leaf=lambda x: x is None))


class ToldTraction(AbstractFrictionLaw):
    """A law whose traction is what a function of slip and normal force tells."""

    function: Any = eqx.field(static=True)
    smoothness: ClassVar = "C2"

    def traction(self, constants, slip, normal_force, memory):
        return self.function(slip, normal_force)


# A type checker does not see that equinox makes dataclasses of these.
told: Any = ToldTraction


@pytest.mark.parametrize("function", [lambda slip, n: -0.1 * n, lambda slip, n: None, lambda slip, n: (0 * n, 0 * n)])
def test_a_traction_is_as_long_as_the_slip(function):
    with refused("traction"):
        cj.simulate(crank_with(told(function)), 1e-4)


def test_a_law_that_gives_energy_is_named():
    """Friction along the slip instead of against it."""

    def sign(slip, n, factor):
        return tuple(factor * 0.05 * n * jnp.tanh(v / 0.1) for v in slip)

    with pytest.warns(EnergyWarning, match="Contact laws of `wrist` have given"):
        cj.simulate(crank_with(told(lambda slip, n: sign(slip, n, 1.0))), 3e-3, rtol=1e-6)
    cj.simulate(crank_with(told(lambda slip, n: sign(slip, n, -1.0))), 3e-3, rtol=1e-6)
    # Metrics too keep the books for such a law, and for no law of the library.
    asked = {"end": lambda solution: solution["piston.position.x"]}
    with pytest.warns(EnergyWarning) as warned:
        cj.measure(crank_with(told(lambda slip, n: sign(slip, n, 1.0))), asked, 3e-3, rtol=1e-6)
    assert "`wrist` have given" in str(warned[0].message)
    given = {"balance": lambda solution: jnp.asarray(solution.energy_balance)}
    assert cj.measure(crank_with(told(lambda slip, n: sign(slip, n, -1.0))), given, 3e-3)["balance"]
    assert not cj.measure(crank_with(cj.laws.TanhCoulomb(0.1, 0.01)), given, 3e-3)["balance"]


class LearnedDrive(AbstractDrive):
    """An angle by a network of time."""

    net: eqx.nn.MLP

    def __call__(self, time):
        def rate(t):
            return jax.jvp(lambda t: 0.05 * self.net(jnp.stack([50 * t])), (t,), (jnp.ones_like(t),))

        (q, v), (_, a) = jax.jvp(rate, (time,), (jnp.ones_like(time),))
        return q, v, a


class LearnedControl(AbstractController):
    """Accelerations that lead to the targets, with a correction by a network."""

    name: str = eqx.field(static=True)
    references: tuple[cj.controllers.Reference, ...]
    net: eqx.nn.MLP
    model: Any = None
    period: float | None = eqx.field(static=True, default=None)

    def accelerations(self, time, positions, velocities):
        wanted = []
        for reference, q, v in zip(self.references, positions, velocities, strict=True):
            goal, rate, acceleration = reference.target(time)
            wanted.append(acceleration + 2500 * (goal - q) + 100 * (rate - v) + self.net(jnp.stack([q])))
        return wanted


learned_control: Any = LearnedControl


class LearnedWear(cj.wear.AbstractWearLaw):
    """Archard's law with a coefficient by a network of the pressure."""

    net: eqx.nn.MLP

    def rate(self, at):
        factor = jnp.exp(jnp.vectorize(lambda p: self.net(jnp.stack([1e-8 * p])))(at.pressure))
        return 6e-14 * factor * at.pressure * at.speed


def network(key=0):
    return eqx.nn.MLP(1, "scalar", 8, 1, activation=jnp.tanh, key=jax.random.key(key))


def arm(motion, controllers=()):
    play = cj.RevoluteClearance(1e-4, 0.01, HuntCrossley(1e9, 1.0), length=0.02)
    return cj.Mechanism(
        (cj.Body("arm", 1.0, 0.01, cj.Position(0.1)),),
        (cj.Revolute("hip", "ground", "arm", motion=motion, clearance=play),),
        points=(cj.Point("tip", "arm", cj.Position(0.2)),),
        gravity=cj.Gravity(y=-9.81),
        controllers=controllers,
    )


def driven():
    return arm(cj.Motion(LearnedDrive(network())))


def controlled():
    goal = cj.controllers.Reference("hip", cj.drives.Harmonic(0.3, 20.0))
    return arm(cj.Motion(), (learned_control("control", (goal,), network()),))


@pytest.mark.parametrize("made", [driven, controlled])
def test_a_network_in_a_drive_and_in_a_controller(made):
    """Names, both modes, another set of weights."""
    mechanism, height = made(), cj.metrics.At(cj.metrics.Quantity("tip.position.y"), (END,))
    weights = [name for name in cj.parameters(mechanism) if ".net." in name]
    assert len(weights) == 4
    one, two = (
        cj.sensitivities(mechanism, height, weights, END, rtol=1e-8, mode=mode) for mode in ("adjoint", "controlled")
    )
    assert float(jnp.max(jnp.abs(two.matrix()))) > 0
    np.testing.assert_allclose(one.matrix(), two.matrix(), atol=1e-6 * float(jnp.max(jnp.abs(two.matrix()))))
    name, step = weights[0], 1e-4
    kept = cj.parameters(mechanism)[name].value
    up, down = (
        height(cj.replace(mechanism, {name: kept + s * step * jnp.ones_like(kept)}), END, rtol=1e-10) for s in (1, -1)
    )
    np.testing.assert_allclose(jnp.sum(two.jacobian[name]), jnp.sum(up - down) / (2 * step), rtol=1e-4)


@pytest.mark.slow
def test_a_network_in_datasets_poses_traces_and_wear():
    """What is compiled for arrays alone stands beside functions that are leaves of a network."""
    mechanism = driven()
    solved = cj.simulate(mechanism, END, rtol=1e-8, save_at=11)
    seen = cj.to_dataset(mechanism, solved)
    np.testing.assert_allclose(seen["position"].sel(point="tip", axis="y"), solved["tip.position.y"], rtol=1e-12)
    posed = cj.simulate(mechanism, END, fidelity="quasi-static", save_at=11)
    hip: Any = mechanism.joint("hip")
    angle = [float(hip.motion.drive(jnp.asarray(t))[0]) for t in np.linspace(0, END, 11)]
    np.testing.assert_allclose(posed["hip.position"], angle, rtol=1e-9)
    trace = cj.trace(mechanism, END, rtol=1e-8, start="settled")
    learned, plain = (
        float(cj.wear.wear(trace, "hip", law, cj.wear.Foundation(2e13)).volume)
        for law in (LearnedWear(network()), cj.wear.Archard(6e-14))
    )
    # The network is near one number at pressures far below its scale.
    factor = float(jnp.exp(network()(jnp.zeros(1))))
    assert abs(factor - 1) > 0.05
    assert learned / plain == pytest.approx(factor, rel=0.02)
    assert cj.mobility(mechanism).freedom == 2


def test_sensitivities_inside_programs_and_what_has_no_derivative():
    crank, names = cj.load(SCENES / "slider_crank.toml"), ("conrod.mass",)
    height = cj.metrics.At(cj.metrics.Quantity("piston.position.x"), (1e-3,))

    def slopes(clearance) -> Array:
        moved = cj.replace(crank, {"wrist.radial_clearance": clearance})
        return cj.sensitivities(moved, height, names, 1e-3, rtol=1e-7).matrix()

    several = jnp.asarray([4e-4, 5e-4])
    each = jax.jit(jax.vmap(slopes))(several)
    np.testing.assert_allclose(each, np.stack([slopes(x) for x in several]), rtol=1e-6)
    assert np.all(each != 0)

    def exchanged(clearance):
        return cj.simulate(cj.replace(crank, {"wrist.radial_clearance": clearance}), 1e-3)["exchanged"]

    with refused("exchanged"):
        jax.grad(exchanged)(5e-4)


@pytest.mark.slow
def test_an_exported_program_takes_any_number_of_lanes():
    crank = cj.load(SCENES / "slider_crank.toml")
    end = jax.jit(
        jax.vmap(lambda c: cj.simulate(cj.replace(crank, {"wrist.radial_clearance": c}), 5e-4, rtol=1e-6).final)
    )
    (lanes,) = jax.export.symbolic_shape("lanes")
    exported = jax.export.export(end)(jax.ShapeDtypeStruct((lanes,), jnp.float64))
    for count in (1, 70):
        clearances = jnp.linspace(4e-4, 5e-4, count)
        np.testing.assert_allclose(exported.call(clearances), end(clearances), rtol=1e-9)


@pytest.mark.quick
def test_a_mechanism_with_a_network_is_saved_and_read(tmp_path):
    def made(net):
        return arm(cj.Motion(LearnedDrive(net)))

    saved, other = made(network(0)), made(network(1))
    assert not eqx.tree_equal(saved, other)
    np.savez(tmp_path / "numbers.npz", **{name: leaf.value for name, leaf in cj.parameters(saved).items()})
    numbers = dict(np.load(tmp_path / "numbers.npz"))
    assert eqx.tree_equal(cj.replace(other, numbers), saved)
    with refused("drive.hip.net.layers.0.weight"):
        cj.replace(made(eqx.nn.MLP(1, "scalar", 4, 1, key=jax.random.key(1))), numbers)
    eqx.tree_serialise_leaves(tmp_path / "mechanism.eqx", saved)
    assert eqx.tree_equal(eqx.tree_deserialise_leaves(tmp_path / "mechanism.eqx", other), saved)


class Heights(LearnedWear):
    """A law with an array of numbers."""

    net: Any = None
    heights: Array = eqx.field(default_factory=lambda: jnp.zeros(0))


@pytest.mark.quick
def test_a_part_prints_its_numbers():
    law = HuntCrossley(2e9, 1.5)
    assert repr(law) == "HuntCrossley(stiffness=2000000000.0, damping_factor=1.5)"
    assert "heights=[0.0, 0.5, 1.0]" in repr(Heights(heights=jnp.linspace(0, 1, 3)))
    assert "heights=f64[9]" in repr(Heights(heights=jnp.zeros(9)))
    traced = []
    jax.eval_shape(lambda k: traced.append(repr(HuntCrossley(k, 1.0))), 1.0)
    assert traced == ["HuntCrossley(stiffness=f64[], damping_factor=f64[])"]

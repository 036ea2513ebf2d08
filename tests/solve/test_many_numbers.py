"""Derivatives by the entries of an array, which directions move one by one: the weights of a law, say."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from places import SCENES

import clearance_jax as cj
from clearance_jax.laws._friction import along_slip
from clearance_jax.solve.steps.problem import Unchanged, basis, sparsity

COUNT, END = 12, 0.03


class Table(cj.laws.AbstractFrictionLaw):
    """A coefficient of friction by bumps of the slip, of which each has its height."""

    heights: Array
    width: Array
    smoothness: ClassVar = "C2"

    def traction(self, constants, slip, normal_force, memory):
        at = jnp.linspace(-0.2, 0.2, self.heights.size)

        def profile(v):
            coefficient = jnp.sum(self.heights * jnp.exp(-(((v - at) / self.width) ** 2)))
            return -normal_force * jnp.tanh(v / 0.01) * coefficient

        return along_slip(profile, slip)

    def event_functions(self, constants, slip, normal_force, memory):
        return ()


@pytest.fixture(scope="module")
def place():
    """The place of the tip by the heights, the width, and the mass."""
    arm = cj.load(SCENES / "arm.toml")
    name = arm.clearance_joints()[0].name

    def put(heights, width, mass):
        joint = arm.joint(name)
        law: Any = Table
        rough = eqx.tree_at(lambda j: j.clearance.friction, joint, law(heights, width), is_leaf=lambda x: x is None)
        made = cj.replace(arm.with_joint(rough), {f"{arm.bodies[0].name}.mass": mass})
        return cj.simulate(made, END, rtol=1e-8)["tip.position.x"]

    return put


HEIGHTS = 0.1 + 0.02 * np.sin(np.arange(COUNT))
NUMBERS = (jnp.asarray(HEIGHTS), jnp.asarray(0.04), jnp.asarray(1.0))


def test_each_entry_has_its_derivative(place):
    found = jax.jit(jax.grad(place, (0, 1, 2)))(*NUMBERS)
    value = jax.jit(place)
    assert np.max(np.abs(found[0])) > 1e-6
    rng = np.random.default_rng(0)
    for _ in range(3):
        along = [jnp.asarray(x * rng.uniform(-1, 1, np.shape(x))) for x in NUMBERS]
        ends = [float(value(*(x + sign * 1e-3 * d for x, d in zip(NUMBERS, along, strict=True)))) for sign in (1, -1)]
        slope = sum(float(jnp.sum(g * d)) for g, d in zip(found, along, strict=True))
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=1e-5, abs=1e-9)
    # One number at a time, each by itself: nothing is moved entry by entry there.
    for k in (0, 7):
        one = jax.jit(jax.grad(lambda x, k=k: place(NUMBERS[0].at[k].set(x), *NUMBERS[1:])))(NUMBERS[0][k])
        assert float(found[0][k]) == pytest.approx(float(one), rel=1e-6, abs=1e-10)


def test_a_batch_has_the_same_derivatives(place):
    heights = jnp.stack([NUMBERS[0], 1.2 * NUMBERS[0], 0.5 * NUMBERS[0]])
    slopes = jax.jit(jax.vmap(jax.grad(place, (0, 2)), (0, None, None)))(heights, *NUMBERS[1:])
    one = jax.jit(jax.grad(place, (0, 2)))
    for k in range(3):
        alone = one(heights[k], *NUMBERS[1:])
        np.testing.assert_allclose(slopes[0][k], alone[0], rtol=1e-6, atol=1e-10)
        np.testing.assert_allclose(slopes[1][k], alone[1], rtol=1e-6)


def test_what_moves_entry_by_entry_is_known():
    directions = basis({"a": jnp.zeros(3), "b": jnp.zeros((4, 5)), "c": jnp.zeros(())})
    own = [Unchanged((i,)) for i in range(3)]
    assert sparsity(own, directions) == ((0, 1, 2), range(3, 23), (23,))
    # A function of a number, and of two, may be moved by every direction of these.
    assert sparsity([frozenset((1,)), frozenset((0, 2))], directions) == (tuple(range(3, 23)), (0, 1, 2, 23))
    # Directions that are no unit ones, or not known when the program is made.
    moved = dict(directions, b=2.0 * directions["b"])
    assert sparsity(own[1:2], moved) == (tuple(range(3, 23)),)


VIA = np.linspace(0.0, END, 12)
DRIVES = {
    "quintic": cj.drives.Quintic,
    "spline": cj.drives.Spline,
    "table": lambda times, values: cj.drives.Quintic(times, values, jnp.gradient(values, times)),
}


@pytest.mark.parametrize("kind", DRIVES)
def test_via_points_have_their_derivatives(kind):
    """A step sees the pieces beside it only, of which the derivatives by all points are made."""
    arm = cj.load(SCENES / "arm.toml")

    def place(values):
        moved = arm.with_drives({"hip": DRIVES[kind](VIA, values)})
        return cj.simulate(moved, END, save_at=(0.5 * END, END), rtol=1e-9)["tip.position.x"]

    values, value = jnp.asarray(0.2 * np.sin(VIA / END * 3)), jax.jit(place)
    slopes = jax.jit(jax.jacfwd(place))(values)
    assert np.max(np.abs(slopes)) > 0.01
    rng = np.random.default_rng(1)
    for _ in range(2):
        d = rng.normal(size=len(VIA))
        ends = [value(values + step * d) for step in (2e-7, -2e-7)]
        np.testing.assert_allclose(slopes @ d, (ends[0] - ends[1]) / 4e-7, rtol=2e-6, atol=1e-8)


def test_samples_of_many_derivatives_leave_a_solve_one_function():
    """A long product of matrices among them would be a library's, for which the loop is cut in pieces."""
    arm = cj.load(SCENES / "arm.toml")
    law: Any = Table
    joint = arm.joint(arm.clearance_joints()[0].name)

    def place(heights):
        rough = eqx.tree_at(lambda j: j.clearance.friction, joint, law(heights, 0.04), is_leaf=lambda x: x is None)
        return cj.simulate(arm.with_joint(rough), END, save_at=(0.5 * END, END))["tip.position.x"][0]

    text = jax.jit(jax.grad(place)).lower(jnp.ones(150)).as_text()
    assert 'xla_cpu_small_call = "true"' in text
    assert 'xla_cpu_small_call = "false"' not in text


def test_sensitivities_by_many_numbers_are_the_same_in_every_mode():
    arm = cj.load(SCENES / "arm.toml")
    law: Any = Table
    joint, heights = arm.joint(arm.clearance_joints()[0].name), jnp.linspace(0.08, 0.12, 40)
    rough = arm.with_joint(
        eqx.tree_at(lambda j: j.clearance.friction, joint, law(heights, 0.04), is_leaf=lambda x: x is None)
    )
    (name,) = (n for n, leaf in cj.parameters(rough).items() if np.size(leaf.value) == 40)

    def end(solution):
        return jnp.stack([solution["tip.position.x"], solution["tip.position.y"]])

    modes = ("controlled", "adjoint", "screening")
    found = {mode: cj.sensitivities(rough, end, [name], END, mode=mode, rtol=1e-8).jacobian[name] for mode in modes}
    size = float(np.max(np.abs(found["controlled"])))
    assert found["controlled"].shape == (2, 40)
    assert np.max(np.abs(found["adjoint"] - found["controlled"])) < 1e-5 * size
    assert np.max(np.abs(found["screening"] - found["controlled"])) < 0.05 * size


def test_batches_of_via_points_and_of_long_samples_are_one_function():
    """The derivative of a lookup differs between lanes; and so do samples, of which many lanes make a long product."""
    arm = cj.load(SCENES / "arm.toml")

    def place(values, clearance):
        moved = cj.replace(
            arm.with_drives({"hip": cj.drives.Quintic(VIA, values)}), {"hip.radial_clearance": clearance}
        )
        return cj.simulate(moved, END, save_at=(0.5 * END, END), rtol=1e-7, throw=False)["tip.position.x"]

    values, clearances = jnp.asarray(0.2 * np.sin(VIA / END * 3)), jnp.linspace(5e-5, 2e-4, 40)
    slopes = jax.jit(jax.vmap(jax.jacfwd(place), (None, 0)))
    text = slopes.lower(values, clearances).as_text()
    assert 'xla_cpu_small_call = "true"' in text
    assert 'xla_cpu_small_call = "false"' not in text
    one = jax.jit(jax.jacfwd(place))(values, clearances[7])
    np.testing.assert_allclose(slopes(values, clearances)[7], one, rtol=1e-4, atol=1e-5 * np.max(np.abs(one)))


def test_program_by_many_numbers_is_as_large_as_by_few():
    """Numbers are pushed through the rate however many they are (pulls made it five times as large from 12 on)."""
    arm = cj.load(SCENES / "arm_with_play.toml")
    known = cj.parameters(arm)
    names = [name for name, of in known.items() if name.endswith((".mass", ".pin_radius")) and np.any(of.value)]
    names += [f"{joint.name}.radial_clearance" for joint in arm.clearance_joints()]

    def length(names):
        def place(factors):
            moved = {name: known[name].value * factors[i] for i, name in enumerate(names)}
            solution = cj.simulate(cj.replace(arm, moved), 1e-3, energy_balance=False)
            return solution["tcp.position.x"]

        return len(str(jax.make_jaxpr(jax.grad(place))(jnp.ones(len(names)))))

    assert len(names) >= 12
    assert length(names) <= 1.5 * length(names[:2])

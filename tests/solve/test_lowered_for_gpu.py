"""Batches on a GPU, as far as that goes without one: they are lowered for CUDA, each batch as one loop."""

import re

import catalogue
import jax
import jax.numpy as jnp
import pytest

import clearance_jax as cj
from clearance_jax._compile.platforms import by_platform

# More than a chunk of a CPU, which makes four of 25 of them.
CLEARANCES = jnp.linspace(5e-5, 5e-4, 100)
# As one chunk of whole vectors; on a CPU it is two of 56.
WHOLE = 104


def exported(lane, platform="cuda", values=CLEARANCES) -> str:
    """The program of a batch as it is lowered for a platform; nothing is compiled."""
    out = jax.export.export(jax.jit(jax.vmap(lane)), platforms=[platform])(values)
    assert out.platforms == (platform,)
    return out.mlir_module()


def loops(program: str) -> list[str]:
    """What each loop of a program carries."""
    return re.findall(r"stablehlo\.while\(.*?\) : (.*)", program)


def over(lanes: int, carried: str) -> bool:
    """Whether a loop carries states of lanes: their axis is the last."""
    return re.search(rf"tensor<\d+x{lanes}xf64>", carried) is not None


def foreign(program: str) -> set[str]:
    """Calls of what is not StableHLO itself: XLA has a LAPACK call for a CPU and none for a GPU, or the reverse."""
    return set(re.findall(r"stablehlo\.custom_call @?\"?([\w.$]+)", program))


def end(clearance):
    return cj.simulate(catalogue.slider_crank(clearance), 1e-3, rtol=1e-6)["piston.position.x"]


def of_three(numbers):
    names = ("wrist.radial_clearance", "wrist.friction.coefficient", "conrod.mass")
    mechanism = cj.replace(catalogue.slider_crank(), dict(zip(names, numbers, strict=True)))
    return cj.simulate(mechanism, 1e-3, rtol=1e-6, energy_balance=False)["piston.position.x"]


@pytest.mark.slow
def test_a_batch_is_one_loop_on_a_gpu():
    program = exported(end)
    assert sum(over(WHOLE, one) for one in loops(program)) >= 2  # attempts, and the stages in them
    assert "56xf64>" not in program
    assert not foreign(program)


def test_it_is_chunks_on_a_cpu():
    carried = loops(exported(end, "cpu"))
    assert any("tensor<2x56xf64>" in one for one in carried)  # over the chunks
    assert sum(over(56, one) for one in carried) >= 2
    assert not any(over(WHOLE, one) for one in carried)


@pytest.mark.slow
def test_derivatives_of_a_batch_are_one_loop_on_a_gpu():
    values = jnp.stack([CLEARANCES, jnp.full(100, 0.03), jnp.full(100, 0.21)], axis=1)
    program = exported(jax.value_and_grad(of_three), values=values)
    # The motion and three variations of its four components.
    assert any(re.search(rf"tensor<4x4x{WHOLE}xf64>", one) for one in loops(program))
    assert not foreign(program)


@pytest.mark.slow
def test_all_that_a_solve_has_is_lowered_for_a_gpu():
    """A loop to be assembled and closed, a settled start, samples, energy balance, observers."""
    four_bar = cj.load("experiments/scenes/four_bar.toml")
    metrics = {
        "force": cj.metrics.Peak(cj.metrics.ContactForce("knuckle")),
        "work": lambda solution: solution.energy_residual + solution["tip.position.x"][-1],
    }

    def lane(c):
        changed = cj.replace(four_bar, {"knuckle.radial_clearance": c})
        return cj.measure(changed, metrics, 1e-2, rtol=1e-6, save_at=5, start="settled", energy_balance=True)

    program = exported(lane)
    assert sum(over(WHOLE, one) for one in loops(program)) >= 4
    # Eigenvalues of the settled start, once a solve: by the GPU's own library, which JAX calls where it lowers for one.
    assert foreign(program) <= {"cusolver_syevd_ffi"}


def test_the_other_platforms_program_is_not_even_traced():
    traced = []

    def plain(x):
        return {"sum": x + 1.0}

    def on_gpu(x):
        traced.append(x)
        return {"sum": x + 10.0}

    @jax.jit
    def both(x):
        return by_platform(plain, on_gpu, x)

    assert float(both(jnp.asarray(1.0))["sum"]) == 2.0
    with jax.disable_jit():
        assert float(by_platform(plain, on_gpu, jnp.asarray(1.0))["sum"]) == 2.0
    assert not traced
    for platform in ("cuda", "rocm"):
        program = jax.export.export(both, platforms=[platform])(jnp.asarray(1.0)).mlir_module()
        assert "1.000000e+01" in program
    assert len(traced) == 2


def test_a_program_for_both_has_both():
    program = jax.export.export(jax.jit(lambda x: by_platform(jnp.sin, jnp.cos, x)), platforms=["cpu", "cuda"])
    text = program(jnp.asarray(1.0)).mlir_module()
    assert "stablehlo.sine" in text
    assert "stablehlo.cosine" in text

"""Functions of `numerics`: values against numpy, gradients at the kink, mixed batches, arguments of 1e-12."""

from typing import Any

import jax
import jax.extend
import jax.numpy as jnp
import numpy as np
import pytest

from clearance_jax._basis import numerics

pytestmark = pytest.mark.quick

MIXED = np.array([-3.0, -1.0, -1e-12, -1e-150, 0.0, 1e-150, 1e-12, 1e-6, 0.25, 1.0, 2.0])
ULP = np.finfo(float).eps


def power(exponent):
    return lambda x: numerics.positive_power(x, jnp.asarray(exponent))


# The function, what it is of a positive argument, its slope there; below the kink and at it, value and slope are 0.
ONE_SIDED = {
    "safe_sqrt": (numerics.safe_sqrt, np.sqrt, lambda x: 0.5 / np.sqrt(x)),
    "positive_part": (numerics.positive_part, lambda x: x, np.ones_like),
    "power_three_halves": (numerics.power_three_halves, lambda x: x**1.5, lambda x: 1.5 * x**0.5),
    "positive_power_1": (power(1.0), lambda x: x, np.ones_like),
    "positive_power_1.8": (power(1.8), lambda x: x**1.8, lambda x: 1.8 * x**0.8),
    "positive_power_2": (power(2.0), lambda x: x**2, lambda x: 2 * x),
}


@pytest.mark.parametrize("name", ONE_SIDED)
def test_one_sided_functions_in_a_mixed_batch(name):
    function, value, slope = ONE_SIDED[name]
    got, got_slope = jax.vmap(jax.value_and_grad(function))(jnp.asarray(MIXED))
    positive = MIXED > 0
    assert np.all(np.asarray(got)[~positive] == 0)
    assert np.all(np.asarray(got_slope)[~positive] == 0)
    np.testing.assert_allclose(np.asarray(got)[positive], value(MIXED[positive]), rtol=4 * ULP)
    np.testing.assert_allclose(np.asarray(got_slope)[positive], slope(MIXED[positive]), rtol=4 * ULP)


@pytest.mark.parametrize("name", ONE_SIDED)
def test_reverse_mode_through_a_sum_is_finite_beside_the_kink(name):
    function = ONE_SIDED[name][0]
    slopes = jax.grad(lambda x: jnp.sum(function(x)))(jnp.asarray(MIXED))
    np.testing.assert_array_equal(slopes, jax.vmap(jax.grad(function))(jnp.asarray(MIXED)))


def test_positive_power_has_a_finite_gradient_by_its_exponent():
    got = jax.vmap(jax.grad(numerics.positive_power, 1), (0, None))(jnp.asarray(MIXED), jnp.asarray(1.8))
    positive = MIXED > 0
    expected = MIXED[positive] ** 1.8 * np.log(MIXED[positive])
    assert np.all(np.asarray(got)[~positive] == 0)
    np.testing.assert_allclose(np.asarray(got)[positive], expected, rtol=8 * ULP)


PAIRS = np.array(
    [(0.0, 0.0), (1e-12, 0.0), (0.0, -1e-12), (3e-12, -4e-12), (3e-150, 4e-150), (-5.0, 12.0), (1e-12, 1.0), (0.0, 2.0)]
)


def test_safe_norm_and_unit_of_lengths_from_nothing_to_metres():
    x, y = jnp.asarray(PAIRS.T)
    expected = np.hypot(*PAIRS.T)
    length, ux, uy = numerics.safe_unit(x, y)
    np.testing.assert_allclose(numerics.safe_norm(x, y), expected, rtol=4 * ULP)
    np.testing.assert_allclose(length, expected, rtol=4 * ULP)
    some = expected > 0
    np.testing.assert_allclose(np.asarray(ux)[some], PAIRS[some, 0] / expected[some], rtol=4 * ULP)
    np.testing.assert_allclose(np.asarray(uy)[some], PAIRS[some, 1] / expected[some], rtol=4 * ULP)
    assert (float(length[0]), float(ux[0]), float(uy[0])) == (0.0, 0.0, 0.0)


def test_safe_norm_gradient_is_the_direction_and_0_at_the_origin():
    slopes = np.stack(jax.vmap(jax.grad(numerics.safe_norm, (0, 1)))(*jnp.asarray(PAIRS.T)), 1)
    assert np.all(slopes[0] == 0)
    lengths = np.hypot(*PAIRS[1:].T)[:, None]
    np.testing.assert_allclose(slopes[1:], PAIRS[1:] / lengths, rtol=8 * ULP)


def test_safe_unit_gradient_is_finite_and_perpendicular():
    x, y = PAIRS.T
    jacobian = np.stack(
        [np.stack(row) for row in jax.vmap(jax.jacrev(numerics.safe_unit, (0, 1)))(jnp.asarray(x), jnp.asarray(y))]
    )
    assert np.all(np.isfinite(jacobian))
    assert np.all(jacobian[0, :, 0] == 0)
    ux, uy, length = x[1:] / np.hypot(*PAIRS[1:].T), y[1:] / np.hypot(*PAIRS[1:].T), np.hypot(*PAIRS[1:].T)
    ordinary = length > 1e-100
    expected = np.array([[uy * uy, -ux * uy], [-ux * uy, ux * ux]]) / length
    scaled = (jacobian[1:, :, 1:] - expected) * length
    assert np.max(np.abs(scaled[:, :, ordinary])) < 8 * ULP


ANGLES = np.concatenate(
    [
        np.random.default_rng(0).uniform(-50, 50, 200_000),
        np.arange(-31, 32) * (np.pi / 2),
        np.arange(-63, 64, 2) * (np.pi / 4),
        [0.0, 1e-12, -1e-12, 1e-150],
    ]
)
ANGLES = ANGLES[np.abs(ANGLES) < 50]


def test_sincos_against_numpy():
    sine, cosine = jax.jit(numerics.sincos)(jnp.asarray(ANGLES))
    np.testing.assert_allclose(sine, np.sin(ANGLES), rtol=0, atol=4e-16)
    np.testing.assert_allclose(cosine, np.cos(ANGLES), rtol=0, atol=4e-16)


def test_sincos_keeps_the_digits_of_a_small_angle():
    small = np.array([1e-150, 1e-12, -1e-12, 1e-8, 1e-5])
    np.testing.assert_allclose(numerics.sincos(jnp.asarray(small))[0], np.sin(small), rtol=2 * ULP)
    np.testing.assert_allclose(numerics.sincos(jnp.asarray(small))[1], np.cos(small), rtol=2 * ULP)


def test_sincos_error_grows_as_its_docstring_says():
    large = np.random.default_rng(1).uniform(50, 1e5, 100_000)
    sine, cosine = jax.jit(numerics.sincos)(jnp.asarray(large))
    assert np.max(np.abs(sine - np.sin(large)) / large) < 1e-16
    assert np.max(np.abs(cosine - np.cos(large)) / large) < 1e-16


def test_sincos_derivatives():
    x = jnp.asarray(ANGLES)
    _, (sine_rate, cosine_rate) = jax.jvp(numerics.sincos, (x,), (jnp.full_like(x, 2.0),))
    np.testing.assert_allclose(sine_rate, 2 * np.cos(ANGLES), rtol=0, atol=8e-16)
    np.testing.assert_allclose(cosine_rate, -2 * np.sin(ANGLES), rtol=0, atol=8e-16)
    reverse = jax.grad(lambda a: jnp.sum(numerics.sincos(a)[0] + 3 * numerics.sincos(a)[1]))(x)
    np.testing.assert_allclose(reverse, np.cos(ANGLES) - 3 * np.sin(ANGLES), rtol=0, atol=2e-15)
    second = jax.vmap(jax.grad(jax.grad(lambda a: numerics.sincos(a)[0])))(x)
    np.testing.assert_allclose(second, -np.sin(ANGLES), rtol=0, atol=4e-16)


STEPS = {
    "step3": (numerics.step3, np.polynomial.Polynomial([0, 0, 3, -2]), 1),
    "step5": (numerics.step5, np.polynomial.Polynomial([0, 0, 0, 10, -15, 6]), 2),
    "step7": (numerics.step7, np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]), 3),
}


@pytest.mark.parametrize("name", STEPS)
class TestStep:
    def test_value_slope_and_curvature_inside(self, name):
        function, polynomial, _ = STEPS[name]
        s = np.concatenate([[1e-12, 1e-6], np.linspace(0.01, 0.99, 99), [1 - 1e-6]])
        for order in range(3):
            expected = polynomial.deriv(order)
            # Both sides sum terms as large as the coefficients.
            rounding = 4 * ULP * np.sum(np.abs(expected.coef))
            np.testing.assert_allclose(jax.vmap(function)(jnp.asarray(s)), expected(s), rtol=0, atol=rounding)
            function = jax.grad(function)

    def test_ends_and_beyond(self, name):
        function, _, _ = STEPS[name]
        outside = jnp.array([-5.0, -1e-12, 0.0, 1.0, 1 + 1e-12, 7.0])
        np.testing.assert_array_equal(jax.vmap(function)(outside), [0, 0, 0, 1, 1, 1])
        np.testing.assert_array_equal(jax.vmap(jax.grad(function))(outside), np.zeros(6))

    def test_small_arguments_keep_their_digits(self, name):
        function, polynomial, _ = STEPS[name]
        assert float(function(jnp.asarray(1e-12))) == pytest.approx(polynomial(1e-12), rel=1e-14)
        assert float(jax.grad(function)(jnp.asarray(1e-12))) == pytest.approx(polynomial.deriv()(1e-12), rel=1e-11)

    def test_continuous_derivatives_end_where_they_should(self, name):
        function, polynomial, continuous = STEPS[name]
        h = 1e-9
        for order in range(continuous + 2):
            jumps = [float(function(jnp.asarray(end + h)) - function(jnp.asarray(end - h))) for end in (0.0, 1.0)]
            if order <= continuous:
                steepest = np.max(np.abs(polynomial.deriv(order + 1)(np.linspace(0.0, 1.0, 101))))
                assert np.max(np.abs(jumps)) < 1.01 * h * steepest
            else:
                jump = polynomial.deriv(order)
                np.testing.assert_allclose(jumps, [jump(0.0), -jump(1.0)], rtol=1e-6)
            function = jax.grad(function)


def test_the_slope_of_the_seventh_step():
    s = jnp.array([-1.0, 0.0, 1e-6, 0.2, 0.5, 0.9, 1.0, 3.0])
    np.testing.assert_allclose(numerics.step7_slope(s), jax.vmap(jax.grad(numerics.step7))(s), rtol=1e-11, atol=1e-13)


def test_a_rounded_corner():
    """With |s| it is the even quartic (3 + 6 s^2 - s^4) / 8 within 1; at 0 its slope is that of s > 0."""
    s = np.array([-3.0, -1.0, -0.4, -1e-12, 0.0, 1e-12, 0.4, 1.0, 3.0])
    inside = np.abs(s) < 1
    expected = np.where(inside, (3 + 6 * s**2 - s**4) / 8 - np.abs(s), 0.0)
    np.testing.assert_allclose(jax.vmap(numerics.corner)(jnp.asarray(s)), expected, rtol=0, atol=2 * ULP)
    slopes = np.where(inside, (3 * s - s**3) / 2 - np.where(s < 0, -1.0, 1.0), 0.0)
    np.testing.assert_allclose(jax.vmap(jax.grad(numerics.corner))(jnp.asarray(s)), slopes, rtol=0, atol=4 * ULP)


def test_numbers_without_derivatives_keep_their_values():
    tree = {"a": jnp.asarray(2.0), "name": "spring", "b": (jnp.asarray([3.0, 4.0]), None)}
    same = numerics.without_derivatives(tree)
    assert (float(same["a"]), same["name"], same["b"][0].tolist(), same["b"][1]) == (2.0, "spring", [3.0, 4.0], None)

    def both(a):
        return a * numerics.without_derivatives({**tree, "a": a})["a"]

    # Of a^2 only one factor has a derivative.
    assert float(jax.grad(both)(jnp.asarray(5.0))) == 5.0


def test_the_lesser_the_greater_and_what_lies_within():
    """Values, slopes of one argument or, where they are equal, half of each; and what is no number stays none."""
    x, y = np.meshgrid(np.append(MIXED, np.nan), np.append(MIXED, np.nan))
    ours = (numerics.lesser, np.minimum, np.less), (numerics.greater, np.maximum, np.greater)
    for function, value, wins in ours:
        got, slopes = jax.vmap(jax.value_and_grad(function, (0, 1)))(jnp.asarray(x.ravel()), jnp.asarray(y.ravel()))
        np.testing.assert_array_equal(got, value(x, y).ravel())
        known = ~np.isnan(x + y).ravel()
        by_x = np.where(x == y, 0.5, wins(x, y)).ravel()
        np.testing.assert_array_equal(np.stack(slopes)[:, known], np.stack([by_x, 1 - by_x])[:, known])
    got, slope = jax.vmap(jax.value_and_grad(lambda s: numerics.within(s, -2.0, 0.5)))(jnp.asarray(MIXED))
    np.testing.assert_array_equal(got, np.clip(MIXED, -2.0, 0.5))
    np.testing.assert_array_equal(slope, (MIXED > -2.0) & (MIXED < 0.5))


def test_every_public_function_is_tested_here():
    public = {
        name
        for name, value in vars(numerics).items()
        if callable(value) and getattr(value, "__module__", "") == numerics.__name__ and not name.startswith("_")
    }
    assert public == {
        *("sincos", "safe_sqrt", "safe_norm", "safe_unit", "positive_part", "power_three_halves", "positive_power"),
        *("step3", "step5", "step7", "step7_slope", "corner", "without_derivatives", "lesser", "greater", "within"),
    }


def in_two_minds(function, x: float) -> float:
    """The value of a function of one number where the first kernel finds the number not positive, the next ones do."""
    traced = jax.make_jaxpr(function)(jnp.asarray(x))
    known: dict[Any, Any] = dict(zip(traced.jaxpr.invars, [jnp.asarray(x)], strict=True))
    known |= dict(zip(traced.jaxpr.constvars, traced.consts, strict=True))
    signs: list[Any] = []
    for step in traced.jaxpr.eqns:
        given = [known[v] if isinstance(v, jax.extend.core.Var) else v.val for v in step.invars]
        if signs and any(v is signs[0] for v in step.invars):
            given[[v is signs[0] for v in step.invars].index(True)] = jnp.asarray(False)
            signs.clear()
        made = step.primitive.bind(*given, **step.params)
        known |= dict(zip(step.outvars, made if step.primitive.multiple_results else [made], strict=True))
        signs += step.outvars if step.primitive.name == "gt" else []
    return float(known[traced.jaxpr.outvars[0]])


@pytest.mark.parametrize("function", [numerics.safe_sqrt, power(1.5)])
def test_kernels_that_disagree_about_a_sign_see_nothing_large(function):
    """An argument of 1e-19 in one kernel may be 0 in another, which multiplies with other roundings. A power of one
    that stood in for it would be a force of 10 GN.
    """
    for x in (1e-19, 1e-38, 1e-300):
        assert 0 <= in_two_minds(function, x) <= 1.1e-15

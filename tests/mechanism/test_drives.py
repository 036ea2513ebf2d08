"""Drives: derivatives, break times, splines against scipy, the STEP formulas, the paper's drive expressions."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import ClosedJaxpr, Jaxpr
from places import refused
from scipy.interpolate import CubicSpline

import clearance_jax as cj
from clearance_jax._basis.types import Scalar
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.mechanism.actuators import AbstractActuator
from clearance_jax.mechanism.motion.expressions import read_expression
from clearance_jax.mechanism.motion.motion_laws import AbstractDrive, DriveSum, PreparedSpline, spline_curvature
from clearance_jax.parameters import physical

KNOTS = np.array([0.1, 0.35, 0.5, 0.9, 1.0, 1.45, 1.7])
TABLE = np.array([0.2, -0.4, 0.1, 0.9, 0.3, -1.1, 0.4])
STEPS = ([0.2, 0.7, 1.1], [0.7, 1.3, 1.5], [1.5, -0.4, 0.3])
STEP_TIMES = [0.2, 0.7, 1.1, 1.3, 1.5]
# A move that keeps its speed for a while and one that reaches half of it; two moves without a stop between.
MOVE_TIMES = [0.125, 0.375, 0.625, 0.875, 1.0, 1.125, 1.25]
TIMED_TIMES = [0.125, 0.5, 0.875, 1.125, 1.375]
# One example of every concrete drive, and the times at which its q'' or q''' jumps.
DRIVES: dict[str, tuple[AbstractDrive, list[float]]] = {
    "constant-speed": (cj.drives.ConstantSpeed(-2.0, 0.3), []),
    "step": (cj.drives.StepSum(*STEPS, 0.1), STEP_TIMES),
    "step5": (cj.drives.Step5Sum(*STEPS, 0.1), STEP_TIMES),
    "harmonic": (cj.drives.Harmonic(0.4, 7.0, 0.3, -0.2), []),
    "constant": (cj.drives.Constant(0.7), []),
    "trapezoid": (cj.drives.Trapezoid([0.125, 1.0], [1.0, -0.125], 2.0, 8.0, offset=0.1), MOVE_TIMES),
    "trapezoid-timed": (
        cj.drives.Trapezoid([0.125, 0.875], [1.0, -0.5], duration=[0.75, 0.5], cruise=0.0),
        TIMED_TIMES,
    ),
    "quintic": (cj.drives.Quintic(KNOTS, TABLE), [KNOTS[0], KNOTS[-1]]),
    "quintic-speeds": (cj.drives.Quintic(KNOTS, TABLE, -TABLE), [KNOTS[0], KNOTS[-1]]),
    "quintic-all": (cj.drives.Quintic(KNOTS, 0 * TABLE, 0 * TABLE, 1.0 + TABLE), KNOTS.tolist()),
    "spline-not-a-knot": (cj.drives.Spline(KNOTS, TABLE), KNOTS[2:-2].tolist()),
    "spline-natural": (cj.drives.Spline(KNOTS, TABLE, "natural"), KNOTS[1:-1].tolist()),
    "spline-clamped": (cj.drives.Spline(KNOTS, TABLE, "clamped"), KNOTS[1:-1].tolist()),
    "sum": (
        DriveSum(
            (
                cj.drives.StepSum([0.3], [0.8], [1.0]),
                cj.drives.Step5Sum([0.6], [1.2], [2.0]),
                cj.drives.Harmonic(0.1, 5.0),
            )
        ),
        [0.3, 0.6, 0.8, 1.2],
    ),
}


def concrete(cls):
    for sub in cls.__subclasses__():
        yield from concrete(sub)
        if not sub.__abstractmethods__ and sub.__module__.startswith("clearance_jax"):
            yield sub


def test_every_drive_is_in_the_catalogue():
    assert set(concrete(AbstractDrive)) == {type(drive) for drive, _ in DRIVES.values()}


def part(drive, order):
    return lambda t: jnp.asarray(drive(t)[order], dtype=float)


@functools.cache
def sampled(name):
    """Times between the multiples of 1/1000, and there q, q', q'' as given, by autodiff, and two derivatives more."""
    drive = DRIVES[name][0]
    given = [part(drive, order) for order in range(3)]
    derived = [jax.grad(given[0]), jax.grad(jax.grad(given[0]))]
    beyond = [jax.grad(given[2]), jax.grad(jax.grad(given[2]))]
    t = 0.0005 + np.arange(2000) / 1000
    values = jax.jit(jax.vmap(lambda t: ([f(t) for f in given], [f(t) for f in derived], [f(t) for f in beyond])))
    return (t, *values(jnp.asarray(t)))


@pytest.mark.parametrize("name", DRIVES)
class TestContract:
    def test_rates_are_derivatives_of_the_position(self, name):
        _, given, derived, _ = sampled(name)
        for order in (1, 2):
            size = 1 + np.max(np.abs(derived[order - 1]))
            np.testing.assert_allclose(given[order], derived[order - 1], rtol=0, atol=1e-12 * size)

    def test_position_and_speed_are_continuous(self, name):
        t, given, _, _ = sampled(name)
        for order in (0, 1):
            steepest = np.max(np.abs(given[order + 1]))
            assert np.max(np.abs(np.diff(given[order]))) <= 1.001 * steepest * (t[1] - t[0]) + 1e-12

    def test_jumps_are_where_they_should_be(self, name):
        t, given, _, (third, fourth) = sampled(name)
        jumping = np.zeros(t.size - 1, bool)
        for values, slopes in ((given[2], third), (third, fourth)):
            smooth = (t[1] - t[0]) * np.max(np.abs(slopes))
            jumping |= np.abs(np.diff(values)) > 2 * smooth + 1e-9
        found = t[:-1][jumping] + 0.0005
        np.testing.assert_allclose(found, DRIVES[name][1], rtol=0, atol=1e-12)

    def test_breaks_are_the_jumps(self, name):
        drive, jumps = DRIVES[name]
        # A table's times are its breaks: a spline's end pieces (and with not-a-knot the next) go on without a jump, and
        # a curve of least jerk jumps at its ends only.
        expected = KNOTS.tolist() if isinstance(drive, cj.drives.Spline | cj.drives.Quintic) else jumps
        assert set(np.asarray(drive.breaks()).tolist()) == set(expected)
        assert set(jumps) <= set(expected)

    def test_prepared_is_the_same_drive(self, name):
        drive = DRIVES[name][0]
        t, prepared = jnp.asarray(0.777), drive.prepare()
        np.testing.assert_allclose(np.stack(prepared(t)), np.stack(drive(t)), rtol=1e-14)
        np.testing.assert_array_equal(prepared.breaks(), drive.breaks())
        assert prepared.prepare() == prepared  # a mechanism may be prepared twice


@pytest.mark.parametrize("ends", ["not-a-knot", "natural", "clamped"])
class TestSpline:
    def test_against_scipy_inside_at_the_ends_and_beyond(self, ends):
        t = np.concatenate([np.linspace(-0.3, 2.1, 241), KNOTS, KNOTS - 1e-12])
        got = jax.jit(jax.vmap(cj.drives.Spline(KNOTS, TABLE, ends)))(jnp.asarray(t))
        reference = CubicSpline(KNOTS, TABLE, bc_type=ends)
        for order in range(3):
            expected = reference(t, order)
            np.testing.assert_allclose(got[order], expected, rtol=0, atol=1e-13 * np.max(np.abs(expected)) + 1e-14)

    def test_shortest_table(self, ends):
        t = np.linspace(0.1, 0.9, 33)
        got = jax.vmap(cj.drives.Spline(KNOTS[:4], TABLE[:4], ends).prepare())(jnp.asarray(t))
        reference = CubicSpline(KNOTS[:4], TABLE[:4], bc_type=ends)
        for order in range(3):
            np.testing.assert_allclose(got[order], reference(t, order), rtol=0, atol=1e-11)

    def test_derivative_by_the_table(self, ends):
        t = 1.2
        slopes = jax.grad(lambda values: cj.drives.Spline(KNOTS, values, ends).prepare()(jnp.asarray(t))[0])(
            jnp.asarray(TABLE)
        )
        basis = CubicSpline(KNOTS, np.eye(KNOTS.size), bc_type=ends)
        np.testing.assert_allclose(slopes, basis(t), rtol=0, atol=1e-13)

    def test_derivatives_by_the_table_and_its_times(self, ends):
        t = np.array([0.0, 0.2, 0.95, 1.5, 1.9])  # the first and the last beyond the table
        table = np.concatenate([KNOTS, TABLE])

        def ours(table):
            return jnp.stack(
                jax.vmap(cj.drives.Spline(table[: KNOTS.size], table[KNOTS.size :], ends).prepare())(jnp.asarray(t))
            )

        def theirs(table):
            return np.stack([CubicSpline(*np.split(table, 2), bc_type=ends)(t, order) for order in range(3)])

        moves = 1e-5 * np.eye(table.size)
        expected = np.stack([theirs(table + m) - theirs(table - m) for m in moves], axis=-1) / 2e-5
        for jacobian in (jax.jacfwd, jax.jacrev):
            slopes = np.asarray(jax.jit(jacobian(ours))(jnp.asarray(table)))
            np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-7 * np.max(np.abs(expected)))

    def test_many_tables_at_once(self, ends):
        stretched, tables = np.stack([KNOTS, 2 * KNOTS]), np.stack([TABLE, TABLE[::-1]])
        got = jax.vmap(lambda times, values: spline_curvature(times, values, ends))(stretched, tables)
        alone = [spline_curvature(jnp.asarray(t), jnp.asarray(v), ends) for t, v in zip(stretched, tables, strict=True)]
        np.testing.assert_array_equal(got, np.stack(alone))

    def test_a_long_table_needs_no_square_array(self, ends):
        n = 20_000
        rng = np.random.default_rng(0)
        times, values = np.cumsum(rng.uniform(0.5, 1.5, n)), rng.standard_normal(n)

        def curvature(times, values):
            return spline_curvature(times, values, ends)

        def slopes(times, values):
            return jax.grad(lambda *table: jnp.sum(curvature(*table) ** 2), (0, 1))(times, values)

        for function in (curvature, slopes):
            assert largest(jax.make_jaxpr(function)(times, values).jaxpr) <= 10 * n
        expected = CubicSpline(times, values, bc_type=ends)(times, 2)
        size = np.max(np.abs(expected))
        np.testing.assert_allclose(
            curvature(jnp.asarray(times), jnp.asarray(values)), expected, rtol=0, atol=1e-13 * size
        )
        assert all(np.all(np.isfinite(s)) for s in slopes(jnp.asarray(times), jnp.asarray(values)))


def largest(program: Jaxpr) -> int:
    """Size of the largest array in a program and in the programs that it calls."""
    sizes = [getattr(variable.aval, "size", 1) for equation in program.eqns for variable in equation.outvars]
    for equation in program.eqns:
        inner = jax.tree.leaves(equation.params, is_leaf=lambda p: isinstance(p, Jaxpr | ClosedJaxpr))
        sizes += [largest(p.jaxpr if isinstance(p, ClosedJaxpr) else p) for p in inner if hasattr(p, "eqns")]
    return max(sizes, default=0)


def test_the_largest_array_is_found_inside_calls_too():
    def dense(x):
        return jax.lax.cond(x[0] > 0, jax.jit(lambda x: x + jnp.sum(jnp.outer(x, x))), jnp.sin, x)

    assert largest(jax.make_jaxpr(dense)(jnp.ones(50)).jaxpr) == 2500


def test_a_spline_needs_four_values_of_one_length():
    for times, values in ((KNOTS[:3], TABLE[:3]), (KNOTS, TABLE[:-1])):
        with refused("times"):
            cj.drives.Spline(times, values)


def step(t, t0, h0, t1, h1):
    s = np.clip((t - t0) / (t1 - t0), 0, 1)
    return h0 + (h1 - h0) * s * s * (3 - 2 * s)


def step5(t, t0, h0, t1, h1):
    s = np.clip((t - t0) / (t1 - t0), 0, 1)
    return h0 + (h1 - h0) * s**3 * (10 - 15 * s + 6 * s * s)


TIMES = np.linspace(-0.5, 9.5, 401)


@pytest.mark.parametrize(("cls", "formula"), [(cj.drives.StepSum, step), (cj.drives.Step5Sum, step5)])
def test_step_sums_are_the_adams_formulas(cls, formula):
    drive = cls([0.0, 1.0], [2.0, 9.0], [1.5, -4.0], 0.25)
    expected = 0.25 + formula(TIMES, 0, 0, 2, 1.5) + formula(TIMES, 1, 0, 9, -4.0)
    q, v, a = jax.vmap(drive)(jnp.asarray(TIMES))
    np.testing.assert_allclose(q, expected, rtol=0, atol=1e-14)
    outside = (TIMES < 0) | (TIMES > 9)
    assert np.all(np.asarray(v)[outside] == 0)
    assert np.all(np.asarray(a)[outside] == 0)


def test_step_jumps_by_six_rises_over_the_square_of_its_span():
    drive = cj.drives.StepSum([0.5], [2.5], [1.2])
    a = [float(drive(jnp.asarray(t))[2]) for t in (0.5 - 1e-12, 0.5, 2.5 - 1e-12, 2.5)]
    np.testing.assert_allclose(a, [0.0, 6 * 1.2 / 4, -6 * 1.2 / 4, 0.0], rtol=1e-10)


def test_harmonic_against_numpy():
    t = np.linspace(0, 4, 101)
    q, v, a = jax.vmap(cj.drives.Harmonic(0.4, 7.0, 0.3, -0.2))(jnp.asarray(t))
    np.testing.assert_allclose(q, -0.2 + 0.4 * np.sin(7 * t + 0.3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(v, 0.4 * 7 * np.cos(7 * t + 0.3), rtol=0, atol=1e-14)
    np.testing.assert_allclose(a, -0.4 * 49 * np.sin(7 * t + 0.3), rtol=0, atol=1e-13)


def test_a_sum_adds_its_terms_and_their_breaks():
    terms = (cj.drives.StepSum([0.3], [0.8], [1.0]), cj.drives.Spline(KNOTS, TABLE), cj.drives.ConstantSpeed(3.0, -1.0))
    drive = DriveSum(terms)
    for t in (0.0, 0.4, 1.6):
        parts = [term(jnp.asarray(t)) for term in terms]
        expected = [sum(float(p[order]) for p in parts) for order in range(3)]
        np.testing.assert_allclose(np.stack(drive(jnp.asarray(t))), expected, rtol=1e-14)
        np.testing.assert_allclose(np.stack(drive.prepare()(jnp.asarray(t))), expected, rtol=1e-12)
    assert sorted(np.asarray(drive.breaks()).tolist()) == sorted([0.3, 0.8, *KNOTS.tolist()])
    assert isinstance(drive.prepare().terms[1], PreparedSpline)


class Push(AbstractActuator):
    """A force that is there from `begin` on."""

    force: Scalar = physical("effort")
    begin: Scalar = physical("s")

    def __call__(self, time, position, velocity):
        return jnp.where(time >= self.begin, self.force, 0.0) + 0 * position

    def breaks(self):
        return self.begin[None]


def block(*actuators):
    """A mass of 2 kg on a guide."""
    guide = cj.Prismatic("guide", "ground", "block", motion=cj.Motion(actuators=actuators))
    return cj.Mechanism((cj.Body("block", 2.0),), (guide,))


def test_drive_breaks_are_those_of_drives_and_actuators():
    target = cj.drives.Spline(KNOTS, TABLE)
    servo = cj.actuators.Servo(target, 10.0, 1.0)
    m = block(servo, Push(3.0, 0.62), cj.actuators.ConstantEffort(1.0))
    for mechanism in (m, m.prepare()):
        assert sorted(np.asarray(drive_breaks(mechanism)).tolist()) == sorted([0.62, *KNOTS.tolist()])
    driven = cj.Prismatic("guide", "ground", "block", motion=cj.Motion(cj.drives.StepSum([0.3], [0.8], [1.0])))
    assert np.asarray(drive_breaks(cj.Mechanism((cj.Body("block"),), (driven,)))).tolist() == [0.3, 0.8]
    assert drive_breaks(block()).shape == (0,)


def test_a_force_with_a_break_is_integrated_on_both_sides_of_it():
    s = cj.simulate(block(Push(3.0, 0.6217)), 1.0, rtol=1e-6, energy_balance=False)
    left = 1.0 - 0.6217
    np.testing.assert_allclose(s.final, [1.5 * left**2 / 2, 1.5 * left], rtol=1e-12)
    assert int(s.rejected) == 0


def test_a_solve_is_differentiable_by_a_spline_and_its_times():
    m = block(cj.actuators.Servo(cj.drives.Spline(KNOTS, TABLE), 50.0, 5.0))

    def end(values, times):
        table = {"guide.0.target.values": values, "guide.0.target.times": times}
        return cj.simulate(cj.replace(m, table), 1.6, t0=0.2, rtol=1e-10, energy_balance=False).final[0]

    point = jnp.stack([TABLE, KNOTS])
    slopes = jnp.concatenate(jax.grad(end, (0, 1))(*point))
    moves = 1e-4 * np.eye(14).reshape(14, 2, 7)
    value = jax.jit(end)
    expected = [(value(*(point + m)) - value(*(point - m))) / 2e-4 for m in moves]
    np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-6 * np.max(np.abs(expected)))


def test_what_vanishes_identically_is_absent_from_the_program():
    t = jnp.asarray(1.0)
    assert isinstance(cj.drives.ConstantSpeed(2.0)(t)[2], float)
    assert isinstance(DriveSum((cj.drives.ConstantSpeed(2.0), cj.drives.ConstantSpeed(1.0)))(t)[2], float)


# Table 2 of the paper but its first row: ends of the three steps, speed in the middle of the first, start acceleration.
TABLE_2 = [
    ((1, 2, 3), 2.35619, 9.42478),
    ((2, 4, 6), 1.17810, 2.35619),
    ((3, 6, 8), 0.785398, 1.04720),
]


@pytest.mark.parametrize(("ends", "speed", "acceleration"), TABLE_2)
def test_drive_expressions_of_the_papers_table_2(ends, speed, acceleration):
    first, second, third = ends
    drive = read_expression(
        f"step(time, 0, 0, {first}, 90 d) + step(time, {first}, 0, {second}, 30 d)"
        f" + step(time, {second}, 0, {third}, 10 d)"
    )
    parts = ((0, first, 90), (first, second, 30), (second, third, 10))
    expected = sum(step(TIMES, begin, 0, end, np.deg2rad(rise)) for begin, end, rise in parts)
    q, v, a = np.stack(jax.vmap(drive)(jnp.concatenate([jnp.asarray(TIMES), jnp.array([first / 2, 0.0])])))
    np.testing.assert_allclose(q[:-2], expected, rtol=0, atol=1e-14)
    assert float(q[-3]) == pytest.approx(np.deg2rad(130), rel=1e-14)
    assert float(v[-2]) == pytest.approx(speed, rel=3e-6)
    assert float(a[-1]) == pytest.approx(acceleration, rel=3e-6)
    assert set(np.asarray(drive.breaks()).tolist()) == {0.0, *map(float, ends)}


DEGREE = np.pi / 180
EXPRESSIONS = {
    "2.5": lambda t: np.full_like(t, 2.5),
    "-30d": lambda t: np.full_like(t, -30 * DEGREE),
    "time": lambda t: t,
    "-180 d * time": lambda t: -180 * DEGREE * t,
    "time * -180d + 90d": lambda t: (90 - 180 * t) * DEGREE,
    "2*time*3 - time": lambda t: 5 * t,
    "1 - -2 + .5e1": lambda t: np.full_like(t, 8.0),
    "step(time, 1, 2, 3, -1)": lambda t: step(t, 1, 2, 3, -1),
    "STEP5(TIME,1,-2,3,5) - 4": lambda t: step5(t, 1, -2, 3, 5) - 4,
    "-step(time, 1, 2, 3, -1) + 0.5*step5(time, 0, 1, 4, 90d)": lambda t: (
        -step(t, 1, 2, 3, -1) + 0.5 * step5(t, 0, 1, 4, np.pi / 2)
    ),
    "1 + step(time,0,1,1,2) + time*2 + step5(time,2,1,4,0) - step(time,1,0,2,3)": lambda t: (
        1 + step(t, 0, 1, 1, 2) + 2 * t + step5(t, 2, 1, 4, 0) - step(t, 1, 0, 2, 3)
    ),
    "step(time, -1, 0, 2, 1)": lambda t: step(t, -1, 0, 2, 1),
}


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_expressions_mean_what_adams_means(text):
    q, _, _ = jax.vmap(lambda t: [jnp.asarray(x, dtype=float) for x in read_expression(text)(t)])(jnp.asarray(TIMES))
    np.testing.assert_allclose(q, EXPRESSIONS[text](TIMES), rtol=0, atol=2e-14 * np.max(np.abs(q)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("step(time, 0, 0, 1, 2", "expected `,`|expected `\\)`"),
        ("step time", "expected `\\(`"),
        ("2 * 3", "`step\\(...\\)`"),
        ("time time", "`\\+`, `-` or the end"),
        ("1 + ", "a number"),
        ("time / 2", "`step5`, `time` or a sign"),
        ("step(time, 2, 0, 2, 1)", "must end after"),
    ],
)
def test_bad_expressions_say_what_was_expected(text, words):
    with pytest.raises(ValueError, match=words):
        read_expression(text)

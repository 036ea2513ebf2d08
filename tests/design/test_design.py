"""Tolerance design: against closed forms, with its messages, its memory and its certificate."""

import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import slider_crank
from places import refused

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.ask.question import Answer
from clearance_jax.design.asked.formulation import _identity
from clearance_jax.design.asked.specification import scenarios_of
from clearance_jax.design.judge import verify
from clearance_jax.design.search import evaluate, yields
from clearance_jax.design.search.evaluate import simulations_of
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.measure import Request
from clearance_jax.runs.identity import differences
from clearance_jax.solve.settings import Settings
from experiments.trust.horizon import CHAOTIC
from experiments.trust.scenes import NAME as PLAY
from experiments.trust.scenes import scene
from optimize import (
    allocate_four_bar,
    allocate_planar_arm,
    allocate_slider_crank,
    largest_clearance,
    treacherous,
    yield_design,
)
from optimize import exponential_cost_closed_form as closed_form
from optimize.cma_method import CMA_ES
from optimize.optax_methods import PROJECTED_ADAM

NAME = "wrist.radial_clearance"
NAME5 = yield_design.NAME
PEAK = metrics.Peak(metrics.PositionError("piston"))


def test_the_literatures_example():
    """B = (1, 3, 2), S = (1, 1/2, 2), bound 0.1: clearances and costs by hand."""
    worst, rss = closed_form.allocation("worst case", 3), closed_form.allocation("statistical", 3)
    np.testing.assert_allclose(worst.x, [0.0236701, 0.0579796, 0.0236701], rtol=3e-6)
    np.testing.assert_allclose(worst.cost, 178.4847, rtol=1e-6)
    np.testing.assert_allclose(rss.x, [0.0455006, 0.1041703, 0.0361138], rtol=3e-6)
    np.testing.assert_allclose(rss.cost, 106.1572, rtol=1e-6)


def test_closed_form_allocations(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for row in closed_form.main(quick=True):
        assert abs(row.cost_error) <= 1e-6, row
        assert row.violation <= 1e-8, row
        assert 0 < row.needed <= (40 if row.method == "slsqp" else 250), row


@pytest.mark.parametrize(
    ("method", "error"), [("trust-constr", 1e-4), ("cobyqa", 1e-5), (PROJECTED_ADAM, 2e-2), (CMA_ES, 1e-3)]
)
def test_the_other_solvers_agree(method, error):
    problem = closed_form.allocation("worst case", 3)
    program = problem.program()
    assert design.run(program, method, np.full(3, 0.01)) == ""
    assert program.best is not None
    assert -1e-8 <= program.best.objective / problem.cost - 1 <= error


def test_a_model_of_manufacture_is_one_class():
    """Parts with their titles and numbers, and what of all limits of them is judged, come from the class alone."""

    class Ends(design.AbstractManufacture):
        @property
        def title(self):
            return "of both ends"

        @property
        def scattered(self):
            return ("slider.mass",)

        def parts(self, names, fresh=0, seed=None):
            return [design.Part(f", at {f:g}", np.full(len(names), f), {"slider.mass": f}) for f in (0.5, 1.0)]

        def judge(self, values, slopes):
            return np.max(values).reshape(1), None

    specification = asked(manufacture=Ends()).specification
    found = scenarios_of(specification)
    mass = float(cj.parameters(slider_crank())["slider.mass"].value)
    assert [one.title for one in found] == [", at 0.5", ", at 1"]
    assert [float(one.values["slider.mass"]) for one in found] == [0.5 * mass, mass]
    assert [one.factors.tolist() for one in found] == [[0.5], [1.0]]
    assert design.formulate(specification).limit_names == ("of both ends",)
    assert [part.is_design for part in design.AsDesigned().parts((NAME,))] == [True]
    with refused("no"):
        asked(manufacture=design.Yield({"no": 0.1}))


def test_costs():
    c = jnp.array([1e-5, 4e-5, 2e-4])
    np.testing.assert_allclose(design.Reciprocal(2e-3, 2.0, 7.0)(c), 7 + 2e-3 / c**2)
    np.testing.assert_allclose(design.Exponential(3.0, 1e4, 1.0)(c), 1 + 3 * jnp.exp(-1e4 * c))
    np.testing.assert_allclose(design.ExponentialReciprocal(3.0, 1e4, 0.5)(c), 3 * jnp.exp(-1e4 * c) / c**0.5)
    table = design.CostTable([1e-5, 4e-5, 1e-4], [9.0, 4.0, 1.0])
    np.testing.assert_allclose([table(x) for x in (1e-5, 4e-5, 1e-4)], [9, 4, 1])
    np.testing.assert_allclose(table(1.0), 1)
    assert float(table(5e-6)) > 9
    between = [float(table(x)) for x in np.linspace(1e-5, 1e-4, 50)]
    assert np.all(np.diff(between) < 0)
    with pytest.raises(ClearanceError, match="increasing"):
        design.CostTable([1e-5, 1e-5], [1, 2])


def test_a_band_has_its_ends_and_corners():
    factors = design.Band(0.5).factors(2)
    assert {tuple(row) for row in factors} == {(0.5, 0.5), (0.75, 0.75), (1, 1), (0.5, 1), (1, 0.5)}


def test_a_record_of_another_start_is_another_problems():
    """Settled pins make other peaks than falling ones: their designs must not be mixed."""
    limit = design.Limit(metrics.Peak(metrics.PositionError("piston")), 1e-3)

    def identity(**options):
        variables = {"wrist.radial_clearance": (1e-4, 1e-3)}
        specification = design.ToleranceProblem(slider_crank(), 1e-3, variables, [limit], **options).specification
        return _identity(specification, simulations_of(specification))

    usual = identity()
    assert identity(start="centre", t0=0.0) == usual
    for name, other in (("start", "settled"), ("t0", 1e-4), ("max_steps", 100)):
        assert list(differences(usual, identity(**{name: other}))) == [f"option {name}"]


def test_what_was_evaluated_is_kept_and_resumed_from(tmp_path):
    problem, file = closed_form.allocation("worst case", 5), tmp_path / "points.jsonl"

    def program(**options):
        n = len(problem.x)
        names = [f"c{i}" for i in range(n)]
        return design.Program(problem._evaluate, names, np.full(n, 1e-6), np.full(n, 1e2), ["error"], **options)

    first = program(record=file, most=6)
    assert "as many" in design.run(first, "slsqp", np.full(5, 1e-3))
    assert first.gradients == 6
    assert first.best is not None
    second = program(record=file)
    assert second.gradients == 0
    assert second.best is not None
    assert second.best.objective == first.best.objective
    design.run(second, "slsqp", np.full(5, 1e-3))
    assert second.best.objective <= problem.cost * (1 + 1e-6)
    fresh = program()
    design.run(fresh, "slsqp", np.full(5, 1e-3))
    assert second.gradients == fresh.gradients - 6  # the first six were remembered
    with refused(file, "variables"):
        design.Program(problem._evaluate, ["other"], np.ones(1), 2 * np.ones(1), ["error"], record=file)


def test_an_interrupted_run_keeps_its_best():
    problem = closed_form.allocation("worst case", 3)

    def stop(point):
        if point.worst < 0 and program.gradients > 4:
            raise KeyboardInterrupt

    program = design.Program(
        problem._evaluate, ["a", "b", "c"], np.full(3, 1e-6), np.full(3, 1e2), ["error"], progress=stop
    )
    assert design.run(program, "slsqp", np.full(3, 1e-3)) == "interrupted"
    assert program.best is not None
    assert program.best.objective < program.history[0].objective


def asked(mechanism=None, variables=None, limits=None, **options):
    return design.ToleranceProblem(
        slider_crank() if mechanism is None else mechanism,
        1e-3,
        {NAME: (1e-5, 1e-3)} if variables is None else variables,
        [design.Limit(PEAK, 1e-4)] if limits is None else limits,
        **options,
    )


def test_messages():
    with refused("wrist.radial_clearence", allowed=NAME):
        asked(variables={"wrist.radial_clearence": (1e-5, 1e-3)})
    with refused(NAME, "(0.001, 1e-05)"):
        design.formulate(asked(variables={NAME: (1e-3, 1e-5)}).specification)
    with refused("drive.main.speed"):
        asked(conditions={"fast": {"drive.main.speed": np.nan}})
    with refused(NAME, "wide"):
        asked(conditions={"wide": {NAME: 1e-4}})
    with refused("bound"):
        design.Limit(PEAK, np.nan)
    with refused("Peak PositionError of piston"):
        asked(limits=[design.Limit(PEAK, 1e-4), design.Limit(PEAK, 2e-4)])
    with refused(NAME, None):
        asked(cost={"other": design.Reciprocal(1.0)})
    with refused("method", "newton"):
        asked().solve("newton")
    with pytest.raises(ClearanceError, match=r"whole number.*cobyqa"):
        asked(limits=[design.Limit(metrics.Impacts("wrist"), 3.0)]).solve()


@pytest.mark.slow
def test_infeasible_and_unlimited_problems_say_so():
    impossible = asked(limits=[design.Limit(PEAK, 1e-9, "piston")]).solve()
    assert not impossible.feasible
    assert "NO FEASIBLE DESIGN: piston" in str(impossible)
    assert len(impossible.program.history) > 1
    with pytest.raises(ClearanceError, match="no feasible design to verify: piston"):
        impossible.verify()
    free = asked(limits=[design.Limit(PEAK, 1.0)]).solve()
    np.testing.assert_allclose(free.clearances[NAME], 1e-3)
    assert "no limit decides" in str(free)


@pytest.mark.slow
def test_largest_clearance_of_the_papers_robot(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    found = largest_clearance.main(quick=True)
    assert found.feasible
    assert found.program.gradients <= 8
    certificate = found.verify(sweep=4)
    assert certificate.holds
    np.testing.assert_allclose(certificate.scale, 1.0, atol=1e-6)
    assert len(certificate.islands) == 1
    printed = capsys.readouterr().out
    assert "in one piece" in printed
    assert "Nearest common fit: " in printed
    # By another way: the error at the answer, and beside it.
    c = found.clearances[largest_clearance.NAME]
    error, asked = metrics.Peak(metrics.PositionError("end")), found.specification
    at, above = (
        error(cj.replace(asked.mechanism, {largest_clearance.NAME: s * c}), asked.t1, solver="dopri8")
        for s in (1.0, 1.001)
    )
    assert float(at) <= largest_clearance.BOUND * (1 + 1e-6) < float(above)


def test_conditional_value_at_risk():
    part = design.Yield({}, 0.9, 25, confidence=0.0)
    worst = np.random.default_rng(0).standard_normal(25)
    weights = part.weights(worst)
    np.testing.assert_allclose(weights.sum(), 1.0)
    top = np.sort(worst)[::-1]
    np.testing.assert_allclose(weights @ worst, (top[0] + top[1] + 0.5 * top[2]) / 2.5)
    # Clopper and Pearson: 459 clean samples prove 99 % at 99 %, so 299 do at 95 % (Wilks 1941).
    assert yields.estimate_yield(np.ones(299, bool)).least >= 0.99
    assert yields.estimate_yield(np.ones(298, bool)).least < 0.99
    assert yields.samples_needed(0.99) == 299
    with refused(NAME, 1.0):
        design.Yield({NAME: 1.0}).draws((NAME,))


@pytest.mark.slow
@pytest.mark.optimised
def test_a_yield_is_what_fresh_samples_have(capsys):
    found, fresh = yield_design.main(quick=True)
    assert found.feasible
    assert fresh.share >= yield_design.TARGET
    assert fresh.least >= 0.98
    # The error is nearly proportional to the clearance, and the mean of the worst hundredth of a normal scatter 2.665
    # standard deviations out.
    certain = largest_clearance.BOUND / 1.084 / (1 + 2.665 * yield_design.SCATTER[NAME5])
    np.testing.assert_allclose(found.clearances[NAME5], certain, rtol=0.02)
    assert "95 % confidence" in capsys.readouterr().out


def test_static_weights_of_a_lever():
    """A driven arm of length L, its end pinned with play to a slider on a line through the hub: the slider's place by
    an offset (a, b) of the pin is a along the line and b tan(beta) across, so the weight is 1 / cos(beta) at most.
    """
    weights = design.static_weights(slider_crank(), "piston", 0.012)
    beta = np.arcsin(0.05 / 0.12)
    np.testing.assert_allclose(weights["wrist"], 1 / np.cos(beta), rtol=1e-3)


@pytest.mark.slow
def test_a_metric_without_derivative_is_designed_for_without():
    """Impacts are counted: COBYQA finds a design that has few, and its certificate does without slopes."""
    problem = asked(limits=[design.Limit(metrics.Impacts("wrist"), 50.0)])
    found = problem.solve("cobyqa", most=12)
    assert found.feasible
    assert found.program.gradients == 0
    certificate = found.verify(sweep=3)
    assert certificate.holds
    assert np.isnan(certificate.residual)


@pytest.mark.slow
@pytest.mark.parametrize("study", [allocate_slider_crank, allocate_four_bar, allocate_planar_arm])
def test_allocations(study, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    found = study.main(quick=True)
    (designed,) = found.designs.values()
    assert designed.feasible
    assert designed.active
    assert designed.program.gradients <= 15
    assert found.certificate.holds
    np.testing.assert_allclose(found.certificate.scale, 1.0, atol=1e-6)
    assert found.certificate.residual <= 1e-2
    # What play alone could do is most of the error, and not more than all of it.
    (static,) = found.certificate.static.values()
    bound = designed.specification.limits[0].bound
    assert 0.2 * bound <= static <= 1.2 * bound
    assert "the rest" in capsys.readouterr().out
    assert all(path.stat().st_size > 1000 for path in (tmp_path / "out").glob("*.png"))


@pytest.mark.slow
def test_islands_are_reported(capsys):
    found = treacherous.main(quick=True)
    assert found.docking.feasible
    assert len(found.certificate.islands) >= 2
    assert "ISLANDS" in capsys.readouterr().out
    # Between two islands the limit is violated, by a solve of its own.
    between = np.sqrt(found.certificate.islands[0][1] * found.certificate.islands[1][0])
    asked = found.docking.specification
    (metric,) = (limit.metric for limit in asked.limits)
    assert isinstance(metric, metrics.AbstractMetric)
    moved = cj.replace(asked.mechanism, {NAME: between * found.docking.clearances[NAME]})
    assert float(metric(moved, asked.t1)[0]) > treacherous.BOUND


class Place(metrics.AbstractMetric):
    """How far the pin is from where it started [m]."""

    def request(self, mechanism, t1, options):
        return Request()

    def value(self, reply):
        return jnp.abs(reply.solution.final[0])


@pytest.mark.slow
def test_a_chaotic_design_is_not_left_to_gradients():
    clearance = CHAOTIC["A2"].clearance
    problem = design.ToleranceProblem(
        scene(CHAOTIC["A2"]), 0.2, {PLAY: (0.5 * clearance, 2 * clearance)}, [design.Limit(Place(), 1.0)]
    )
    found = problem.solve("auto", most=5)
    assert found.method.name == "cobyqa"
    assert found.program.gradients == 0
    assert "Gradients are not to be trusted" in str(found)


def test_a_variable_at_its_bound_stays_on_the_scaling_line():
    """Two variables, one at its upper bound: the other goes on alone, to where the sum is the bound."""

    def evaluate(x, gradient):
        return design.Evaluation(x, float(np.sum(1 / x)), np.array([np.sum(x) - 1]))

    program = design.Program(evaluate, ["a", "b"], np.full(2, 1e-3), np.array([0.25, 10.0]), ["sum"])
    x = np.array([0.25, 0.5])
    scale = verify._scale(program, x, program.at(x))
    np.testing.assert_allclose(scale, 1.5, rtol=1e-9)
    assert verify._islands(program, x, 50)[-1][1] <= 1.5


def test_a_start_that_cannot_be_simulated_is_left():
    """Above 1 nothing can be simulated: solvers begin below, where it can."""

    def evaluate(x, gradient):
        limits = np.array([np.nan if x[0] > 1 else x[0] / 0.3 - 1])
        slopes = (np.array([-1 / x[0] ** 2]), np.array([[1 / 0.3]])) if gradient else ()
        return design.Evaluation(x, float(1 / x[0]), limits, *slopes)

    program = design.Program(evaluate, ["a"], np.array([1e-3]), np.array([100.0]), ["error"])
    assert design.run(program, "slsqp", np.array([50.0])) == ""
    assert program.best is not None
    np.testing.assert_allclose(program.best.x, 0.3, rtol=1e-8)


def test_lanes_do_not_mix_conditions(monkeypatch):
    """Conditions that set different names, one of them twice and apart."""

    def answers(question, numbers, place):
        (name,) = set(numbers) - {"x"}
        calls.append(name)
        return Answer({"0": numbers[name]}, {}, {})

    calls: list = []
    monkeypatch.setattr(evaluate, "answers", answers)
    rows = [("a", 1.0), ("a", 2.0), ("b", 3.0), ("b", 4.0), ("a", 5.0), ("a", np.nan), ("a", 7.0)]
    scenarios = [evaluate.Scenario("", {name: jnp.asarray(v)}, np.ones(1)) for name, v in rows]
    simulations = evaluate.Simulations(slider_crank(), [PEAK], [2.0], ["x"], 1.0, Settings())
    found = simulations.worst(np.ones(1), scenarios)
    np.testing.assert_allclose(found, [-0.5, 0, 0.5, 1, 1.5, np.inf, 2.5])
    assert calls == ["a", "b", "a"]

"""Designs by several models of the motion: searched by quasi-static poses, judged by the dynamics."""

import dataclasses

import numpy as np
import pytest
from catalogue import playful_servo
from numpy.testing import assert_allclose
from places import refused

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.cli.design import check_choices
from clearance_jax.design.asked import formulation
from clearance_jax.design.asked.manufacture import Neighbours
from clearance_jax.design.judge.findings import OF_DYNAMICS, _see, known_findings
from clearance_jax.design.judge.verify import expected_evaluations
from clearance_jax.design.search.model_management import MATCHED, MATCHED_VALUES
from clearance_jax.design.search.run import BY_VALUES, STILL, USELESS
from clearance_jax.design.search.scaling import StandsStill, UselessSlopes, followed, optimality
from experiments.common import SCENES
from optimize.allocate_slider_crank import BOUND, COSTS, problem

PLAY = tuple(COSTS)


@pytest.fixture(scope="module")
def asked():
    """The two pins of a loaded slider-crank over half a revolution."""
    whole = problem().specification
    return design.ToleranceProblem(
        whole.mechanism,
        0.5 * whole.t1,
        whole.variables,
        list(whole.limits),
        cost=dict(zip(PLAY, whole.costs, strict=True)),
        start="settled",
    )


@pytest.fixture(scope="module")
def single(asked):
    return asked.solve()


@pytest.fixture(scope="module")
def auto(asked):
    return asked.solve(fidelity="auto")


@pytest.mark.slow
def test_the_answer_is_the_one_of_the_dynamics(single, auto):
    assert auto.feasible
    assert auto.evaluation.fidelity == "dynamics"
    assert_allclose(auto.objective, single.objective, rtol=1e-3)
    assert optimality(auto.program, auto.evaluation)[0] <= 1e-6
    assert any("piston" in name for name in auto.active)


@pytest.mark.slow
def test_full_solves_are_few_and_counted_apart(single, auto):
    assert auto.program.gradients < single.program.gradients
    assert auto.program.evaluations == 2
    assert {point.fidelity for point in auto.program.history} == {"dynamics"}
    assert {point.fidelity for point in auto.program.cheap.history} == {"quasi-static"}
    full, poses = auto.program.gradients, auto.program.cheap.gradients
    assert f"{full} evaluations with gradients, 2 without by dynamics; {poses} evaluations" in str(auto)
    assert "by dynamics" not in str(single)


@pytest.mark.slow
def test_poses_alone_are_a_design_that_the_dynamics_judge(asked, auto):
    posed = asked.solve(fidelity="quasi-static")
    assert posed.program.cheap is None
    assert posed.evaluation.fidelity == "quasi-static"
    assert_allclose(posed.objective, auto.objective, rtol=0.1)
    assert "by quasi-static" in str(posed)
    certificate = posed.verify(sweep=2, solver="tsit5")
    assert_allclose(certificate.worst, auto.program.at(posed.evaluation.x).worst, atol=1e-5)


@pytest.mark.slow
def test_an_interrupted_search_goes_on_from_its_record(asked, auto, tmp_path):
    file, seen = tmp_path / "points.jsonl", []

    def stop(point):
        seen.append(point)
        if point.fidelity == "dynamics":
            raise KeyboardInterrupt

    cut = asked.solve(fidelity="auto", record=file, progress=stop)
    assert cut.stop_reason == "interrupted"
    assert (cut.program.gradients, cut.program.evaluations) == (0, 1)
    assert len(seen) == 1 + cut.program.cheap.gradients
    rest = asked.solve(fidelity="auto", record=file)
    assert rest.program.cheap.gradients < auto.program.cheap.gradients
    assert (rest.program.gradients, rest.program.evaluations) == (auto.program.gradients, 1)
    assert_allclose(rest.evaluation.x, auto.evaluation.x, rtol=1e-9)
    again = asked.solve(fidelity="auto", record=file)
    assert again.program.gradients == again.program.cheap.gradients == 0
    with refused(file, "option fidelity"):
        asked.solve(record=file)
    few = asked.solve(fidelity="auto", most=1)
    assert "as many evaluations as allowed" in few.stop_reason
    assert few.program.solves == 1


@pytest.mark.slow
def test_what_poses_cannot_give_is_left_to_the_dynamics(asked):
    impacts = design.ToleranceProblem(
        asked.specification.mechanism, 1e-3, {PLAY[0]: (1e-5, 1e-3)}, [design.Limit(metrics.Impacts("wrist"), 3.0)]
    )
    assert "quasi-static" in formulation.unposed(impacts.specification)
    with refused("TouchCounter"):
        impacts.solve("cobyqa", fidelity="quasi-static", most=1)
    free = design.ToleranceProblem(
        playful_servo(),
        1e-3,
        {"hip.radial_clearance": (1e-5, 1e-3)},
        [design.Limit(metrics.Peak(metrics.PositionError("tip")), 1e-3)],
        fidelity="auto",
    )
    found = free.solve(most=1)
    assert "by the dynamics alone" in found.note
    assert "moves freely" in found.note
    assert found.program.cheap is None
    with refused('fidelity = "auto"'):
        asked.solve("cobyqa", fidelity="auto")
    with refused("fidelity", "static"):
        asked.solve(fidelity="static")


@pytest.mark.slow
def test_an_unreachable_bound_is_answered_at_once(asked):
    whole = asked.specification
    peak = metrics.Peak(metrics.PositionError("piston"))
    tight = design.ToleranceProblem(
        whole.mechanism, whole.t1, whole.variables, [design.Limit(peak, 0.05 * BOUND, "piston")], start="settled"
    )
    found = tight.solve(fidelity="auto")
    assert not found.feasible
    # Values alone say so: their program is compiled sooner.
    assert found.program.gradients == 0
    assert len(found.program.history) == 1
    assert "no clearances within their bounds hold piston" in found.stop_reason
    assert "by the elasticity of the contacts alone" in found.stop_reason
    assert "Joint `" in found.stop_reason
    assert "smaller least clearances" in found.stop_reason


# Without a solve --------------------------------------------------------------------------------------------------


def power(weights, bound, noise=lambda x: 1.0, slope=1.0, **options):
    """Errors that are sums of clearances, times what a model adds; costs 1 / c."""
    weights = np.asarray(weights)

    def evaluate(x, gradient):
        error = float(weights @ x) * noise(x) / bound
        slopes = (-1 / x**2, slope * (weights * noise(x) / bound)[None]) if gradient else (None, None)
        return design.Evaluation(x, float((1 / x).sum()), np.array([error - 1]), *slopes, **word)

    word = {"fidelity": options.get("fidelity", "dynamics")}
    names = [f"c{i}" for i in range(len(weights))]
    return design.Program(evaluate, names, np.full(len(weights), 1e-3), np.ones(len(weights)), ["error"], **options)


def pair(**dear):
    cheap = power([1.0, 2.0, 1.0], 0.1, fidelity="quasi-static")
    return power([1.2, 2.5, 0.8], 0.1, cheap=cheap, **dear)


def test_model_management_finds_the_optimum_of_the_dear_model():
    program, alone = pair(), power([1.2, 2.5, 0.8], 0.1)
    assert design.run(program, MATCHED, np.full(3, 0.05)) == ""
    design.run(alone, "slsqp", np.full(3, 0.05))
    assert program.best is not None
    assert alone.best is not None
    exact = 0.1 / np.sqrt([1.2, 2.5, 0.8]) / np.sqrt([1.2, 2.5, 0.8]).sum()
    assert_allclose(program.best.x, exact, rtol=1e-6)
    assert optimality(program, program.best)[0] <= 1e-6
    assert program.gradients <= 5
    moved = program.with_bound("error", 1.1)
    assert design.run(moved, MATCHED, program.best.x) == ""
    assert moved.best is not None
    assert_allclose(moved.best.x, 1.1 * exact, rtol=1e-6)


def test_useless_slopes_are_seen_and_values_are_matched_in_their_place():
    steep = pair(slope=1e9)
    stop_reason = design.run(steep, MATCHED, np.full(3, 0.05))
    assert stop_reason.startswith(USELESS + "slopes are useless")
    assert steep.gradients == 1
    with pytest.raises(UselessSlopes, match=r"error would change 5e\+06 times"):
        followed(steep, steep.history[-1])
    assert design.run(steep, MATCHED_VALUES, np.full(3, 0.05)) == ""
    assert steep.best is not None
    assert -0.03 <= steep.best.worst <= 0
    assert_allclose(steep.best.objective, 1 / 0.1 * np.sqrt([1.2, 2.5, 0.8]).sum() ** 2, rtol=0.05)
    # Two values show what is chaotic, before any slope is asked for.
    chaotic = pair(noise=lambda x: 1 + 0.05 * np.sin(1e9 * x.sum()))
    assert "chaos" in design.run(chaotic, MATCHED, np.full(3, 0.05))
    assert chaotic.gradients == 0
    assert design.run(chaotic, MATCHED_VALUES, np.full(3, 0.05)) == ""
    assert chaotic.gradients == 0
    assert chaotic.best is not None
    assert_allclose(chaotic.best.objective, 1 / 0.1 * np.sqrt([1.2, 2.5, 0.8]).sum() ** 2, rtol=0.1)
    # A motion that fails says nothing of the difference of the models.
    fragile = pair(noise=lambda x: np.inf if x.max() > 0.02 else 1.0)
    design.run(fragile, MATCHED_VALUES, np.full(3, 0.05))
    assert fragile.best is not None
    assert fragile.best.objective < 1.5 / 0.02 + 2 / 0.01
    wrong = pair(slope=-1.0)
    assert "gained nothing of what the slopes promised" in design.run(wrong, MATCHED, np.full(3, 0.05))
    # Alone they leave the search to values.
    alone = power([1.2, 2.5, 0.8], 0.1, slope=1e9)
    said = design.run(alone, "slsqp", np.full(3, 0.05))
    # Their directions are right here: where these agree with the limit that is met, nothing need be said.
    assert said == "" or ("slopes are useless" in said and said.endswith(BY_VALUES))
    assert alone.best is not None
    assert_allclose(alone.best.objective, 1 / 0.1 * np.sqrt([1.2, 2.5, 0.8]).sum() ** 2, rtol=0.01)
    assert alone.solves < 80


def test_of_neighbours_the_largest_value_of_each_limit_counts(asked):
    among = Neighbours(samples=4)
    parts = among.parts(PLAY)
    assert [part.is_design for part in parts] == [True, False, False, False]
    assert_allclose(parts[0].factors, 1.0)
    assert 0 < np.abs(np.stack([part.factors for part in parts[1:]]) - 1).max() < 0.05
    values = np.array([[1.0, 5.0], [2.0, 3.0], [0.0, np.nan]])
    assert_allclose(among.judge(values, None)[0], [2.0, np.nan])
    wider = design.Specification(**{**vars(asked.specification), "manufacture": among, "fidelity": "auto"})
    program = design.formulate(wider)
    assert program.limit_names[0].endswith("largest of 4 neighbours")
    assert program.fidelity == "dynamics, largest of 4 neighbours"
    assert program.cheap is not None
    assert len(program.cheap.limit_names) == len(program.limit_names)
    assert program.leaders.tolist() == [0, 0, 0]


def test_a_search_that_stands_still_says_so():
    # Cost falls with clearance and no limit is met: every point is the upper corner.
    free = power([1e-6, 1e-6, 1e-6], 0.1)
    assert design.run(free, "slsqp", np.ones(3)) in ("", STILL)
    assert len(free.history) <= 2
    asked_for = design.ScaledProgram(power([1.0], 1.0), np.array([0.5]))
    asked_for.slopes(asked_for.start + 1e-13)
    with pytest.raises(StandsStill):
        asked_for.slopes(asked_for.start + 2e-13)
    assert len(asked_for.program.history) <= 2
    method = design.Method("still", _still)
    stuck = power([1e-6], 0.1)
    assert design.run(stuck, method, np.ones(1)) == STILL
    inside = power([1e-6], 0.1)
    # From inside values alone go on to the bound.
    assert design.run(inside, method, np.full(1, 0.5)) == STILL
    assert inside.best is not None
    assert_allclose(inside.best.x, 1.0)


def _still(program, start):
    scaled = design.ScaledProgram(program, start)
    for k in range(10):
        scaled.slopes(scaled.start + k * 1e-12)


def test_a_study_and_the_command_say_the_fidelity(tmp_path):
    text = (
        f'scene = "{SCENES / "slider_crank_loaded.toml"}"\n'
        't1 = "1 ms"\n[metric.piston]\nkind = "peak"\nsignal = "position-error"\npoint = "piston"\n'
        '[design]\nfidelity = "auto"\n[design.variable."wrist.radial_clearance"]\nlower = "10 um"\nupper = "1 mm"\n'
        '[design.limit.piston]\nbound = "0.1 mm"\n'
    )
    file = tmp_path / "study.toml"
    file.write_text(text)
    asked = cj.load_study(file).design
    assert asked is not None
    assert asked.problem.specification.fidelity == "auto"
    # What is said of the design wins over what is said of all motions, and that over nothing.
    solve = '[solve]\nfidelity = "quasi-static"\n'
    for said, expected in ((text + solve, "auto"), (text.replace('fidelity = "auto"\n', "") + solve, "quasi-static")):
        file.write_text(said)
        asked = cj.load_study(file).design
        assert asked is not None
        assert asked.problem.specification.fidelity == expected
    file.write_text(text.replace('"auto"', '"static"'))
    with refused("design.fidelity", "static", "auto"):
        cj.load_study(file)
    with refused("--fidelity", "static"):
        check_choices(None, "static")


@pytest.mark.slow
def test_a_report_of_poses_says_whose_pictures_it_shows(asked):
    posed = asked.solve(fidelity="quasi-static")
    found = _see(known_findings(posed))
    assert OF_DYNAMICS in found.notes
    assert found.loads
    assert all(standing.value is not None for standing in found.standings)


@pytest.mark.slow
def test_a_design_among_neighbours_is_told_as_such(asked):
    wider = dataclasses.replace(asked.specification, manufacture=Neighbours(samples=2), fidelity="auto")
    program = design.formulate(wider)
    assert design.run(program, MATCHED_VALUES, np.full(2, 1e-4)) == ""
    assert program.best is not None
    assert program.best.fidelity == "dynamics, largest of 2 neighbours"
    found = design.Design(wider, program, MATCHED_VALUES, program.best, "", "")
    assert -0.05 < found.evaluation.worst <= 0
    assert found.active
    rows = known_findings(found).standings
    assert rows[0].bound == BOUND
    (why,) = design.responses(found)
    assert why.where.endswith("by quasi-static poses")
    certificate = found.verify(sweep=2, solver="tsit5")
    assert certificate.holds
    assert np.isnan(certificate.scale)
    assert "slopes say nothing" in str(certificate)
    assert expected_evaluations(3, certificate.among, sweep=2) == 3

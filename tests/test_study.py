"""Study files, the command `clearance optimize` and its report."""

import re
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.cli.main import app, main
from clearance_jax.design import formulation
from clearance_jax.errors import ClearanceError
from clearance_jax.io.study import load_study
from clearance_jax.report.html import write_report

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "experiments" / "scenes" / "slider_crank.toml"
STUDY = f"""
name = "Wrist <pin>"
cost_unit = "EUR"
scene = "{SCENE}"
t1 = "1 ms"

[solve]
rtol = 1e-7

[verify]
sweep = 3

[variable."wrist.radial_clearance"]
least = "20 um"
greatest = "0.5 mm"
cost = {{ law = "reciprocal", factor = "0.1 mm" }}

[limit.piston]
metric = "peak"
signal = "position-error"
point = "piston"
bound = "0.1 mm"

[condition.slow]
"drive.main.speed" = "3000 rpm"
"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


def test_a_study_is_the_problem_it_says(study):
    loaded = load_study(study)
    problem = loaded.problem.specification
    assert problem.variables == {"wrist.radial_clearance": (pytest.approx(2e-5), pytest.approx(5e-4))}
    (limit,) = problem.limits
    assert limit.bound == pytest.approx(1e-4)
    assert isinstance(limit.metric, metrics.Peak)
    assert isinstance(limit.metric.signal, metrics.PositionError)
    assert limit.metric.signal.point == "piston"
    np.testing.assert_allclose(problem.conditions["slow"]["drive.main.speed"], 100 * np.pi)
    np.testing.assert_allclose(problem.costs[0](2e-5), 5.0)
    assert (problem.t1, problem.rtol, problem.solver) == (pytest.approx(1e-3), 1e-7, "tsit5")
    assert problem.cost_unit == "EUR"
    assert loaded.solve == {"method": "slsqp"}
    assert loaded.verify == {"sweep": 3}


def test_costs_limits_and_manufacture_of_a_study(tmp_path):
    def loaded(old, new):
        path = tmp_path / "s.toml"
        path.write_text(STUDY.replace(old, new))
        return load_study(path).problem.specification

    reciprocal = 'law = "reciprocal", factor = "0.1 mm"'
    squared = loaded(reciprocal, 'law = "reciprocal", factor = "4 mm^2", power = 2, fixed = 1')
    np.testing.assert_allclose(squared.costs[0](1e-3), 5.0)
    exponential = loaded(reciprocal, 'law = "exponential", factor = 3, rate = "1 / (10 um)"')
    np.testing.assert_allclose(exponential.costs[0](1e-5), 3 / np.e)
    both = loaded(reciprocal, 'law = "exponential-reciprocal", factor = "1 mm", rate = "1 / mm"')
    np.testing.assert_allclose(both.costs[0](1e-3), 1 / np.e)
    table = loaded(reciprocal, 'law = "table", clearances = ["10 um", "40 um"], costs = [9, 4]')
    np.testing.assert_allclose(table.costs[0](4e-5), 4)
    force = loaded(
        'metric = "peak"\nsignal = "position-error"\npoint = "piston"\nbound = "0.1 mm"',
        'metric = "rms"\nsignal = "contact-force"\njoint = "wrist"\nbound = "1 kN"',
    )
    assert isinstance(force.limits[0].metric, metrics.Rms)
    assert force.limits[0].bound == 1000
    reaction = loaded(
        'metric = "peak"\nsignal = "position-error"\npoint = "piston"\nbound = "0.1 mm"',
        'metric = "peak"\nsignal = "joint-reaction"\njoint = "main"\nbound = "1 kN"',
    )
    assert isinstance(reaction.limits[0].metric, metrics.Peak)
    assert reaction.limits[0].metric.signal == metrics.JointReaction("main")
    instant = loaded('metric = "peak"', 'metric = "at"\ntimes = ["0.5 ms", "1 ms"]')
    assert isinstance(instant.limits[0].metric, metrics.At)
    np.testing.assert_allclose(instant.limits[0].metric.times, [5e-4, 1e-3])
    lost = loaded(
        'metric = "peak"\nsignal = "position-error"\npoint = "piston"\nbound = "0.1 mm"',
        'metric = "energy-lost"\nbound = "1 J"',
    )
    assert lost.limits[0].metric.unit == "J"
    band = loaded("[condition.slow]", '[manufacture]\nkind = "band"\nleast = 0.8\n[condition.slow]')
    assert band.manufacture == design.Band(0.8)
    scattered = '[manufacture]\nkind = "yield"\ntarget = 0.95\nsamples = 8\n'
    scattered += '[manufacture.scatter]\n"slider.mass" = "2 percent"\n[condition.slow]'
    asked = loaded("[condition.slow]", scattered).manufacture
    assert isinstance(asked, design.Yield)
    assert (asked.scatter, asked.target, asked.samples) == ({"slider.mass": 0.02}, 0.95, 8)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('cost_unit = "EUR"', "cost_unit = 3", "cost_unit must be a text in quotes"),
        ('bound = "0.1 mm"', 'bound = "0.1 kg"', "limit.piston.bound must be in m"),
        ('bound = "0.1 mm"', 'bound = "0.1 mm"\nbond = 1', "limit.piston.bond is not a known key"),
        ('metric = "peak"', 'metric = "peek"', "Did you mean `peak`"),
        ('signal = "position-error"', 'signal = "speed"', "limit.piston.signal must be one of"),
        ('least = "20 um"', 'least = "1 mm"', "contradict"),
        ("wrist.radial_clearance", "wrist.radial_clearence", "Did you mean `wrist.radial_clearance`"),
        ('"drive.main.speed"', '"drive.main.sped"', "drive.main.sped"),
        ('"3000 rpm"', '"nan rpm"', "finite"),
        ("sweep = 3", "sweep = 0.5", "whole number"),
        ('law = "reciprocal"', 'law = "linear"', "variable.wrist.radial_clearance.cost.law"),
        ("[solve]", '[solve]\nmethod = "newton"', "solve.method must be one of"),
        (f'scene = "{SCENE}"', 'scene = "no.toml"', "Cannot read the scene file"),
        ("[verify]", '[manufacture]\nkind = "yield"\n[manufacture.scatter]\n"no" = "1 percent"\n[verify]', "`no`"),
        ("[verify]", '[made]\nkind = "band"\nleast = 0.8\n[verify]', "made is called `manufacture` now"),
    ],
)  # fmt: skip
def test_a_wrong_study_ends_with_one_sentence_and_code_2(old, new, words, study, monkeypatch, capsys):
    study.write_text(STUDY.replace(old, new))
    monkeypatch.setattr(sys, "argv", ["clearance", "optimize", str(study)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert words in message.replace("\n", " ")
    assert "Traceback" not in message


def test_every_study_of_the_repository_loads():
    studies = sorted((ROOT / "optimize" / "studies").glob("*.toml"))
    assert studies
    for path in studies:
        assert load_study(path).problem.specification.limits


@pytest.mark.slow
def test_optimize_command(study, tmp_path):
    """Answer, certificate, report and record; a second run goes on from the record."""
    report, record = tmp_path / "r.html", tmp_path / "p.jsonl"
    arguments = ["optimize", str(study), "--report", str(report), "--record", str(record)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "decided by: piston: position error, peak" in result.output
    assert " EUR" in result.output
    assert "Compiling the program that evaluates designs" in result.output
    assert "The limits hold in a fresh simulation" in result.output
    assert re.search(r"Verifying by another solver: some 20 evaluations, about \d+ (s|min)", result.output)
    page = report.read_text()
    assert "Wrist &lt;pin&gt;" in page
    for words in ("For the drawing", "Ø 20 mm", "Loads of the joints", "Path of the pin", "EUR"):
        assert words in page
    assert page.count("<svg") == 6  # mechanism, path, history, contributions, trade-off, convergence
    assert not re.search(r'(src|href)="(?!#)', page)  # needs nothing else
    # The numbers are the solver's, here by a solve of its own.
    (allowed,) = re.findall(r'"largest allowed"><span>([0-9.]+) µm<', page)
    mechanism = cj.replace(
        cj.load(SCENE), {"wrist.radial_clearance": 1e-6 * float(allowed), "drive.main.speed": 100 * np.pi}
    )
    error = metrics.Peak(metrics.PositionError("piston"))(mechanism, 1e-3, rtol=1e-7)
    np.testing.assert_allclose(error, 1e-4, rtol=1e-4)
    again = ["optimize", str(study), "--record", str(record), "--no-verify", "--cluster", "local"]
    again = CliRunner().invoke(app, again)
    assert again.exit_code == 0, again.output
    assert "0 evaluations with gradients, 0 without" in again.output


def test_an_interrupted_search_keeps_its_best(study, monkeypatch):
    def interrupted(specification, x, gradient, scenarios, simulations):
        calls.append(x)
        if len(calls) > 2:
            raise KeyboardInterrupt
        return design.Evaluation(x, float(1 / x[0]), np.full(3, -0.5), -1 / x**2, np.zeros((3, 1)))

    calls: list = []
    monkeypatch.setattr(formulation, "_evaluate", interrupted)
    result = CliRunner().invoke(app, ["optimize", str(study)])
    assert result.exit_code == 130
    assert "interrupted" in result.output
    assert "wrist.radial_clearance = " in result.output


class Pressed:
    """Ctrl-C where an exception is forgotten."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def test_an_interruption_that_python_forgets_is_not_lost(study, monkeypatch):
    def evaluated(specification, x, gradient, scenarios, simulations):
        calls.append(x)
        if len(calls) == 2:
            Pressed()
        return design.Evaluation(x, float(1 / x[0]), np.full(3, -0.5), -1 / x**2, np.zeros((3, 1)))

    calls: list = []
    monkeypatch.setattr(formulation, "_evaluate", evaluated)
    before = signal.getsignal(signal.SIGINT), sys.unraisablehook
    result = CliRunner().invoke(app, ["optimize", str(study)])
    assert result.exit_code == 130
    assert "interrupted" in result.output
    assert len(calls) == 2
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == before


def test_an_interruption_before_the_first_design_is_said(study, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(formulation, "_evaluate", interrupted)
    result = CliRunner().invoke(app, ["optimize", str(study)])
    assert result.exit_code == 130
    assert "nothing to keep" in result.output


def test_infeasible_designs_report_what_is_violated(study, tmp_path):
    asked = load_study(study).problem.specification

    def evaluate(x, gradient):
        return design.Evaluation(x, 1.0, np.array([0.5]), np.zeros(1), np.zeros((1, 1)))

    program = design.Program(evaluate, asked.names, np.array([1e-5]), np.array([1e-3]), ["piston"])
    point = program.at(np.array([1e-4]), True)
    answer = design.Design(asked, program, design.METHODS["slsqp"], point, "", "")
    found = design.findings(answer)
    assert "No design holds every limit" in found.notes[0]
    write_report(found, tmp_path / "r.html")
    assert "No feasible design: piston is 1.5 times its bound" in (tmp_path / "r.html").read_text()
    with pytest.raises(ClearanceError, match="Cannot write the report"):
        write_report(found, tmp_path / "missing" / "r.html")

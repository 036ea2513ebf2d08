"""Studies of designs, `clearance run` of them, and the report."""

import io
import re
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import ROOT, refused
from rich.console import Console
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.cli.main import app, main
from clearance_jax.cli.pace import ProgressDisplay
from clearance_jax.design.asked import formulation
from clearance_jax.io.study.study import load_study
from clearance_jax.report.html import write_report

SCENE = ROOT / "experiments" / "scenes" / "slider_crank.toml"
STUDY = f"""
name = "Wrist <pin>"
scene = "{SCENE}"
t1 = "1 ms"

[solve]
rtol = 1e-7

[metric.piston]
kind = "peak"
signal = "position-error"
point = "piston"

[design]
cost_unit = "EUR"

[design.verify]
sweep = 3

[design.variable."wrist.radial_clearance"]
lower = "20 um"
upper = "0.5 mm"
cost = {{ law = "reciprocal", factor = "0.1 mm" }}

[design.limit.piston]
bound = "0.1 mm"

[design.condition.slow]
"drive.main.speed" = "3000 rpm"
"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


def test_a_study_is_the_problem_it_says(study):
    loaded = load_study(study).design
    assert loaded is not None
    problem = loaded.problem.specification
    assert problem.variables == {"wrist.radial_clearance": (pytest.approx(2e-5), pytest.approx(5e-4))}
    (limit,) = problem.limits
    assert limit.bound == pytest.approx(1e-4)
    assert isinstance(limit.metric, metrics.Peak)
    assert isinstance(limit.metric.signal, metrics.PositionError)
    assert limit.metric.signal.point == "piston"
    np.testing.assert_allclose(problem.conditions["slow"]["drive.main.speed"], 100 * np.pi)
    np.testing.assert_allclose(problem.costs[0](2e-5), 5.0)
    assert (problem.t1, problem.rtol, problem.solver) == (pytest.approx(1e-3), 1e-7, "dopri8")
    assert problem.cost_unit == "EUR"
    assert loaded.solve == {"method": "slsqp"}
    assert loaded.verify == {"sweep": 3}


def specified(path: Path) -> Any:
    """What the design of a study is to be."""
    asked = load_study(path).design
    assert asked is not None
    return asked.problem.specification


def test_costs_limits_and_manufacture_of_a_study(tmp_path):
    def loaded(*changes: tuple[str, str]):
        path, text = tmp_path / "s.toml", STUDY
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
        return specified(path)

    reciprocal = 'law = "reciprocal", factor = "0.1 mm"'
    squared = loaded((reciprocal, 'law = "reciprocal", factor = "4 mm^2", power = 2, fixed = 1'))
    np.testing.assert_allclose(squared.costs[0](1e-3), 5.0)
    exponential = loaded((reciprocal, 'law = "exponential", factor = 3, rate = "1 / (10 um)"'))
    np.testing.assert_allclose(exponential.costs[0](1e-5), 3 / np.e)
    both = loaded((reciprocal, 'law = "exponential-reciprocal", factor = "1 mm", rate = "1 / mm"'))
    np.testing.assert_allclose(both.costs[0](1e-3), 1 / np.e)
    table = loaded((reciprocal, 'law = "table", clearances = ["10 um", "40 um"], costs = [9, 4]'))
    np.testing.assert_allclose(table.costs[0](4e-5), 4)
    metric = 'kind = "peak"\nsignal = "position-error"\npoint = "piston"'

    def limited(new, bound):
        (limit,) = loaded((metric, new), ('bound = "0.1 mm"', f"bound = {bound}")).limits
        return limit

    force = limited('kind = "rms"\nsignal = "contact-force"\njoint = "wrist"', '"1 kN"')
    assert isinstance(force.metric, metrics.Rms)
    assert force.bound == 1000
    reaction = limited('kind = "peak"\nsignal = "joint-reaction"\njoint = "main"', '"1 kN"')
    assert isinstance(reaction.metric, metrics.Peak)
    assert reaction.metric.signal == metrics.JointReaction("main")
    instant = limited(metric.replace('"peak"', '"at"\ntimes = ["0.5 ms", "1 ms"]'), '"0.1 mm"')
    assert isinstance(instant.metric, metrics.At)
    np.testing.assert_allclose(instant.metric.times, [5e-4, 1e-3])
    assert limited('kind = "energy-lost"', '"1 J"').metric.unit == "J"
    band = loaded(("[design.verify]", '[design.manufacture]\nkind = "band"\nleast = 0.8\n[design.verify]'))
    assert band.manufacture == design.Band(0.8)
    scattered = '[scatter."slider.mass"]\ndeviation = "2 percent"\n[design.manufacture]\nkind = "yield"\n'
    scattered += "target = 0.95\nsamples = 8\n[design.condition.slow]"
    asked = loaded(("[design.condition.slow]", scattered)).manufacture
    assert isinstance(asked, design.Yield)
    assert (asked.scatter, asked.target, asked.samples) == ({"slider.mass": 0.02}, 0.95, 8)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('cost_unit = "EUR"', "cost_unit = 3", "cost_unit must be a text in quotes"),
        ('bound = "0.1 mm"', 'bound = "0.1 kg"', "limit.piston.bound must be in m"),
        ('bound = "0.1 mm"', 'bound = "0.1 mm"\nbond = 1', "limit.piston.bond is not a known key"),
        ('kind = "peak"', 'kind = "peek"', "Did you mean `peak`"),
        ('kind = "peak"', 'metric = "peak"', "metric.piston.metric is called `kind` now"),
        ('signal = "position-error"', 'signal = "speed"', "metric.piston.signal must be one of"),
        ("[metric.piston]", "[metric.pistn]", "the study has no metric `piston`. Did you mean `pistn`"),
        ('lower = "20 um"', 'lower = "1 mm"', "contradict"),
        ('lower = "20 um"', 'least = "20 um"', "least is called `lower` now"),
        ("wrist.radial_clearance", "wrist.radial_clearence", "Did you mean `wrist.radial_clearance`"),
        ('"drive.main.speed"', '"drive.main.sped"', "drive.main.sped"),
        ('"3000 rpm"', '"nan rpm"', "finite"),
        ("sweep = 3", "sweep = 0.5", "whole number"),
        ('law = "reciprocal"', 'law = "linear"', "variable.wrist.radial_clearance.cost.law"),
        ("[design]", '[design]\nmethod = "newton"', "design.method must be one of"),
        ("[solve]", '[solve]\nmethod = "slsqp"', "solve.method is called `design.method` now"),
        (f'scene = "{SCENE}"', 'scene = "no.toml"', "Cannot read the scene file"),
        ("[design]", '[design.manufacture]\nkind = "yield"\nof = ["no"]\n[design]', "`no` does not scatter"),
        ("[design]", '[manufacture]\nkind = "band"\nleast = 0.8\n[design]', "is called `design.manufacture` now"),
        ("[design]", '[limit.piston]\nbound = "1 mm"\n[design]', "limit is called `design.limit` now"),
        ("[design]", '[axis."slider.mass"]\nkind = "values"\n[design]', "axis is called `sweep.axis` now"),
        ("[design.verify]", "until = 3\n[design.verify]", "design.until is not a known key"),
    ],
)  # fmt: skip
def test_a_wrong_study_ends_with_one_sentence_and_code_2(old, new, words, study, monkeypatch, capsys):
    study.write_text(STUDY.replace(old, new))
    monkeypatch.setattr(sys, "argv", ["clearance", "run", str(study)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert words in message.replace("\n", " ")
    assert "Traceback" not in message


@pytest.mark.slow
def test_every_study_of_the_repository_loads():
    studies = sorted((ROOT / "optimize" / "studies").glob("*.toml"))
    assert studies
    for path in studies:
        assert specified(path).limits


@pytest.mark.slow
def test_optimize_command(study, tmp_path):
    """Answer, certificate, report and record; a second run goes on from the record."""
    report, record = tmp_path / "r.html", tmp_path / "p.jsonl"
    arguments = ["run", str(study), "--report", str(report), "--record", str(record), "--tradeoff"]
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
    # Mechanism, path, when the pin bears, history, contributions, trade-off, convergence.
    assert page.count("<svg") == 7
    assert not re.search(r'(src|href)="(?!#)', page)  # needs nothing else
    # The numbers are the solver's, here by a solve of its own.
    (allowed,) = re.findall(r'"largest allowed"><span>([0-9.]+) µm<', page)
    mechanism = cj.replace(
        cj.load(SCENE), {"wrist.radial_clearance": 1e-6 * float(allowed), "drive.main.speed": 100 * np.pi}
    )
    error = metrics.Peak(metrics.PositionError("piston"))(mechanism, 1e-3, rtol=1e-7)
    np.testing.assert_allclose(error, 1e-4, rtol=1e-4)
    kept = record.read_bytes()
    again = ["run", str(study), "--record", str(record), "--no-verify", "--tradeoff", "--cluster", "local"]
    again = CliRunner().invoke(app, again)
    assert again.exit_code == 0, again.output
    assert "0 evaluations with gradients, 0 without" in again.output
    assert record.read_bytes() == kept  # nor did the trade-off solve anything


def test_an_interrupted_search_keeps_its_best(study, monkeypatch):
    def interrupted(specification, x, gradient, scenarios, simulations):
        calls.append(x)
        if len(calls) > 2:
            raise KeyboardInterrupt
        return design.Evaluation(x, float(1 / x[0]), np.full(3, -0.5), -1 / x**2, np.zeros((3, 1)))

    calls: list = []
    monkeypatch.setattr(formulation, "_evaluate", interrupted)
    result = CliRunner().invoke(app, ["run", str(study)])
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
    result = CliRunner().invoke(app, ["run", str(study)])
    assert result.exit_code == 130
    assert "interrupted" in result.output
    assert len(calls) == 2
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == before


def test_an_interruption_before_the_first_design_is_said(study, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(formulation, "_evaluate", interrupted)
    result = CliRunner().invoke(app, ["run", str(study)])
    assert result.exit_code == 130
    assert "nothing to keep" in result.output


def proportional(calls):
    """In the place of simulations: an error that is the clearance, of a bound of 0.1 mm."""

    def evaluated(specification, x, gradient, scenarios, simulations):
        calls.append(float(x[0]))
        limits = np.array([x[0] / 1e-4 - 1, -0.5, -0.5])
        return design.Evaluation(x, float(1e-4 / x[0]), limits, -1e-4 / x**2, np.array([[1e4], [0.0], [0.0]]))

    return evaluated


def test_a_trade_off_begins_with_the_answer_and_goes_on_from_the_record(study, tmp_path, monkeypatch):
    """Its own bound is not searched again, an interrupted one goes on, and one that is done solves nothing."""
    calls, said = [], []
    monkeypatch.setattr(formulation, "_evaluate", proportional(calls))
    record = tmp_path / "p.jsonl"
    asked: Any = load_study(study).design
    answer = asked.problem.solve(record=record)
    np.testing.assert_allclose(answer.evaluation.x, 1e-4, rtol=1e-6)

    def interrupt(text):
        said.append(text)
        if text.startswith("trade-off, bound 2 of 2") and text.endswith("designs"):
            raise KeyboardInterrupt

    before = len(calls)
    with pytest.raises(KeyboardInterrupt):
        design.tradeoff(answer, factors=(0.8, 1.0, 1.25), progress=interrupt)
    assert [text for text in said if "designs" not in text] == [
        "trade-off, bound 1 of 2 (0.8 times)",
        "trade-off, bound 2 of 2 (1.25 times)",
    ]
    first, asked = len(calls) - before, len(calls)
    found = design.tradeoff(answer, factors=(0.8, 1.0, 1.25))
    np.testing.assert_allclose(found.objectives, [1 / 0.8, 1.0, 0.8], rtol=1e-6)
    np.testing.assert_allclose(found.bounds, [0.8e-4, 1e-4, 1.25e-4])
    assert len(set(calls[asked:]) & set(calls[before:asked])) == 0
    assert first > 0
    done = len(calls)
    asked: Any = load_study(study).design
    again = asked.problem.solve(record=record)
    np.testing.assert_array_equal(design.tradeoff(again, factors=(0.8, 1.0, 1.25)).objectives, found.objectives)
    assert len(calls) == done
    assert answer.program.history[-1].x[0] == pytest.approx(1e-4, rel=1e-3)  # the answer's own search is as it was
    assert "bound 80 um: cost 1.25, wrist.radial_clearance = 80 um" in str(found)
    with refused("factors"):
        design.tradeoff(answer, factors=(-1.0,))


def test_a_trade_off_is_made_on_request_only(study, monkeypatch):
    """By the study or the command line; without a terminal every phase is a line."""
    monkeypatch.setattr(formulation, "_evaluate", proportional([]))
    plain = CliRunner().invoke(app, ["run", str(study), "--no-verify"])
    assert plain.exit_code == 0, plain.output
    assert "search: compiling" in plain.output
    assert "rade-off" not in plain.output
    asked = CliRunner().invoke(app, ["run", str(study), "--no-verify", "--tradeoff"])
    assert "trade-off, bound 7 of 7 (2 times)" in asked.output
    assert "Trade-off of piston: position error:" in asked.output
    study.write_text(STUDY + "[design.tradeoff]\nfactors = [0.8, 1]\n")
    asked = CliRunner().invoke(app, ["run", str(study), "--no-verify"])
    assert "trade-off, bound 1 of 1 (0.8 times)" in asked.output
    study.write_text(STUDY + '[design.tradeoff]\nlimit = "no"\n')
    asked = CliRunner().invoke(app, ["run", str(study)])
    assert "there is no limit" in str(asked.exception)


def test_where_there_is_no_terminal_progress_is_plain_lines():
    text = io.StringIO()
    with ProgressDisplay(Console(file=text, force_terminal=False), every=0.01) as shown:
        shown.phase("search")
        shown.update("search: 3 designs")
        deadline = time.monotonic() + 30
        while "3 designs (0 s)" not in text.getvalue() and time.monotonic() < deadline:
            time.sleep(0.01)
    lines = text.getvalue().splitlines()
    assert lines[0] == "search"
    assert lines[-1] == "search: 3 designs (0 s)"
    alive = io.StringIO()
    with ProgressDisplay(Console(file=alive, force_terminal=True, width=80)) as shown:
        shown.phase("judge")
    assert "judge" in alive.getvalue()
    assert "(0 s)" not in alive.getvalue()


@pytest.mark.slow
def test_infeasible_designs_report_what_is_violated(study, tmp_path):
    asked = specified(study)

    def evaluate(x, gradient):
        return design.Evaluation(x, 1.0, np.array([0.5]), np.zeros(1), np.zeros((1, 1)))

    program = design.Program(evaluate, asked.names, np.array([1e-5]), np.array([1e-3]), ["piston"])
    point = program.at(np.array([1e-4]), True)
    answer = design.Design(asked, program, design.METHODS["slsqp"], point, "", "")
    found = design.findings(answer)
    assert "No design holds every limit" in found.notes[0]
    write_report(found, tmp_path / "r.html")
    assert "No feasible design: piston is 1.5 times its bound" in (tmp_path / "r.html").read_text()
    with refused(tmp_path / "missing" / "r.html"):
        write_report(found, tmp_path / "missing" / "r.html")

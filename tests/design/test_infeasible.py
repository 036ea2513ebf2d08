"""A design that holds nothing says why, and what would help; a command that is stopped keeps what it has."""

from typing import Any

import numpy as np
import pytest
from places import refused
from scipy.optimize import brentq
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.cli.main import app
from clearance_jax.design.search import infeasible
from clearance_jax.design.search.infeasible import why_infeasible
from clearance_jax.units import format_quantity
from experiments.common import SCENES
from optimize.allocate_slider_crank import problem

END = 2e-3


def small(bound, **options):
    """The pins of a loaded slider-crank for two milliseconds."""
    whole = problem().specification
    costs = dict(zip(whole.variables, whole.costs, strict=True))
    limit = design.Limit(metrics.Peak(metrics.PositionError("piston")), bound, "piston")
    options = {"start": "settled"} | options
    return design.ToleranceProblem(whole.mechanism, END, whole.variables, [limit], cost=costs, **options)


@pytest.fixture(scope="module")
def hopeless():
    return small(5e-6).solve()


@pytest.mark.slow
def test_an_impossible_bound_names_the_joint_and_what_would_help(hopeless):
    said = str(hopeless)
    assert said.startswith("NO FEASIBLE DESIGN: piston")
    assert "not held: piston" in said
    assert "no clearances within their bounds hold piston" in hopeless.stop_reason
    assert "by quasi-static poses" in hopeless.stop_reason
    assert "without any clearance, by the elasticity of the contacts alone" in hopeless.stop_reason
    assert "Joint `wrist` contributes most" in hopeless.stop_reason
    assert "a longer sleeve, a larger pin" in hopeless.stop_reason
    # The nearest design is kept.
    assert np.allclose(hopeless.evaluation.x, 1e-5)


@pytest.mark.slow
def test_a_motion_without_an_end_says_why():
    found = small(2e-4, max_steps=20).solve(most=3)
    assert not found.feasible
    assert "is not a number" in str(found)
    why = why_infeasible(found.specification, found.program)
    assert why.startswith("none of ")
    assert "the largest number of steps was reached" in why


@pytest.mark.slow
def test_an_error_that_is_motion_is_told_from_play(hopeless, monkeypatch):
    """Poses that hold the bound where the dynamics do not."""

    class Cheap:
        def at(self, x, gradient):
            return hopeless.program.at(x, gradient)._replace(limits=np.full(3, -0.5))

    monkeypatch.setattr(infeasible, "formulate", lambda specification: Cheap())
    why = why_infeasible(hopeless.specification, hopeless.program)
    assert "but 0.5 times by quasi-static poses: what is left is motion" in why
    assert "damping or a preload" in why


def test_a_singular_posture_is_named(hopeless, monkeypatch):
    class Cheap:
        def at(self, x, gradient):
            return hopeless.program.at(x, gradient)._replace(limits=np.full(3, np.nan))

    monkeypatch.setattr(infeasible, "formulate", lambda specification: Cheap())
    monkeypatch.setattr(infeasible, "_ending", lambda specification, mechanism: "a loop cannot be closed")
    why = why_infeasible(hopeless.specification, hopeless.program)
    assert "its quasi-static motion has no end: a loop cannot be closed. Near a singular posture" in why


# Without a solve ---------------------------------------------------------------------------------------------------


def searched(limits, points):
    """A program with limits of one variable that was evaluated at some points."""

    def evaluate(x, gradient):
        values = np.array([of(float(x[0])) for of in limits.values()])
        slopes = np.array([[(of(1.001 * x[0]) - of(x[0])) / (1e-3 * x[0])] for of in limits.values()])
        return design.Evaluation(x, float(1 / x[0]), values, -1 / x**2, slopes)

    program = design.Program(evaluate, ["c"], np.array([1e-3]), np.array([1.0]), list(limits))
    for point in points:
        program.at(np.array([point]), True)
    return program


def test_limits_that_contradict_each_other_are_named():
    program = searched({"error": lambda c: c / 0.1 - 1, "force": lambda c: 0.3 / c - 1}, (0.05, 0.2, 0.5))
    why = why_infeasible(small(1e-4).specification, program)
    assert "no design holds all of them: they contradict each other" in why
    assert "`error`, `force`" in why


def test_what_the_evaluated_designs_say():
    asked = small(1e-4).specification
    stiff = searched({"force": lambda c: 9.0 + 0.01 * c}, (0.05, 0.2, 0.5))
    assert "none has force below 10 times its bound, and by what they change no variables will" in why_infeasible(
        asked, stiff
    )
    falling = searched({"force": lambda c: 2.0 / c - 1}, (0.05, 0.2, 0.5))
    assert "A larger `c` helps most" in why_infeasible(asked, falling)


@pytest.mark.parametrize("few", [0, 5])
def test_a_drive_that_gives_way_too_far_is_named(few, monkeypatch):
    """A held arm: the drive's elasticity alone exceeds the bound; values alone say so, and values with derivatives."""
    monkeypatch.setattr(infeasible, "FEW", few)
    hub = cj.Revolute("hub", "ground", "wheel", motion=cj.Motion(cj.drives.Constant(0.4)))
    arm = cj.Mechanism(
        bodies=(cj.Body("wheel", 4.0, 0.03, cj.Position(0.3)),),
        joints=(hub,),
        gravity=cj.Gravity(0.0, -9.81),
        points=(cj.Point("tip", "wheel", cj.Position(0.6)),),
    )
    arm = cj.with_compliance(arm, "hub", cj.Compliance(500.0, 1.0, backlash=1e-2))
    limit = design.Limit(metrics.Peak(metrics.PositionError("tip")), 0.01, "tip")
    asked = design.ToleranceProblem(arm, 0.05, {"hub.backlash": (2e-3, 2e-2)}, [limit], start="settled")
    found = asked.solve()
    assert not found.feasible
    assert "no backlash within its bounds holds tip" in found.stop_reason
    # k x = m g l cos(0.4 + x) on the flank that bears the load.
    sag: list[Any] = [
        brentq(lambda x, b=b: 500 * (x + b / 2) + 4 * 9.81 * 0.3 * np.cos(0.4 + x), -1.0, 0.0) for b in (2e-3, 0.0)
    ]
    loose, bare = (format_quantity(1.2 * np.sin(-x / 2), "m", 3) for x in sag)
    assert f"At the least it is {loose} of at most 10 mm; by quasi-static poses {loose}" in found.stop_reason
    assert f"and {bare} without any backlash, by the elasticity of the drives alone" in found.stop_reason
    assert "Drive `hub` contributes most" in found.stop_reason
    assert "a stiffer drive there helps, or a looser bound." in found.stop_reason


STUDY = f"""
scene = "{SCENES / "slider_crank_loaded.toml"}"
t1 = "2 ms"
solve = {{ start = "settled" }}
[metric.piston]
kind = "peak"
signal = "position-error"
point = "piston"
[design.variable."wrist.radial_clearance"]
lower = "10 um"
upper = "100 um"
cost = {{ law = "reciprocal", factor = "0.1 mm" }}
classes = ["H7/g6", "H7/f7", "H8/e8"]
[design.variable."crankpin.radial_clearance"]
lower = "10 um"
upper = "100 um"
cost = {{ law = "reciprocal", factor = "0.2 mm" }}
classes = ["H7/g6", "H7/f7", "H8/e8"]
[design.limit.piston]
bound = "0.08 mm"
"""


@pytest.mark.slow
def test_a_command_that_is_stopped_at_any_stage_keeps_what_it_has(tmp_path, monkeypatch):
    file, record = tmp_path / "study.toml", tmp_path / "points.jsonl"
    file.write_text(STUDY)
    asked = ["run", str(file), "--record", str(record), "--no-verify"]
    note, seen, stop = design.Program._note, [], 0

    def noted(self, point):
        found = note(self, point)
        seen.append(point)
        if len(seen) == stop:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(design.Program, "_note", noted)
    whole = CliRunner().invoke(app, asked)
    assert whole.exit_code == 0, whole.output
    solves = len(record.read_text().splitlines()) - 1
    for at in (2, solves - 1):
        record.unlink()
        seen.clear()
        stop = at
        cut = CliRunner().invoke(app, asked)
        assert cut.exit_code == 130
        assert "interrupted" in cut.output
        assert "wrist.radial_clearance = " in cut.output
        stop = 0
        rest = CliRunner().invoke(app, asked)
        assert rest.exit_code == 0
        assert answer(rest) == answer(whole)
        assert len(record.read_text().splitlines()) - 1 == solves


def answer(result):
    """What a command says of its clearances and their cost."""
    lines = [line.strip() for line in result.output.splitlines()]
    return [line for line in lines if "_clearance = " in line or line.startswith("cost ")]


def test_contradictory_bounds_are_refused_before_a_solve(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(STUDY.replace('upper = "100 um"', 'upper = "5 um"', 1))
    with refused("design.variable.wrist.radial_clearance", pytest.approx(5e-6)):
        cj.load_study(file)
    file.write_text(STUDY.replace('upper = "100 um"', 'upper = "11 um"', 1))
    with refused("wrist.radial_clearance") as caught:
        cj.load_study(file)
    assert "within the variable's bounds" in str(caught.value)

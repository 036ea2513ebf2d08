"""Every experiment runs in its quick mode, and shows there what it is for."""

import importlib

import numpy as np
import pytest

import clearance_jax as cj
from experiments import (
    batches,
    bifurcation,
    contact_laws,
    cores,
    first_results,
    forward_dynamics,
    gpu,
    paper_sweeps,
    publish,
    quasi_static,
    robots,
    scalar,
    settled_starts,
    sweeps,
    wear_jumps,
    wear_kills,
    work_precision,
)
from experiments.hard import __main__ as hard
from experiments.hard import crank, pin, rubbing, several
from experiments.hard.case import Solved, examine


@pytest.fixture(autouse=True)
def elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def test_a_run_that_is_broken_off_leaves_what_it_found(tmp_path, monkeypatch):
    for name, value in {"PAGES": tmp_path, "found": [], "drawn": [], "pages": [], "commit": lambda: "abc"}.items():
        monkeypatch.setattr(publish, name, value)
    monkeypatch.setattr("sys.argv", ["some", "--save"])

    def broken_off(quick):
        publish.say("first")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        publish.command(broken_off, "Some: `python -m experiments.some`.")
    left = (tmp_path / "some.md").read_text(encoding="utf-8")
    assert "first" in left
    assert publish.UNENDED in left
    publish.pages.clear()
    publish.command(lambda quick: publish.say("second"), "Some: `python -m experiments.some`.")
    whole = (tmp_path / "some.md").read_text(encoding="utf-8")
    assert "second" in whole
    assert publish.UNENDED not in whole


def test_work_precision(tmp_path):
    points = work_precision.main(quick=True)
    ours = [p for p in points if p.tool in work_precision.SOLVERS]
    assert {p.rtol for p in ours} == {1e-5, 1e-8}
    assert all(p.error <= 3000 * p.rtol for p in ours)
    assert {"scipy odeint + numba", "numba DOP853"} <= {p.tool for p in points}
    assert (tmp_path / "out" / "work_precision_quick.png").stat().st_size > 10_000
    assert "tsit5, no events" in (tmp_path / "out" / "work_precision_quick.md").read_text()


def test_contact_laws(tmp_path):
    biases = contact_laws.main(quick=True)
    assert all(0 < bias < contact_laws.RTOL for bias in biases.values())
    assert "| tsuji, 0.7 | 0.7000 " in (tmp_path / "out" / "contact_laws_speeds_quick.md").read_text()


# Cases that share a compiled program; the others run in full only, by the command.
HARD = {
    "joint5": rubbing.CASES[:1] + rubbing.CASES[2:3],
    "slider-crank": (crank.tiny_clearance,),
    "pin": (pin.chattering, pin.bouncing, pin.slow_hour),
    "two-joints": (several.two,),
}


@pytest.mark.parametrize("group", HARD)
def test_hard_cases(group):
    rows = hard.main(quick=True, cases=HARD[group])
    assert [row.broken for row in rows] == [()] * len(rows)
    # Impacts amplify; an error that does not fall with the tolerance is a floor.
    assert all(row.falls for row in rows)


def test_a_hard_case_says_which_bound_it_breaks():
    solution = cj.simulate(pin.pin(pin.laws.Hertz(1e9), 1e-3), 1e-3, throw=False, max_steps=2)
    row = examine("wrong", 4, lambda rtol: Solved(solution, 1e-2), "", checks=[("a contact is lost", False)])
    assert len(row.broken) == 7
    assert row.broken[0] == "max steps at rtol 1e-06"
    assert "error 1.0e-02 at rtol 1e-08 (allowed 3.0e-05)" in row.broken
    assert row.broken[-1] == "a contact is lost"
    assert not row.falls
    assert "NOT PASSED: max steps" in hard.cells(row)[8]
    assert "0 of 1 cases pass. The error falls with rtol in 0 of the 1" in hard.summary([row])


def test_batches():
    assert batches.main(quick=True) <= 10


def test_lanes_beside_scalar_c():
    assert scalar.main(quick=True) <= 1e-4


def test_robots_against_newton_and_euler():
    fixed, free = robots.main(quick=True)
    assert (fixed.coordinates, free.coordinates) == (8, 14)
    for row in (fixed, free):
        assert set(row.errors) == set(robots.COMPARED)
        assert max(row.errors.values()) <= 1e-12


def test_articulated_bodies_agree_with_composite_ones():
    rows = forward_dynamics.main(quick=True)
    assert [row.program.split()[0] for row in rows] == ["composite", "articulated", "articulated"]
    assert max(row.error for row in rows) <= 1e-10


def test_quasi_static():
    rows = quasi_static.main(quick=True)
    assert len(rows) == 6
    assert {row.damped for row in rows} == {True, False}
    assert not any(quasi_static.broken(row) for row in rows)
    # What was measured is read and not measured again.
    assert quasi_static.main(quick=True) == rows


def test_settled_starts():
    rows = settled_starts.main(quick=True)
    assert [row.case.from_rest for row in rows] == [True, False] * 2
    for row in rows:
        assert row.broken == []
        assert float(row.found.residual) < 1e-6
        # One that moves faster than allowed is told.
        assert "2 pi f r" in row._replace(of_limit=1.5).broken[0]
    assert "from rest" in rows[0]._replace(speed=0.06).broken[0]
    assert rows[1]._replace(speed=0.06).broken == []
    assert "force" in rows[1]._replace(force=6.0).broken[0]


def test_the_largest_displacement_of_a_tool_by_a_sleeve():
    """Beyond the sleeve's end it is 2 c lever / length, with the pin's ends at opposite walls; within, c."""
    mechanism = cj.load(settled_starts.SCENES / "arm_with_play.toml")
    moves = np.zeros((3, 12))
    # Along x with the pin of axis 5, whose tilt about its y moves it by 0.3 m.
    moves[0, 8], moves[0, 11] = 1.0, 0.3
    found = settled_starts.largest_displacement(mechanism, moves)
    assert found == pytest.approx(20e-6 * 2 * 0.3 / 0.04, rel=1e-3)
    # Within the sleeve the tool is never further off than the clearance.
    moves[0, 11] = 0.01
    assert settled_starts.largest_displacement(mechanism, moves) == pytest.approx(20e-6, rel=1e-3)


def test_first_results(monkeypatch):
    monkeypatch.delenv("CLEARANCE_KEPT", raising=False)
    cold, kept = first_results.main(quick=True)
    assert (cold.case, cold.task, cold.state, kept.state) == ("slider-crank", "simulate", "cold", "kept")
    # The second process adds nothing: it finds all that the first one kept.
    assert kept.files == cold.files >= 6
    assert min(cold.cpu, kept.cpu) > 0.1
    assert min(cold.memory, kept.memory) > 100


@pytest.mark.optimised
def test_lanes_over_cores():
    found = {(row.lanes, row.order): row.efficiency for row in cores.main(quick=True)}
    for lanes in {lanes for lanes, _ in found}:
        known = found[lanes, "by their true costs"]
        assert all(found[lanes, order] <= known <= 1 for other, order in found if other == lanes)
    assert found["the same, shuffled", "learned"] > found["the same, shuffled", "as they come"]


def test_gpu_with_the_cpu_in_its_place(tmp_path):
    (row,) = gpu.main(quick=True)
    *_, median, largest, slopes = row
    assert float(median) <= float(largest) <= 1e-5
    assert float(slopes) <= 1e-2
    assert (tmp_path / "out" / "gpu_quick.md").exists()


def test_without_a_gpu_nothing_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(gpu, "device_of", lambda quick: None)
    assert gpu.main() == []
    assert capsys.readouterr().out.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_sweeps(monkeypatch):
    run = importlib.import_module("clearance_jax.sweep.run")
    monkeypatch.setattr(run, "LEAST", run.LEAST)  # the experiment makes regions small, for itself
    monkeypatch.setattr(run, "CHUNKS_A_CORE", run.CHUNKS_A_CORE)
    partial = importlib.import_module("clearance_jax.runs.partial")
    monkeypatch.setattr(partial, "PATIENCE", partial.PATIENCE)
    found = sweeps.main(quick=True)
    assert {row.way for row in found.rates} == {"`batch`", "`sweep`", "`sweep`, one core", "`sweep` into a store"}
    assert all(duel.sweep.error <= duel.error and duel.rival.error <= duel.error for duel in found.duels)
    assert "scipy odeint" in {duel.rival.program for duel in found.duels}
    sizes = list(found.memory.values())
    assert 0 < sizes[0] < sizes[-1]
    assert found.kills == (2, 2, 0, True)


@pytest.mark.optimised
def test_jumps_over_cycles():
    (row,) = wear_jumps.main(quick=True)
    assert row.evaluations < 8
    assert max(row.profile, row.life) < 1e-4


@pytest.mark.slow
def test_lives_that_are_killed():
    found = wear_kills.main(quick=True)
    assert (found.kills, found.kept, found.identical) == (2, True, True)


def test_bifurcations(tmp_path):
    swept, rows = bifurcation.main(quick=True)
    assert swept["section"].shape == (4, 4, 2)
    assert not swept["code"].any()
    smallest, largest = rows
    assert (smallest.motion, largest.motion) == ("regular", "undecided")  # six revolutions say little
    assert smallest.difference <= 1e-8
    assert smallest.exponent == pytest.approx(smallest.single, rel=1e-3)
    assert largest.clearance == swept[bifurcation.CLEARANCE][-1]
    assert (tmp_path / "out" / "bifurcation_quick.png").exists()


def test_paper_sweeps(tmp_path):
    swept, trends = paper_sweeps.main(quick=True)
    assert not swept["code"].any()
    rank = {(row.result, row.friction): row.rank for row in trends}
    assert rank["deviation", 0.0] == rank["peak_force", 0.0] == 1
    rubbed = swept["friction_loss"].values[:, :, 0]
    assert np.all(rubbed[:, 0] == 0)
    assert np.all(rubbed[:, 1] > 0)
    assert (tmp_path / "out" / "paper_sweeps_map_quick.png").exists()

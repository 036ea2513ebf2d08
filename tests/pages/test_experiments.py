"""Every experiment runs in its quick mode, and shows there what it is for."""

import importlib

import numpy as np
import pytest

import clearance_jax as cj
from experiments import (
    batches,
    bifurcation,
    calibration,
    contact_laws,
    cores,
    drives,
    first_results,
    forward_dynamics,
    gpu,
    impacts,
    memory,
    mimic,
    needs,
    paper_sweeps,
    publish,
    published,
    quasi_static,
    robots,
    scalar,
    searches,
    settled_starts,
    sweeps,
    wear_jumps,
    wear_kills,
    work_precision,
    yields,
)
from experiments.hard import __main__ as hard
from experiments.hard import crank, pin, rubbing, several
from experiments.hard.case import Solved, examine
from experiments.learning import __main__ as learning
from experiments.learning import scenes as learning_scenes
from experiments.work_precision.pictures import draw
from experiments.work_precision.points import Point, cheapest

# rtol, error of positions and time of made runs.
RUNS = ((1e-3, 5e-5, 0.5), (1e-4, 2e-4, 1.0), (1e-5, 9e-5, 2.0), (1e-6, 1e-6, 3.0))


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


@pytest.mark.parametrize("gap", [" ", "\n"])
def test_a_page_is_named_by_its_command_wherever_the_line_ends(tmp_path, monkeypatch, gap):
    for name, value in {"PAGES": tmp_path, "found": [], "drawn": [], "pages": [], "commit": lambda: "abc"}.items():
        monkeypatch.setattr(publish, name, value)
    monkeypatch.setattr("sys.argv", ["some", "--save"])
    publish.command(lambda quick: publish.say("first"), f"Some: `python -m{gap}experiments.some`.")
    assert "first" in (tmp_path / "some.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_work_precision(tmp_path, monkeypatch):
    monkeypatch.setitem(work_precision.peers.PACKAGES, "Exudyn", "a_package_that_nobody_has")
    found = work_precision.main(quick=True)
    ours = [p for p in found.points if p.tool in work_precision.QUICK_TOOLS]
    assert {p.rtol for p in ours} == {1e-5, 1e-8}
    located = [p for p in ours if p.tool == "tsit5"]
    assert all(p.state <= 3000 * p.rtol and p.force <= 3000 * p.rtol for p in located)
    assert all(p.slope <= 3000 * p.rtol for p in located)
    assert {"LSODA (odeint) + numba", "DOP853 in numba"} <= {p.tool for p in found.points}
    others = [p for p in found.points if p not in ours and p.rtol == 1e-8]
    assert all(p.position <= 1e-4 for p in others)
    assert all(p.position <= 1e-5 for p in found.one if p.rtol == 1e-8)
    out = tmp_path / "out"
    assert (out / "work_precision_quick.png").read_bytes().startswith(b"\x89PNG")
    (panel,) = draw(found.points).axes
    assert len(panel.lines) == len({p.tool for p in found.points}) >= 4
    assert "| tsit5, no events " in (out / "work_precision_quick.md").read_text()
    assert "Exudyn: not installed, not measured." in work_precision.unmeasured()


def test_least_times_count_only_what_stays_within_the_bound():
    runs = [Point("a", "b", rtol, error, 0.0, 0.0, 0.0, 1, took, took) for rtol, error, took in RUNS]
    best = cheapest(runs, 1e-4)
    assert best is not None
    # The run at 1e-3 was lucky: the next tighter one is worse than the bound.
    assert (best.rtol, best.seconds) == (1e-5, 2.0)
    assert cheapest(runs, 1e-9) is None
    # A solve that gave up at the tightest tolerance says nothing of the others.
    lost = runs[0]._replace(rtol=1e-8, position=np.nan, seconds=np.nan)
    assert cheapest([*runs, lost], 1e-4) == best


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_steps_of_laws_with_memory():
    without, latched, by_penetration = memory.main(quick=True)
    assert without.touches == latched.touches == by_penetration.touches > 0
    assert latched.rejected < 0.7 * by_penetration.rejected
    np.testing.assert_allclose(latched.end, by_penetration.end, rtol=0, atol=1e-5)


def test_drives_with_backlash():
    found = drives.main(quick=True)
    assert max(float(row[2]) for row in found["errors"]) < 1e-9
    assert max(float(row[3]) for row in found["cycles"]) < 1e-9


@pytest.mark.slow
def test_a_measured_loop_has_the_width_of_its_gap_and_friction():
    found = drives.loop()
    gap, stiffness, friction = (found.values[name] for name in (drives.GAP, drives.STIFFNESS, drives.FRICTION))
    # Between two of the points of the curve it is 4.0 deg wide at zero torque.
    assert np.degrees(gap + 2 * friction / stiffness) == pytest.approx(4.0, abs=0.5)
    least, greatest = found.intervals[drives.STIFFNESS]
    assert least < 337 < greatest


def test_impacts_over_decades():
    for row in impacts.main(quick=True):
        assert row.early == 0
        assert row.error is not None
        assert row.error < 1e-4
    refused, *_ = impacts.rows_of("anagnostopoulos, 0.7", quick=True)
    assert refused.cell == "refused"


@pytest.mark.slow
def test_batches():
    assert batches.main(quick=True) <= 10


@pytest.mark.slow
def test_lanes_beside_scalar_c():
    assert scalar.main(quick=True) <= 1e-4


@pytest.mark.slow
def test_what_a_scene_does_not_have_costs_nothing():
    rows = needs.main(quick=True)
    whole, *others = rows
    assert [row.removed for row in others] == list(needs.OF_ALL)
    assert all(row.states <= whole.states and row.attempt < whole.attempt for row in others)
    of_field = {row.removed: row.field for row in others}
    for removed in ("friction", "a clearance", "gravity", "energy balance"):
        assert of_field[removed] < whole.field
    assert needs.not_lower(rows) == []
    # A row that costs as much as the whole scene is found.
    assert needs.not_lower([whole, whole._replace(removed="gravity")])


def test_published_numbers_and_other_programs():
    peers, numbers, problems = published.main(quick=True)
    assert [number.verdict for number in numbers] == ["agrees"] * len(numbers)
    assert numbers[0]._replace(ours=numbers[0].ours * 1.001).verdict == "differs"
    assert [problem.verdict for problem in problems] == ["agrees"]
    # Whatever of the other programs is installed.
    exudyn = [peer.position for peer in peers if peer.program == "Exudyn"]
    assert exudyn == [] or (exudyn[-1] < 1e-8 and exudyn[-1] < 0.1 * exudyn[0])
    assert all(peer.position < 2e-6 for peer in peers if peer.program == "MuJoCo")


def test_a_program_that_is_not_installed_is_left_out(capsys):
    assert not published.is_installed("no_such_program")
    assert "no_such_program is not installed" in capsys.readouterr().out


@pytest.mark.slow
def test_robots_whose_joints_follow():
    (gripper,) = mimic.main(quick=True)
    assert (gripper.coordinates, gripper.followers) == (1, 1)
    assert gripper.error < 1e-13


def test_models_of_mujoco(tmp_path):
    mjcf = pytest.importorskip("experiments.mjcf", exc_type=ImportError)
    rows = {row.model: row for row in mjcf.main(quick=True)}
    assert {name: row.coordinates for name, row in rows.items()} == {"floating": 7, "gripper": 2, "pendulums": 4}
    assert all(row.error < 1e-11 for row in rows.values())
    assert "| gripper " in (tmp_path / "out" / "mjcf_quick.md").read_text()


def test_robots_against_newton_and_euler():
    fixed, free = robots.main(quick=True)
    assert (fixed.coordinates, free.coordinates) == (8, 14)
    for row in (fixed, free):
        assert set(row.errors) == set(robots.COMPARED)
        assert max(row.errors.values()) <= 1e-12


@pytest.mark.slow
def test_articulated_bodies_agree_with_composite_ones():
    rows = forward_dynamics.main(quick=True)
    assert [row.program.split()[0] for row in rows] == ["composite", "articulated", "articulated"]
    assert max(row.error for row in rows) <= 1e-10


@pytest.mark.slow
def test_quasi_static():
    rows = quasi_static.main(quick=True)
    assert len(rows) == 6
    assert {row.damped for row in rows} == {True, False}
    assert not any(quasi_static.broken(row) for row in rows)
    # What was measured is read and not measured again.
    assert quasi_static.main(quick=True) == rows


def test_yields():
    """64 samples without a margin fall short of 99 %, and 512 with one do not."""
    few, _, _, enough = yields.main(quick=True)
    assert (few.confidence, few.samples) == (0.0, 64)
    assert few.below >= 4
    assert (enough.confidence, enough.samples, enough.below) == (0.95, 512, 0)
    assert 1.0 < enough.cost < 1.1


@pytest.mark.slow
def test_searches_against_sweeps():
    rows = searches.main(quick=True)
    assert len(rows) == 3
    for row in rows:
        assert row.short < searches.SHORT, row
        assert row.over < 1e-5, row
        assert row.solves < 30
    # Answers are near the bound, and do not come from the sweep.
    assert max(row.short for row in rows) > -searches.SHORT
    assert not any(np.array_equal(row.x, row.best) for row in rows)


@pytest.mark.slow
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


@pytest.mark.slow
def test_first_results(monkeypatch):
    monkeypatch.delenv("CLEARANCE_KEPT", raising=False)
    cold, kept = first_results.main(quick=True)
    assert (cold.case, cold.task, cold.state, kept.state) == ("slider-crank", "simulate", "cold", "kept")
    # The second process adds nothing: it finds all that the first one kept.
    assert kept.files == cold.files >= 6
    assert min(cold.cpu, kept.cpu) > 0.1
    assert min(cold.memory, kept.memory) > 100


@pytest.mark.slow
@pytest.mark.optimised
def test_lanes_over_cores():
    found = {(row.lanes, row.order): row.efficiency for row in cores.main(quick=True)}
    for lanes in {lanes for lanes, _ in found}:
        known = found[lanes, "by their true costs"]
        assert all(found[lanes, order] <= known <= 1 for other, order in found if other == lanes)
    assert found["the same, shuffled", "learned"] > found["the same, shuffled", "as they come"]


@pytest.mark.slow
def test_gpu_with_the_cpu_in_its_place(tmp_path):
    (row,) = gpu.main(quick=True)
    *_, median, largest, slopes = row
    assert float(median) <= float(largest) <= 1e-5
    assert float(slopes) <= 1e-2
    assert (tmp_path / "out" / "gpu_quick.md").exists()
    assert (tmp_path / "out" / "gpu_sweeps_quick.md").read_text().count("sweep") == 3


def test_lanes_on_a_gpu_begin_with_those_of_the_reference():
    for name in gpu.PROGRAMS:
        numbers = np.asarray(gpu.lanes(name, 8, 4))
        assert numbers.shape == (8, 2 if name == "joint 5, friction" else 3)
        np.testing.assert_array_equal(numbers[:4], numbers[4:])
    np.testing.assert_allclose(
        np.asarray(gpu.lanes(gpu.ARM, 8, 4))[[0, -1]], [[5e-6, 3.5e-6, 2.5e-6], [5e-5, 3.5e-5, 2.5e-5]]
    )


def test_without_a_gpu_nothing_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(gpu, "device_of", lambda quick: None)
    assert gpu.main() == []
    assert capsys.readouterr().out.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.optimised
def test_jumps_over_cycles():
    (row,) = wear_jumps.main(quick=True)
    assert row.evaluations < 8
    assert max(row.profile, row.life) < 1e-4


@pytest.mark.slow
def test_lives_that_are_killed():
    found = wear_kills.main(quick=True)
    assert (found.kills, found.kept, found.identical) == (2, True, True)


@pytest.mark.slow
@pytest.mark.optimised
def test_calibrations_of_a_pendulum_that_shares_no_code():
    right, wrong = calibration.main(quick=True)
    assert right[:5] == (2, 2, 2, 0, 0)
    assert right.motions > 0
    # The friction of a wrong model is wrong, and every answer says that it may be.
    assert wrong.friction == 0
    assert (wrong.silent, wrong.doubted) == (0, 1)


@pytest.mark.slow
def test_gradients_by_weights():
    (row,) = learning.main(quick=True)
    # A single run is no measure of time.
    assert [text for text in learning.broken([row]) if "takes" not in text] == []
    assert row.weights == 15
    key = learning.Key("adjoint", learning.RTOL, learning.factor())
    wrong = row._replace(difference=1e-7, runs=row.runs | {key: row.runs[key]._replace(error=1e-3, seconds=9.0)})
    assert len(learning.broken([wrong])) == 6


@pytest.mark.slow
def test_adjoint_derivatives_on_random_scenes():
    for row in learning_scenes.main(quick=True):
        assert row.derivatives > 10
        assert row.covered >= 0.6 * row.derivatives
        assert np.max(row.truth) < 1e-7
        assert np.max(row.adjoint) < 1e-5
        assert np.max(row.forward) < 1e-4


@pytest.mark.slow
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


@pytest.mark.slow
def test_paper_sweeps(tmp_path):
    swept, trends = paper_sweeps.main(quick=True)
    assert not swept["code"].any()
    rank = {(row.result, row.friction): row.rank for row in trends}
    assert rank["deviation", 0.0] == rank["peak_force", 0.0] == 1
    rubbed = swept["friction_loss"].values[:, :, 0]
    assert np.all(rubbed[:, 0] == 0)
    assert np.all(rubbed[:, 1] > 0)
    assert (tmp_path / "out" / "paper_sweeps_map_quick.png").exists()

"""Scene files, their errors, the command line, and datasets."""

import itertools
import os
import re
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.legend import Legend
from places import SCENES
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.main import app, main
from clearance_jax.cli.motion import HELD, undriven
from clearance_jax.io.scene.scene import load_scene
from clearance_jax.mechanism.form import EquationForm
from clearance_jax.mechanism.motion.expressions import read_expression
from clearance_jax.report.figures import overview
from clearance_jax.results.dataset import to_dataset
from clearance_jax.results.store import load_dataset, save
from clearance_jax.solve.drivers.trace import trace

VELOCITY_1 = "step(time, 0, 0, 0.5, 90 d) + step(time, 0.5, 0, 1, 30 d) + step(time, 1, 0, 1.5, 10 d)"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda p: p.stem)
def test_every_scene_loads(path):
    scene = load_scene(path)
    assert scene.solve["t1"] > 0
    assert scene.mechanism.contacts() or scene.mechanism.closures() or "[robot]" in scene.text


def test_a_scene_may_be_loaded_inside_a_jitted_function():
    def mass(factor):
        return factor * cj.parameters(cj.load(SCENES / "slider_crank.toml"))["slider.mass"].value

    assert float(jax.jit(mass)(2.0)) == pytest.approx(0.28)


CHANGES = [
    ('radial_clearance = "0.5 mm"', "radial_clearance = 0.5", "needs a unit"),
    ('radial_clearance = "0.5 mm"', 'radial_clearance = "0.5 kg"', "must be in m"),
    ('radial_clearance = "0.5 mm"', 'radial_clearance = "-0.5 mm"', "greater than 0"),
    ('radial_clearance = "0.5 mm"', 'radial_clearence = "0.5 mm"', "add `radial_clearance`|not a known key"),
    ('radial_clearance = "0.5 mm"', 'radial_clearance = "nan mm"', "finite"),
    ('pin_radius = "10 mm"', 'pin_radius = "10 mm"\nsleeve_radius = "9 mm"', "must fit in the sleeve"),
    ('mass = "0.14 kg"', 'mass = "-1 kg"', "greater than 0"),
    ('law = "adams-impact"', 'law = "adams-inpact"', "Did you mean `adams-impact`"),
    ('parent = "crank"', 'parent = "crnk"', "Did you mean `crank`"),
    ('type = "prismatic"', 'type = "prismatik"', "Did you mean `prismatic`"),
    ('{ type = "constant-speed", speed = "5000 rpm" }', '"step(time, 0, 0 0.5, 1)"', "expected `,`"),
    ('speed = "5000 rpm"', 'speed = "83 Hz"', "unit of angle"),
    (
        'type = "constant-speed", speed = "5000 rpm"',
        'type = "step", begin = ["1 s"], end = ["0 s"], rise = ["1 rad"]',
        "end",
    ),
    ('radial_clearance = "0.5 mm"', 'radial_clearance = "0.5 mm"\nposition = "3 deg"', "has no effect"),
    ("coefficient = 0.03", "coefficient = [0.03, 0.04]", "must be one quantity"),
    ('law = "adams-impact"', 'law = ["adams-impact"]', "one of the allowed words"),
    ('pin_radius = "10 mm"', 'sleeve_radius = "0.1 mm"', "there is no pin"),
    ("rtol = 1e-8", "rtol = 0", "at least 1e-14"),
]


@pytest.mark.parametrize(("old", "new", "words"), CHANGES)
def test_bad_scenes_are_refused_with_file_key_and_fix(tmp_path, old, new, words):
    text = (SCENES / "slider_crank.toml").read_text()
    assert old in text
    path = tmp_path / "bad.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=words) as caught:
        load_scene(path)
    assert "bad.toml" in str(caught.value)


def test_drive_expression_of_the_paper():
    drive = read_expression(VELOCITY_1)
    assert float(drive(jnp.asarray(2.0))[0]) == pytest.approx(np.deg2rad(130), rel=1e-12)
    assert float(drive(jnp.asarray(0.25))[1]) == pytest.approx(4.71239, rel=1e-5)
    assert float(drive(jnp.asarray(0.0))[2]) == pytest.approx(37.6991, rel=1e-5)
    assert sorted(set(np.asarray(drive.breaks()).tolist())) == [0.0, 0.5, 1.0, 1.5]


@pytest.mark.parametrize(
    "text", ["", "step(time, 0, 0, 1)", "step(tme,0,0,1,2)", "step(time,1,0,0,2)", "90 d 30", "sin(time)", "import os"]
)
def test_bad_expressions_are_refused(text):
    with pytest.raises(ValueError, match=r"expected|must end after"):
        read_expression(text)


@pytest.mark.slow
def test_dataset_roundtrip_and_figure(tmp_path):
    scene = load_scene(SCENES / "slider_crank.toml")
    result = trace(scene.mechanism, 2e-3, rtol=1e-6, save_at=201)
    dataset = to_dataset(scene.mechanism, result, scene=scene.text)
    save(dataset, tmp_path / "a.nc")
    again = load_dataset(tmp_path / "a.nc")
    assert dataset.identical(again)
    assert dataset.sizes["episode"] >= 2
    assert set(np.unique(dataset["contact_state"])) >= {0, 2}
    # Peaks are found between the steps: the largest of 20 001 samples agrees, though the table has no samples. A force
    # is as accurate as 0.17 m * rtol * dF/dd makes it, 3000 rtol here.
    fine = to_dataset(scene.mechanism, trace(scene.mechanism, 2e-3, rtol=1e-9, save_at=20_001))
    assert float(fine["peak_force"].max()) == pytest.approx(float(fine["contact_force"].max()), rel=3e-6)
    # The ends of a touching bodies' reaction agree with the contact force.
    reaction = np.linalg.norm(dataset["joint_reaction"].sel(any_joint="wrist").values, axis=1)
    contact = np.hypot(dataset["contact_force"].values, dataset["friction_force"].values)[:, 0]
    np.testing.assert_allclose(reaction, contact, atol=1e-6)
    figure = overview(dataset)
    figure.savefig(tmp_path / "a.png")
    clocks = [axis for axis in figure.axes if axis.get_xlabel().startswith("time")]
    assert len(clocks) == 2  # that of the first fall, and one for all panels over time
    for axis in clocks:
        assert axis.get_xlabel() == "time, ms"
        boxes = [label.get_window_extent() for label in axis.get_xticklabels()]
        shown = [box for box in boxes if 0 <= axis.transAxes.inverted().transform(box.get_points()).mean(0)[0] <= 1]
        assert 2 <= len(shown) <= 6
        assert all(a.x1 < b.x0 for a, b in itertools.pairwise(shown))
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.slow
def test_trace_agrees_with_simulate():
    scene = load_scene(SCENES / "slider_crank.toml")
    result = trace(scene.mechanism, 2e-3, rtol=1e-8, save_at=11)
    direct = cj.simulate(scene.mechanism, 2e-3, rtol=1e-8, save_at=11)
    assert result.message == ""
    np.testing.assert_allclose(result.solution.y[:, :4], direct.y[:, :4], rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_command_line(tmp_path):
    runner = CliRunner()
    assert "Examples" in runner.invoke(app, ["--help"]).output
    out = tmp_path / "o.nc"
    scene = str(SCENES / "slider_crank.toml")
    result = runner.invoke(
        app, ["simulate", scene, "--t1", "1ms", "--set", "wrist.radial_clearance=0.2mm", "-o", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert float(load_dataset(out).attrs["parameter.wrist.radial_clearance"]) == pytest.approx(2e-4)
    info = runner.invoke(app, ["info", scene])
    assert info.exit_code == 0
    assert "wrist.radial_clearance" in info.output
    robot = str(SCENES / "joint5_velocity_1.toml")
    whole, ideal = (runner.invoke(app, ["info", robot, *more]).output for more in ([], ["--ideal"]))
    assert operations(ideal) < 0.5 * operations(whole)  # what a scene does not need is not compiled
    bad = runner.invoke(app, ["simulate", scene, "--set", "wrist.gap=1mm"])
    assert isinstance(bad.exception, ValueError)
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.slow
def test_a_motion_is_kept_where_the_reader_of_its_text_has_gone(tmp_path, monkeypatch):
    """As with `clearance simulate ... | head -1`."""

    def gone(*_):
        raise BrokenPipeError

    monkeypatch.setattr("clearance_jax.cli.simulate._report", gone)
    path = tmp_path / "kept.nc"
    outcome = CliRunner().invoke(app, ["simulate", str(SCENES / "slider_crank.toml"), "--t1", "1ms", "-o", str(path)])
    assert isinstance(outcome.exception, BrokenPipeError)
    assert float(load_dataset(path)["time"][-1]) == pytest.approx(1e-3)


def test_a_robot_by_itself_holds_its_posture_and_says_how_it_is_driven(tmp_path):
    """By drives, where it stands: nothing moves, the drives carry its weight. What a trajectory moves is not held."""
    robot, out = SCENES / "six_axes.urdf", tmp_path / "o.nc"
    result = CliRunner().invoke(app, ["simulate", str(robot), "-o", str(out), "--samples", "2"])
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "each is held where it stands, for 0.1 s" in said
    assert "`--trajectory FILE`" in said
    dataset = load_dataset(out)
    assert float(dataset["time"][-1]) == HELD
    assert float(abs(dataset["velocity"]).max()) == 0.0
    assert float(abs(dataset["drive_force"]).max()) > 1.0
    mechanism = cj.load(robot)
    lead = cj.read_trajectory(SCENES / "six_axes_turn.csv", mechanism)
    assert undriven(mechanism.with_drives(lead)) == ("finger_left",)


@pytest.mark.slow
def test_no_legend_covers_anything():
    """In a figure of several panels legends stand outside of all axes, and of their labels and titles."""
    scene = load_scene(SCENES / "slider_crank_two_clearances.toml")
    figure = overview(to_dataset(scene.mechanism, trace(scene.mechanism, 5e-4, rtol=1e-5, save_at=21)))
    FigureCanvasAgg(figure).draw()
    axes = figure.axes
    legends = [legend.get_window_extent() for legend in figure.findobj(Legend)]
    assert len(legends) >= 3  # of forces, of contact over time, of the orbits
    drawn = [axis.get_window_extent() for axis in axes]
    drawn += [text.get_window_extent() for axis in axes for text in (axis.xaxis.label, axis.yaxis.label, axis.title)
              if text.get_text()]  # fmt: skip
    assert not any(legend.overlaps(other) for legend in legends for other in drawn)


def test_info_says_how_freely_a_linkage_moves():
    shown = CliRunner().invoke(app, ["info", str(SCENES / "bennett.toml")]).output
    assert "free to move: 1 of 3 free velocities, under 5 conditions, of which 3 only" in " ".join(shown.split())
    assert "written out number by number (3 free velocities and 5 conditions" in " ".join(shown.split())


def test_a_form_of_the_equations_of_motion_says_why_it_was_chosen():
    arm = cj.load(SCENES / "arm_with_play.toml").ideal()
    assert str(arm.form) == "written out number by number (0 free velocities; a table from 17 on)"
    plane = cj.load(SCENES / "squeezer.toml")
    assert str(plane.form) == "written out number by number, as every mechanism in a plane"
    small, large = EquationForm(16, 0, 16, False, False), EquationForm(17, 0, 17, False, False)
    assert not small.is_table
    assert large.is_table
    assert not large._replace(has_play=True).is_table
    assert not large._replace(is_plane=True).is_table
    assert "17 free velocities: more than 16; it compiles sooner and runs slower" in str(large)
    assert "50 coordinates in all, more than 40" in str(small._replace(coordinates=50))


def operations(output):
    return int(re.findall(r"vector field: (\d+) operations", output)[0])


COMMANDS = [
    (["simulate", "{scene}", "--set", "wrist.gap=1mm"], "wrist.gap"),
    (["simulate", "{scene}", "--set", "wrist.radial_clearance=1kg"], "must be in m"),
    (["simulate", "{scene}", "--t1", "-1s"], "greater than `t0`"),
    (["simulate", "{scene}", "-o", "missing/o.nc"], "its folder does not exist"),
    (
        ["simulate", "{scene}", "--t1", "1ms", "--set", "wrist.at_parent.x=3cm", "--set", "drive.main.start=1.5rad"],
        "open",
    ),
    (["simulate", "missing.toml"], "Cannot read the scene file"),
    (["plot", "{scene}"], "as a result file"),
]


@pytest.mark.parametrize(("arguments", "words"), COMMANDS)
def test_bad_commands_end_with_one_sentence_and_code_2(arguments, words, monkeypatch, capsys, tmp_path):
    scene = str(SCENES / "slider_crank.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["clearance", *(a.format(scene=scene) for a in arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert words in message
    assert "Traceback" not in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_without_64_bit_floats_nothing_is_solved():
    run = in_fresh_process(f"import clearance_jax as cj; cj.simulate(cj.load({str(SCENE)!r}), 1e-3)")
    assert run.returncode == 1
    assert "needs 64-bit floats" in run.stderr.splitlines()[-1]


@pytest.mark.slow
def test_set_up_after_jax_has_started_it_says_what_is_lost_and_moves_alike():
    solved = f"print(cj.simulate(cj.load({str(SCENE)!r}), 1e-3).final.tolist())"
    early = in_fresh_process(f"import clearance_jax as cj; cj.configure(); {solved}")
    late = in_fresh_process(
        f"import jax.numpy as jnp; jnp.zeros(1) + 1; import clearance_jax as cj; cj.configure(); {solved}"
    )
    assert "UserWarning" not in early.stderr
    assert "batches keep its narrower vectors" in late.stderr
    assert early.stdout == late.stdout != ""


SCENE = SCENES / "slider_crank.toml"


def in_fresh_process(code: str):
    """A run of Python without flags."""
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "JAX_ENABLE_X64")}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)

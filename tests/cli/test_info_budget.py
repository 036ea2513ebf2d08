"""`clearance info --budget`: of scenes and of robots, with a table, advice and a picture; what it refuses."""

import pytest
from places import refused
from typer.testing import CliRunner

from clearance_jax.cli.info import _point, _with_point
from clearance_jax.cli.main import app
from clearance_jax.errors import ClearanceError
from clearance_jax.io.scene.scene import load_scene
from experiments.common import SCENES

TWO = str(SCENES / "slider_crank_two_clearances.toml")


def info(*arguments):
    result = CliRunner().invoke(app, ["info", *arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return " ".join(result.output.split())


@pytest.mark.slow
def test_the_budget_of_a_scene_is_a_table_with_advice_and_a_picture(tmp_path):
    picture = tmp_path / "budget.png"
    said = info(TWO, "--budget", "--t1", "4 ms", "--plot", str(picture), "--set", "wrist.radial_clearance=0.5mm")
    assert "`piston` is off by" in said
    assert "joint share [um] of play of elasticity wrist" in said
    assert "Most is play of `wrist`: a smaller clearance there" in said
    assert picture.stat().st_size > 1000
    # It stands in the place of the usual table.
    assert "one evaluation of the vector field" not in said


def test_a_budget_is_about_one_point():
    mechanism = load_scene(SCENES / "slider_crank.toml").mechanism
    assert _point(mechanism, None) == "piston"
    robot = SCENES / "six_axes.urdf"
    with pytest.raises(ClearanceError, match=r"has 2 \(jaw_left_frame, jaw_right_frame\)"):
        info(str(robot), "--budget")
    assert [point.name for point in _with_point(load_scene(robot), robot, "tcp", {}).mechanism.points] == ["tcp"]
    with refused("end_effector", "tpc", "tcp"):
        info(str(robot), "--budget", "--point", "tpc")
    with refused("--point", "pistn", "piston"):
        info(TWO, "--budget", "--point", "pistn")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plot", "budget.png"], "`--plot` is about the error budget"),
        (["--t1", "1 ms"], "`--t1` is about the error budget"),
        (["--budget", "--ideal"], "which `--ideal` takes away"),
        (["--budget", "--plot", "budget.txt"], "must end in .png"),
        (["--budget", "--t1", "1"], "needs a unit"),
    ],
)
def test_what_says_nothing_of_a_budget_is_refused(arguments, message):
    with pytest.raises(ClearanceError, match=message):
        info(TWO, *arguments)


def test_a_robot_without_play_has_no_budget():
    with refused("clearance"):
        info(str(SCENES / "six_axes.urdf"), "--budget", "--point", "tcp")


def test_couplings_are_named(tmp_path):
    text = "".join(
        f'[body.{name}]\nmass = "1 kg"\ninertia = "1 kg*m^2"\n[joint.at_{name}]\ntype = "revolute"\nparent = "ground"\n'
        f'child = "{name}"\n'
        for name in ("sun", "ring", "arm")
    )
    train = (
        '[coupling.train]\ntype = "planetary"\nsun = "at_sun"\nring = "at_ring"\ncarrier = "at_arm"\nteeth = [20, 60]\n'
    )
    (tmp_path / "train.toml").write_text(text + train)
    said = info(str(tmp_path / "train.toml"))
    assert "coupling train: at_arm = 0.25 at_sun + 0.75 at_ring" in said
    assert "positions and speeds of at_sun, at_ring" in said

"""Studies of robots: trajectories, payloads and speeds of a design, settling times and their bands."""

from pathlib import Path

import numpy as np
import pytest
from places import refused

from clearance_jax import metrics
from clearance_jax.design import Yield
from clearance_jax.errors import ClearanceError
from clearance_jax.io.study.study import load_study

SCENE = Path(__file__).parents[2] / "experiments" / "scenes" / "arm.toml"
STUDY = f"""
scene = "{SCENE}"
t1 = "0.2 s"

[metric.tip]
kind = "peak"
signal = "position-error"
point = "tip"

[metric.tilt]
kind = "peak"
signal = "orientation-error"
body = "arm"

[metric.path]
kind = "rms"
signal = "path-deviation"
point = "tip"

[metric.rest]
kind = "settling-time"
signal = "position-error"
point = "tip"
band = "20 um"

[design]
speed = [0.5, 1]

[design.variable."hip.radial_clearance"]
lower = "10 um"
upper = "0.3 mm"

[design.limit.tip]
bound = "0.2 mm"

[design.limit.tilt]
bound = "0.05 deg"

[design.limit.rest]
bound = "30 ms"

[design.trajectory]
up = "up.csv"
down = "down.csv"

[design.payload.empty]
body = "arm"
mass = "0 kg"

[design.payload.tool]
body = "arm"
mass = "1 kg"
center_of_mass = ["0.4 m", "0 m"]
inertia = "1e-3 kg*m^2"
"""


@pytest.fixture
def folder(tmp_path):
    for name, top in (("up", 20), ("down", -15)):
        rows = "\n".join(
            f"{t},{top * (t / 0.1) ** 3 * (10 - 15 * t / 0.1 + 6 * (t / 0.1) ** 2):.9f}" for t in np.linspace(0, 0.1, 6)
        )
        (tmp_path / f"{name}.csv").write_text(f"time [s],hip [deg]\n{rows}\n")
    return tmp_path


def read(folder, *changes):
    text = STUDY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "study.toml"
    path.write_text(text)
    design = load_study(path).design
    assert design is not None
    return design.problem.specification


@pytest.mark.slow
def test_a_study_multiplies_trajectories_payloads_and_speeds(folder):
    asked = read(folder)
    assert list(asked.conditions) == [
        f"{way}, {load}, speed {speed}"
        for way in ("up", "down")
        for load in ("empty", "tool")
        for speed in ("0.5", "1")
    ]
    slow = asked.conditions["down, tool, speed 0.5"]
    np.testing.assert_allclose(slow["drive.hip.times"], np.linspace(0, 0.2, 6))
    assert slow["drive.hip.values"][-1] == pytest.approx(np.deg2rad(-15))
    assert (slow["arm.mass"], float(slow["arm.center_of_mass.x"])) == (3.0, pytest.approx(0.8 / 3))
    limits = {limit.name: limit for limit in asked.limits}
    assert limits["tilt"].bound == pytest.approx(np.deg2rad(0.05))
    assert limits["rest"].bound == 0.03
    rest = limits["rest"].metric
    assert isinstance(rest, metrics.SettlingTime)
    assert rest.since is None
    assert float(rest.band) == pytest.approx(2e-5)


@pytest.mark.slow
def test_the_time_of_a_crossing_is_read_with_its_level_and_its_direction(folder):
    crossing = """[metric.touch]
kind = "crossing-time"
signal = "quantity"
quantity = "hip.penetration"
level = "-2 um"
direction = "falling"
since = "1 ms"
[design.limit.touch]
bound = "30 ms"
[design.limit.tip]"""
    asked = read(folder, ("[design.limit.tip]", crossing))
    metric = {limit.name: limit for limit in asked.limits}["touch"].metric
    assert isinstance(metric, metrics.CrossingTime)
    assert metric.signal == metrics.Quantity("hip.penetration", "m")
    assert (float(metric.level), metric.direction, float(metric.since)) == (pytest.approx(-2e-6), "falling", 1e-3)
    for change, message in (
        (('"hip.penetration"', '"hip.penetratio"'), "no quantity 'hip.penetratio'. Did you mean"),
        (('signal = "quantity"', 'signal = "contact-force"\njoint = "hip"'), "quantity.* has no effect"),
        (('"-2 um"', '"2 N"'), "level"),
    ):
        with pytest.raises(ClearanceError, match=message):
            read(folder, ("[design.limit.tip]", crossing.replace(*change)))


@pytest.mark.slow
def test_conditions_that_are_written_down_are_multiplied_too(folder):
    asked = read(
        folder,
        ("[design.payload.empty]", '[design.condition.dry]\n"hip.friction.coefficient" = 0.3\n[design.payload.empty]'),
    )
    assert asked.conditions["up, empty, dry, speed 1"]["hip.friction.coefficient"] == 0.3


def test_what_a_study_cannot_multiply_is_named_with_its_place(folder):
    for change, message in (
        (('up = "up.csv"', 'up = "no.csv"'), "no.csv"),
        (("speed = [0.5, 1]", "speed = [0.25, 1]"), r"move until 0\.4 s"),
        (("speed = [0.5, 1]", "speed = [-1]"), "positive number"),
        (('body = "arm"\nmass = "0 kg"', 'body = "am"\nmass = "0 kg"'), r"no body `am`"),
        (('mass = "1 kg"', 'mass = "-1 kg"'), r"design\.payload\.tool\.mass"),
        (('band = "20 um"', 'band = "20 deg"'), r"metric\.rest\.band"),
        (('body = "arm"\n\n[metric.path]', 'body = "arm"\nband = "1 um"\n\n[metric.path]'), "band"),
    ):
        with pytest.raises(ClearanceError, match=message):
            read(folder, change)


def test_a_star_stands_for_the_numbers_of_all_joints(tmp_path):
    scene = SCENE.parent / "slider_crank_two_clearances.toml"
    text = f'''
scene = "{scene}"
[metric.piston]
kind = "peak"
signal = "position-error"
point = "piston"
[scatter."*.mass"]
deviation = "2 percent"
[scatter."slider.mass"]
deviation = "3 percent"
[design.variable."*.radial_clearance"]
lower = "10 um"
upper = "1 mm"
cost = {{ law = "reciprocal", factor = "0.2 mm" }}
[design.limit.piston]
bound = "0.3 mm"
[design.manufacture]
kind = "yield"
'''
    path = tmp_path / "study.toml"
    path.write_text(text)
    design = load_study(path).design
    assert design is not None
    asked = design.problem.specification
    joints = [joint.name for joint in asked.mechanism.clearance_joints()]
    assert len(joints) == 2
    assert set(asked.variables) == {f"{name}.radial_clearance" for name in joints}
    assert len(asked.costs) == 2
    assert isinstance(asked.manufacture, Yield)
    masses = {name: round(share, 6) for name, share in asked.manufacture.scatter.items()}
    assert masses.pop("slider.mass") == 0.03
    assert masses
    assert set(masses.values()) == {0.02}
    path.write_text(text.replace("*.radial_clearance", "*.radial_clearances"))
    with refused("*.radial_clearances"):
        load_study(path)

"""Messages about numbers of drives, gears and stops give units, and not the words that stand for them."""

import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax.laws import Flank
from clearance_jax.parameters import check_values

SEVERAL = np.array([1.0, 2.0])
FALLING = {"stiffness": np.array([1.0, 2.0, 3.0]), "efforts": np.array([3.0, 2.0]), "backlash": 1e-3}


def driven(make, compliance):
    joint = make("axis", "ground", "link", motion=cj.Motion(cj.drives.Constant(0.0)))
    return cj.with_compliance(cj.Mechanism((cj.Body("link", 1.0, 1.0),), (joint,)), "axis", compliance)


def stopped(make, flank):
    joint = make("axis", "ground", "link", motion=cj.Motion(stops=cj.Stops(upper=1.0, flank=flank)))
    return cj.Mechanism((cj.Body("link", 1.0, 1.0),), (joint,))


def meshed(flank, module=None):
    joints = (
        cj.Revolute("pinion", "ground", "small", motion=cj.Motion(cj.drives.ConstantSpeed(1.0))),
        cj.Revolute("wheel", "ground", "large", cj.Position(0.06, 0.0)),
    )
    gear = cj.Gear("mesh", "wheel", "pinion", (20, 40), backlash=1e-3, flank=flank, module=module)
    return cj.Mechanism((cj.Body("small", 1.0, 1.0), cj.Body("large", 1.0, 1.0)), joints, couplings=(gear,))


@pytest.mark.parametrize(
    ("make", "name", "units"),
    [
        (lambda: driven(cj.Revolute, cj.Compliance(**FALLING)), "axis.efforts", "N*m"),
        (lambda: driven(cj.Prismatic, cj.Compliance(**FALLING)), "axis.efforts", "N"),
        (lambda: driven(cj.Revolute, cj.Compliance(-1.0)), "axis.actuator.compliance.stiffness", "N*m/rad"),
        (lambda: stopped(cj.Revolute, Flank(SEVERAL)), "axis.stops.stiffness", "N*m/rad"),
        (lambda: stopped(cj.Prismatic, Flank(SEVERAL)), "axis.stops.stiffness", "N/m"),
        (lambda: stopped(cj.Prismatic, Flank(1.0, cubic=-1.0)), "axis.stops.cubic", "N/m^3"),
        (lambda: meshed(Flank(1.0, 1.0, damping_factor=1.0)), "mesh.damping", "N*m*s/rad"),
        (lambda: meshed(Flank(SEVERAL), 2e-3), "mesh.stiffness", "N/m"),
        (lambda: Flank(-1.0), "stiffness", "N*m/rad (N/m of a slide)"),
        (lambda: Flank(SEVERAL), "stiffness", "N*m/rad (N/m of a slide)"),
        (lambda: cj.actuators.JointFriction(-1.0), "effort", "N*m (N of a slide)"),
    ],
)
def test_a_message_gives_the_unit_of_the_coordinate(make, name, units):
    with refused(name) as caught:
        check_values(make())
    assert str(caught.value).endswith(f" {units}.")
    assert "coordinate" not in str(caught.value)


SCENE = """
[body.link]
mass = "1 kg"
inertia = "1 kg*m^2"
[joint.axis]
type = "prismatic"
parent = "ground"
child = "link"
stops = { upper = "10 mm", stiffness = ["1 N/m", "2 N/m", "3 N/m"], efforts = ["3 N", "2 N"] }
"""


def test_a_scene_does_too(tmp_path):
    (file := tmp_path / "scene.toml").write_text(SCENE)
    with refused("efforts") as caught:
        cj.load(file)
    assert str(caught.value).endswith("[3.0, 2.0] N.")

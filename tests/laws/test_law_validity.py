"""A law that is used beyond its validity says so."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.analysis.validity import ValidityWarning, within_validity
from clearance_jax.solve.law_validity import sunk

STEEL = 2.07e11, 2.07e11


def pendulum(law, mass=1.0):
    play = cj.RevoluteClearance(1e-4, 0.01, law, length=0.02)
    return cj.Mechanism(
        bodies=(cj.Body("arm", mass, 0.01, cj.Position(0.1)),),
        joints=(cj.Revolute("hip", "ground", "arm", clearance=play),),
        gravity=cj.Gravity(y=-9.81),
    )


@pytest.mark.slow
def test_one_motion_warns_with_its_numbers():
    with pytest.warns(ValidityWarning, match=r"joint `hip`: .*m is beyond 0 um, it is for comparison only") as caught:
        cj.simulate(pendulum(laws.goldsmith(*STEEL, restitution=0.5)), 6e-3, save_at=50)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = cj.simulate(pendulum(laws.johnson(*STEEL, restitution=0.5)), 6e-3, save_at=50)
    assert float(np.max(motion["hip.penetration"])) > 0
    assert bool(within_validity(motion)["hip"])
    assert within_validity(cj.simulate(pendulum(laws.HuntCrossley(1e9, 0.5)), 1e-3)) == {}


def test_a_batch_has_flags():
    """A soft material, and a heavier pin, goes beyond where the relation turns back."""
    mechanism = pendulum(laws.johnson(5e6, 5e6, restitution=0.5))

    def motion(mass):
        return cj.simulate(cj.replace(mechanism, {"arm.mass": mass}), 8e-3, save_at=50)

    found = jax.vmap(motion)(jnp.array([0.1, 100.0]))
    assert within_validity(found)["hip"].tolist() == [True, False]


@pytest.mark.parametrize(
    "law",
    [
        laws.LinearKelvinVoigt(laws.InternalHertz(*STEEL), 10.0),
        laws.StandardLinearSolid(laws.InternalHertz(*STEEL), 0.5, 5e-3),
        laws.Anagnostopoulos(laws.InternalHertz(*STEEL), 0.7, 1.0),
    ],
    ids=["kelvin-voigt", "standard-linear-solid", "anagnostopoulos"],
)
def test_a_linear_law_takes_no_stiffness_of_another_unit(law):
    """N/m^1.5 was taken for N/m, without a word."""
    with refused("stiffness", "InternalHertz"):
        cj.simulate(pendulum(law), 1e-4)


def test_a_pin_that_sinks_in_is_told():
    """20 kg on a wall of 1 N/um sink in by 196 um: more than the play, and more than a tenth of a pin of 1 mm."""
    disc = cj.Body("disc", 20.0, 0.1)

    def hung(pin_radius):
        clearance = cj.RevoluteClearance(1e-4, pin_radius, laws.LinearKelvinVoigt(1e6, 5e3))
        pin = cj.Revolute("pin", "ground", "disc", motion=cj.Motion(cj.drives.Constant(0.0)), clearance=clearance)
        return cj.Mechanism((disc,), (pin,), gravity=cj.Gravity(y=-9.81))

    def deepest(mechanism):
        return float(cj.simulate(mechanism, 1e-3, start="settled")["pin.penetration"])

    thin, thick = hung(1e-3), hung(1e-2)
    depth = {"pin": deepest(thin)}
    assert "joint `pin`: 196 um deep, of a play of 100 um. The contact is too soft" in sunk(thin, depth)
    assert sunk(thick, depth) == ""
    assert sunk(thin, {"pin": 9e-5}) == ""

"""Metrics of the gaps of drives, gears and stops: against samples and the energy account; units; what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax import metrics as m
from clearance_jax.metrics.observed import FirstFall, JointWork

T1 = 0.1


@pytest.fixture(scope="module")
def gears():
    return cj.load(SCENES / "gears.toml")


def test_metrics_of_a_gap_are_those_of_its_samples_and_of_the_energy_account(gears):
    asked = {
        "force": m.Peak(m.ContactForce("mesh")),
        "mean": m.Mean(m.ContactForce("mesh")),
        "impacts": m.Impacts("mesh"),
        "work": JointWork("mesh"),
        "lost": m.EnergyLost(),
    }
    found = cj.measure(gears, asked, T1, rtol=1e-9)
    dataset = cj.to_dataset(gears, cj.trace(gears, T1, rtol=1e-9, save_at=np.linspace(0, T1, 20001)))
    effort = np.abs(dataset["gap_effort"].sel(gap="mesh"))
    assert_allclose(found["force"], effort.max(), rtol=2e-3)
    assert 0.99 * effort.max() < np.abs(dataset["step_gap_effort"].sel(gap="mesh")).max() < 1.001 * effort.max()
    assert found["impacts"] == dataset.sizes["gap_episode"] > 3
    work = found["work"]
    assert_allclose(work.mean_force, found["mean"], rtol=1e-6)
    assert work.friction_loss == 0
    assert_allclose(work.contact_loss, found["lost"], rtol=1e-6)
    assert float(found["lost"]) > 1e-4


def test_units_of_gaps_are_those_of_efforts(gears):
    force, place = m.Peak(m.ContactForce("mesh")), m.Peak(m.Quantity("mesh.position"))
    assert (force.form(gears).unit, place.form(gears).unit) == ("N m", "rad")
    limits = [cj.design.Limit(force, 10.0), cj.design.Limit(place, 0.1)]
    problem = cj.design.ToleranceProblem(gears, T1, {"mesh.backlash": (1e-3, 1e-2)}, limits)
    first, second = problem.specification.limits
    assert (first.metric.unit, second.metric.unit) == ("N m", "rad")
    assert first.label == "mesh: effort of the flanks"


STUDY = f"""
scene = "{SCENES / "gears.toml"}"
t1 = "20 ms"
[metric.effort]
kind = "peak"
signal = "contact-force"
joint = "mesh"
[metric.touches]
kind = "impacts"
joint = "mesh"
[sweep]
metrics = ["effort", "touches"]
[sweep.axis."mesh.backlash"]
kind = "values"
values = ["5 arcmin", "10 arcmin"]
"""


def test_a_study_asks_for_gaps_by_their_names(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(STUDY)
    study = cj.load_study(file)
    assert study.sweep is not None
    assert study.sweep["outputs"]["effort"].unit == "N m"
    file.write_text(STUDY.replace('"contact-force"', '"joint-reaction"'))
    with refused("mesh", None):
        cj.load_study(file)
    file.write_text(STUDY.replace('"mesh"', '"mash"'))
    with refused("metric.effort.joint", "mash", "mesh"):
        cj.load_study(file)


def test_what_a_gap_has_not_is_refused(gears):
    for metric in (FirstFall("mesh"), m.Peak(m.JointReaction("mesh")), m.Peak(m.JointMoment("mesh"))):
        with refused("mesh"):
            metric(gears, T1)
    arm = cj.Mechanism(
        (cj.Body("link", 1.0, 1.0),), (cj.Revolute("hub", "ground", "link", motion=cj.Motion(cj.drives.Constant(0.0))),)
    )
    spring = cj.with_compliance(arm, "hub", cj.Compliance(np.array([1e3, 2e3]), efforts=np.array([1.0])))
    with refused("hub_drive"):
        m.Impacts("hub_drive")(spring, T1)

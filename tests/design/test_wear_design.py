"""Limits that hold while a joint wears: designed for, proved, over parts that scatter, in the report."""

import dataclasses

import numpy as np
import pytest
import scipy.stats
from places import refused

import clearance_jax as cj
from clearance_jax import design, laws, wear
from clearance_jax.design.asked.conditions import values_for, without_wear, worth
from clearance_jax.design.asked.specification import PEAKS, Scenario
from clearance_jax.design.judge.findings import known_findings
from clearance_jax.design.search.evaluate import simulations_of
from clearance_jax.errors import WearFailure
from clearance_jax.report import design_figures
from clearance_jax.report.html import render

# A disc on a pin that turns in its sleeve, on a patch of fixed width: the pin sinks by clearance, penetration and wear,
# and that by k F v T / (2 a R B) a cycle, for ever.
LAW, PRESSURE, CYCLE, CYCLES = wear.Archard(1.25e-11), wear.Uniform(0.2), 0.02, 40
DEPTH = 1.25e-11 * 196.2 * 3.0 * 25e-3 * CYCLE * CYCLES / (2 * 0.2 * 25.1e-3 * 0.05)
PENETRATION = (196.2 / 1e10) ** (2 / 3)
BOUND = 1e-4 + DEPTH
SUNK = cj.metrics.Peak(cj.metrics.PositionError("axis"), since=0.015)
SOLVE = {"start": "settled", "rtol": 1e-7}
PLAY = "pin.radial_clearance"


@pytest.fixture(scope="module")
def lasting() -> design.Design:
    """The largest clearance from which the pin sinks no further than the bound."""
    clearance = cj.RevoluteClearance(1e-4, 25e-3, laws.HuntCrossley(1e10, 50.0), length=0.05)
    mechanism = cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1),),
        joints=(
            cj.Revolute("pin", "ground", "disc", motion=cj.Motion(cj.drives.ConstantSpeed(3.0)), clearance=clearance),
        ),
        gravity=cj.Gravity(y=-9.81),
        points=(cj.Point("axis", "disc"),),
    )
    aged = wear.AfterWear(SUNK, joint="pin", wear=LAW, pressure=PRESSURE, cycle=CYCLE, cycles=(0, CYCLES))
    limit = design.Limit(aged, BOUND)
    return design.ToleranceProblem(mechanism, CYCLE, {PLAY: (2e-5, 4e-4)}, [limit], **SOLVE).solve(most=8)


@pytest.mark.slow
@pytest.mark.optimised
def test_the_largest_clearance_that_holds_is_the_bound_less_wear(lasting):
    assert lasting.feasible
    assert lasting.clearances[PLAY] == pytest.approx(1e-4 - PENETRATION, abs=0.03 * DEPTH)
    assert f"after {CYCLES} cycles of wear" in lasting.active[0]
    (limit,) = lasting.specification.limits
    assert limit.title == "Peak PositionError of axis worn at pin"
    metric = limit.simulation_metric
    by = PLAY, "wear.coefficient"
    values, slopes = metric.of(lasting.specification.mechanism, {}, CYCLE, by, **SOLVE)
    assert values.shape == (2 * PEAKS,)
    assert slopes[:, 0] == pytest.approx(1, rel=2e-2)
    assert slopes[:PEAKS, 1] == pytest.approx(0, abs=1e-9 * DEPTH / 1.25e-11)
    assert slopes[PEAKS:, 1] == pytest.approx(DEPTH / 1.25e-11, rel=1e-2)


@pytest.mark.slow
@pytest.mark.optimised
def test_a_certificate_over_a_life_is_what_a_life_says(lasting):
    """By finer jumps; a bound 1 % looser gives what the closed form has, bound / clearance."""
    proof = lasting.verify(sweep=2, solver="tsit5")
    assert proof.holds
    assert proof.scale == pytest.approx(1, abs=1e-6)
    (price,) = proof.prices.values()
    assert price == pytest.approx(BOUND / lasting.clearances[PLAY], rel=1e-2)
    until = wear.Exceeds(SUNK, BOUND, CYCLE, SOLVE)
    model = wear.WearModel(lasting.mechanism, "pin", LAW, PRESSURE, CYCLE)
    direct = wear.simulate_wear(model, 3 * CYCLES, until=until, **SOLVE)
    assert direct.end == pytest.approx(CYCLES, rel=1e-3)


@pytest.mark.slow
@pytest.mark.optimised
def test_a_yield_over_scattering_wear_is_its_closed_form(lasting):
    """Of parts whose coefficient scatters by 50 % those last whose depth is below what the bound leaves."""
    scatter = design.Yield({"wear.coefficient": 0.5})
    asked = dataclasses.replace(lasting.specification, manufacture=scatter)
    clearance = lasting.clearances[PLAY] - 0.25 * DEPTH
    point = lasting.evaluation._replace(x=np.array([clearance]))
    found = dataclasses.replace(lasting, specification=asked, evaluation=point).yield_estimate(samples=24, seed=3)
    most = (BOUND - clearance - PENETRATION) / DEPTH
    drawn = scatter.draws((PLAY,), 24, 3)["wear.coefficient"]
    assert np.min(np.abs(drawn / most - 1)) > 0.03  # so that the closed form decides about every part
    assert found.share == np.mean(drawn < most)
    width = np.sqrt(np.log1p(0.25))
    probability = scipy.stats.lognorm(s=width, scale=np.exp(-0.5 * width**2)).cdf(most)
    assert found.least < probability < 1 - scipy.stats.beta.ppf(0.05, 24 * (1 - found.share), 24 * found.share + 1)
    # One that wears through, or is out of bounds, is a part that fails, no error; but no design is out of bounds.
    simulations, x = simulations_of(asked), np.array([clearance])
    gone = Scenario("", {"wear.coefficient": np.asarray(1e-6)}, np.ones(1))
    assert simulations.worst(x, [gone]) == np.inf
    made = Scenario("", {"wear.coefficient": np.asarray(-1e-12)}, np.ones(1), designed={})
    assert simulations.worst(x, [made]) == np.inf
    for wrong in (made._replace(designed=None), made._replace(designed=made.values)):
        with refused("wear.coefficient", -1e-12, kind=WearFailure):
            simulations.worst(x, [wrong])


@pytest.mark.slow
def test_an_entry_of_an_array_reaches_a_life_and_no_number_of_another_wear_does(lasting):
    (limit,) = lasting.specification.limits
    aged = limit.metric
    other = dataclasses.replace(aged, pressure=wear.Foundation(2e13))
    given = lasting.specification.mechanism
    steps = cj.Motion(cj.drives.StepSum([0.0, 0.01], [0.01, 0.02], [0.1, 0.2]))
    mechanism = given.with_joint(dataclasses.replace(given.joint("pin"), motion=steps))
    values = {"drive.pin.rise.1": 0.3, "wear.coefficient": 1e-12, "pressure.stiffness": 1e13, "pressure.spread": 0.1}
    measures = [SUNK, aged, other]
    assert (
        values_for(SUNK, mechanism, measures, values)
        == without_wear(mechanism, measures, values)
        == {"drive.pin.rise.1": 0.3}
    )
    assert values_for(aged, mechanism, measures, values).keys() == values.keys() - {"pressure.stiffness"}
    assert values_for(other, mechanism, measures, values).keys() == values.keys() - {"pressure.spread"}
    assert worth(mechanism, measures, "drive.pin.rise.1") == 0.2


@pytest.mark.slow
@pytest.mark.optimised
def test_the_maintenance_interval_falls_with_the_clearance(lasting):
    """As (bound - clearance - penetration) over the depth of a cycle; figure and page show it."""
    softer = dataclasses.replace(lasting.specification, conditions={"softer": {"wear.coefficient": 1.25 * 1.25e-11}})
    (found,) = design.maintenances(dataclasses.replace(lasting, specification=softer))
    clearances = found.shares * lasting.clearances[PLAY]
    expected = (BOUND - clearances - PENETRATION) / (1.25 * DEPTH) * CYCLES
    np.testing.assert_allclose(found.lives[""], expected, atol=0.03 * CYCLES, rtol=5e-3)
    assert found.lives[""].min() < CYCLES < 5 * CYCLES < found.lives[""].max()
    axes = design_figures.intervals(found, lasting).axes[0]
    np.testing.assert_allclose(np.asarray(axes.lines[0].get_xydata()), np.stack([1e6 * clearances, found.lives[""]], 1))
    page = render(known_findings(lasting)._replace(maintenance=(found,)))
    assert f"Asked for: {CYCLES}" in page
    assert all(f">{life:.4g}<" in page for life in found.lives[""])


@pytest.mark.slow
def test_sectors_of_all_designs_follow_from_the_mechanism(lasting, monkeypatch):
    """A patch of a stiff foundation is too narrow for 360 sectors: more are taken, and as many for other numbers."""
    (limit,) = lasting.specification.limits
    taken = []
    begin = wear.WearModel.begin
    monkeypatch.setattr(wear.WearModel, "begin", lambda self, count: (taken.append(count), begin(self, count))[1])
    given, law, stiff = lasting.specification.mechanism, wear.Archard(6e-14), wear.Foundation(2e13)
    needed = wear.WearModel(given, "pin", law, stiff, CYCLE).sectors(dict(SOLVE))
    assert needed > 360
    narrow = dataclasses.replace(limit.metric, wear=law, pressure=stiff, cycles=(0, 3))
    taken.clear()
    for values in ({}, {PLAY: 5e-5}):
        narrow.of(given, values, CYCLE, **SOLVE)
        assert taken[-1] == needed
    with pytest.warns(wear.SectorsWarning, match=f"{needed} sectors would do"):
        dataclasses.replace(narrow, sectors=360).of(given, {}, CYCLE, **SOLVE)

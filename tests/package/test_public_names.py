"""What a newcomer finds: names at the root, one door for options, solutions that answer by name, own metrics."""

import functools
import inspect
import subprocess
import sys
from collections.abc import Callable
from typing import Any, ClassVar, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import slider_crank
from places import refused

import clearance_jax as cj
import clearance_jax.parameters  # puts the module beside the function of that name
from clearance_jax.metrics.functions import arguments
from clearance_jax.metrics.measure import as_metric, by_name
from clearance_jax.solve.settings import Settings, SolveOptions, evenly, settings_of

CRANK, T1, NAME = slider_crank(), 2e-3, "wrist.radial_clearance"
SOLVED: SolveOptions = {"save_at": 5, "rtol": 1e-7, "energy_balance": True}
PEAK = cj.metrics.Peak(cj.metrics.PositionError("piston"))


# Names ---------------------------------------------------------------------------------------------------------------


def test_every_public_name_is_there():
    """What type checkers read, `__init__.pyi`, is what Python finds, and all of it can be asked for."""
    assert set(cj.__all__) == set(dir(cj))
    assert all(getattr(cj, name) is not None for name in cj.__all__)


def test_functions_are_not_hidden_by_modules_of_their_name():
    assert callable(cj.parameters)
    assert callable(cj.configure)
    assert sys.modules["clearance_jax.parameters"].parameters is cj.parameters


def test_a_misspelt_name_is_corrected():
    with pytest.raises(AttributeError, match=r"no `simulat`\. Did you mean `simulate`"):
        cj.simulat  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]


def test_the_help_does_not_wait_for_jax():
    code = """
import sys
import clearance_jax
from clearance_jax.cli.main import app
from typer.testing import CliRunner
assert "simulate" in CliRunner().invoke(app, ["--help"]).output
print(sorted({"jax", "numpy", "equinox", "diffrax", "xarray"} & set(sys.modules)))
clearance_jax.ClearanceError
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_what_to_extend_is_there():
    bases = (
        cj.laws.AbstractNormalLaw,
        cj.laws.AbstractFrictionLaw,
        cj.joints.AbstractClearance,
        cj.joints.AbstractElement,
        cj.drives.AbstractDrive,
        cj.actuators.AbstractActuator,
        cj.controllers.AbstractController,
        cj.metrics.AbstractMetric,
        cj.metrics.AbstractSignal,
        cj.design.AbstractCost,
        cj.wear.AbstractWearLaw,
    )
    assert all(inspect.isabstract(base) for base in bases)


def test_public_modules_list_their_names():
    modules = [thing for name in cj.__all__ if inspect.ismodule(thing := getattr(cj, name))]
    assert cj.drives in modules
    for module in modules:
        assert module.__all__
        assert all(getattr(module, name) is not None for name in module.__all__)


def test_the_root_lists_what_scripts_use():
    assert len(cj.__all__) <= 106


# Options -------------------------------------------------------------------------------------------------------------


def test_options_are_one_list():
    """What only the library itself adds comes last."""
    assert (*get_type_hints(SolveOptions), "observers") == Settings._fields


LIMIT = cj.design.Limit(PEAK, 1e-4)
DOORS = {
    "simulate": lambda **o: cj.simulate(CRANK, T1, **o),
    "trace": lambda **o: cj.trace(CRANK, T1, **o),
    "measure": lambda **o: cj.measure(CRANK, {"peak": PEAK}, T1, **o),
    "metric": lambda **o: PEAK(CRANK, T1, **o),
    "times": lambda **o: PEAK.times(CRANK, T1, **o),
    "sensitivities": lambda **o: cj.sensitivities(CRANK, PEAK, [NAME], T1, **o),
    "hessian": lambda **o: cj.analysis.hessian(CRANK, PEAK, [NAME], T1, **o),
    "gradient_report": lambda **o: cj.gradient_report(CRANK, PEAK, [NAME], T1, **o),
    "periodic_motion": lambda **o: cj.periodic_motion(CRANK, 0.012, **o),
    "design": lambda **o: cj.design.ToleranceProblem(CRANK, T1, {NAME: (1e-5, 1e-3)}, [LIMIT], **o),
}


@pytest.mark.parametrize("door", DOORS)
def test_every_door_refuses_alike(door):
    for options, about in (
        ({"rtoll": 1e-8}, ("rtoll", "rtoll", "rtol")),
        ({"rtol": 2.0}, ("rtol", 2.0)),
        ({"rtol": "abc"}, ("rtol", "abc", "one number")),
        ({"t0": 1.0}, ("t1", T1, "greater than t0")),
        ({"solver": "tsit6"}, ("solver", "tsit6", "tsit5")),
        ({"solver": 5}, ("solver", 5)),
    ):
        if door == "periodic_motion" and "t0" in options:
            continue  # it ends a period after whatever t0
        with refused(*about):
            DOORS[door](**options)


@pytest.mark.parametrize(
    ("options", "about"),
    [
        ({"save_at": [1.0, 0.5]}, ("save_at", 1.0)),
        ({"save_at": 1}, ("save_at", 1, "between 2 and 1000000, the number of samples")),
        ({"save_at": 2.5}, ("save_at", None)),
        ({"y0": [1.0]}, ("y0",)),
        ({"derivatives": "exact"}, ("derivatives", "exact", "controlled")),
    ],
)
def test_values_are_checked_at_the_door(options, about):
    with refused(*about):
        settings_of(CRANK, T1, options)


def test_a_metrics_samples_end_at_the_end_too():
    """By t0 + (t1 - t0) the last of them would lie a round-off beyond."""
    assert -1.0 + (0.1 - -1.0) > 0.1
    times = evenly(jnp.asarray(-1.0), jnp.asarray(0.1), 11)
    assert (float(times[0]), float(times[-1])) == (-1.0, 0.1)


def test_samples_begin_and_end_exactly():
    times = settings_of(CRANK, 0.7, {"t0": 0.1, "save_at": 12}).save_at
    assert times is not None
    assert (float(times[0]), float(times[-1])) == (0.1, 0.7)


# Solutions -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def solution():
    return cj.simulate(CRANK, T1, **SOLVED)


@pytest.mark.slow
def test_quantities_are_the_datasets(solution):
    table = cj.to_dataset(CRANK, solution)
    for name, expected in {
        "piston.position": table["position"].sel(point="piston"),
        "piston.velocity.x": table["velocity"].sel(point="piston", axis="x"),
        "piston.acceleration": table["acceleration"].sel(point="piston"),
        "main": table["q"].sel(coordinate="main"),
        "main.velocity": table["v"].sel(coordinate="main"),
        "guide": table["q"].sel(coordinate="guide"),
        "crankpin.velocity": table["v"].sel(coordinate="crankpin"),
        "wrist.contact_force": table["contact_force"].sel(joint="wrist"),
        "main.drive_force": table["drive_force"].sel(drive="main"),
        "elastic_energy": table["elastic_energy"],
        "friction_loss": table["friction_loss"],
    }.items():
        np.testing.assert_allclose(solution[name], expected, rtol=1e-9, atol=1e-12, err_msg=name)
    np.testing.assert_array_equal(solution.state("crankpin.velocity"), solution.y[:, 2])


def test_every_quantity_has_a_name(solution):
    """A mechanism with play in the tree, memory, servo, gravity: names and shapes, without a solve."""
    play = cj.RevoluteClearance(1e-4, 0.01, cj.laws.flores(1e9, 0.6))
    arm = cj.Mechanism(
        bodies=(cj.Body("arm", 1.0, 0.01, cj.Position(0.1)),),
        joints=(cj.Revolute("hip", "ground", "arm", motion=cj.Motion(cj.drives.ConstantSpeed(20.0)), clearance=play),),
    )
    names = cj.simulate(arm, 1e-5, rtol=1e-4).names
    assert {"hip.play_x", "hip.play_y.velocity", "hip.impact_speed", "hip", "hip.eccentricity.y"} <= set(names)
    assert len(set(names)) == len(names)
    assert {"wrist.eccentricity", "guide.position", "damping_loss"} <= set(solution.names)


@pytest.mark.slow
def test_in_a_batch_and_under_differentiation(solution):
    def end(clearance):
        return cj.simulate(cj.replace(CRANK, {NAME: clearance}), T1, rtol=1e-7)

    clearances = jnp.array([5e-4, 2e-4, -1.0])
    batch = jax.jit(jax.vmap(end))(clearances)
    place = batch["piston.position"]
    assert place.shape == (3, 2)
    np.testing.assert_allclose(place[0], solution["piston.position"][-1], rtol=1e-6)
    np.testing.assert_allclose(place[:, 0], batch.state("guide"))
    assert "2 reached t1; 1 a number is out of its bounds" in repr(batch)
    assert "at the end" in repr(jax.tree.map(lambda x: x[1], batch))
    # The piston is where the guide is.
    _, (place, guide) = jax.jvp(lambda c: (lambda s: (s["piston.position"], s["guide"]))(end(c)), (5e-4,), (1.0,))
    assert place.shape == (2,)
    np.testing.assert_allclose(place, [guide, 0.0], rtol=1e-12)
    assert abs(guide) > 0


def test_where_a_point_is_depends_on_the_mechanisms_numbers_too():
    """A mass on a slide: the point is 0.3 m ahead of it, which the state does not know."""
    mass = cj.Mechanism(
        bodies=(cj.Body("mass", 1.0),),
        joints=(cj.Prismatic("slide", "ground", "mass", motion=cj.Motion(velocity=2.0)),),
        points=(cj.Point("nose", "mass", cj.Position(0.3)),),
    )

    def nose(ahead, t1):
        return cj.simulate(cj.replace(mass, {"nose.at.x": ahead}), t1, t0=0.5, rtol=1e-6)["nose.position.x"]

    value, slopes = jax.value_and_grad(nose, (0, 1))(0.3, 1.5)
    np.testing.assert_allclose([value, *slopes], [2.3, 1.0, 2.0], rtol=1e-12)
    end = jax.jvp(lambda t: cj.simulate(mass, t, save_at=3, rtol=1e-6).end_time, (1.5,), (1.0,))
    np.testing.assert_allclose(end, (1.5, 1.0))


class Own(cj.laws.AbstractNormalLaw):
    """A law with a function of its own, which no compiled program can return."""

    stiffness: jax.Array
    curve: Callable = jnp.tanh
    smoothness: ClassVar = "C0"

    def formula(self, constants, penetration, penetration_rate, memory):
        return self.stiffness * self.curve(penetration)

    def energy(self, constants, penetration):
        return 0.5 * self.stiffness * penetration**2


def test_a_law_may_hold_what_is_no_number(solution):
    law: Any = Own
    bare = cj.RevoluteClearance(5e-4, 0.01, law(jnp.asarray(1e8)))
    own = solution.of(CRANK.with_clearance("wrist", bare))
    again = jax.jit(lambda s: s)(own)
    np.testing.assert_array_equal(again["guide"], solution["guide"])
    assert again.mechanism.joint("wrist").clearance.normal.curve is jnp.tanh


def test_it_prints_itself(solution):
    text = repr(solution)
    assert "reached t1 at t = 0.002 s" in text
    assert "energy residual" in text
    assert f"{float(solution['guide'][-1]) * 1e3:.5g} mm" in text
    assert len(text.splitlines()) == 4
    stopped = cj.simulate(CRANK, T1, rtol=1e-7, max_steps=3, throw=False)
    assert "stopped (the largest number of steps was reached)" in repr(stopped)
    assert float(stopped.end_time) < T1
    shown = []
    jax.jit(lambda s: shown.append(repr(s)))(solution)
    assert "Solution(" in shown[0]


def test_sensitivities_print_themselves():
    found = cj.analysis.Sensitivities(jnp.asarray(2e-4), {NAME: jnp.asarray(1.25)}, (NAME,))
    assert str(found).splitlines() == ["value 0.0002", f"  d/d {NAME} = 1.25"]


def test_wrong_names_are_corrected(solution):
    for ask, words in (
        (lambda: solution["pistn.position"], "no quantity `pistn.position`. Did you mean `piston.position`"),
        (lambda: solution["piston"], "no quantity `piston`"),
        (lambda: solution.state("crnkpin"), "no state `crnkpin`. Did you mean `crankpin`"),
        (lambda: solution.state("main"), r"`main` is no state: .* Use `solution\[\"main\"\]`"),
        (lambda: solution._lookup(0, {}), "asked by name"),  # what `solution[0]` comes to
    ):
        with pytest.raises(cj.ClearanceError, match=words):
            ask()


# Metrics as functions ------------------------------------------------------------------------------------------------


def by_both(mechanism, solution, scale=2.0):
    return scale * solution["guide"]


def test_a_metric_is_a_function_of_one_or_two(solution):
    own = {"one": lambda s: s["guide"], "two": by_both}
    found = cj.measure(CRANK, {"two": by_both}, T1, **SOLVED)
    np.testing.assert_allclose(found["two"], 2 * solution["guide"], rtol=1e-12)
    # Samples that another metric asks for are none of theirs.
    at = cj.metrics.At(cj.metrics.ContactForce("wrist"), solution.time)
    ends = cj.measure(CRANK, own | {"force": at}, T1, rtol=1e-7, energy_balance=True)
    np.testing.assert_allclose((ends["one"], ends["two"]), (found["two"][-1] / 2, found["two"][-1]), rtol=1e-12)
    np.testing.assert_allclose(ends["force"], solution["wrist.contact_force"], rtol=1e-9)
    assert cj.design.Limit(by_both, 1.0).title == "by_both"


def test_a_metric_of_ones_own_stands_beside_integrals(solution):
    """Without the energy balance, whose place in the state the integral of another metric has."""
    mean = cj.metrics.Mean(cj.metrics.ContactForce("wrist"))
    found = cj.measure(CRANK, {"mean": mean, "own": lambda s: s["piston.acceleration.x"]}, T1, save_at=5, rtol=1e-7)
    np.testing.assert_allclose(found["own"], solution["piston.acceleration.x"], rtol=1e-9)
    assert float(found["mean"]) > 0


@pytest.mark.parametrize(
    ("function", "count"),
    [
        (lambda s: s, 1),
        (lambda m, s: s, 2),
        (by_both, 2),
        (functools.partial(by_both, CRANK), 1),
        (lambda solution, scale=1.0: solution, 1),
    ],
)
def test_arguments_are_counted(function, count):
    assert arguments(function) == count


@pytest.mark.parametrize(
    "metric",
    [
        lambda: 1.0,
        lambda a, b, c: 1.0,
        lambda s, *, scale: s,
        lambda solution, mechanism: solution,
        cj.metrics.Peak,
        cj.metrics.PositionError("piston"),
        "peak",
    ],
)
def test_anything_else_is_refused(metric):
    with pytest.raises(cj.ClearanceError, match=r"`f\(solution\)` or `f\(mechanism, solution\)`"):
        as_metric(metric)


def test_what_a_metric_returns_must_be_a_number():
    with refused("<lambda>", "dict"):
        cj.measure(CRANK, {"it": lambda s: {}}, T1, **SOLVED)
    with refused("measure"):
        by_name(PEAK)

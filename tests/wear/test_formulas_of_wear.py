"""The formulas of docs/wear.md against the code: wear laws and their options, as a study states them."""

import jax.numpy as jnp
import numpy as np
import pytest
from formulas import Equations, of_page
from places import ROOT, SCENES

from clearance_jax.io.study.study import load_study
from clearance_jax.wear import SlidingState

PAGE = (ROOT / "docs" / "wear.md").read_text(encoding="utf-8")
P, V, TRACTION, T = np.array([2e5, 4e6, 3e7]), np.array([0.3, 0.02, 1.5]), 0.2, 700.0
SYMBOLS = {"p": P, "v": V, "T": TRACTION, "N": 1.0, "t": T}
ALONE = {
    "archard": ('coefficient = "6e-14 1/Pa"', {"k": 6e-14}),
    "reye": ('coefficient = "1e-13 1/Pa"', {"k_r": 1e-13}),
}
OPTIONS = {
    "graded": (
        'graded = { pressure = "10 MPa", speed = "0.1 m/s", by_pressure = 0.5, by_speed = -0.25 }',
        {"p_r": 1e7, "v_r": 0.1, "a": 0.5, "b": -0.25},
    ),
    "least_pressure": ('least_pressure = "1 MPa"', {"p_0": 1e6}),
    "running_in": ('running_in = { factor = 5.0, duration = "1000 s" }', {"f": 5.0, "T_r": 1000.0}),
}


def entry(name):
    """The item of the list that a word begins or names, with its lines."""
    items = [item for item in PAGE.split("\n- ")[1:] if f"`{name}`" in item.partition("$")[0]]
    assert items, f"the page has no item of `{name}`"
    return items[0].partition("\n\n")[0]


def rate_of_study(tmp_path, law, options):
    """The rate of a law [m/s], as a study with these options reads it."""
    path = tmp_path / "life.toml"
    lines = [f'kind = "{law}"', ALONE[law][0], *(OPTIONS[name][0] for name in options)]
    head = f'scene = "{SCENES / "disc.toml"}"\n[wear]\njoint = "pin"\nlength = "50 mm"\ncycles = 100\n'
    head += '[wear.pressure]\nkind = "foundation"\nstiffness = "2e13 Pa/m"\n'
    path.write_text(head + "[wear.law]\n" + "\n".join(lines))
    asked = load_study(path).wear
    assert asked is not None
    at = SlidingState(jnp.asarray(P), jnp.asarray(V), jnp.asarray(TRACTION), jnp.asarray(T))
    return np.asarray(asked.model.wear.rate(at))


def rate_of_page(law, options):
    """The same by the page's equations, the options in the order in which it says that they act."""

    def alone(p):
        return Equations(list(of_page(entry(law))), {**SYMBOLS, "p": p, **ALONE[law][1]}, True)("h'")

    def graded(p):
        if "graded" not in options:
            return alone(p)
        # The page writes the rates as functions of the pressure: h_g' (p) and h_0' (p).
        text = entry("graded").replace("h_g (p)", "h_g").replace("h_0 (p)", "h_0")
        return Equations(list(of_page(text)), {**SYMBOLS, **OPTIONS["graded"][1], "p": p, "h_0'": alone(p)}, True)(
            "h_g'"
        )

    p = P
    if "least_pressure" in options:
        text = entry("least_pressure").replace("$\\max", "$q = \\max")
        p = Equations(list(of_page(text)), {**SYMBOLS, **OPTIONS["least_pressure"][1]}, True)("q")
    rate = graded(p)
    if "running_in" in options:
        symbols = {**SYMBOLS, **OPTIONS["running_in"][1], "h_1'": rate}
        rate = Equations(list(of_page(entry("running_in"))), symbols, True)("h'")
    return rate


@pytest.mark.parametrize("law", ALONE)
@pytest.mark.parametrize("options", [(), ("graded",), ("least_pressure",), ("running_in",), tuple(OPTIONS)])
def test_rates_are_those_of_the_page(tmp_path, law, options):
    seen, told = rate_of_study(tmp_path, law, options), rate_of_page(law, options)
    assert np.all(told[1:] > 0)
    assert (told[0] == 0) == ("least_pressure" in options)
    np.testing.assert_allclose(seen, told, rtol=1e-13)

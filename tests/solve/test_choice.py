"""`solver="auto"` is the solver that it names, before anything is told apart."""

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax.runs.identity import settings as in_words
from clearance_jax.solve.settings import (
    HIGH,
    LIMITS,
    LOW,
    PLANE,
    SMOOTH,
    SPACE,
    choose_solver,
    kind_of,
    settings_of,
    with_solver,
)

CRANK, T1 = catalogue.slider_crank(), 1e-3
LOOSE, TIGHT = 10 * LIMITS[PLANE], 0.1 * LIMITS[PLANE]


@pytest.mark.parametrize(("rtol", "named"), [(LOOSE, LOW), (TIGHT, HIGH)])
def test_auto_gives_the_bits_of_the_solver_that_it_names(rtol, named):
    auto, same = (cj.simulate(CRANK, T1, rtol=rtol, solver=solver) for solver in ("auto", named))
    np.testing.assert_array_equal(auto.final, same.final)
    assert (int(auto.steps), int(auto.rejected)) == (int(same.steps), int(same.rejected))


@pytest.mark.parametrize(("rtol", "named"), [(LOOSE, LOW), (TIGHT, HIGH)])
def test_what_tells_questions_apart_names_the_chosen_solver(rtol, named):
    options = {"rtol": rtol, "solver": "auto"}
    assert in_words(settings_of(CRANK, T1, options)._asdict())["solver"] == named
    assert with_solver(CRANK, options) == {"rtol": rtol, "solver": named}
    assert with_solver(CRANK, {"solver": LOW}) == {"solver": LOW}


def test_a_default_that_is_not_given_counts():
    """A function with an accuracy of its own chooses by that; `simulate`'s is 1e-8."""
    assert settings_of(CRANK, T1, {"solver": "auto"}, rtol=LOOSE).solver == LOW
    assert settings_of(CRANK, T1, {"solver": "auto"}).solver == choose_solver(CRANK, 1e-8)
    assert with_solver(CRANK, {"solver": "auto"})["solver"] == choose_solver(CRANK, 1e-8)


def test_kinds_of_scenes():
    assert kind_of(CRANK) == PLANE
    assert kind_of(CRANK.ideal()) == SMOOTH
    assert kind_of(cj.load(SCENES / "tool_changer.toml")) == SPACE


def test_auto_needs_a_number_and_other_words_are_refused():
    def end(rtol):
        return cj.simulate(CRANK, T1, rtol=rtol, solver="auto").final

    with refused("solver", "auto"):
        jax.jit(end)(jnp.asarray(1e-6))
    with refused("solver", "auto5", "auto"):
        cj.simulate(CRANK, T1, solver="auto5")


@pytest.mark.parametrize("scene", ["slider_crank", "tool_changer"])
def test_asking_a_mechanism_what_it_is_changes_nothing_of_its_structure(scene):
    """A program is found again by the structure of its arguments."""
    mechanism = cj.load(SCENES / f"{scene}.toml")
    for one in (mechanism, mechanism.prepare()):
        copy = jax.tree.map(lambda x: x, one)
        assert isinstance(one.is_plane, bool)
        assert jax.tree.structure(one) == jax.tree.structure(copy)

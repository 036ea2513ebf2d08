"""A joint kind of one's own is one class: files keep its outline, pictures show it, a budget and a designer's numbers
make it.
"""

from typing import Any, ClassVar

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.design.judge.budget import error_budget
from clearance_jax.joints import AbstractClearance, JointOutline
from clearance_jax.parameters import physical
from clearance_jax.report import figures
from clearance_jax.report.magnified import CrossSection
from clearance_jax.results.play import station_paths
from clearance_jax.solve.steps.events import event_groups

GAP, FAR, RADIUS = 1e-4, 3e-4, 0.01
HEIGHTS = (-0.02, 0.0, 0.02)
GROOVE = np.outer((0.0, FAR - GAP, 0.0), np.ones(36))


class GroovedSleeve(AbstractClearance):
    """A pin in two equal rims at the ends of a sleeve, with a groove between them that it does not reach."""

    gap: Any = physical("m", above=0.0)
    pin_radius: Any = physical("m", above=0.0)
    normal: Any = None
    friction: Any = None
    element: Any = None
    count: ClassVar[int] = 2
    tangents: ClassVar[int] = 1

    @classmethod
    def sizes(cls):
        return {"gap": True, "pin_radius": False}

    def one_rim(self):
        return cj.RevoluteClearance(self.gap, self.pin_radius, self.normal, self.friction)

    def play(self):
        return self.one_rim().play()

    def geometry(self):
        return self.one_rim().geometry()

    def points(self, at):
        return jax.tree.map(lambda x: jnp.stack([jnp.asarray(x, float)] * 2), self.one_rim().points(at))

    def travel(self, along):
        return self.gap

    def outline(self):
        return JointOutline(self.pin_radius, self.gap, GROOVE, heights=HEIGHTS)


def grooved(mechanism=None, **changes):
    numbers: Any = {"kind": GroovedSleeve, "gap": GAP, "pin_radius": RADIUS} | changes
    return (mechanism or catalogue.slider_crank().ideal()).with_clearance("wrist", **numbers)


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    """What a file of a motion says, where no joint exists any more."""
    mechanism, path = grooved(), tmp_path_factory.mktemp("own") / "a.nc"
    dataset = cj.to_dataset(mechanism, cj.trace(mechanism, 3e-3, rtol=1e-6, save_at=61))
    cj.save(dataset, path)
    read = cj.load_dataset(path)
    assert read.identical(dataset)
    return read


def test_numbers_make_it():
    made: Any = grooved().joint("wrist").clearance  # pyright: ignore[reportAttributeAccessIssue]
    assert type(made) is GroovedSleeve
    assert (float(made.gap), float(made.pin_radius), made.friction) == (GAP, RADIUS, None)
    assert isinstance(made.normal, laws.HuntCrossley)
    wider: Any = grooved(grooved(), gap=2 * GAP).joint("wrist")
    assert float(wider.clearance.gap) == 2 * GAP
    with refused("pin_radius"):
        grooved(pin_radius=None)
    with refused("wrist.length"):
        grooved(length=0.02)
    with refused("gap", -GAP):
        grooved(gap=-GAP)


@pytest.mark.slow
def test_its_paths_are_drawn_at_its_heights_within_its_walls(motion):
    figure = figures.play(motion)
    shown = [axis.get_title().split(":")[0] for axis in figure.axes[1:]]
    assert shown == ["z = −20 mm, edge", "z = +0 mm", "z = +20 mm, edge"]
    paths = station_paths(motion, "wrist")
    for path, axis, far in zip(paths, figure.axes[1:], (GAP, FAR, GAP), strict=True):
        limit = np.hypot(*axis.lines[-1].get_data())
        np.testing.assert_allclose(limit, 1e6 * far, rtol=1e-2)
        # It bears at the rims where the solve says so, and never in the groove.
        there = np.isin(path.time, motion["step_time"].values)
        touches = motion["step_state"].values[:, 0] > 0
        np.testing.assert_array_equal(path.state[there] > 0, touches & (far == GAP))


def test_it_is_magnified_in_its_own_outline(motion):
    film = cj.animate(motion, "wrist", exaggeration=10.0)
    (section,) = [view for view in film._views if isinstance(view, CrossSection)]
    film.show(len(film) - 1)
    walls = [np.hypot(*section.joint.around(np.zeros(1), k)) for k in range(3)]
    np.testing.assert_allclose(np.ravel(walls), RADIUS + 10 * np.array([GAP, FAR, GAP]), rtol=1e-12)
    eccentric = motion["eccentricity"].values[film.frames[-1], 0]
    np.testing.assert_allclose(section.pin.center, 10 * eccentric, rtol=1e-12)


def test_an_error_budget_closes_its_gap():
    budget = error_budget(grooved(), "piston", 2e-3, dynamics=False)
    assert set(budget.shares) == {"wrist"}
    assert budget.peaks["play"] == pytest.approx(GAP, rel=0.2)
    assert budget.peaks["elasticity"] < 0.2 * budget.peaks["play"]


@pytest.mark.parametrize("kind", [cj.Revolute, cj.Cylindrical, cj.Prismatic])
def test_it_goes_beside_one_on_another_joint(kind):
    """One plays in a plane, the other may slide out of it: their events are not located together."""
    sleeves = [GroovedSleeve(gap, RADIUS, laws.HuntCrossley(1e9, 0.5)) for gap in (GAP, FAR)]
    bodies = tuple(cj.Body(name, 1.0, (0.01, 0.02, 0.015), cj.Position(0.1, 0.01, 0.02)) for name in "ab")
    joints = (
        cj.Revolute("first", "ground", "a", clearance=sleeves[0]),
        kind("second", "a", "b", cj.Position(0.3), clearance=sleeves[1]),
    )
    mechanism = cj.Mechanism(bodies, joints, gravity=cj.Gravity(y=-9.81))
    together = kind is cj.Revolute
    assert event_groups(mechanism.prepare(), jnp.zeros(())) == ([[0, 1]] if together else [[0], [1]])
    jax.eval_shape(lambda end: cj.simulate(mechanism, end).final, 1e-3)

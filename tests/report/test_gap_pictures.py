"""Figures of contacts in gaps of drives, gears and stops: their units, what they count, and what they refuse."""

import numpy as np
import pytest
from matplotlib.patches import Circle
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax.results.places import bounds, outline


@pytest.fixture(scope="module")
def dataset():
    """Gears with backlash in a joint with play, beside a slide between stops."""
    gears = cj.load(SCENES / "gears.toml").with_clearance("wheel_axis", radial_clearance=50e-6, pin_radius=0.01)
    stops = cj.Stops(-5e-3, 5e-3, flank=cj.laws.Flank(2e5, 50.0))
    rail = cj.Prismatic("rail", "ground", "block", motion=cj.Motion(velocity=1.0, stops=stops))
    both = cj.Mechanism(
        (*gears.bodies, cj.Body("block", 1.0, 1.0)),
        (*gears.joints, rail),
        points=gears.points,
        couplings=gears.couplings,
        gravity=cj.Gravity(0.0, -9.81),
    )
    return cj.to_dataset(both, cj.trace(both, 0.05, save_at=np.linspace(0.0, 0.05, 101)))


def labels(figure):
    return [axis.get_ylabel() for axis in figure.axes]


@pytest.mark.parametrize("narrow", [False, True])
def test_episodes_of_joints_angles_and_slides_have_their_units(dataset, narrow):
    figure = cj.figures.episodes(dataset, narrow)
    shown = {axis.get_title(loc="left"): axis for axis in figure.axes if axis.get_title(loc="left")}
    assert [*shown] == ["joints", "flanks of angles", "flanks of slides"]
    speeds = {title: axis.get_ylabel().removeprefix("impact speed, ") for title, axis in shown.items()}
    assert speeds == {"joints": "m/s", "flanks of angles": "rad/s", "flanks of slides": "m/s"}
    assert {"largest force, N", "largest effort, N m", "largest effort, N"} <= set(labels(figure))
    counted = [text for axis in figure.axes for text in axis.get_legend_handles_labels()[1]]
    of = [str(dataset["gap"].values[k]) for k in dataset["gap_episode_gap"].values]
    assert f"mesh: {of.count('mesh')} episodes" in counted
    assert f"rail_stop: {of.count('rail_stop')} episodes" in counted


def test_spectra_of_torques_and_forces_of_flanks(dataset):
    figure = cj.figures.spectrum(dataset)
    titles = [axis.get_title(loc="left").partition(",")[0] for axis in figure.axes]
    assert titles == ["force", "torque of flanks", "force of flanks"]
    assert labels(figure)[1:] == ["density, (N m)²/Hz", "density, N²/Hz"]


def test_a_spectrum_of_flanks_has_the_line_of_the_whole_cycle():
    """A block between two stops bears on one, then on the other."""
    stops = cj.Stops(-5e-3, 5e-3, flank=cj.laws.Flank(2e5, 0.0))
    rail = cj.Prismatic("rail", "ground", "block", motion=cj.Motion(velocity=1.0, stops=stops))
    block = cj.Mechanism((cj.Body("block", 1.0, 1.0),), (rail,))
    period = 2 * (1e-2 + np.pi * np.sqrt(1 / 2e5))
    figure = cj.figures.spectrum(cj.to_dataset(block, cj.trace(block, 20 * period, rtol=1e-8)))
    frequency, density = np.asarray(figure.axes[0].get_lines()[0].get_data())
    assert abs(frequency[np.argmax(density)] - 1 / period) <= 0.6 * frequency[0]


def test_play_shows_which_flank_bears(dataset):
    figure = cj.figures.play(dataset)
    bars = next(axis for axis in figure.axes if [t.get_text() for t in axis.get_yticklabels()] == ["rail_stop", "mesh"])
    assert [text.get_text() for text in bars.get_legend().get_texts()][1] == "apart"
    only = dataset.drop_dims(["joint", "episode"])
    assert "which flanks bear" in cj.figures.play(only)._suptitle.get_text()
    with refused("rail_stop"):
        cj.figures.polar_load(only)


def test_films_show_a_slide_between_its_stops(dataset):
    axis = cj.animate(dataset, "rail_stop").figure.axes[1]
    assert axis.get_title() == "rail_stop: place between the stops (dashed)"
    ends = [float(np.asarray(line.get_ydata())[0]) for line in axis.get_lines() if line.get_linestyle() == "--"]
    assert sorted(ends) == pytest.approx([-5.0, 5.0])  # mm
    titles = [axis.get_title() + axis.get_title(loc="left") for axis in cj.figures.motion(dataset).axes]
    assert any(title.endswith("place between the stops") for title in titles)


def test_films_show_gears_as_circles_and_the_place_in_a_gap(dataset):
    film = cj.animate(dataset, "mesh")
    circles = [patch for patch in film.figure.axes[0].patches if isinstance(patch, Circle)]
    radii = sorted(float(circle.get_radius()) for circle in circles)
    np.testing.assert_allclose(radii, [0.02, 0.04], rtol=1e-12)
    assert film.figure.axes[1].get_title() == "mesh: place in the gap (dashed: its ends)"
    cursor = film.show(len(film) - 1).axes[1].lines[-1]
    assert [*np.asarray(cursor.get_xdata())] == pytest.approx([50.0, 50.0])
    left, right = film.figure.axes[0].get_xlim()
    assert left <= -0.02
    assert right >= 0.1
    low, high = bounds(outline(dataset).visible)
    np.testing.assert_allclose([low[0], high[0]], [-0.02, 0.1], atol=1e-3)
    assert cj.animate(dataset).joint == "wheel_axis"
    with refused("mash", allowed="wheel_axis"):
        cj.animate(dataset, "mash")

"""Figures of sweeps, and sensitivity indices: what is drawn is what the dataset holds."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from looks import check_texts
from matplotlib.collections import LineCollection
from places import refused
from scipy import stats

import clearance_jax as cj
from clearance_jax.errors import ClearanceError
from clearance_jax.report import recurrence_figures, sweep_axes, sweep_figures
from clearance_jax.results.sobol import middle_derivatives, sobol_indices
from clearance_jax.sweep.axes import sobol_samples

pytestmark = pytest.mark.quick

CLEARANCE, SPEED, FRICTION = "wrist.radial_clearance", "drive.main.speed", "wrist.friction.coefficient"
UNITS = {CLEARANCE: "m", SPEED: "rad/s", FRICTION: ""}


def grid() -> xr.Dataset:
    """A result that is a product, over 21 clearances, 16 speeds and 4 coefficients of friction; one lane failed."""
    axes = {CLEARANCE: np.linspace(0, 1e-3, 21), SPEED: np.linspace(100, 600, 16), FRICTION: np.linspace(0, 0.3, 4)}
    c, w, mu = np.meshgrid(*axes.values(), indexing="ij")
    error, code = c * (w / 100) * (1 - mu), np.zeros(c.shape, int)
    error[3, 4, 1], code[3, 4, 1] = np.nan, 2
    coordinates = {name: (name, values, {"units": UNITS[name]}) for name, values in axes.items()}
    return xr.Dataset({"error": (list(axes), error, {"units": "m"}), "code": (list(axes), code)}, coords=coordinates)


def recurrent() -> xr.Dataset:
    """Sections of ten lanes, every other one chaotic."""
    lanes = np.linspace(1e-5, 1e-4, 10)
    points = np.random.default_rng(0).normal(size=(10, 7, 2)) * [1.0, 1e-5]
    exponent = np.where(np.arange(10) % 2, 5.0, -5.0)
    section = ((CLEARANCE, "instant", "quantity"), points, {"units": "m/s, m", "metric": "PoincareSection"})
    return xr.Dataset(
        {
            "section": section,
            "exponent": (CLEARANCE, exponent, {"units": "1/s", "metric": "LyapunovExponent"}),
            "code": (CLEARANCE, np.zeros(10, int)),
        },
        coords={CLEARANCE: (CLEARANCE, lanes, {"units": "m"}), "quantity": ["piston.velocity.x", "wrist.play"]},
    )


def ishigami(samples: int) -> xr.Dataset:
    lanes = sobol_samples(dict.fromkeys(("a.x", "b.x", "c.x"), stats.uniform(-np.pi, 2 * np.pi)), samples)
    a, b, c = lanes.values()
    values = np.sin(a) + 7 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)
    coordinates = {name: ("sample", one, {"units": "rad"}) for name, one in lanes.items()}
    return xr.Dataset({"y": ("sample", values), "code": ("sample", np.zeros(len(a), int))}, coords=coordinates)


def test_sobol_indices_a_known_function():
    """Ishigami and Homma 1990, with a = 7, b = 0.1: the indices in closed form."""
    swept = ishigami(2048)
    swept["y"][5] = np.nan  # a lane that failed
    found = sobol_indices(swept, "y")
    first, total = np.array([0.3139, 0.4424, 0.0]), np.array([0.5576, 0.4424, 0.2437])
    assert found.names == ("a.x", "b.x", "c.x")
    assert found.failed == 1
    np.testing.assert_allclose(found.first, first, atol=0.02)
    np.testing.assert_allclose(found.total, total, atol=0.02)
    for interval, known in ((found.first_interval, first), (found.total_interval, total)):
        assert np.all((interval[0] < known) & (known < interval[1]))
    np.testing.assert_allclose(found.variance, 0.5 + 49 / 8 + 0.1 * np.pi**4 / 5 + 0.01 * np.pi**8 / 18, rtol=0.02)


def test_of_a_linear_function_derivatives_tell_the_indices():
    lanes = sobol_samples({"a.x": cj.scatter(1.0, 0.5), "b.x": stats.uniform(0.0, 3.0)}, 1024)
    values = 2 * lanes["a.x"] - lanes["b.x"]
    coordinates = {name: ("sample", one) for name, one in lanes.items()}
    slopes = xr.DataArray(np.tile([-1.0, 2.0], (len(values), 1)), dims=("sample", "parameter"))
    swept = xr.Dataset({"y": ("sample", values), "y_derivative": slopes}, coords=coordinates)
    swept = swept.assign_coords(parameter=["b.x", "a.x"])
    found = sobol_indices(swept, "y")
    shares = np.array([1, 0.75]) / 1.75
    local = middle_derivatives(swept, "y")
    assert local == {"a.x": 2.0, "b.x": -1.0}
    np.testing.assert_allclose(found.linear(local), shares, atol=5e-3)
    np.testing.assert_allclose(found.first, shares, atol=0.02)
    assert middle_derivatives(swept.drop_vars("y_derivative"), "y") is None
    with refused("b.x"):
        found.linear({"a.x": 2.0})


def test_lanes_of_another_design_have_no_indices():
    swept = ishigami(64)
    # A store has its coordinates in an order of its own.
    turned = xr.Dataset({"y": swept["y"].variable}, coords={name: swept[name] for name in ("c.x", "a.x", "b.x")})
    for ours, theirs in zip(sobol_indices(swept, "y"), sobol_indices(turned, "y"), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    swept["b.x"][70] += 0.1
    with refused("y"):
        sobol_indices(swept, "y")
    with refused("count", 100):
        sobol_samples({"a.x": stats.uniform(0.0, 1.0)}, 100)
    with refused("a.x", "(0.0, 1.0)"):
        sobol_samples({"a.x": (0.0, 1.0)}, 64)


def test_a_heat_map_has_a_cell_for_every_lane():
    figure = sweep_figures.heat_map(grid(), "error", CLEARANCE, SPEED)
    maps = [axes for axes in figure.axes if axes.get_title()]
    assert [axes.get_title() for axes in maps] == [
        f"wrist friction coefficient {mu}" for mu in ("0", "0.1", "0.2", "0.3")
    ]
    cells: Any = [axes.collections[0].get_array() for axes in maps]
    assert all(one.shape == (16, 21) for one in cells)
    np.testing.assert_allclose(cells[0][-1], 6 * np.linspace(0, 1, 21))  # in mm
    assert np.ma.count_masked(cells[1]) == 1
    assert maps[-1].get_xlabel() == "wrist radial clearance, mm"
    assert maps[0].get_ylabel() == "drive main speed, rad/s"
    assert figure.get_suptitle() == "of 1344 samples 1 failed (grey)"
    running = grid()
    running["code"][5:] = sweep_axes.NOT_RUN
    assert "1 failed and 1024 not run yet" in sweep_figures.heat_map(running, "error").get_suptitle()


def test_what_changes_together_has_one_axis():
    """A speed zipped with the end of the motion is one axis, by the speed, however its dimension is called."""
    zipped = grid().isel({FRICTION: 0}, drop=True).rename({SPEED: "speed"})
    zipped = zipped.drop_vars("speed").assign_coords({SPEED: ("speed", np.linspace(600, 100, 16))})
    zipped = zipped.assign_coords(speed=np.arange(16), t1=("speed", 1 / zipped[SPEED].values))
    tidied = sweep_axes.tidy(zipped)
    assert sweep_axes.variables(tidied) == (CLEARANCE, SPEED)
    assert tidied["error"].dims == (CLEARANCE, SPEED)
    np.testing.assert_array_equal(tidied["error"], zipped["error"])
    (axes, _) = sweep_figures.heat_map(zipped, "error").axes
    assert axes.get_ylabel() == "drive main speed"
    # What scatters stays, and values in any order are sorted.
    assert sweep_axes.variables(sweep_axes.tidy(ishigami(8))) == ("a.x", "b.x", "c.x")
    mixed = sweep_axes.tidy(grid().isel({CLEARANCE: [4, 1, 2]}))
    np.testing.assert_allclose(mixed[CLEARANCE], [5e-5, 1e-4, 2e-4])


def test_curves_are_medians_between_quantiles():
    figure = sweep_figures.curves(grid(), "error", CLEARANCE)
    (axes,) = figure.axes
    assert len(axes.lines) == 4  # one for each friction
    # Of 16 speeds the median is the mean speed.
    np.testing.assert_allclose(np.asarray(axes.lines[0].get_xydata()), np.linspace(0, 1, 21)[:, None] * [1.0, 3.5])
    one = sweep_figures.curves(grid().isel({SPEED: [0], FRICTION: [0]}), "error", CLEARANCE).axes[0]
    assert len(one.collections) == 0  # nothing else varies: no bands
    scattered = sweep_figures.curves(ishigami(64), "y", "b.x").axes[0]
    assert len(scattered.collections) == 2
    assert scattered.get_xlabel() == "b x, rad"


def test_parallel_coordinates_have_a_line_for_every_lane():
    figure = sweep_figures.parallel_coordinates(grid(), "error")
    lines: Any
    (lines,) = [one for one in figure.axes[0].collections if isinstance(one, LineCollection)]
    assert len(lines.get_segments()) == 1343  # all but the one that failed
    assert lines.get_segments()[0].shape == (4, 2)


def test_a_bifurcation_diagram_has_every_point():
    figure = recurrence_figures.bifurcation(recurrent(), "section", exponent="exponent")
    above, below = figure.axes
    regular, chaotic = (np.asarray(one.get_offsets(), float) for one in above.collections)
    assert regular.shape == chaotic.shape == (5 * 7, 2)
    np.testing.assert_allclose(np.unique(regular[:, 0]), [10, 30, 50, 70, 90])  # in um
    np.testing.assert_allclose(regular[:7, 1], recurrent()["section"][0, :, 0])
    assert above.get_ylabel() == "piston velocity x, m/s\nonce a period"
    assert below.get_xlabel() == "wrist radial clearance, µm"
    np.testing.assert_allclose(np.asarray(below.lines[0].get_ydata()), recurrent()["exponent"])


def test_chaos_is_an_exponent_beyond_its_uncertainty():
    swept = recurrent()
    labels = [
        one.get_label()
        for one in recurrence_figures.bifurcation(swept, "section", exponent="exponent").axes[0].collections
    ]
    assert labels == ["exponent negative", "exponent positive"]  # which says nothing of chaos
    both = xr.concat([swept["exponent"], xr.full_like(swept["exponent"], 2.0)], "estimate").transpose(..., "estimate")
    both[1] = [5.0, 3.0]
    swept["exponent"] = both.assign_coords(estimate=["value", "uncertainty"])
    np.testing.assert_array_equal(sweep_axes.exponent_of(swept, "exponent").sign, [-1, 0, *[-1, 1] * 4])
    above = recurrence_figures.bifurcation(swept, "section", exponent="exponent").axes[0]
    sizes = {one.get_label(): len(np.asarray(one.get_offsets())) for one in above.collections}
    assert sizes == {
        "stable: exponent negative": 5 * 7,
        "exponent zero within its uncertainty": 7,
        "chaotic: exponent positive": 4 * 7,
    }
    titles = [axes.get_title() for axes in recurrence_figures.sections(swept, "section", [1], "exponent").axes]
    assert titles == ["wrist radial clearance 20 µm\nexponent +5 ± 3 1/s"]
    # Of a grid the diagram over one axis lies in the middle of the other.
    wide = xr.concat([swept, swept.assign(section=2 * swept["section"])], "rate").assign_coords(rate=[1.0, 2.0])
    wide = wide.transpose(CLEARANCE, "rate", ...)
    figure = recurrence_figures.bifurcation(wide, "section", CLEARANCE)
    assert figure.get_suptitle() == "rate 2"
    assert len(np.asarray(figure.axes[0].collections[0].get_offsets())) == 10 * 7


def test_sections_show_points_in_their_plane():
    figure = recurrence_figures.sections(recurrent(), "section", [2, 5], "exponent")
    assert len(figure.axes) == 2
    points = np.asarray(figure.axes[1].collections[0].get_offsets(), float)
    np.testing.assert_allclose(points, recurrent()["section"][5] * [1, 1e6])
    assert figure.axes[1].get_title() == "wrist radial clearance 60 µm\nexponent +5 1/s"
    with refused("section"):
        recurrence_figures.sections(recurrent().isel(quantity=0), "section")


def test_sensitivities_have_a_bar_for_each_number_and_kind():
    found = sobol_indices(ishigami(256), "y")
    figure = sweep_figures.sensitivities(found, dict.fromkeys(found.names, 1.0), "y")
    patches: Any = figure.axes[0].patches
    widths = np.reshape([bar.get_width() for bar in patches], (3, 3))
    np.testing.assert_allclose(widths, [found.first, found.total, found.linear(dict.fromkeys(found.names, 1.0))])


STUDY = """
[sweep.axis."wrist.radial_clearance"]
from = "0.01 mm"
[sweep.axis.speeds]
values = { "drive.main.speed" = ["1000 rpm", "2000 rpm"] }
[sweep.axis."wrist.friction.coefficient"]
from = 0.0
"""


def test_axes_have_the_units_of_the_study():
    swept = grid().assign_attrs(study=STUDY)
    figure = sweep_figures.heat_map(swept, "error", CLEARANCE, SPEED)
    assert figure.axes[0].get_ylabel() == "drive main speed, rpm"
    (bottom, top) = figure.axes[0].get_ylim()
    np.testing.assert_allclose((bottom + top) / 2, 350 * 30 / np.pi)
    over: Any = sweep_figures.curves(swept, "error", SPEED, FRICTION).axes[0]
    np.testing.assert_allclose(np.asarray(over.lines[0].get_xdata())[[0, -1]], np.array([100, 600]) * 30 / np.pi)
    assert over.get_legend().get_title().get_text() == "wrist friction coefficient"
    assert sweep_axes.written_unit(STUDY, CLEARANCE) == "mm"
    assert sweep_axes.written_unit("no study", CLEARANCE) == ""


def test_every_picture_of_a_sweep_can_be_read():
    """No legend and no title is cut off, however long the names are."""
    over = grid().assign_attrs(study=STUDY)
    scattered = ishigami(64)
    local = {"y": dict.fromkeys(("a.x", "b.x", "c.x"), 1.0)}
    drawn = [
        over,
        over.isel({FRICTION: [0, 0, 1, 1, 2, 2, 3, 3]}).assign_coords({FRICTION: np.arange(8) / 70}),
        recurrent(),
    ]
    pictures = [figure for dataset in drawn for figure in sweep_figures.figures(dataset).values()]
    pictures += sweep_figures.figures(scattered, {"y": sobol_indices(scattered, "y")}, local).values()
    assert len(pictures) > 15
    for figure in pictures:
        check_texts(figure)
    assert "6 of 8 values" in sweep_figures.heat_map(drawn[1], "error").get_suptitle()


def test_what_fits_a_sweep_is_drawn():
    over = grid()
    over["steps"] = over["error"]  # with others that are no results
    assert set(sweep_figures.figures(over)) == {
        "error: heat map",
        "error: response surface",
        *(f"error over {name}" for name in UNITS),
        "parallel coordinates",
    }
    assert set(sweep_figures.figures(recurrent())) == {
        f"section: bifurcations over {CLEARANCE}",
        "section: Poincare sections",
        f"exponent over {CLEARANCE}",
    }
    scattered = ishigami(64)
    assert set(sweep_figures.figures(scattered, {"y": sobol_indices(scattered, "y")})) == {
        *(f"y over {name}.x" for name in "abc"),
        "parallel coordinates",
        "y: sensitivity indices",
    }
    with pytest.raises(ClearanceError, match="no result of a sweep"):
        sweep_figures.figures(over.drop_vars("code"))
    with pytest.raises(ClearanceError, match="no sample has a result"):
        sweep_figures.figures(over.assign(error=np.nan * over["error"]))
    with refused("eror", allowed="error"):
        sweep_figures.heat_map(over, "eror")
    with refused("wrist.pin_radius"):
        sweep_figures.curves(over, "error", "wrist.pin_radius")

"""The report of a design, from findings made by hand: what it says, in which words, and that names stay text."""

import dataclasses
import itertools
import re
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import slider_crank
from looks import check_texts
from made_findings import CLEARANCE, answer, crank_motion, made, piston_limit, rows_of, text_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from places import refused

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.design.asked.classes import NONE_CHOSEN
from clearance_jax.design.judge.explain import Maintenance
from clearance_jax.design.judge.findings import CUT_SHORT, known_findings
from clearance_jax.design.judge.observed import Observed, _of_fall, pin_size, standings
from clearance_jax.design.search.yields import YieldEstimate
from clearance_jax.metrics.observed import Instants
from clearance_jax.report import design_figures, html
from clearance_jax.report.figures import overview
from clearance_jax.report.html import render, write_report
from clearance_jax.report.panels import time_axis
from clearance_jax.results.dataset import picture_dataset
from clearance_jax.results.places import outline, picture, places

pytestmark = pytest.mark.quick

# Below it a text is hard to read [px]; the width that a phone leaves a figure, of its 390 px [px].
LEAST_TEXT, PHONE = 11.0, 340.0


def test_a_page_says_what_a_drawing_needs():
    page = render(made(answer([piston_limit()])), "Press")
    (row,) = [row for row in rows_of(page, "joint") if "Ø" in row[1]]
    # H8/f7 at 20 mm by ISO 286-1: hole +33/0, shaft -20/-41.
    assert row == ["wrist", "Ø 20 mm", "H8 +33 / 0 µm", "f7 −20 / −41 µm", "10 to 37 µm", "80 µm"]
    assert "Cost 1.25 EUR." in text_of(page)
    assert "EUR" in page[page.index("What another bound") :]


def test_the_first_card_says_what_decides_and_what_is_not_proved():
    found = dataclasses.replace(answer([piston_limit()]), note="slopes were of no use")
    page = text_of(render(made(found)))
    first = page[: page.index("For the drawing")]
    assert "Decided by: piston: position error, peak 1." in first
    assert "slopes were of no use." in first


def test_limits_have_bound_share_and_instant():
    (row,) = rows_of(render(made(answer([piston_limit()]))), "limit")
    assert row == ["piston: position error, peak 1", "199.98 µm", "200 µm", "99.9900 %", "3.4 ms"]


def test_from_when_and_from_where_is_said():
    """A motion that starts with a fall has another largest force than a machine's."""
    page = text_of(render(made(answer([piston_limit()]))))
    assert "from t = 0 ms to 12 ms" in page
    later = text_of(render(made(answer([piston_limit()], t0=2e-3, start="settled"))))
    assert "from t = 2 ms to 12 ms" in later
    assert "over 10 ms; an impact" in later


def test_instants_are_in_the_unit_of_the_time_axes():
    assert [html.instant(t) for t in (None, 0.0, 0.0034, 3.25, 105.0)] == ["", "0 ms", "3.4 ms", "3.25 s", "105 s"]


def test_it_is_said_from_when_on_a_limit_counts_and_how_pins_start():
    settled = piston_limit()
    later = dataclasses.replace(settled, metric=dataclasses.replace(settled.metric, since=jnp.asarray(0.004)))
    page = render(made(answer([later])))
    assert [row[2] for row in rows_of(page[page.index("What was asked") :], "limit")] == ["4 ms"]
    assert "does not count" in page
    assert "may belong to that fall" in text_of(page)
    page = render(made(answer([settled], start="settled")))
    assert [row[2] for row in rows_of(page[page.index("What was asked") :], "limit")] == ["the start"]
    assert "may belong to that fall" not in text_of(page)
    assert "Pins start at the walls" in text_of(page)


def test_the_class_of_each_variable_is_said():
    (name,) = answer([piston_limit()]).clearances
    chosen = {name: design.ToleranceClass("standard", 0.0, 3e-3, unit="rad")}
    classes = dataclasses.replace(NONE_CHOSEN, chosen=chosen)
    page = render(made(dataclasses.replace(answer([piston_limit()]), classes=classes)))
    assert [row[2] for row in rows_of(page, "variable")] == ["standard: 0 arcmin to 10.3132 arcmin"]


def test_the_curve_of_a_reduced_signal_is_called_by_the_signal():
    limit = design.Limit(metrics.Rms(metrics.ContactForce("wrist")), 400.0, "load")
    assert (limit.label, limit.signal_label, limit.reduction) == (
        "load: RMS contact force of wrist",
        "load: contact force of wrist",
        "RMS",
    )


def test_slopes_by_a_clearance_are_per_micrometre():
    units, slopes = {CLEARANCE: "m", "slider.mass": "kg"}, {CLEARANCE: 5e5, "slider.mass": 2.0}
    force = design.Response("load", "load", "N", 1.0, 2.0, units, slopes, {})
    assert [force.sensitivity(name) for name in units] == ["0.5 N per um", "2 N per kg"]


def test_loads_have_pressures_only_where_a_length_is_known():
    found = made(answer([piston_limit()]))
    (load,) = found.loads
    assert load.largest_pressure == pytest.approx(2449.0 / (0.02 * 0.02))
    page = render(found)
    row = next(row for row in rows_of(page[page.index("Loads of the joints") :], "joint"))
    assert row == ["wrist", "2449 N", "0.4285 ms", "156.2 N", "0.26 J", "0.0104 J", "7", "6.122 MPa", "0.3905 MPa"]
    without = text_of(render(made(answer([piston_limit()]), length=None)))
    assert "no joint says the length" in without
    assert "MPa" not in without


def test_a_load_of_the_first_fall_is_named_as_such():
    found = made(answer([piston_limit()]))
    fell = found.loads[0]._replace(first_fall=True, after=213.0, time_after=0.02)
    others = [fell._replace(joint="hip", first_fall=False, after=None), fell._replace(joint="knee", after=None)]
    page = render(found._replace(loads=(fell, *others), motions={}))
    rows = rows_of(page[page.index("Loads of the joints") :], "joint")
    assert [row[1:4] for row in rows] == [
        ["2449 N (first fall)", "0.4285 ms", "213 N at 20 ms"],
        ["2449 N", "0.4285 ms", "the same"],
        ["2449 N (first fall)", "0.4285 ms", "not known"],
    ]
    assert "falls to its wall first" in text_of(page)
    fallen = render(found._replace(loads=(fell,)))
    assert "Path of the pin in the sleeve of wrist" in fallen
    assert "falls to its wall first" not in text_of(render(found))


def test_the_largest_force_after_the_first_fall_is_found():
    force = Instants(np.array([9.0, 8.0, 5.0]), np.array([1e-3, 1.2e-3, 4e-3]))
    assert _of_fall(force, 2e-3) == {"first_fall": True, "after": 5.0, "time_after": 4e-3}
    assert _of_fall(force, -np.inf) == {}
    assert _of_fall(force, 5e-3) == {"first_fall": True}


def test_names_are_text_and_the_page_needs_nothing_else():
    name = '<script>alert("1")</script>'
    found = made(answer([piston_limit(name)], cost_unit="<i>"))
    page = render(found, title="A & <b>", study='name = "</pre><img src=x>"')
    assert "<script" not in page
    assert "<img" not in page
    assert "<i>" not in page
    assert "<h1>A &amp; &lt;b&gt;</h1>" in page
    assert not re.search(r'(src|href)="(?!#)', page)
    assert page.count("<svg") == 7  # mechanism, path, when it bears, history, contributions, trade-off, convergence


def test_figures_are_readable_on_a_phone():
    page = render(made(answer([piston_limit()])))
    figures = re.findall(r"<svg.*?</svg>", page, re.S)
    for figure in figures:
        (width,) = re.findall(r'viewBox="0 0 ([0-9.]+) ', figure)
        sizes = [float(size) for size in re.findall(r"font-size: ([0-9.]+)px", figure)]
        assert sizes
        assert min(sizes) * PHONE / float(width) >= LEAST_TEXT
    # And all else is sized in rem of 16 px.
    assert min(float(size) for size in re.findall(r"font-size: ([0-9.]+)rem", page)) * 16 >= LEAST_TEXT


def test_a_mechanism_is_drawn_where_its_joints_are_apart_and_says_their_names():
    found = outline(crank_motion())
    at = found.places.at[found.sample]
    assert at[found.places.joints["crankpin"]][1] > 0.04  # at the start all is in one line
    assert found.places.loose == {"wrist"}
    assert set(found.places.slides) == set(found.places.pairs) == {"guide"}
    np.testing.assert_allclose(np.abs(found.places.slides["guide"]), [[1.0, 0.0]] * 50, atol=1e-12)
    figure = design_figures.mechanism(found)
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    names = [line for text in figure.axes[0].texts for line in text.get_text().splitlines()]
    assert {"main", "crankpin", "wrist", "guide", "piston"} < set(names)
    # Nothing is cut off, and no two names hide each other.
    boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert all(figure.bbox.containsx(x) for box in boxes for x in (box.x0, box.x1))
    assert all(figure.bbox.containsy(y) for box in boxes for y in (box.y0, box.y1))
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_nothing_in_figures_of_a_design_is_cut_off():
    """However long the name of a limit is, and however many conditions there are."""
    found = made(answer([piston_limit("error of the piston at the end of its stroke")]))
    (history,), (why,) = found.time_histories, found.responses
    conditions = ("cold and dry", "warm, with the heaviest payload", "at the end of its life")
    many = history._replace(values=dict.fromkeys(conditions, history.values[""]), since=1e-3)
    lives = np.array([3e4, 2e4, np.inf])
    drawn = [
        design_figures.over_time(history),
        design_figures.over_time(many),
        design_figures.contributions([why, why._replace(limit="force on the wrist")]),
        design_figures.trade(found.tradeoff, found.design),
        design_figures.convergence(found.design),
        design_figures.intervals(
            Maintenance("error", 10_000, 50_000, np.array([0.8, 1.0, 1.2]), dict.fromkeys(conditions, lives)),
            found.design,
        ),
        design_figures.pin_in_sleeve(found.motions[""], "wrist"),
    ]
    for figure in drawn:
        check_texts(figure)


@pytest.mark.parametrize(("last", "unit"), [(1e-4, "ms"), (0.105, "ms"), (0.3, "s"), (7.0, "s"), (1234.5, "s")])
def test_a_time_axis_has_at_most_six_ticks_apart_from_each_other(last, unit):
    figure = Figure(figsize=(3.6, 2.6), layout="constrained")
    axis, t = figure.subplots(), np.linspace(0, last, 11)
    shown = time_axis(axis, last) * t
    axis.plot(shown, t)
    figure.draw_without_rendering()
    assert axis.get_xlabel() == f"time, {unit}"
    np.testing.assert_allclose(shown, t * (1e3 if unit == "ms" else 1.0))
    low, high = axis.get_xlim()
    ticks = [tick.label1.get_window_extent() for tick in axis.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    assert 3 <= len(ticks) <= 6
    assert all(a.x1 < b.x0 for a, b in itertools.pairwise(ticks))


@pytest.mark.parametrize(
    ("limit", "labels"),
    [
        (piston_limit(""), ["piston: position error, peak 1", "piston: position error, peak 2"]),
        (piston_limit("first"), ["first: position error of piston, peak 1", "first: position error of piston, peak 2"]),
        (design.Limit(metrics.Rms(metrics.ContactForce("wrist")), 1.0, "wrist"), ["wrist: RMS contact force"]),
        (design.Limit(metrics.Impacts("wrist"), 1.0), ["wrist: impacts"]),
        (design.Limit(metrics.EnergyLost(), 1.0, "heat"), ["heat: energy lost"]),
        (
            design.Limit(metrics.At(metrics.Acceleration("piston"), [1e-3, 2e-3]), 1.0),
            ["piston: acceleration, at 1 ms", "piston: acceleration, at 2 ms"],
        ),
    ],
)
def test_limits_are_called_by_what_they_are(limit, labels):
    assert limit.labels(len(labels)) == labels


class RodStress(metrics.AbstractMetric):
    """A metric of one's own with several values."""

    @property
    def label(self):
        return "stress of the rod"

    @property
    def unit(self):
        return "Pa"

    def components(self, count):
        return tuple(f"section {'ABC'[k]}" for k in range(count))

    def request(self, mechanism, t1, options):
        return metrics.Request()

    def value(self, reply):
        return jnp.ones(3)


@pytest.mark.parametrize(("name", "called"), [("", "stress of the rod"), ("rod", "rod: stress of the rod")])
def test_a_metric_of_ones_own_says_how_a_report_calls_it(name, called):
    limit = design.Limit(RodStress(), 2e6, name)
    assert limit.labels(3) == [f"{called}, section {letter}" for letter in "ABC"]
    page = render(known_findings(answer([limit])))
    rows = rows_of(page, "limit")
    assert [row[:3] for row in rows] == [[f"{called}, section {x}", "1.9998e+06 Pa", "2e+06 Pa"] for x in "ABC"]
    assert f"Decided by: {called}, section A" in text_of(page)


def test_standings_know_which_limit_and_condition_a_row_is_of():
    conditions = {"slow": {"drive.main.speed": 50.0}, "fast": {"drive.main.speed": 500.0}}
    found = answer([piston_limit()], conditions=conditions)
    looked = []

    def look(scenario):
        looked.append(scenario.title)
        times = Instants(np.ones(3), len(looked) + 0.1 * np.arange(3))
        return Observed((times,), (None,), (), (), (), (), None)

    rows = standings(found, look)
    assert looked == [" (slow)", " (fast)"]
    assert [row.time for row in rows] == [1.0, 1.1, 1.2, 2.0, 2.1, 2.2]
    assert {row.bound for row in rows} == {2e-4}
    assert [row.value for row in rows] == pytest.approx([2e-4 * (1 - 1e-4)] * 6)


def test_without_a_solve_the_limits_and_the_drawing_are_known():
    found = known_findings(answer([piston_limit()], held=False))
    assert not found.good
    page = text_of(render(found))
    assert "No feasible design: piston: position error, peak 1 is 1.5 times its bound." in page
    assert "No design holds every limit" in page
    assert "Ø 20 mm" in page


def test_an_interrupted_explanation_keeps_what_it_has(monkeypatch, tmp_path):
    def interrupted(*_):
        raise KeyboardInterrupt

    # The package exports a function of the module's own name.
    monkeypatch.setattr(sys.modules["clearance_jax.design.judge.observed"], "observe", interrupted)
    said = []
    found = design.findings(answer([piston_limit()]), progress=said.append)
    assert said == ["loads and pictures"]
    assert found.notes == (CUT_SHORT,)
    assert found.standings
    write_report(found, tmp_path / "r.html")
    assert CUT_SHORT in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_numbers_are_written_as_in_a_workshop():
    assert html.deviations((-41e-6, -20e-6)) == "−20\N{NO-BREAK SPACE}/\N{NO-BREAK SPACE}−41\N{NO-BREAK SPACE}µm"
    assert html.deviations((0.0, 33e-6)).split("\N{NO-BREAK SPACE}") == ["+33", "/", "0", "µm"]
    assert html.quantity(2e-5, "m") == "20 µm"
    assert html.quantity(None, "m") == ""
    assert html.pressure(6.1225e6) == "6.122 MPa"
    assert str(html.breakable("<a>.b_c.d")) == "&lt;a&gt;.b_<wbr>c.<wbr>d"


def test_the_places_of_a_state_are_those_of_its_mechanism():
    mechanism = slider_crank().prepare()
    (joint,) = slider_crank().clearance_joints()
    assert pin_size(joint) == (0.02, None)
    # The conrod turned by -90 degrees from a crank at 90: its end is below; the slider at x = 0.17.
    y = jnp.array([-np.pi / 2, 0.17, 0.0, 0.0])
    quarter = jnp.asarray(np.pi / 2 / (5000 * np.pi / 30))
    at = jax.jit(lambda t, y: picture(mechanism, t, y))(quarter, y)
    found = places(picture_dataset(slider_crank(), np.array([float(quarter)]), {n: x[None] for n, x in at.items()}))
    np.testing.assert_allclose(found.at[0, found.joints["crankpin"]], [0.0, 0.05], atol=1e-12)
    np.testing.assert_allclose(found.at[0, found.bodies["conrod"]], [[0.0, 0.05], [0.12, 0.05]], atol=1e-12)
    np.testing.assert_allclose(found.at[0, found.points["piston"]], [0.17, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.slides["guide"], [[1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(at["eccentricity"][0], [0.05, -0.05], atol=1e-12)
    assert cj.parameters(slider_crank())["wrist.pin_radius"].value == 0.01


def test_a_path_that_cannot_be_written_is_one_sentence(tmp_path):
    with refused(tmp_path / "missing" / "r.html"):
        write_report(known_findings(answer([piston_limit()])), tmp_path / "missing" / "r.html")


def test_a_robots_figure_shows_coordinates_points_and_drives():
    """Panels are lettered from (a); speeds count all three axes."""
    body = cj.Body("link", 1.0, (0.1, 0.1, 0.1), cj.Position(0.2))
    lift = cj.Prismatic("lift", "ground", "column", axis="z", motion=cj.Motion(cj.drives.Harmonic(0.1, 3.0)))
    turn = cj.Revolute("turn", "column", "link", motion=cj.Motion(velocity=2.0))
    column, tip = cj.Body("column", 1.0, (0.1, 0.1, 0.1)), cj.Point("tip", "link", cj.Position(0.3))
    robot = cj.Mechanism((column, body), (lift, turn), points=(tip,), gravity=cj.Gravity(z=-9.81))
    dataset = cj.to_dataset(robot, cj.simulate(robot, 1.0, save_at=51))
    figure = overview(dataset)
    titles = [axis.get_title() for axis in figure.axes]
    wanted = "turns", "slides", "velocity of tip", "acceleration of tip", "forces of drives", "path of tip"
    assert titles == [f"({letter}) {title}" for letter, title in zip("abcdef", wanted, strict=True)]
    (speed,) = figure.axes[2].lines
    expected = np.hypot(0.3 * 2.0, 0.1 * 3.0 * np.cos(3.0 * dataset["time"].values))
    np.testing.assert_allclose(np.asarray(speed.get_ydata()), expected, rtol=1e-6)


def test_a_yield_below_its_target_is_no_good_news():
    """The row of a yield has its bound, and the headline says that too few fresh samples hold."""
    scattered = design.Yield({CLEARANCE: 0.05}, target=0.95, samples=4)
    found = known_findings(answer([piston_limit()], manufacture=scattered))
    (row, *_) = found.standings
    assert (row.unit, row.bound) == ("m", 2e-4)
    assert row.value == pytest.approx(2e-4 * row.share)
    for samples, good in ((YieldEstimate(0.97, 0.96, 1000), True), (YieldEstimate(0.93, 0.92, 1000), False)):
        proof = design.Certificate(
            {CLEARANCE: "m"}, np.array([1e-4]), -0.01, "piston", np.nan, (), np.nan, {}, {}, (), 1.0, "lowers the cost",
            samples, {}, "dopri8", 1e-8, target=0.95,
        )  # fmt: skip
        told = found._replace(certificate=proof)
        assert told.good is good
        assert ("The yield is below its target, 95.0000%" in text_of(render(told))) is not good
        assert ("BELOW THE TARGET" in str(proof)) is not good

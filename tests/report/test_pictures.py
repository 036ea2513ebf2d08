"""Where pins bear over time, their orbits, and films: what is drawn is what the dataset says."""

import base64
import io
import re
import sys
from typing import Any

import catalogue
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from looks import check_texts
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from places import ANY, ROOT, SCENES, refused
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.cli.main import main
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import Relative
from clearance_jax.joints.sleeve import lobatto
from clearance_jax.report import figures, magnified, play_figures
from clearance_jax.report.figures import overview
from clearance_jax.report.magnified import CrossSection, Side
from clearance_jax.report.skeleton import Skeleton
from clearance_jax.results.first_fall import first_fall_ends
from clearance_jax.results.places import outline, places
from clearance_jax.results.play import FACE, along_sleeve, spans, station_paths

RADIAL, AXIAL, RADIUS, LENGTH = 1e-4, 5e-5, 0.01, 0.04
LAW = laws.HuntCrossley(1e9, 0.5)


def sleeve(pin="through", stations=5):
    return cj.SleeveClearance(RADIAL, RADIUS, LENGTH, LAW, axial_clearance=AXIAL, pin=pin, stations=stations)


@pytest.fixture(scope="module")
def crank():
    mechanism = catalogue.slider_crank()
    return cj.to_dataset(mechanism, cj.trace(mechanism, 4e-3, rtol=1e-6, save_at=81))


@pytest.fixture(scope="module")
def arm():
    """An arm in space that is shaken on its pin, with its centre of mass out of the middle."""
    body = cj.Body("arm", 2.0, cj.Inertia(2e-3, 0.03, 0.03), cj.Position(0.2, None, 0.02))
    hip = cj.Revolute("hip", "ground", "arm", motion=cj.Motion(cj.drives.Harmonic(0.35, 30.0)), clearance=sleeve())
    tip = cj.Point("tip", "arm", cj.Position(0.4))
    mechanism = cj.Mechanism((body,), (hip,), points=(tip,), gravity=cj.Gravity(0.0, -3.0, -9.81))
    return cj.to_dataset(mechanism, cj.trace(mechanism, 0.03, rtol=1e-5, save_at=121))


@pytest.fixture(scope="module")
def lift():
    """A robot without play."""
    motion, inertia = cj.Motion(cj.drives.Harmonic(0.1, 3.0)), (0.1, 0.1, 0.1)
    joints = (
        cj.Prismatic("lift", "ground", "column", axis="z", motion=motion),
        cj.Revolute("turn", "column", "link", motion=cj.Motion(velocity=2.0)),
    )
    bodies = cj.Body("column", 1.0, inertia), cj.Body("link", 1.0, inertia, cj.Position(0.2))
    tip = cj.Point("tip", "link", cj.Position(0.3))
    robot = cj.Mechanism(bodies, joints, points=(tip,), gravity=cj.Gravity(z=-9.81))
    return cj.to_dataset(robot, cj.simulate(robot, 1.0, save_at=21))


# What is known ------------------------------------------------------------------------------------------------------


def test_marks_are_where_joints_and_points_are(crank):
    marks = {(name, body): crank["mark_position"].values[:, k] for k, (name, body) in
             enumerate(zip(crank["mark"].values, crank["mark_body"].values, strict=True))}  # fmt: skip
    angle = 5000 * np.pi / 30 * crank["time"].values
    pin = 0.05 * np.stack([np.cos(angle), np.sin(angle)], 1)
    np.testing.assert_allclose(marks["crankpin", "crank"], pin, atol=1e-12)
    np.testing.assert_allclose(marks["crankpin", "conrod"], pin, atol=1e-12)
    np.testing.assert_array_equal(marks["piston", "slider"], crank["position"].sel(point="piston"))
    # The two places of the joint with play are as far from each other as the pin is from its sleeve's middle.
    apart = np.linalg.norm(marks["wrist", "slider"] - marks["wrist", "conrod"], axis=1)
    eccentric = np.linalg.norm(crank["eccentricity"].values[:, 0], axis=1)
    np.testing.assert_allclose(apart, eccentric, atol=1e-15 / 1e-3)
    assert eccentric.max() > 5e-4


@pytest.mark.parametrize("pin", ["through", "inside"])
def test_stations_are_those_of_the_joint(pin):
    """Penetrations along a sleeve, from a dataset's two vectors: the joint's own, which knows the whole rotation."""
    rng, joint = np.random.default_rng(2), sleeve(pin, stations=6)
    heights = 0.5 * LENGTH * lobatto(6)[0]
    for _ in range(5):
        place, turn = 1e-4 * rng.normal(size=3), 5e-3 * rng.normal(size=3)
        rows = Rotation.from_rotvec(turn).as_matrix()
        triples = tuple(tuple(jnp.asarray(x) for x in row) for row in rows)
        at = Relative(tuple(jnp.asarray(x) for x in place), 0.0, (0.0,) * 3, (0.0,) * 3, triples)
        own = joint.points(at).penetration[:6]
        centre = along_sleeve(place[None], rows[None, :2, 2], heights, pin == "through")[0]
        np.testing.assert_allclose(np.hypot(*centre.T) - RADIAL, own, rtol=0, atol=1e-17)


@pytest.mark.slow
def test_a_file_says_what_its_joints_are(arm, tmp_path):
    cj.save(arm, tmp_path / "a.nc")
    again = cj.load_dataset(tmp_path / "a.nc")
    assert again.identical(arm)
    said = {name: value for name, value in again.attrs.items() if name.startswith("clearance.hip")}
    assert said == {
        "clearance.hip": "sleeve",
        "clearance.hip.pin": "through",
        "clearance.hip.stations": 5,
        "clearance.hip.ring": 8,
    }
    assert cj.animate(again).exaggeration == cj.animate(arm).exaggeration == 30.0


@pytest.mark.slow
def test_spans_of_contact_are_the_episodes(crank, arm):
    for dataset, joint in ((crank, "wrist"), (arm, "hip")):
        found = spans(dataset, joint)
        np.testing.assert_array_equal(found.begin[1:], found.end[:-1])
        assert found.begin[0] == dataset["time"][0]
        assert found.end[-1] == dataset["time"][-1]
        bears = np.concatenate([[False], found.pattern > 0, [False]])
        edges = np.append(found.begin, found.end[-1])
        ends = dataset["episode_end"].fillna(found.end[-1])
        assert dataset.sizes["episode"] >= 2
        # Steps end just past touch and separation.
        for edge, event in (
            (edges[bears[1:] & ~bears[:-1]], dataset["episode_start"]),
            (edges[~bears[1:] & bears[:-1]], ends),
        ):
            late = edge - event.values
            assert np.all((late >= 0) & (late < 1e-5))
    # In space they tell more; at the samples it is what is observed there.
    codes = found.pattern[np.searchsorted(found.begin, arm["time"].values[:-1], side="right") - 1]
    differ = codes != arm["contact_pattern"].values[:-1, 0]
    assert np.mean(differ) < 0.1  # between two step ends one edge may follow another
    assert len(set(found.pattern)) >= 3
    assert found.share(found.pattern >= 0) == pytest.approx(1.0)
    np.testing.assert_array_equal(arm["step_pattern"].values[1:, 0] > 0, arm["step_state"].values[1:, 0] > 0)


def test_samples_have_to_do_where_steps_are_not_known(arm):
    bare = arm.drop_vars([name for name in arm if str(name).startswith("step_")])
    found = spans(bare, "hip")
    codes = found.pattern[np.searchsorted(found.begin, arm["time"].values[:-1], side="right") - 1]
    np.testing.assert_array_equal(codes, arm["contact_pattern"].values[:-1, 0])


def swinging() -> xr.Dataset:
    """A lever that swings by 0.4 rad and has a corner out of its line; a block slides on it through its middle mark."""
    time = np.linspace(0.0, 1.0, 41)
    along = np.stack([np.cos(0.4 * time), np.sin(0.4 * time)], 1)
    across, far = np.stack([-along[:, 1], along[:, 0]], 1), (time - 0.5)[:, None]
    middle = 1.0 * along
    block = middle + far * along
    at = np.stack([0 * along, 0 * along, middle, middle + across, block, block], 1)
    marks = {"mark": ["pivot", "pivot", "guide", "corner", "guide", "block"],
             "mark_body": ["ground", "lever", "lever", "lever", "block", "block"]}  # fmt: skip
    coords = {name: ("mark", values) for name, values in marks.items()}
    return xr.Dataset(
        {"mark_position": (("time", "mark", "axis"), at)},
        coords | {"time": time, "any_joint": ["pivot", "guide"], "point": ["corner"]},
    )


def test_a_slider_lies_along_its_guide_and_a_broad_body_is_a_plate():
    """Where the slider is in the middle, its two marks in one place, it has the direction that it had just before."""
    found = places(swinging())
    assert (set(found.pairs), set(found.bodies), found.ground) == ({"guide"}, {"lever", "block"}, [0])
    lever = found.at[:, 2]
    along = np.abs(np.sum(found.slides["guide"] * lever, axis=1))
    np.testing.assert_allclose(along, 1.0, atol=2e-3)
    skeleton = Skeleton(Figure().subplots(), found)
    ((plate, marks),) = skeleton._plates
    ((block, rails, name, mark),) = skeleton._sliders
    for i in (0, 20, 40):
        skeleton.show(i)
        corners = plate.get_xy()[:-1]  # closed
        assert {tuple(corner) for corner in corners} == {tuple(at) for at in found.at[i, marks]}
        np.testing.assert_allclose(block.get_xy()[:-1].mean(axis=0), found.at[i, mark], atol=1e-12)
        run = np.diff(rails.get_xydata()[:2], axis=0)[0]
        np.testing.assert_allclose(np.abs(run @ found.slides[name][i]), np.linalg.norm(run), rtol=1e-12)
    assert outline(swinging()).seen == ""


# Figures ------------------------------------------------------------------------------------------------------------


def bars(axis) -> dict:
    """Of every label the spans that its bars cover."""
    found = {}
    for collection in axis.collections:
        boxes = [path.get_extents() for path in collection.get_paths()]
        found[collection.get_label()] = np.array([(box.x0, box.x1) for box in boxes])
    return found


def test_the_timeline_has_a_bar_for_every_span(arm):
    figure = figures.play(arm)
    drawn, found = bars(figure.axes[0]), spans(arm, "hip")
    for code, (words, *_) in enumerate(play_figures.PATTERNS):
        chosen = found.pattern % FACE == code
        shown = [box for label, box in drawn.items() if label.startswith(words)]
        if not np.any(chosen):
            assert shown == []
            continue
        wanted = 1e3 * np.stack([found.begin, found.end], 1)[chosen]
        np.testing.assert_allclose(shown[0], wanted, rtol=0, atol=1e-9)
    (faces,) = [box for label, box in drawn.items() if label.startswith("on a face")]
    assert len(faces) == np.sum(found.pattern >= FACE) > 0
    # The shares of the radial states make up the whole, as far as whole per cents do.
    shares = [int(share) for label in drawn for share in re.findall(r"\((\d+)%", label) if "face" not in label]
    assert abs(sum(shares) - 100) <= 2


def test_orbits_are_the_pins_places_at_every_station(arm):
    figure = figures.play(arm)
    orbits = [axis for axis in figure.axes if axis.get_title().startswith("z = ")]
    found = station_paths(arm, "hip")
    assert len(orbits) == len(found) == 5
    assert found[0].time.size > arm.sizes["time"]
    for path, axis in zip(found, orbits, strict=True):
        flight, touching, circle = axis.lines
        bears = path.state > 0
        np.testing.assert_array_equal(np.stack(touching.get_data(), 1), 1e6 * path.places[bears])
        # Flights are smooth curves through the places that are known, within the clearance.
        drawn = np.stack(flight.get_data(), 1)
        near, _ = KDTree(drawn[np.isfinite(drawn[:, 0])]).query(1e6 * path.places[~bears])
        assert near.max() < 0.01 * 1e6 * RADIAL
        assert np.nanmax(np.hypot(*drawn.T)) < max(1.01 * 1e6 * RADIAL, 1e6 * np.hypot(*path.places.T).max())
        reach = np.hypot(*touching.get_data())
        assert np.all(reach > 1e6 * RADIAL)
        assert len(reach) == np.sum(bears)
        np.testing.assert_allclose(np.hypot(*circle.get_data()), 1e6 * RADIAL)
        assert axis.get_aspect() == 1.0
    assert "edge" in orbits[0].get_title()
    assert "edge" not in orbits[2].get_title()
    assert "−20 mm" in orbits[0].get_title()
    only = [axis for axis in figures.play(arm, edges=True).axes if axis.get_title().startswith("z = ")]
    assert [axis.get_title() for axis in only] == [orbits[0].get_title(), orbits[-1].get_title()]
    # At the middle station the pin's centre is where the dataset says.
    middle = np.isin(found[2].time, arm["time"].values)
    place = arm["eccentricity"].values[:, 0]
    slope = arm["pin_tilt"].values[:, 0]
    expected = place[:, :2] - place[:, 2:] * slope / np.sqrt(1 - np.sum(slope**2, 1, keepdims=True))
    np.testing.assert_allclose(found[2].places[middle], expected, atol=1e-18)


def test_joints_of_the_plane_stand_side_by_side(crank):
    """With the share of the time that the episodes last."""
    figure = figures.play(crank)
    bars_of, orbit = figure.axes
    lasts = (crank["episode_end"].fillna(crank["time"][-1]) - crank["episode_start"]).values.sum()
    share = lasts / float(crank["time"][-1])
    assert orbit.get_title() == f"wrist: bears {share:.0%}"
    assert set(bars(bars_of)) == {f"apart ({1 - share:.0%})", f"in contact ({share:.0%})"}


def many(dataset, count):
    """A dataset of one joint as that of so many, each with another force."""
    names = [f"axis_{k + 1}_joint" for k in range(count)]
    factors = xr.DataArray(np.random.default_rng(3).permutation(np.linspace(0.5, 2.0, count)), dims="joint")
    of_episodes = [name for name in dataset if dataset[name].dims == ("episode",)]
    out = dataset.drop_vars(of_episodes).isel(joint=[0] * count).assign_coords(joint=names)
    out = out.drop_vars("mark_position")  # the marks have the old names
    out = out.assign({name: out[name] * factors for name in ("contact_force", "step_force")})
    tiled = {name: ("episode", np.tile(dataset[name], count), dataset[name].attrs) for name in of_episodes}
    tiled["episode_joint"] = "episode", np.repeat(np.arange(count), dataset.sizes["episode"]), {}
    numbers = {k.replace("wrist", name): v for k, v in dataset.attrs.items() if "wrist" in k for name in names}
    largest = sorted(names[k] for k in np.argsort(factors.values)[-6:])
    return out.assign(tiled).assign_attrs(numbers), largest


@pytest.mark.parametrize("count", [4, 12, 30])
def test_a_figure_of_many_joints_shows_those_that_bear_most(crank, count):
    """No two texts lie over each other, and none leaves the figure."""
    dataset, largest = many(crank, count)
    for figure in (overview(dataset), figures.play(dataset)):
        check_texts(figure)
        shown = [axis.get_title().split(":")[0] for axis in figure.axes]
        shown = sorted(name for name in shown if name.startswith("axis_"))
        assert shown == (largest if count > 6 else list(dataset["joint"].values))
        assert (f"the 6 of {count}" in figure.get_suptitle() or f"of {count} joints" in figure.get_suptitle()) == (
            count > 6
        )


def test_what_is_no_play_is_refused(crank, lift):
    with pytest.raises(ClearanceError, match="no joint of this result has clearance"):
        figures.play(lift)
    with refused("wirst", allowed="wrist"):
        spans(crank, "wirst")
    with refused("wrist"):
        station_paths(crank.assign_attrs({"clearance.wrist": "guide", "outline.wrist.height": 0.02}), "wrist")


def frames_of(gif: Any) -> int:
    return gif.n_frames


# Films --------------------------------------------------------------------------------------------------------------


def views(film, kind) -> list:
    return [view for view in film._views if isinstance(view, kind)]


def test_a_magnified_pin_is_its_eccentricity_times_the_factor(crank):
    film = cj.animate(crank, "wrist", exaggeration=7.0)
    ((section,), (skeleton,)) = views(film, CrossSection), views(film, Skeleton)
    assert (film.exaggeration, section.joint.outline.radius) == (7.0, 0.01)
    assert section.joint.wall == pytest.approx(0.01 + 7 * 5e-4, rel=1e-12)
    touched = 0
    for k in range(0, len(film), 5):
        film.show(k)
        i = film.frames[k]
        np.testing.assert_allclose(section.pin.center, 7.0 * crank["eccentricity"].values[i, 0], rtol=1e-12)
        touching = crank["penetration"].values[i, 0] > 0
        assert (len(section.mark.get_xdata()) > 0) == touching
        if touching:  # marked where the pin's centre points to
            x, y = np.mean(section.mark.get_data(), axis=1)
            towards = crank["eccentricity"].values[i, 0]
            np.testing.assert_allclose(np.arctan2(y, x), np.arctan2(towards[1], towards[0]), atol=1e-12)
            touched += 1
        for line, marks in skeleton._lines:
            np.testing.assert_array_equal(np.transpose(line.get_data()), crank["mark_position"].values[i, marks])
        assert film.figure.get_suptitle().startswith(f"mechanism   t = {1e3 * crank['time'].values[i]:.3f} ms")
        assert [cursor.get_xdata()[0] for cursor in film._cursors] == [1e3 * crank["time"].values[i]] * 2
    assert touched > 0


def test_a_leaning_pin_is_seen_from_the_side_and_at_both_edges(arm):
    film = cj.animate(arm)
    assert film.joint == "hip"
    sides, sections, found = views(film, Side), views(film, CrossSection), station_paths(arm, "hip")
    at_samples = np.isin(found[0].time, arm["time"].values)
    places = np.stack([path.places[at_samples] for path in found], 1)
    bearing = np.stack([path.state[at_samples] > 0 for path in found], 1)
    k, edges = film.exaggeration, np.array([[-LENGTH / 2, 0.0], [LENGTH / 2, 0.0]])
    marked = on_faces = 0
    for frame, i in enumerate(film.frames.tolist()):
        film.show(frame)
        for section, end in zip(sections, (0, -1), strict=True):
            np.testing.assert_allclose(section.pin.center, k * places[i, end], atol=1e-12)
            assert (len(section.mark.get_xdata()) > 0) == bearing[i, end]
        for up, side in enumerate(sides):
            # The axis of the pin, drawn: at the edges where the sections have it, and shifted along as it slid.
            moved = side.move(edges, i)
            np.testing.assert_allclose(moved[:, 0] - edges[:, 0], k * arm["eccentricity"].values[i, 0, 2], atol=1e-12)
            np.testing.assert_allclose(moved[:, 1], k * places[i][[0, -1], up], atol=1e-5)
            marked += len(side.walls.get_xdata())
            bears = arm["contact_pattern"].values[i, 0] >= FACE
            assert (len(side.faces.get_xdata()) > 0) == bears
            on_faces += bears
    # Every station that bears is marked in the view in which it bears at the edge of the picture.
    assert marked == np.sum(bearing[film.frames]) > 0
    assert on_faces > 0


def test_nothing_hides_anything_else(arm, crank, lift):
    """No two texts of a frame overlap, and none leaves the picture."""
    for dataset in (arm, crank, lift):
        film = cj.animate(dataset)
        figure = film.show(len(film) // 2)
        figure.draw_without_rendering()
        texts = {id(text): text for text in figure.findobj(Text) if text.get_visible()}.values()
        boxes = [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text().strip()]
        page = figure.bbox
        inside = [(t, b) for t, b in boxes if b.x1 > 0 and b.y1 > 0 and b.x0 < page.x1 and b.y0 < page.y1]
        assert len(inside) > 8
        for text, box in inside:
            if not re.fullmatch(r"[−\d.]+", text):  # ticks of a hidden part of an axis
                assert box.x0 >= 0, text
                assert box.x1 <= page.x1, text
                assert box.y1 <= page.y1, text
        titles = [(text, box) for text, box in inside if len(text) > 6]
        for a, (text, box) in enumerate(titles):
            for other, its in titles[a + 1 :]:
                assert not box.overlaps(its), (text, other)


def test_a_gif_has_every_frame_for_as_long_as_it_lasts(crank, tmp_path):
    film = cj.animate(crank, slowdown=500.0, span=(1e-3, 2e-3), fps=10.0)
    done = []
    path = film.save(tmp_path / "film.gif", done.append)
    assert list(tmp_path.iterdir()) == [path]
    assert done == pytest.approx([(k + 1) / len(film) for k in range(len(film))])
    with Image.open(path) as gif:
        assert (gif.format, frames_of(gif)) == ("GIF", len(film))
        assert gif.info["duration"] == 100
        assert gif.size == tuple(int(x) for x in film.figure.bbox.size)
        pictures = []
        for k in (0, len(film) - 1):
            gif.seek(k)
            pictures.append(np.asarray(gif.convert("RGB"), int))
    assert np.any(np.abs(pictures[0] - pictures[1]) > 100)
    canvas = FigureCanvasAgg(film.show(len(film) - 1))
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    # One palette for all frames: nothing is further than a shade from what was drawn.
    assert np.mean(np.any(pictures[1] != drawn, axis=-1)) < 0.02
    assert np.max(np.abs(pictures[1] - drawn)) < 60


def test_a_notebook_shows_a_film_by_itself(crank):
    film = cj.animate(crank, slowdown=2000.0, span=(0.0, 2e-4))
    data = re.findall(r'src="data:image/gif;base64,([^"]*)"', film._repr_html_())[0]
    with Image.open(io.BytesIO(base64.b64decode(data))) as gif:
        assert frames_of(gif) == len(film) == 5


def test_frames_are_samples_and_no_more_than_there_are(crank):
    film = cj.animate(crank, slowdown=2000.0)
    assert list(film.frames) == list(range(81))
    assert film.fps == pytest.approx(80 / 8.0)
    few = cj.animate(crank, slowdown=500.0, fps=10.0)
    assert len(few) == 21
    assert few.fps == pytest.approx(10.0)
    assert cj.animate(crank).slowdown == 2000  # 4 ms in 8 s: ten at most
    part = cj.animate(crank, span=(1e-3, 2e-3))
    times = crank["time"].values[part.frames]
    assert times[0] == pytest.approx(1e-3)
    assert times[-1] == pytest.approx(2e-3)


@pytest.mark.parametrize(("value", "rounded"), [(7.0, 7.0), (0.3, 1.0), (74.9, 70.0), (100.0, 100.0), (2300.0, 2000.0)])
def test_a_factor_is_round_and_never_makes_smaller(value, rounded):
    assert magnified.round_factor(value) == rounded


def test_half_a_film_is_no_film(crank, tmp_path):
    def interrupted(done):
        if done > 0.3:
            raise KeyboardInterrupt

    film = cj.animate(crank, slowdown=500.0, span=(0.0, 5e-4))
    with pytest.raises(KeyboardInterrupt):
        film.save(tmp_path / "film.gif", interrupted)
    assert list(tmp_path.iterdir()) == []
    with refused(tmp_path / "missing" / "film.gif"):
        film.save(tmp_path / "missing" / "film.gif")


def test_without_play_the_mechanism_alone_is_filmed(lift):
    film = cj.animate(lift)
    (skeleton,) = film._views
    assert skeleton.in_space
    film.show(len(film) - 1)
    tips = np.stack(next(line.get_data_3d() for line, _ in skeleton._trails), axis=1)
    np.testing.assert_allclose(tips, lift["position"].sel(point="tip").values)
    np.testing.assert_allclose(tips[:, 2], 0.1 * np.sin(3 * lift["time"].values), atol=1e-12)


def test_a_block_leans_in_its_guide():
    law = laws.HuntCrossley(1e9, 0.5)
    play = cj.GuideClearance(side_clearance=1e-4, length=0.06, height=0.03, normal=law)
    joint = cj.Prismatic("guide", "ground", "block", motion=cj.Motion(velocity=0.2), clearance=play)
    block = cj.Mechanism((cj.Body("block", 0.5, 2e-4, cj.Position(0.01)),), (joint,), gravity=cj.Gravity(y=-9.81))
    dataset = cj.to_dataset(block, cj.simulate(block, 0.02, save_at=41))
    film = cj.animate(dataset, "guide")
    (side,) = views(film, Side)
    touched = 0
    for k, i in enumerate(film.frames):
        film.show(k)
        corner = side.patches[0].get_xy()
        lean = np.tan(dataset["q"].sel(coordinate="guide.tilt_y").values[i])
        middle = dataset["eccentricity"].values[i, 0, 0]
        low = film.exaggeration * (middle - lean * 0.03) - 0.015
        assert np.min(np.abs(corner[:, 1] - low)) < 1e-12
        touched += len(side.walls.get_xdata())
        if dataset["penetration"].values[i, 0] < -1e-8:
            assert len(side.walls.get_xdata()) == 0
    assert touched > 0
    loose = dataset.sel(coordinate=[name for name in dataset["coordinate"].values if "tilt" not in name])
    with refused("guide"):
        cj.animate(loose, "guide")


@pytest.mark.parametrize(
    ("options", "about"),
    [
        ({"joint": "wirst"}, ("wirst", "wirst", "wrist")),
        ({"slowdown": 0.0}, ("slowdown", 0.0, "greater than 0")),
        ({"exaggeration": 0.5}, ("exaggeration", 0.5, "at least 1")),
        ({"fps": float("nan")}, ("fps", ANY, "greater than 0")),
        ({"span": (3e-3, 2e-3)}, ("span", 0)),
    ],
)
def test_what_cannot_be_filmed_is_said(crank, options, about):
    with refused(*about):
        cj.animate(crank, **options)


def test_older_results_and_other_endings_are_refused(crank, monkeypatch, tmp_path):
    with pytest.raises(ClearanceError, match="Simulate again"):
        cj.animate(crank.drop_vars("mark_position"))
    film = cj.animate(crank)
    with refused(tmp_path / "film.avi"):
        film.save(tmp_path / "film.avi")
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(ClearanceError, match="needs the program ffmpeg"):
        film.save(tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


# On the command line ------------------------------------------------------------------------------------------------


def run(monkeypatch, capsys, *arguments) -> tuple[int, str]:
    monkeypatch.setattr(sys, "argv", ["clearance", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out + said.err


def test_a_result_file_is_filmed_and_its_play_drawn(crank, monkeypatch, capsys, tmp_path):
    cj.save(crank, tmp_path / "a.nc")
    options = "--slowdown", "500", "--from", "1ms", "--to", "1.5ms", "--magnify", "wrist"
    code, said = run(monkeypatch, capsys, "animate", tmp_path / "a.nc", *options)
    assert code == 0
    assert "a.gif" in said
    with Image.open(tmp_path / "a.gif") as gif:
        assert frames_of(gif) == 6
    code, said = run(monkeypatch, capsys, "plot", tmp_path / "a.nc", "--play", "-o", tmp_path / "p.png")
    assert code == 0
    with Image.open(tmp_path / "p.png") as picture:
        assert picture.format == "PNG"
    code, said = run(monkeypatch, capsys, "animate", tmp_path / "a.nc", "-o", tmp_path / "b.gif", "--magnify", "wirst")
    assert code == 2
    assert "Did you mean `wrist`?" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.gif", "a.nc", "p.png"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--movie", "a.gif", "--magnify", "wirst"], "Did you mean `wrist`?"),
        (["--magnify", "wrist"], "Add `--movie FILE`"),
        (["--movie", "a.avi"], "must end in .gif or .mp4"),
        (["--movie", "missing/a.gif"], "its folder does not exist"),
        (["--movie", "a.gif", "--plot", "b.gif"], "must end in .png"),
        (["--movie", "a.gif", "--plot", "a.gif"], "are the same file"),
    ],
)
def test_what_no_film_can_show_is_said_before_the_solve(options, words, monkeypatch, capsys, tmp_path):
    scene = SCENES / "slider_crank.toml"
    monkeypatch.chdir(tmp_path)
    code, said = run(monkeypatch, capsys, "simulate", scene, "--t1", "1ms", *options)
    assert code == 2
    assert words in said
    assert list(tmp_path.iterdir()) == []


# Kinds of figures ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def erring(crank):
    """The crank with errors of its point, as a dataset has them."""
    errors = 1e-4 * np.abs(np.sin(2 * np.pi * crank["time"].values / 1e-3))[:, None]
    return crank.assign(position_error=(("time", "point"), errors, {"units": "m"}))


@pytest.mark.parametrize("kind", figures.KINDS)
def test_every_kind_of_figure_can_be_read(erring, kind):
    """On a page and on a phone, with one joint and with six; text of a narrow figure is large enough on 390 pixels."""
    for dataset in (erring, many(erring, 6)[0]):
        for narrow in (False, True):
            check_texts(figures.KINDS[kind](dataset, narrow=narrow))
    assert 390 / figures.KINDS[kind](erring, narrow=True).get_figwidth() * 8 / 72 > 10


def wandering(*reach: float) -> xr.Dataset:
    """A point that goes so far along x, y and z [m]."""
    angle = np.linspace(0.0, 2 * np.pi, 21)
    place = np.stack([np.cos(angle), np.sin(angle), np.sin(2 * angle + 0.3)], 1) * reach
    coords = {"time": angle, "point": ["tool"], "axis": ["x", "y", "z"]}
    return xr.Dataset({"position": (("time", "point", "axis"), place[:, None])}, coords)


@pytest.mark.parametrize("reach", [(0.3, 0.3, 1.0), (1.0, 0.02, 1.0), (1.0, 1.0, 0.02)])
@pytest.mark.parametrize("narrow", [False, True])
def test_the_labels_of_axes_in_space_are_on_the_page(reach, narrow):
    """Layouts of matplotlib leave no room for them, whatever the box is like."""
    figure = figures.motion(wandering(*reach), narrow=narrow)
    check_texts(figure)
    (axis,) = figure.axes
    assert [getattr(axis, f"get_{name}label")() for name in "xyz"] == ["x, m", "y, m", "z, m"]


def titled(figure, words: str) -> Any:
    (axis,) = [axis for axis in figure.axes if words in axis.get_title(loc="left")]
    return axis


def test_the_first_fall_is_set_apart(erring):
    figure = overview(erring)
    (over,) = first_fall_ends(erring)
    force, fall = titled(figure, "contact force after the first fall"), titled(figure, "in the first fall")
    assert 0 < over < float(erring["time"][-1])
    ends, forces = erring["step_time"].values, erring["step_force"].values[:, 0]
    drawn = {axis: np.stack(axis.lines[-1].get_data()) for axis in (force, fall)}
    assert drawn[fall][0].max() == pytest.approx(1e3 * over)
    assert drawn[force][0].min() > 1e3 * over
    peaks = erring["peak_force"].values[erring["peak_time"].values > over]
    assert drawn[force][1].max() == pytest.approx(1e-3 * max(forces[ends > over].max(), *peaks))
    assert force.get_ylim()[1] < 1e-3 * forces.max() < fall.get_ylim()[1]  # both in kN
    assert f"{drawn[force][1].max():.4g} kN" in force.get_legend().get_texts()[0].get_text()
    (error,) = titled(figure, "ideal mechanism").lines
    np.testing.assert_allclose(error.get_ydata(), 1e6 * erring["position_error"].values[:, 0])
    # Without the error the figure says why.
    assert "it moves freely" in overview(crank_without(erring)).get_suptitle()


def crank_without(dataset):
    return dataset.drop_vars("position_error").assign_attrs(ideal="it moves freely")


def test_the_rose_has_the_share_of_every_direction(crank):
    forces, rose = figures.polar_load(crank).axes
    (over,) = first_fall_ends(crank)
    last = float(crank["time"][-1])
    begin, end = crank["episode_start"].values, crank["episode_end"].fillna(last).values
    bears = np.sum(np.clip(end - np.maximum(begin, over), 0, None)) / (last - over)
    assert sum(bar.get_height() for bar in rose.patches) == pytest.approx(100 * bears, rel=0.02)
    angle, force = forces.lines[0].get_data()
    largest = int(np.argmax(np.where(crank["time"] > over, crank["contact_force"].values[:, 0], 0)))
    x, y = crank["eccentricity"].values[largest, 0]
    near = int(np.argmin(np.abs(1e3 * force - crank["contact_force"].values[largest, 0])))
    assert angle[near] == pytest.approx(np.arctan2(y, x))


def test_a_spectrum_finds_a_frequency_and_the_variance(crank):
    """Of a sine: the density is largest at its frequency, and its integral is the variance, by Parseval's theorem."""
    time = np.linspace(0.0, 1.0, 4001)
    sine = 30.0 + 5.0 * np.sin(2 * np.pi * 200.0 * time)
    signal = xr.Dataset(
        {"contact_force": (("time", "joint"), sine[:, None]), "contact_state": (("time", "joint"), np.ones((4001, 1)))},
        coords={"time": time, "joint": ["wrist"]},
    )
    figure = figures.spectrum(signal, modes=[250.0])
    (axis,) = figure.axes
    frequency, density = axis.lines[0].get_data()
    resolution = frequency[0]
    assert f"{resolution:.3g} Hz" in axis.get_title(loc="left")
    assert abs(frequency[np.argmax(density)] - 200.0) <= resolution
    assert np.sum(density) * resolution == pytest.approx(12.5, rel=0.02)
    assert axis.lines[1].get_xdata()[0] == 250.0
    few = crank.drop_vars([name for name in crank if str(name).startswith("step_")])
    with refused("time", ANY):
        figures.spectrum(few.isel(time=slice(0, 60)))


def test_episodes_are_those_of_the_dataset(crank):
    speed, force, restitution = figures.episodes(crank).axes
    (over,) = first_fall_ends(crank)
    for axis, name in ((speed, "impact_speed"), (restitution, "restitution")):
        later, falling = axis.lines
        fell = crank["episode_start"].values <= over
        np.testing.assert_array_equal(later.get_ydata(), crank[name].values[~fell])
        np.testing.assert_array_equal(falling.get_ydata(), crank[name].values[fell])
        assert falling.get_markerfacecolor() == "none"
    assert force.get_ylabel() == "largest force, kN"


def test_a_kind_is_chosen_by_name(crank, lift, monkeypatch, capsys, tmp_path):
    with pytest.raises(ClearanceError) as refusal:
        figures.polar_load(lift)
    assert "is a pin in a sleeve" in str(refusal.value)
    check_texts(figures.motion(lift, narrow=True))
    cj.save(crank, tmp_path / "a.nc")
    code, said = run(monkeypatch, capsys, "plot", tmp_path / "a.nc", "--plot-kind", "episodes", "--narrow")
    assert (code, (tmp_path / "a.png").exists()) == (0, True)
    code, said = run(monkeypatch, capsys, "plot", tmp_path / "a.nc", "--plot-kind", "episode")
    assert code == 2
    assert "Did you mean `episodes`?" in said
    code, said = run(monkeypatch, capsys, "plot", tmp_path / "a.nc", "--plot-kind", "episodes", "--play")
    assert code == 2
    page = (ROOT / "docs" / "figures.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in page for name in figures.KINDS)

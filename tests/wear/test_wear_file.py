"""Studies of wear, worn sleeves in scenes, and `clearance run` of a life."""

import json
import signal
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from key_reference import example
from looks import check_texts
from places import SCENES, refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import wear
from clearance_jax.cli.main import app
from clearance_jax.io.keys import play as play_keys
from clearance_jax.io.keys import study as study_keys
from clearance_jax.io.keys import wear as wear_keys
from clearance_jax.io.scene.scene import load_scene
from clearance_jax.io.study.study import load_study
from clearance_jax.io.study.wear import WearAsked
from clearance_jax.report import wear_figures
from clearance_jax.results.play import pin_travel
from clearance_jax.runs.journal import Journal

SCENE = SCENES / "disc.toml"
RUN = CliRunner()


def lines(values: dict[str, str]) -> str:
    return "".join(f"{name} = {value}\n" for name, value in values.items())


def inline(values: dict[str, str]) -> str:
    return "{ " + ", ".join(f"{name} = {value}" for name, value in values.items()) + " }"


TOP = lines({"joint": '"pin"', "length": '"50 mm"', "cycles": "100"})
LAW = '[wear.law]\nkind = "archard"\ncoefficient = "6e-14 1/Pa"\n'
PRESSURE = '[wear.pressure]\nkind = "foundation"\nstiffness = "2e13 Pa/m"\n'


def load(tmp_path, top=TOP, law=LAW, pressure=PRESSURE, rest="") -> WearAsked:
    path = tmp_path / "life.toml"
    path.write_text(f'scene = "{SCENE}"\n[wear]\n{top}{law}{pressure}{rest}')
    asked = load_study(path).wear
    assert asked is not None
    return asked


# The section ----------------------------------------------------------------------------------------------------------


def test_examples_of_the_section_are_read(tmp_path):
    values = example(wear_keys.WEAR, "law", "pressure", "until")
    rest = "[solve]\n" + lines(example(study_keys.SOLVE)) + '[set]\n"disc.mass" = "5 kg"\n'
    read = load(tmp_path, lines(values | {"joint": '"pin"'}), rest=rest)
    clearance: Any = read.model.mechanism.joint("pin")
    assert float(clearance.clearance.length) == pytest.approx(0.02)
    assert float(clearance.clearance.sleeve_material.modulus) == pytest.approx(110e9)
    assert (float(read.model.cycle), read.cycles, read.model.joint) == (0.012, 100000, "pin")
    assert read.options == {"sectors": 720, "tolerance": 0.01, "longest": 1000}
    assert read.solve == {"rtol": 1e-8, "solver": "dopri8", "start": "settled", "max_steps": 100000} | {
        "fidelity": "quasi-static"
    }
    assert float(read.model.mechanism.bodies[0].mass) == 5
    assert read.journal == tmp_path / "wear.journal"
    # What is said nowhere is the scene's.
    assert (float(load(tmp_path).model.cycle), load(tmp_path).solve) == (0.05, {"rtol": 1e-6, "start": "settled"})


@pytest.mark.parametrize("word", wear_keys.LAW_TABLES)
def test_examples_of_laws_are_read(word, tmp_path):
    changes = {"least_pressure": '"1 MPa"'}
    changes |= {name: inline(example(getattr(wear_keys, name.upper()))) for name in ("graded", "running_in")}
    values = example(wear_keys.LAW_TABLES[word], *changes, "hardness")
    at = wear.SlidingState(jnp.asarray(3e6), jnp.asarray(0.2), jnp.asarray(0.3), jnp.asarray(3600.0))
    plain = load(tmp_path, law="[wear.law]\n" + lines(values)).model.wear
    assert float(plain.rate(at)) == pytest.approx({"archard": 6e-14, "reye": 0.3 * 1e-13}[word] * 3e6 * 0.2)
    changed = load(tmp_path, law="[wear.law]\n" + lines(values | changes)).model.wear
    graded = (2e6 / 10e6) ** 0.5 * (0.2 / 0.1) ** -0.25
    assert float(changed.rate(at)) == pytest.approx(float(plain.rate(at)) * 2 / 3 * graded * (1 + 4 / np.e))


def test_archard_s_number_stands_beside_a_hardness(tmp_path):
    law: Any = load(tmp_path, law='law = { kind = "archard", coefficient = 7.8e-5, hardness = "1.3 GPa" }\n').model.wear
    assert float(law.coefficient) == pytest.approx(6e-14)


@pytest.mark.parametrize("word", wear_keys.PRESSURE_TABLES)
def test_examples_of_pressures_are_read(word, tmp_path):
    materials = "".join(f"{which}_material = {inline(example(wear_keys.MATERIAL))}\n" for which in ("pin", "sleeve"))
    layer = ("thickness", "material")
    pressure = "[wear.pressure]\n" + lines(example(wear_keys.PRESSURE_TABLES[word], *layer))
    read = load(tmp_path, TOP + materials, pressure=pressure)
    kinds = {"foundation": wear.Foundation, "hertz": wear.HertzLine, "uniform": wear.Uniform}
    assert isinstance(read.model.pressure, kinds[word])
    if word == "foundation":
        values = example(wear_keys.PRESSURE_TABLES[word], "stiffness")
        found: Any = load(tmp_path, pressure="[wear.pressure]\n" + lines(values)).model.pressure
        assert float(found.stiffness) == pytest.approx(0.6 * 3e9 / (1.4 * 0.2 * 2e-3))


RIM = '[metric.rim]\nkind = "peak"\nsignal = "position-error"\npoint = "rim"\n'


@pytest.mark.parametrize("word", wear_keys.UNTIL_TABLES)
def test_examples_of_ends_are_read(word, tmp_path):
    values = example(wear_keys.UNTIL_TABLES[word])
    values |= {"metric": '"rim"'} if word == "metric" else {}
    read = load(tmp_path, rest="[wear.until]\n" + lines(values) + RIM)
    assert isinstance(read.until, wear.AbstractCriterion)
    assert read.until.bound > 0
    assert read.words


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"law": ""}, "wear lacks the key `law`"),
        ({"law": LAW.replace("archard", "archad")}, "wear.law.kind must be one of the allowed words.* `archard`"),
        ({"law": LAW.replace('"6e-14 1/Pa"', "6e-14")}, r"wear.law.coefficient needs a unit.* \"6e-14 1/Pa\""),
        ({"law": LAW.replace("1/Pa", "m")}, "wear.law.coefficient must be in 1/Pa or a unit of that dimension"),
        ({"law": LAW + 'hardness = "1 GPa"\n'}, "wear.law.coefficient must be a bare number"),
        ({"law": LAW.replace("coefficient", "coeficient")}, "wear.law.coeficient is not a known key.* `coefficient`"),
        ({"pressure": '[wear.pressure]\nkind = "hertz"\n'}, "pressure: Hertz's line contact needs `pin_material`"),
        ({"pressure": PRESSURE + 'thickness = "1 mm"\n'}, "must have a `stiffness`, or `thickness` and `material`"),
        ({"top": TOP.replace('"pin"', '"pni"')}, "joint: no joint with clearance has this name.* `pin`"),
        ({"top": TOP.replace('length = "50 mm"\n', "")}, "lacks the key `length`"),
        ({"top": TOP + 'cycle = "-1 s"\n'}, "cycle must be greater than the scene's t0"),
        ({"top": TOP + "sectors = 8\n"}, "sectors must be"),
        ({"rest": '[wear.until]\nkind = "depth"\nbound = "1 s"\n'}, "until.bound must be in m"),
        ({"rest": '[wear.until]\nkind = "metric"\nmetric = "rm"\nbound = "1 mm"\n' + RIM}, "no metric `rm`. Did you"),
        ({"top": TOP.replace("cycles = 100\n", "")}, "wear has no effect: it lacks the key `cycles`"),
        ({"top": TOP.replace("cycles = 100\n", "longest = 3\n")}, "longest has no effect without `cycles`"),
    ],
)
def test_what_a_wear_file_cannot_say(parts, words, tmp_path):
    with pytest.raises(cj.ClearanceError, match=words):
        load(tmp_path, **parts)


# Worn sleeves in scenes ----------------------------------------------------------------------------------------------

DEPTH = 1e-6 * np.maximum(0, np.cos(2 * np.pi * np.arange(180) / 180 + 1.0))

# The smooth wall of a worn bore is a largest depth over the sectors, blended over so much: c w^2.
BLEND = 1e-4 * (2 * np.pi / 180) ** 2


@pytest.fixture
def dataset():
    """A life without a solve: the same profile, ever deeper."""
    clearance = cj.RevoluteClearance(1e-4, 25e-3, cj.laws.HuntCrossley(1e10, 50.0), length=0.05)
    mechanism = cj.load(SCENE).with_clearance("pin", clearance)
    history = wear.WearHistory(np.array([0, 100, 400]), np.array([0, 1.0, 2.0])[:, None] * DEPTH, 12, None)
    model = wear.WearModel(mechanism, "pin", wear.Archard(1e-13), wear.Foundation(2e13), 0.05)
    return wear.to_dataset(history, model)


def worn(tmp_path, table: str) -> Any:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.read_text() + f"worn = {table}\n")
    return load_scene(path).mechanism


def test_a_worn_sleeve_is_listed_or_read_from_a_file(tmp_path, dataset):
    cj.save(dataset, tmp_path / "wear.nc")
    rows = [f"{angle},{1e6 * depth}" for angle, depth in zip(2 * np.arange(180), DEPTH, strict=True)]
    (tmp_path / "profile.csv").write_text("angle, depth\n" + "\n".join(rows))
    listed = [f"{depth} m" for depth in DEPTH]
    for table, factor in (
        (f"{{ depth = {json.dumps(listed)} }}", 1.0),
        ('{ file = "profile.csv", unit = "um" }', 1.0),
        ('{ file = "wear.nc" }', 2.0),
        ('{ file = "wear.nc", cycles = 250 }', 1.5),
    ):
        found: Any = worn(tmp_path, table).joint("pin").clearance
        assert isinstance(found, cj.RevoluteClearance)
        np.testing.assert_allclose(np.asarray(found.depth), factor * DEPTH, rtol=1e-12)
    assert set(example(play_keys.WORN)) == {"depth", "file", "cycles", "unit"}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("{}", "joint.pin.worn must have `depth` or `file`"),
        ('{ depth = ["1 um", "2 um"] }', "worn: `depth` must be one number a sector, at least 16"),
        ('{ depth = ["-1 um"] }', "must have depths of at least 0"),
        ('{ file = "none.nc" }', "worn.file: there is no file"),
        ('{ file = "wear.nc", cycles = 1000 }', "worn.cycles must be at most the 400 cycles"),
        ('{ file = "wear.nc", unit = "um" }', "worn.unit has no effect"),
        ('{ file = "odd.csv", unit = "um" }', "must go round once, evenly"),
        ('{ file = "odd.csv" }', "lacks the key `unit`"),
    ],
)
def test_what_is_no_worn_sleeve(table, words, tmp_path, dataset):
    cj.save(dataset, tmp_path / "wear.nc")
    (tmp_path / "odd.csv").write_text("0,1\n10,1\n30,1\n")
    with pytest.raises(cj.ClearanceError, match=words):
        worn(tmp_path, table)


@pytest.mark.slow
def test_info_says_that_a_sleeve_is_worn(tmp_path, dataset):
    cj.save(dataset, tmp_path / "wear.nc")
    worn(tmp_path, '{ file = "wear.nc" }')
    said = RUN.invoke(app, ["info", str(tmp_path / "scene.toml")]).output
    assert f"worn off by {2e6 * DEPTH.max():.6g} um at most" in " ".join(said.split())
    assert "180 numbers from 0 to" in " ".join(said.split())


# Datasets and figures ------------------------------------------------------------------------------------------------


def test_a_dataset_says_how_far_the_pin_can_go(dataset):
    """To the bottom of a groove that is as wide as the sleeve it goes by its depth more; across by half of that."""
    assert dataset["depth"].dims == ("cycle", "sector")
    np.testing.assert_allclose(dataset["pin_travel"][0], 1e-4, rtol=1e-6)
    np.testing.assert_allclose(dataset["deepest"], [0, DEPTH.max(), 2 * DEPTH.max()])
    bottom = int(DEPTH.argmax())
    np.testing.assert_allclose(dataset["pin_travel"][-1, bottom], 1e-4 + 2 * DEPTH.max(), atol=BLEND)
    np.testing.assert_allclose(dataset["radial_clearance"][-1], 1e-4 + DEPTH.max(), atol=BLEND)
    area = 2 * np.pi / 180 * 25.1e-3 * 0.05
    np.testing.assert_allclose(dataset["volume"], [0, area * DEPTH.sum(), 2 * area * DEPTH.sum()])
    assert (dataset.attrs["cycles_lived"], dataset.attrs["cycles_computed"]) == (400, 12)


def test_the_travel_of_a_pin_in_a_worn_bore_is_the_room_of_its_centre(dataset):
    """Half-planes, drawn, against the smooth wall that the dynamics knows."""
    far = np.hypot(*pin_travel(1e-4, 2 * DEPTH))[:-1:2]
    np.testing.assert_allclose(far, dataset["pin_travel"][-1], atol=BLEND)


def test_figures_and_films_of_a_life(dataset, tmp_path):
    dataset["watched"] = ("cycle", [1e-4, 1.5e-4, 2.5e-4], {"units": "m", "bound": 2e-4, "long_name": "error"})
    dataset.attrs["life"] = 250.0
    figure = cj.wear_figures.overview(dataset)
    axes: Any = figure.axes
    profile, _, growth, watched = axes
    # Of the last age the profile at the end of life, between two blocks.
    np.testing.assert_allclose(profile.lines[-1].get_ydata(), 1e6 * 1.5 * DEPTH)
    np.testing.assert_allclose(growth.lines[0].get_ydata(), 1e6 * dataset["deepest"])
    np.testing.assert_allclose(watched.lines[0].get_ydata(), [100, 150, 250])
    assert watched.get_ylabel() == "µm"
    film = cj.wear_figures.animate(dataset, frames=3)
    film.show(2)
    np.testing.assert_allclose(film._curve.get_ydata(), 1e6 * 1.5 * DEPTH)
    assert film.save(tmp_path / "life.gif").stat().st_size > 10_000
    with pytest.raises(cj.ClearanceError, match="no result of a study of wear"):
        cj.wear_figures.overview(dataset.drop_vars("depth"))
    with refused("frames", 1):
        cj.wear_figures.animate(dataset, frames=1)


def test_nothing_in_figures_of_a_life_is_cut_off(dataset):
    for watched in (False, True):
        if watched:
            dataset["watched"] = ("cycle", [1e-4, 1.5e-4, 2.5e-4], {"units": "m", "bound": 2e-4, "long_name": "error"})
            dataset.attrs["life"] = 123_456.0
        for narrow in (False, True):
            check_texts(wear_figures.overview(dataset, narrow=narrow))
    cycles, half = np.linspace(0, 1e6, 5), np.linspace(0, 0.5, 5)
    check_texts(wear_figures.failures(wear.Failures(cycles, half, 0.5 * half, 1.5 * half, 0.95)))
    lives = ("sample", [2e5, 3e5, np.inf])
    over = xr.Dataset({"life": lives, "pin.normal.stiffness": ("sample", [1e9, 2e9, 3e9])}, attrs={"cycles": 500_000})
    check_texts(wear_figures.intervals(over, "pin.normal.stiffness"))


# The command ---------------------------------------------------------------------------------------------------------

# The disc falls from the middle of its sleeve in every cycle: it meets the wall at sqrt(2 g (c + h)).
FALLING = """
solve = { start = "centre", rtol = 1e-9 }

[wear]
joint = "pin"
length = "50 mm"
cycle = "8 ms"
cycles = 100000
sectors = 88
tolerance = 0.3
law = { kind = "archard", coefficient = "1e-12 1/Pa" }
pressure = { kind = "foundation", stiffness = "2e13 Pa/m" }
until = { kind = "impact-speed", bound = "45 mm/s" }
"""


@pytest.mark.slow
@pytest.mark.optimised
def test_the_command_lives_until_the_end_and_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    study, whole, result = (tmp_path / name for name in ("life.toml", "whole.nc", "life.nc"))
    study.write_text(f'scene = "{SCENE}"\n{FALLING}')

    def run(*arguments, out=result):
        return RUN.invoke(app, ["run", str(study), "-o", str(out), *arguments])

    first = run("--plot", str(tmp_path / "life.png"), out=whole)
    assert first.exit_code == 0, first.output
    assert "largest speed of impact: reaches 0.045 m/s after" in first.output
    assert "88 sectors of 4.09 deg are too wide for the patch" in first.output
    assert (tmp_path / "life.png").stat().st_size > 10_000
    expected = cj.load_dataset(whole)
    speed, lived = expected["watched"].values, expected["cycle"].values
    # In a worn sleeve the pin meets the rounded edges of its pocket too.
    fall = speed**2 / (2 * 9.81)
    np.testing.assert_allclose(fall[0], 1e-4, rtol=1e-5)
    np.testing.assert_allclose(fall, expected["pin_travel"][:, 66], rtol=0.03)  # at 270 deg
    assert lived[-2] < expected.attrs["life"] <= lived[-1] < 100000
    assert speed[-2] < 0.045 <= speed[-1]

    add = Journal.add

    def stopping(journal: Journal, **record: Any) -> None:
        add(journal, **record)
        if done := {2: signal.SIGINT, 5: signal.SIGTERM}.get(len(Journal(journal.path).records)):
            signal.raise_signal(done)

    monkeypatch.setattr(Journal, "add", stopping)
    stopped = run()
    assert stopped.exit_code == 130
    assert "Interrupted. What is done is kept" in stopped.output
    assert "keeps a life that has begun" in str(run().exception)
    for records in (2, 5):
        part = cj.load_dataset(result)
        assert part.sizes["cycle"] == 1 + records
        assert part.attrs["result"] == f"interrupted after {int(lived[records])} cycles"
        for name in ("depth", "watched", "radial_clearance"):
            np.testing.assert_array_equal(part[name].values, expected[name].values[: 1 + records])
        if records == 2:
            again = run("--resume")
            assert again.exit_code == 130, again.output
    done = run("--resume")
    assert done.exit_code == 0, done.output
    assert cj.load_dataset(result).identical(expected)
    study.write_text(study.read_text().replace("1e-12 1/Pa", "2e-12 1/Pa"))
    assert "`coefficient (law of wear)` is 2e-12 here and 1e-12 there" in str(run("--resume").exception)

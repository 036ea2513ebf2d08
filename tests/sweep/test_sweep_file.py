"""Studies of sweeps, scatter and metrics in studies, and `clearance run` of a sweep."""

import importlib
import tomllib
from typing import Any

import numpy as np
import pytest
import xarray as xr
from key_reference import example
from places import ROOT, refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.main import app
from clearance_jax.io.keys import metric as metric_keys
from clearance_jax.io.keys import study as study_keys
from clearance_jax.io.study.study import load_study

SCENE = ROOT / "experiments/scenes/slider_crank.toml"


def lines(values: dict[str, str]) -> str:
    return "".join(f"{name} = {value}\n" for name, value in values.items())


AXIS = '[sweep.axis."wrist.radial_clearance"]\n' + lines(example(study_keys.AXIS_TABLES["range"]))
METRIC = "[metric.peak]\n" + lines(example(metric_keys.METRIC_KINDS["peak"], "body", "joint", "quantity", "times"))


SECTION = '[metric.section]\nkind = "poincare-section"\nquantities = ["guide.velocty"]\n'
SENSITIVITY = '[scatter."slider.mass"]\ndeviation = "1 g"\n[sweep.axis.part]\nkind = "sensitivity"\ncount = 64\n'


def load(tmp_path, top="", axis=AXIS, metric=METRIC, rest="") -> dict[str, Any]:
    path = tmp_path / "sweep.toml"
    path.write_text(f'scene = "{SCENE}"\n{top}{axis}{metric}{rest}')
    asked = load_study(path).sweep
    assert asked is not None
    return asked


def test_examples_of_the_section_are_read(tmp_path):
    rest = "".join(
        f"[{name}]\n{lines(example(table, *skip))}"
        for name, table, skip in (
            ("solve", study_keys.SOLVE, ()),
            ("sweep", study_keys.SWEEP, ("axis", "again", "quantities")),
            ("sweep.again", study_keys.AGAIN, ()),
        )
    )
    rest += '[set]\n"slider.mass" = "0.2 kg"\n'
    read = load(tmp_path, 't1 = "12 ms"\n', rest=rest)
    assert (read["t1"], read["times"], read["wrt"]) == (0.012, 101, ("wrist.radial_clearance",))
    assert read["start"] == "settled"
    assert read["again"] == {"rtol": 1e-8, "solver": "dopri8", "start": "settled", "max_steps": 100000}
    assert float(read["mechanism"].bodies[2].mass) == pytest.approx(0.2)
    np.testing.assert_allclose(read["axes"]["wrist.radial_clearance"], np.geomspace(1e-4, 5e-4, 200))
    # What is said nowhere is the scene's.
    assert (load(tmp_path)["t1"], load(tmp_path)["rtol"]) == (0.024, 1e-8)


@pytest.mark.parametrize("word", study_keys.AXIS_TABLES)
def test_examples_of_axes_are_read(word, tmp_path):
    (tmp_path / "rough.toml").write_text(SCENE.read_text())
    name = {"values": "wrist.radial_clearance", "range": "wrist.radial_clearance"}.get(word, "mine")
    values = example(study_keys.AXIS_TABLES[word], "of")
    both = "".join(f'[scatter."{body}.mass"]\ndeviation = "1 percent"\n' for body in ("slider", "conrod"))
    given = load(tmp_path, axis=f'[sweep.axis."{name}"]\n{lines(values)}', rest=both)["axes"][name]
    kinds = {
        "zipped": cj.Zipped,
        "sampled": cj.Sampled,
        "sensitivity": cj.Zipped,
        "scenes": cj.Choice,
        "range": np.ndarray,
        "values": list,
    }
    assert isinstance(given, kinds[word])
    if word == "sampled":
        assert given.correlation == {("slider.mass", "conrod.mass"): 0.5}
        assert (given.count, given.method, given.seed) == (1024, "random", 1)
    if word == "sensitivity":
        assert len(given.values["slider.mass"]) == 256 * 4


@pytest.mark.parametrize(
    ("given", "mean", "deviation"),
    [
        ('deviation = "2 percent"', 0.14, 0.0028),
        ('mean = "0.2 kg"\ndeviation = "1 g"', 0.2, 1e-3),
        ('distribution = "log-normal"\nmean = "0.2 kg"\ndeviation = "60 g"', 0.2, 0.06),
        ('distribution = "uniform"\nlower = "0.1 kg"\nupper = "0.4 kg"', 0.25, 0.3 / np.sqrt(12)),
        # Half of a normal one: sqrt(2 / pi) above its mean, and sqrt(1 - 2 / pi) wide.
        ('deviation = "1 g"\nlower = "0.14 kg"', 0.14 + 1e-3 * np.sqrt(2 / np.pi), 1e-3 * np.sqrt(1 - 2 / np.pi)),
    ],
)
def test_a_number_scatters_as_its_table_says(given, mean, deviation, tmp_path):
    axis = '[sweep.axis.part]\nkind = "sampled"\ncount = 4096\n'
    drawn = load(tmp_path, axis=axis, rest=f'[scatter."slider.mass"]\n{given}\n')["axes"]["part"].draw()["slider.mass"]
    assert np.mean(drawn) == pytest.approx(mean, rel=2e-3)
    assert np.std(drawn) == pytest.approx(deviation, rel=2e-2)


def test_the_example_of_scatter_is_read(tmp_path):
    axis = '[sweep.axis.part]\nkind = "sampled"\ncount = 16\n'
    table = '[scatter."slider.mass"]\n' + lines(example(study_keys.SCATTER))
    drawn = load(tmp_path, axis=axis, rest=table)["axes"]["part"].draw()["slider.mass"]
    assert 0.13 < drawn.min() < drawn.max() < 0.15


@pytest.mark.parametrize("word", metric_keys.METRIC_KINDS)
def test_examples_of_metrics_are_read(word, tmp_path):
    skip = ("since",) if word == "at" else ("times",)
    values = example(metric_keys.METRIC_KINDS[word], "body", "joint", "quantity", "speed", *skip)
    values |= {"kind": f'"{word}"'}
    values |= {"joint": '"wrist"'} if word == "impacts" else {}
    found = load(tmp_path, metric="[metric.x]\n" + lines(values))["outputs"]["x"]
    assert isinstance(found, cj.metrics.AbstractMetric)


def test_quantities_are_asked_by_their_names(tmp_path):
    given = '[sweep]\nquantities = ["piston.position"]\n'
    assert load(tmp_path, axis=given + AXIS)["outputs"].keys() == {"peak", "piston.position"}
    given = '[sweep]\nmetrics = ["peak"]\n'
    assert load(tmp_path, axis=given + AXIS, rest=METRIC.replace("peak]", "other]"))["outputs"].keys() == {"peak"}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"axis": "[sweep]\n"}, "sweep lacks the key `axis`"),
        ({"axis": ""}, "asks for nothing. Add a section `sweep`, `design`, `wear` or `calibrate`"),
        ({"metric": ""}, "asks for nothing: add a table `.metric.NAME.`, or `quantities`"),
        ({"axis": '[sweep]\nmetrics = ["peek"]\n' + AXIS}, "sweep.metrics: the study has no metric `peek`. Did you"),
        ({"axis": '[sweep.axis."wrist.gap"]\nkind = "values"\nvalues = ["1 mm"]\n'}, "no parameter `wrist.gap`"),
        ({"axis": AXIS.replace('"0.1 mm"', '"1 kg"')}, "must be in m or a unit"),
        ({"axis": AXIS.replace('"range"', '"line"')}, "must be one of the allowed words"),
        ({"axis": AXIS.replace('"0.1 mm"', '"0 mm"')}, "equal ratios need"),
        ({"metric": METRIC.replace('"piston"', '"pistn"')}, "no point 'pistn'"),
        ({"top": "lanes = 4\n"}, "lanes is not a known key"),
        ({"top": 'wrt = ["slider.mass"]\n'}, "wrt is called `sweep.by` now"),
        ({"axis": SENSITIVITY.replace("[scatter", "[scattr")}, "scattr is not a known key. Did you mean `scatter`"),
        ({"axis": SENSITIVITY.replace('deviation = "1 g"', "")}, "needs `mean` and `deviation`"),
        ({"axis": SENSITIVITY.replace("1 g", "-1 g")}, "must be greater than zero"),
        ({"axis": '[sweep.axis."wrist.radial_clearance"]\nkind = "values"\nvalues = []\n'}, "must be a list such as"),
        (
            {"metric": SECTION + 'period = "12 ms"\nspeed = "drive.main.speed"\n'},
            "one of the keys `period` and `speed`",
        ),
        ({"metric": SECTION}, "one of the keys `period` and `speed`"),
        ({"metric": SECTION + 'speed = "drive.main.sped"\n'}, "no parameter `drive.main.sped`"),
        ({"metric": SECTION + 'period = "12 ms"\ncount = 3\n'}, "no quantity `guide.velocty`"),
        ({"metric": SECTION.replace("poincare-section", "poincare")}, "Did you mean `poincare-section`"),
        ({"axis": SENSITIVITY.replace("64", "100")}, "must be a power of two"),
    ],
)
def test_what_a_sweep_file_cannot_say(parts, words, tmp_path):
    with pytest.raises(cj.ClearanceError, match=words):
        cj.sweep(**load(tmp_path, **parts))


@pytest.mark.slow
def test_the_command_writes_a_store_that_can_grow(tmp_path):
    path, store = tmp_path / "sweep.toml", tmp_path / "out.zarr"
    text = f"""
scene = "{SCENE}"
t1 = "0.5 ms"
solve = {{ rtol = 1e-6, solver = "tsit5", max_steps = 82 }}
sweep.quantities = ["guide.velocity"]
sweep.axis."wrist.radial_clearance" = {{ kind = "values", values = ["0.1 mm", "0.2 mm", "0.4 mm", "0.5 mm"] }}
"""
    assert tomllib.loads(text)

    def run(*arguments, said=text):
        path.write_text(said)
        return CliRunner().invoke(app, ["run", str(path), "-o", str(store), "--cores", "1", *arguments])

    pictures = tmp_path / "pictures"
    pictures.write_text("a file")
    assert "it is a file" in str(run("--plot", str(pictures)).exception)
    assert not store.exists()
    pictures.unlink()
    first = run("--plot", str(pictures))
    assert first.exit_code == 0, first.output
    assert {path.name for path in pictures.iterdir()} == {"guide.velocity_over_wrist.radial_clearance.png"}
    assert "4 samples in 1 regions, 1 programs, on 1 cores" in first.output
    assert "4 samples, 2 failed: 2 the largest number of steps was reached" in first.output
    assert "exists already" in str(run().exception)
    grown = run("--resume", said=text.replace('"0.5 mm"]', '"0.5 mm", "0.55 mm"]'))
    assert "5 samples, 2 failed" in grown.output
    found = xr.open_zarr(store)
    assert found.attrs["study"] == path.read_text()
    assert found["wrist.radial_clearance"].attrs["units"] == "m"
    assert int(found["code"].isnull().sum()) == 0
    drawn = CliRunner().invoke(app, ["plot", str(store)])
    assert drawn.exit_code == 0, drawn.output
    assert (tmp_path / "out_pictures" / "guide.velocity_over_wrist.radial_clearance.png").exists()
    assert "no motion is in it" in str(CliRunner().invoke(app, ["plot", str(store), "--plot-kind", "play"]).exception)
    assert "as a store of a sweep" in str(CliRunner().invoke(app, ["plot", str(tmp_path)]).exception)


def test_what_cannot_be_done_is_said_before_anything_is(tmp_path, monkeypatch):
    """A grid that no disk holds, and a scheduler that does not answer; no store is begun."""
    path = tmp_path / "sweep.toml"

    def said(count: int, *arguments: str) -> str:
        second = AXIS.replace("wrist.radial_clearance", "drive.main.speed").replace('"0.1 mm"', '"400 rad/s"')
        second = second.replace('"0.5 mm"', '"500 rad/s"').replace("200", str(count))
        path.write_text(f'scene = "{SCENE}"\n{AXIS.replace("200", str(count))}{second}{METRIC}')
        error = CliRunner().invoke(app, ["run", str(path), *arguments]).exception
        assert isinstance(error, cj.ClearanceError)
        assert not path.with_suffix(".zarr").exists()
        return str(error)

    monkeypatch.setattr(importlib.import_module("clearance_jax.ask.answers"), "PATIENCE", "1s")
    assert "may take" in said(1_000_000)
    assert "No scheduler answers at `tcp://127.0.0.1:9`" in said(2, "--cluster", "tcp://127.0.0.1:9")


def test_the_old_name_of_a_count_says_the_new_one(tmp_path):
    with refused("sweep.axis.part.samples"):
        load(tmp_path, axis=SENSITIVITY.replace("count", "samples"))

"""What stopped people who tried it: careless input gets one sentence at once, no traceback, no hang, no silence."""

import os
import pickle
import signal
import subprocess
import sys
import time
import warnings
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from places import ROOT, refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.common import check_writable
from clearance_jax.cli.main import app, main
from clearance_jax.cli.pace import Interruption, Pace, shown_duration
from clearance_jax.errors import LONGEST, ClearanceError, WearFailure, cut, quote
from clearance_jax.io.scene.scene import load_scene
from clearance_jax.io.settings import parse_settings, with_play
from clearance_jax.io.study.study import load_study
from clearance_jax.joints.checks import ImplausibleWarning
from clearance_jax.results.dataset import to_dataset
from clearance_jax.solve.settings import MOST_SAMPLES
from clearance_jax.solve.simulate import DOUBTFUL, EnergyWarning, doubt
from clearance_jax.units import to_si

pytestmark = pytest.mark.quick

SCENE = ROOT / "experiments" / "scenes" / "slider_crank.toml"
TEXT = SCENE.read_text()
STUDY = f"""
scene = "{SCENE}"
t1 = "1 ms"
[solve]
rtol = 1e-7
[metric.piston]
kind = "at"
times = ["0.5 ms", "1 ms"]
signal = "position-error"
point = "piston"
[design.variable."wrist.radial_clearance"]
lower = "20 um"
upper = "0.5 mm"
cost = {{ law = "reciprocal", factor = "0.1 mm" }}
[design.limit.piston]
bound = "0.1 mm"
"""
SWEEP = f"""
scene = "{SCENE}"
[sweep]
quantities = ["piston.position"]
axis."slider.mass" = {{ kind = "values", values = ["0.1 kg"] }}
"""


def refuses(load, path, text, words):
    path.write_text(text)
    begin = time.monotonic()
    with pytest.raises(ClearanceError, match=words) as caught:
        load(path)
    assert path.name in str(caught.value)
    assert len(str(caught.value)) <= LONGEST
    assert time.monotonic() - begin < 5


LOOP = '[joint.self]\ntype = "revolute"\nparent = "slider"\nchild = "slider"\n'
SPRING = '[spring.s]\nbody_a = "slider"\nbody_b = "slider"\nstiffness = "1 N/m"\n'
DEEP = "x = " + "[" * 3000 + "]" * 3000 + "\n"
BAD_SCENES = {
    "a loop of a body with itself": ("[point.piston]", LOOP + "[point.piston]", "must name two bodies"),
    "a spring of a body with itself": ("[point.piston]", SPRING + "[point.piston]", "must name two bodies"),
    "a list of speeds": ('speed = "5000 rpm"', 'speed = ["5000 rpm", "1 rpm"]', "must be one quantity"),
    "more samples than memory": ("samples = 2001", "samples = 1000000000000", f"at most {MOST_SAMPLES}"),
    "samples that are true": ("samples = 2001", "samples = true", "whole number"),
    "nested 3000 deep": ('name = "slider-crank"', DEEP, "nested too deep"),
    "a whole number of 5000 digits": ("rtol = 1e-8", "rtol = 0x" + "f" * 5000, "finite"),
    "a word for a number": ("rtol = 1e-8", 'rtol = "abc"', "solve.rtol must be a bare number"),
    "a list for a number": ("rtol = 1e-8", "rtol = [1]", "solve.rtol must be one quantity"),
    "a sum that never ends": ('mass = "0.14 kg"', 'mass = "9**9**9 kg"', "must read NUMBER UNIT"),
    "a long quantity": ('mass = "0.14 kg"', f'mass = "{"1" * 5000} kg"', "longer than 100"),
    "no number": ('pin_radius = "10 mm"', 'pin_radius = "mm"', "it lacks a number"),
    "two signs": ('pin_radius = "10 mm"', 'pin_radius = "--10 mm"', "must read NUMBER UNIT"),
    "a call for a unit": ('pin_radius = "10 mm"', 'pin_radius = "10 __import__(1)"', "must read NUMBER UNIT"),
    "a number as a name": ('name = "slider-crank"', "name = 5", "name must be a text"),
    "no name": ('name = "slider-crank"', 'name = ""', "name must be a text of 1 to"),
    "a name that reads as a path": ("[body.slider]", '[body."a.b"]', "without `.`"),
    "a body's name that is a list": ('body = "slider"', 'body = ["slider"]', "must be a text"),
    "a flag that is a text": (
        'law = "adams-impact", damping = "2000 N*s/m", full_damping_depth = "0.01 mm"',
        'law = "kelvin-voigt", damping = "2000 N*s/m", clipped = "no"',
        "clipped must be true or false",
    ),
    "a table that is a number": ("[solve]", "body = 5\n[solve]", "not valid TOML|must be a table"),
    "a long expression": (
        '{ type = "constant-speed", speed = "5000 rpm" }',
        f'"{"+".join(["step(time, 0, 0, 1, 1)"] * 100_000)[:1_900_000]}"',
        "at most 20000 characters",
    ),
    "a negative clearance": ('radial_clearance = "0.5 mm"', 'radial_clearance = "-30 um"', "0 m, but it is -30 um"),
    "a sleeve in the plane that closes a loop": (
        '"0.5 mm"\npin',
        '"0.5 mm"\nkind = "sleeve"\nlength = "40 mm"\npin',
        "`kind` out",
    ),
    "an endless step": ('{ type = "constant-speed", speed = "5000 rpm" }', '"1e999 * time"', "finite"),
}


@pytest.mark.parametrize("case", BAD_SCENES)
def test_bad_scenes(case, tmp_path):
    old, new, words = BAD_SCENES[case]
    assert old in TEXT
    refuses(load_scene, tmp_path / "bad.toml", TEXT.replace(old, new, 1), words)


@pytest.mark.parametrize("kind", ["a folder", "a device", "no text", "too large", "no path"])
def test_what_is_no_scene_file_is_not_read(kind, tmp_path):
    path = {"a folder": tmp_path, "a device": Path("/dev/zero"), "no path": tmp_path / "a\0b"}.get(kind, tmp_path / "x")
    if kind == "no text":
        path.write_bytes(b"\xff\xfe\x00")
    if kind == "too large":
        path.write_text("#" * 3_000_000)
    words = {
        "a folder": "no file",
        "a device": "no file",
        "no text": "UTF-8",
        "too large": "2 MB",
        "no path": "no path",
    }
    with pytest.raises(ClearanceError, match=words[kind]):
        load_scene(path)


BOUNDS = 'lower = "20 um"\nupper = "0.5 mm"'
COST = 'law = "reciprocal", factor = "0.1 mm"'
TIMES = 'times = ["0.5 ms", "1 ms"]'
YIELD = '[design.manufacture]\nkind = "yield"\n{}\n[scatter."slider.mass"]\ndeviation = "{}"\n[design.limit.piston]'
LIMIT = "[design.limit.piston]"
BAD_STUDIES = {
    "a word for rtol": ("rtol = 1e-7", 'rtol = "abc"', "solve.rtol must be a bare number"),
    "a list for rtol": ("rtol = 1e-7", "rtol = [1]", "solve.rtol must be one quantity"),
    "one time": (TIMES, "times = 5", "metric.piston.times must be a list"),
    "no times": (TIMES, "times = []", "metric.piston.times must be a list"),
    "times beyond the end": (TIMES, 'times = ["0.5 ms", "2 ms"]', "must increase from t0 = 0 s to t1 = 0.001 s"),
    "times that fall": (TIMES, 'times = ["1 ms", "0.5 ms"]', "must increase"),
    "one clearance": (COST, 'law = "table", clearances = 3, costs = [1]', "clearances must be a list"),
    "one cost": (COST, 'law = "table", clearances = ["1 um", "2 um"], costs = 5', "costs must be a list"),
    "costs that rise": (COST, 'law = "table", clearances = ["1 um", "2 um"], costs = [1, 2]', "must fall"),
    "a cost too few": (COST, 'law = "table", clearances = ["1 um", "2 um"], costs = [1]', "a cost for each"),
    "a negative factor": (COST, 'law = "reciprocal", factor = "-0.1 mm"', "factor must be greater than 0"),
    "a negative power": (COST, 'law = "reciprocal", factor = "1 1/mm", power = -1', "power must be greater than 0"),
    "a negative rate": (COST, 'law = "exponential", factor = 1, rate = "-1 / mm"', "rate must be greater than 0"),
    "bounds upside down": (BOUNDS, 'lower = "1 mm"\nupper = "20 um"', "contradict each other"),
    "a lower bound of zero": (BOUNDS, 'lower = "0 mm"\nupper = "20 um"', "contradict each other"),
    "an unknown point": ('point = "piston"', 'point = "pistn"', "no point 'pistn'. Did you mean `piston`"),
    "a negative bound": ('bound = "0.1 mm"', 'bound = "-1 mm"', "bound must be greater than 0"),
    "a share above 1": (LIMIT, YIELD.format("target = 1.2", "1 percent"), "target must be between 0 and 1"),
    "a negative scatter": (LIMIT, YIELD.format("", "-1 percent"), "deviation must be above 0 percent"),
    "a scatter above all": (LIMIT, YIELD.format("", "120 percent"), "The scatter of `slider.mass`"),
    "a scatter without unit": (LIMIT, YIELD.format("", "x"), "it lacks a number"),
    "a scatter of a yield in another unit": (LIMIT, YIELD.format("", "1 kg*m"), "must be in kg"),
    "a uniform yield": (LIMIT, YIELD.format("", '1 percent"\ndistribution = "uniform'), "has no `deviation`"),
    "a set that is a number": (LIMIT, '[set]\n"slider.mass" = [1]\n[design.limit.piston]', "needs a unit"),
    "nested 3000 deep": ("[solve]", DEEP + "[solve]", "nested too deep"),
}


@pytest.mark.parametrize("case", BAD_STUDIES)
def test_bad_studies(case, tmp_path):
    old, new, words = BAD_STUDIES[case]
    assert old in STUDY
    refuses(load_study, tmp_path / "bad.toml", STUDY.replace(old, new, 1), words)


def test_a_study_honours_its_scenes_start(tmp_path):
    (tmp_path / "s.toml").write_text(TEXT.replace("[solve]", '[solve]\nt0 = "0.2 ms"'))
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace(str(SCENE), "s.toml"))
    study = load_study(path).design
    assert study is not None
    asked = study.problem.specification
    assert asked.t0 == pytest.approx(2e-4)
    assert (asked.rtol, asked.solver) == (1e-7, "dopri8")
    refuses(load_study, path, STUDY.replace(str(SCENE), "s.toml").replace("0.5 ms", "0.1 ms"), "from t0 = 0.0002 s")
    refuses(
        load_study,
        path,
        STUDY.replace(str(SCENE), "s.toml").replace('"1 ms"', '"0.1 ms"'),
        "greater than the scene's t0",
    )


def test_sizes_that_nobody_meant_get_one_warning_with_the_numbers(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(TEXT.replace('"0.5 mm"\npin', '"50 mm"\npin').replace('"0.14 kg"', '"1e-320 kg"'))
    with pytest.warns(ImplausibleWarning) as caught:
        load_scene(path)
    (warning,) = caught
    text = str(warning.message)
    assert "wrist.radial_clearance = 50 mm is above the pin's radius 10 mm" in text
    assert "slider.mass = 9.99989e-321 kg" in text
    output = CliRunner().invoke(app, ["info", str(SCENE), "--set", "wrist.radial_clearance=5cm"]).output
    assert "warning: These sizes are hardly meant: wrist.radial_clearance = 50 mm" in output


def test_a_study_warns_of_its_sizes_aloud(tmp_path, monkeypatch):
    path = tmp_path / "study.toml"
    path.write_text(STUDY + '[set]\n"slider.mass" = "1e-20 kg"\n')

    def search(*_, **__):
        raise ClearanceError("as far as the search")

    monkeypatch.setattr("clearance_jax.design.asked.problem.search", search)
    result = CliRunner().invoke(app, ["run", str(path)])
    assert "as far as the search" in str(result.exception)
    assert "hardly meant: slider.mass = 1e-20 kg" in " ".join(result.output.split())


def test_settings_are_given_once_and_in_bounds():
    mechanism = cj.load(SCENE)
    assert parse_settings(["slider.mass=2kg"], mechanism) == {"slider.mass": 2.0}
    for texts, words in [
        (["slider.mass=2kg", "slider.mass = 3 kg"], "a second time"),
        (["slider.mass"], "must read NAME=VALUE"),
        (["slider.mass=-1kg"], "greater than 0"),
        (["slider.mass=9**9**9 kg"], "NUMBER UNIT"),
        (["wrist.friction.coefficient=nan"], "finite"),
        (["wrist.friction.coefficient=x"], "bare number"),
        (["slider.mass.²=1kg"], "no parameter"),
        ([f"slider.mass.{'9' * 5000}=1kg"], "no parameter"),
    ]:
        with pytest.raises(ClearanceError, match=words):
            parse_settings(texts, mechanism)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "{scene}", "-o", "{scene}"], "are the same file"),
        (["simulate", "{scene}", "--plot", "missing/a.png"], "its folder does not exist"),
        (["simulate", "{scene}", "--plot", "a" * 300 + ".png"], "File name too long"),
        (["simulate", "{scene}", "-o", "/dev/null"], "a folder or a device"),
        (["simulate", "{scene}", "-o", "o.csv"], "must end in .nc"),
        (["run", "{sweep}", "-o", "o.csv"], "Give it a name that ends in .zarr"),
        (["run", "{sweep}", "--report", "a.html"], "`--report` has no effect: the study has no section `design`"),
        (["run", "{study}", "-o", "a.zarr"], "`--output` has no effect: the study has no section `sweep` or `wear`"),
        (["simulate", "{scene}", "-o", "/proc/1/o.nc"], "Cannot write"),
        (["simulate", "{scene}", "--samples", str(10**12)], f"between 2 and {MOST_SAMPLES}"),
        (["simulate", "{scene}", "--set", "slider.mass=1kg", "--set", "slider.mass=2kg"], "a second time"),
        (["simulate", "{scene}", "--t1", "mm"], "it lacks a number"),
        (["simulate", "{scene}", "--t1", "5"], '`--t1` needs a unit: write it as "5 s".'),
        (["simulate", "{study}"], "`study.toml` is a study, and not a scene: use `clearance run`"),
        (["run", "{scene}"], "`s.toml` is a scene, and not a study: use `clearance simulate`"),
        (["plot", "."], "Cannot read `.` as a store of a sweep"),
        (["run", "{study}", "--record", "{study}"], "are the same file"),
        (["run", "{study}", "--report", "missing/a.html"], "its folder does not exist"),
    ],
)
def test_bad_commands_are_refused_before_anything_is_solved(arguments, words, tmp_path, monkeypatch):
    def solve(*_, **__):
        raise AssertionError("a solve was begun")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("clearance_jax.solve.drivers.trace._begin", solve)
    monkeypatch.setattr("clearance_jax.design.asked.problem.search", solve)
    (tmp_path / "s.toml").write_text(TEXT)
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    given = [a.format(scene="s.toml", study="study.toml", sweep="sweep.toml") for a in arguments]
    result = CliRunner().invoke(app, given)
    assert isinstance(result.exception, ClearanceError)
    assert words in str(result.exception)
    assert {path.name for path in tmp_path.iterdir()} == {"s.toml", "study.toml", "sweep.toml"}


def test_an_unknown_command_is_answered_with_those_there_are(monkeypatch, capsys):
    for word, hint in (("optimize", "No such command 'optimize'."), ("simulat", "Did you mean 'simulate'?")):
        monkeypatch.setattr(sys, "argv", ["clearance", word, "study.toml"])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2
        said = " ".join(capsys.readouterr().err.split())
        commands = "examples, new, check, simulate, run, info, plot, animate, view, cache"
        assert f"{hint} Allowed: {commands} (`run` does" in said


def test_play_that_rings_is_answered_with_what_damps_it(monkeypatch):
    modes = [SimpleNamespace(frequency=318.7, ratio=ratio) for ratio in (-0.012, 0.67)]
    monkeypatch.setattr("clearance_jax.analysis.modes.seated_modes", lambda _: modes)
    said = " ".join(CliRunner().invoke(app, ["info", str(SCENE)]).output.split())
    assert (
        "warning: 1 of these with a damping ratio below 1 % (they ring for long, or grow where it is negative)" in said
    )
    assert "Give the joints an `element`" in said


def test_a_sleeve_in_a_plane_scene_is_named(tmp_path):
    """A sleeve of some length may tilt: its joint is named, and not only the body that it carries."""
    arm = (ROOT / "experiments" / "scenes" / "arm.toml").read_text()
    path = tmp_path / "long.toml"
    words = r"Joint `hip` is a sleeve.*body `arm` has one moment of inertia.*Leave `kind` out"
    refuses(load_scene, path, arm.replace("pin_radius", 'kind = "sleeve"\nlength = "40 mm"\npin_radius'), words)
    spatial = arm.replace('"0.03 kg*m^2"', '["1e-4 kg*m^2", "0.03 kg*m^2", "0.03 kg*m^2"]')
    path.write_text(spatial.replace("pin_radius", 'kind = "sleeve"\nlength = "40 mm"\npin_radius'))
    assert not load_scene(path).mechanism.is_plane
    # A length alone is that of the contact.
    path.write_text(arm.replace("pin_radius", 'length = "40 mm"\npin_radius'))
    hip: Any = load_scene(path).mechanism.joint("hip")
    assert float(hip.clearance.length) == 0.04


def test_numbers_out_of_bounds_are_shown_as_they_were_given():
    mechanism = cj.load(SCENE)
    with refused("--set wrist.radial_clearance=-30 um", "-30 um"):
        parse_settings(["wrist.radial_clearance=-30 um"], mechanism)
    with refused("radial_clearance", pytest.approx(-3e-5)):
        with_play(mechanism, ["wrist:radial_clearance=-30um"])


def test_what_is_not_installed_is_said_before_anything_is_solved(tmp_path, monkeypatch):
    """With a command that works where the library lies in a clone."""

    def solve(*_, **__):
        raise AssertionError("work was begun")

    monkeypatch.setattr("clearance_jax._basis.extras.importlib.util.find_spec", lambda _: None)
    monkeypatch.setattr(sys.modules["clearance_jax.cli.run"], "Interruption", solve)
    monkeypatch.setattr("clearance_jax.design.search.search.formulate", solve)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    result = CliRunner().invoke(app, ["run", str(tmp_path / "sweep.toml")])
    assert isinstance(result.exception, ClearanceError)
    assert f"is not installed. Install it: `pip install '{ROOT}[sweep]'`" in str(result.exception)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_signals_that_end_a_command_are_heard(number):
    before = signal.getsignal(number)
    asked = Interruption()
    with pytest.raises(KeyboardInterrupt), asked:
        signal.raise_signal(number)
    assert asked.heard
    with pytest.raises(KeyboardInterrupt):
        asked.check()
    assert signal.getsignal(number) is before


def test_the_version_is_one():
    (line,) = CliRunner().invoke(app, ["--version"]).output.splitlines()
    assert line == f"clearance {cj.__version__}"
    assert metadata.version("clearance-jax") == cj.__version__
    assert (ROOT / "clearance_jax" / "py.typed").exists()


def test_the_shell_completes_commands_and_options():
    script = f"import sys; sys.argv = ['clearance']; sys.path.insert(0, {str(ROOT)!r})\n"
    script += "from clearance_jax.cli import main; main()"
    for words, completed in (("clearance si", "simulate"), ("clearance simulate --tra", "--trajectory")):
        asked = {"_CLEARANCE_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        run = subprocess.run([sys.executable, "-c", script], env=os.environ | asked, capture_output=True, text=True)
        assert run.stdout.split() == [completed], run.stderr


def test_outputs_are_tried_without_a_trace(tmp_path):
    check_writable(tmp_path / "new.nc")
    old = tmp_path / "old.nc"
    old.write_text("kept")
    check_writable(old)
    assert [path.name for path in tmp_path.iterdir()] == ["old.nc"]
    assert old.read_text() == "kept"


def test_units_of_a_dataset_are_those_of_what_it_holds():
    """No "rad or m": one kind of coordinate has one unit, of several each entry has its own."""
    mechanism = cj.load(SCENE)
    solution = cj.simulate(mechanism, 1e-4, rtol=1e-4, save_at=2, energy_balance=False)
    dataset = to_dataset(mechanism, solution)
    assert not any(" or " in str(variable.attrs.get("units")) for variable in dataset.variables.values())
    kinds = dict(zip(dataset.coordinate.values, dataset.coordinate_unit.values, strict=True))
    assert (kinds["main"], kinds["guide"]) == ("rad", "m")
    assert dataset.drive_force.attrs["units"] == "N m"


def test_a_motion_whose_energy_is_lost_is_doubted_aloud():
    mechanism = cj.load(SCENE)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        good = cj.simulate(mechanism, 2e-3, rtol=1e-6)
        bad = cj.simulate(mechanism, 2e-3, rtol=0.5, locate_events=False)
    assert doubt(good) == ""
    assert float(bad.energy_residual) > DOUBTFUL
    assert [w.category for w in caught] == [EnergyWarning]
    assert "energy balance does not close" in str(caught[0].message)


def test_messages_are_short():
    assert cut("a" * 700, 600).startswith("a" * 300)
    long = str(ClearanceError("begin " + "x" * 10_000 + " end"))
    assert len(long) == LONGEST
    assert long.startswith("begin ")
    assert long.endswith(" end")
    assert "digits" in quote(16**9000)
    deep: list = []
    for _ in range(5000):
        deep = [deep]
    assert len(quote(deep)) <= 120


def test_a_pace_tells_how_long_more_of_the_same_takes(monkeypatch):
    clock = iter([0.0, 10.0, 11.0, 12.0, 20.0])
    monkeypatch.setattr("clearance_jax.cli.pace.time.monotonic", lambda: next(clock))
    pace = Pace()
    assert pace.estimate(5) is None
    for _ in range(4):
        pace.tick()
    assert pace.estimate(5) == pytest.approx(15.0)  # compiled in 10 s, then usually 1 s each
    assert [shown_duration(s) for s in (None, 0.1, 15.4, 600.0)] == [
        "a time that is not known",
        "about 1 s",
        "about 15 s",
        "about 10 min",
    ]


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("2.487e6 N/mm^1.5", "N/m^1.5", 2.487e6 * 1000**1.5),
        ("0.1 mm", "m", 1e-4),
        ("90 deg", "rad", np.pi / 2),
        ("3 arcmin", "rad", np.pi / 3600),
        ("20 arcsec", "rad", np.pi / 32400),
        ("35 N*m/arcmin", "N*m/rad", 35 * 10800 / np.pi),
        ("5000 rpm", "rad/s", 500 * np.pi / 3),
        ("20 um", "m", 2e-5),
        ("1 / (10 um)", "1/(m)", 1e5),
        ("0.2mm", "m", 2e-4),
        ("2 percent", "percent", 2.0),
        ("2 kg m²", "kg*m^2", 2.0),
        ("2 m s⁻¹", "m/s", 2.0),
        ("-.5 N·m", "N*m", -0.5),
    ],
)
def test_quantities_as_people_write_them(text, unit, value):
    assert to_si(text, unit, "x") == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    "text", ["1 " + "a  " * 32 + "!", "1" * 98 + "!", "1_" * 49 + "!", "1 km^999/km^998", "1 m^2^2"]
)
def test_no_text_keeps_the_reader_of_quantities_busy(text):
    begin = time.monotonic()
    with refused("x", text):
        to_si(text, "m", "x")
    assert time.monotonic() - begin < 1


def wrong(**fields):
    return ClearanceError("The sleeve is odd.").about(**{"name": "hip.length", "value": 3.0, **fields})


def test_an_error_tells_its_fields_also_in_another_process():
    assert (ClearanceError("").name, ClearanceError("a: `b`.").name) == (None, None)
    assert ClearanceError("There is no joint `hip` here: `knee`?").name == "hip"
    error = wrong(value=np.arange(3), allowed={"a": 1, "b": 2})
    assert (error.name, error.value, error.allowed) == ("hip.length", "array([0, 1, 2])", ("a", "b"))
    sent, named = pickle.loads(pickle.dumps(error)), error.at("`file.toml`")
    assert (str(sent), str(named)) == ("The sleeve is odd.", "`file.toml`: The sleeve is odd.")
    assert vars(sent) == vars(error) == vars(named)
    assert ClearanceError("Odd.").at("In `fast`").name == "fast"
    assert wrong(name="/a/scene.toml: joint.hip.length").name == wrong(name="`joint.hip.length`").name


@pytest.mark.parametrize(
    "error",
    [
        wrong(name=None, value=3.0, allowed="x"),
        wrong(name="hip.radius", allowed="x"),
        wrong(value=None, allowed="x"),
        wrong(value=2.0, allowed="x"),
        wrong(),
        wrong(allowed=("xx", "y")),
        WearFailure("The sleeve is odd.").about("hip.length", 3.0, "x"),
    ],
    ids=["no name", "another name", "no value", "another value", "no words", "other words", "another kind"],
)
def test_another_error_is_not_the_one_that_a_test_expects(error):
    for right in (wrong(allowed="x"), wrong(allowed=("x", "y"))):
        with refused("hip.length", 3.0, "x"):
            raise right
    with pytest.raises(AssertionError), refused("hip.length", 3.0, "x"):
        raise error
    with pytest.raises(pytest.fail.Exception), refused("hip.length"):
        pass
    with pytest.raises(ValueError), refused("hip.length"):  # noqa: PT011
        raise ValueError("hip.length")

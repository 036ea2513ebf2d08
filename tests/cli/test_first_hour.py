"""Files to begin with: the examples in the package, what `clearance new` writes, what `clearance check` says."""

import inspect
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import pytest
from key_reference import schema
from places import ROOT, refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.main import app
from clearance_jax.cli.simulate import simulate
from clearance_jax.examples import kinds
from clearance_jax.solve.settings import OF_MOTIONS, SOLVER_WORDS, STARTS

EXAMPLES = ROOT / "clearance_jax" / "examples"


def ran(*words: str):
    return CliRunner().invoke(app, list(words))


# Examples ------------------------------------------------------------------------------------------------------------


def test_every_example_is_a_name_for_type_checkers():
    stub = (EXAMPLES / "__init__.pyi").read_text(encoding="utf-8")
    typed = dict(re.findall(r"^def (\w+)\(\) -> (\w+): \.\.\.$", stub, re.MULTILINE))
    assert set(typed) == {*cj.examples.names()}
    assert {*dir(cj.examples)} == {*typed, "names", "path"}
    for name, kind in typed.items():
        assert (kind == "Study") == (cj.examples.path(name).parent.name == "studies"), name


def test_examples_are_read_by_name():
    assert cj.examples.arm().name == "arm"
    assert isinstance(cj.examples.slider_crank_design(), cj.Study)
    assert cj.examples.path("disc_worn.csv").is_file()
    with refused("slider_krank", "slider_krank", "slider_crank"):
        cj.examples.path("slider_krank")
    with pytest.raises(AttributeError) as caught:
        cj.examples.slider_krank  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]
    assert "no `slider_krank`. Did you mean `slider_crank" in str(caught.value)


def test_examples_are_listed_with_what_they_are():
    lines = ran("examples").stdout.splitlines()
    assert [line.split()[0] for line in lines] == [*cj.examples.names()]
    assert all(len(line.split()) > 3 for line in lines)


@pytest.mark.parametrize("name", cj.examples.names())
def test_an_example_comes_with_all_that_it_names(name, tmp_path, monkeypatch):
    """What is written in an empty folder is valid there, and its first line leads an editor to the schema."""
    monkeypatch.chdir(tmp_path)
    assert ran("examples", name).exit_code == 0
    assert ran("examples", name).exit_code == 0  # the same again changes nothing
    file = tmp_path / cj.examples.path(name).name
    for path in tmp_path.glob("*.toml"):
        address = re.match(r"#:schema (file://\S+)\n", path.read_text(encoding="utf-8"))
        assert address is not None
        found = Path(address[1].removeprefix("file://"))
        kind = "study" if "scene" in tomllib.loads(path.read_text(encoding="utf-8")) else "scene"
        assert json.loads(found.read_text(encoding="utf-8")) == schema(kind)
    (cj.load_study if cj.examples.path(name).parent.name == "studies" else cj.load)(file)


def test_a_file_of_the_users_is_not_overwritten(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "disc.toml").write_text("mine")
    with refused("disc.toml"):
        raise ran("examples", "disc_life").exception or AssertionError("it was overwritten")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]


# New -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", kinds())
def test_what_new_writes_is_valid(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ran("new", "press", "--kind", kind).exit_code == 0
    names = {"press.toml", "press_study.toml"} | ({"press.urdf"} if kind == "robot" else set())
    assert {path.name for path in tmp_path.iterdir()} == names
    for name in sorted(names):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert "NAME" not in text
        if name.endswith(".toml"):
            keys = schema("study" if "_study" in name else "scene")
            jsonschema.Draft202012Validator(keys).validate(tomllib.loads(text))
        result = ran("check", name)
        assert result.exit_code == 0, result.output
        assert result.stdout.startswith(f"{name}: a valid ")


@pytest.mark.slow
@pytest.mark.parametrize("kind", kinds())
def test_what_new_writes_runs(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ran("new", "press", "--kind", kind).exit_code == 0
    for words in (["simulate", "press.toml", "-o", "press.nc"], ["run", "press_study.toml"]):
        result = ran(*words, "--json")
        assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["design"]["confirmed"] is True


def test_new_names_and_kinds_are_checked():
    for words, about in ((["press", "--kind", "sliderkrank"], "--kind"), (["../press"], "NAME")):
        with refused(about):
            raise ran("new", *words).exception or AssertionError("it was written")


# Check ---------------------------------------------------------------------------------------------------------------


def test_check_says_what_is_assumed_and_computes_nothing(tmp_path, monkeypatch):
    def solve(*_, **__):
        raise AssertionError("a solve was begun")

    monkeypatch.setattr("clearance_jax.solve.drivers.trace._begin", solve)
    result = ran("check", str(EXAMPLES / "arm.toml"), "--json")
    told = json.loads(result.stdout)
    assert (told["kind"], told["exit_code"]) == ("scene", 0)
    assert told["assumed"] == {"rtol": 1e-8, "solver": "auto", "start": "centre"}
    assert told["mechanism"]["with_play"] == ["hip"]
    assert "assumed: start = centre" in result.stderr
    robot = ran("check", str(EXAMPLES / "two_axes.urdf")).stdout
    assert "nothing drives shoulder, play" in robot
    study = ran("check", str(EXAMPLES / "studies" / "slider_crank_design.toml")).stdout
    assert "variable wrist.radial_clearance: 10 um to 1 mm" in study
    wrong = tmp_path / "wrong.toml"
    wrong.write_text((EXAMPLES / "arm.toml").read_text().replace("hunt-crossley", "hunt-krossley"))
    bad = ran("check", str(wrong), "--json")
    told = json.loads(bad.stdout)
    assert told["exit_code"] == 2
    assert "Did you mean `hunt-crossley`" in told["error"]["message"]


# What is said where --------------------------------------------------------------------------------------------------


def test_a_missing_file_is_answered_before_anything_slow_is_imported():
    code = """
import sys
from clearance_jax.cli.main import main
sys.argv = ["clearance", *sys.argv[1:]]
try:
    main()
except SystemExit as ended:
    print(ended.code, sorted({"jax", "numpy", "xarray", "matplotlib"} & set(sys.modules)))
"""
    for words in (["simulate", "arm.toml"], ["info", "a.toml"], ["run", "a.toml"], ["check", "a"], ["plot", "a.nc"]):
        asked = [sys.executable, "-c", code, words[0], f"missing/{words[1]}"]
        done = subprocess.run(asked, capture_output=True, text=True, check=True, cwd=ROOT)
        assert done.stdout.strip() == "2 []"
        assert "there is no such file" in done.stderr
        assert ("`clearance examples arm`" in done.stderr) == (words[1] == "arm.toml")


@pytest.mark.slow
def test_simulate_and_info_answer_programs(tmp_path):
    """One object on stdout, with units; it says what the dataset says, and what people are told goes to stderr."""
    out = tmp_path / "arm.nc"
    result = ran("simulate", str(EXAMPLES / "arm.toml"), "--t1", "20ms", "--rtol", "1e-6", "-o", str(out), "--json")
    told, dataset = json.loads(result.stdout), cj.load_dataset(out)
    assert (told["result"], told["result_code"], told["exit_code"]) == ("successful", 0, 0)
    assert told["files"] == {"dataset": str(out)}
    assert told["options"]["solver"] == "dopri8"
    assert told["accepted_steps"] == dataset.attrs["accepted_steps"]
    force = told["largest"]["contact_force"]["hip"]
    assert (force["value"], force["unit"]) == (float(dataset["contact_force"].max()), "N")
    assert told["largest_force"]["value"] >= force["value"]
    assert told["largest"]["position"]["tip.x"]["unit"] == "m"
    assert "contact episodes" in result.stderr
    told = json.loads(ran("info", str(EXAMPLES / "arm.toml"), "--json").stdout)
    assert told["parameters"]["hip.radial_clearance"] == {"value": 1e-4, "unit": "m"}
    assert told["modes"][0]["frequency"]["unit"] == "Hz"
    failed = ran("simulate", str(EXAMPLES / "arm.toml"), "--t1", "0s", "--json")
    assert json.loads(failed.stdout)["error"]["name"] == "t1"


def test_cache_answers_programs(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    told = json.loads(ran("cache", "--json").stdout)
    assert told["ready_to_run"] == {"folder": str(tmp_path / "clearance_jax" / "programs"), "programs": 0, "bytes": 0}


def test_lines_of_a_pipe_are_whole(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    code = "from clearance_jax.cli.answer import console; console.print('word ' * 100)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.count("\n") == 1


def test_values_are_completed():
    options = {name: each.default for name, each in inspect.signature(simulate).parameters.items()}
    for name, words in (("solver", SOLVER_WORDS), ("start", STARTS), ("fidelity", OF_MOTIONS)):
        assert {*options[name].autocompletion()} == {*words}


def test_help_has_a_short_name_and_says_the_exit_codes():
    assert ran("simulate", "-h").output == ran("simulate", "--help").output
    assert "130: interrupted" in " ".join(ran("-h").output.split())


def test_a_second_interruption_ends_the_process_at_once():
    """Python is busy elsewhere: nothing but the thread of the command hears it."""
    code = """
import os, signal, time
from clearance_jax.cli.pace import Interruption
with Interruption("keeping what was computed"):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(60)
    except KeyboardInterrupt:
        pass
    while True:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(60)
        except KeyboardInterrupt:
            pass
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 130
    assert done.stderr == "interrupted: keeping what was computed; Ctrl-C again leaves at once\n"

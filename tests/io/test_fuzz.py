"""A share of the cases of the fuzzer, and whether it would see what it looks for (all: `python -m tests.fuzz`)."""

import os
import time

import pytest

from tests import fuzz, fuzz_cases
from tests.fuzz_cases import Case

pytestmark = pytest.mark.quick


@pytest.mark.slow
def test_a_share_of_the_cases():
    found = fuzz.fuzz(180, seed=0)
    assert found.wrong == []
    loaded = {"scene loaded", "urdf loaded"}
    refused = {f"{kind} refused" for kind in ("scene", "study", "command", "trajectory", "urdf")}
    assert loaded | refused <= set(found.ends)


def test_every_case_can_be_made_again():
    def some():
        return list(fuzz_cases.cases(30, seed=3))

    assert some() == some()
    assert len(set(some())) == 30


def test_shipped_files_survive_the_fuzzers_way_of_writing_them(tmp_path):
    path = tmp_path / "s.toml"
    for source in fuzz_cases.SCENES[:2]:
        for robot in source.parent.glob("*.urdf"):  # which a scene names beside itself
            (tmp_path / robot.name).write_bytes(robot.read_bytes())
        path.write_text(fuzz_cases.toml(fuzz_cases.tomllib.loads(source.read_text())))
        assert fuzz.laid_out("scene", path).mechanism.bodies


def bug(kind, path):
    raise TypeError("unsupported operand")


def hang(kind, path):
    time.sleep(5)


def execution(kind, path):
    os.system("true")


def writing(kind, path):
    (path.parents[2] / "fuzz-elsewhere.txt").open("a").close()
    (path.parents[2] / "fuzz-elsewhere.txt").unlink()


def long_message(kind, path):
    error = fuzz_error()
    error.args = ("x" * 601,)
    raise error


def fuzz_error():
    from clearance_jax.errors import ClearanceError

    return ClearanceError("")


@pytest.mark.parametrize(
    ("does", "words"),
    [
        (bug, "TypeError: unsupported operand"),
        (hang, "Hang"),
        (execution, "did what it must not: os.system"),
        (writing, "fuzz-elsewhere.txt"),
        (long_message, "a message of 601 characters"),
    ],
)
def test_the_fuzzer_sees_what_it_is_for(does, words, monkeypatch):
    def laid_out(kind, path):
        return does(kind, path) if path.parent.name == "inside" else None

    monkeypatch.setattr(fuzz, "laid_out", laid_out)
    monkeypatch.setattr(fuzz, "LONGEST_CASE", 0.5)
    monkeypatch.setattr(fuzz, "cases", lambda count, seed: [Case("scene", b"")])
    ((case, report),) = fuzz.fuzz(1).wrong
    assert "case 0" in case
    assert words in report


def test_what_the_command_line_asks_for_is_no_writing_elsewhere(tmp_path):
    watch = fuzz.Watch(tmp_path / "inside")
    watch.asked = ("simulate", "s.toml", "-o", str(tmp_path / "o.nc"))
    watch.on = True
    for name in ("o.nc", ".1.o.nc.partial", "p.nc"):
        (tmp_path / name).open("w").close()
    watch.on = False
    assert len(watch.seen) == 1
    assert "p.nc" in watch.seen[0]


def test_a_command_that_ends_badly_is_seen(monkeypatch):
    def ends(*_):
        print("Traceback", file=fuzz.sys.stderr)
        raise SystemExit(2)

    monkeypatch.setattr("clearance_jax.cli.main", ends)
    with pytest.raises(fuzz.Violation, match="exit code 2"):
        fuzz.commanded(Case("command", b"", ("info", "scene.toml")))

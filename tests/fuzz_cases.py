"""What the fuzzer tries: shipped scenes and studies with a few things changed, trajectories, command lines on them."""

import collections
import importlib
import random
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from tests.fuzz_trajectories import trajectory
from tests.fuzz_urdf import urdf
from tests.places import ROOT

sys.path.append(str(ROOT / "docs" / "_ext"))  # for `python -m tests.fuzz`
reference: Any = importlib.import_module("key_reference").reference

SCENES = sorted((ROOT / "experiments" / "scenes").glob("*.toml"))
STUDIES = sorted((ROOT / "optimize" / "studies").glob("*.toml"))
LIFT = str(ROOT / "experiments" / "scenes" / "arm_lift.csv")
# A word that is in every text that would do harm if it were run.
CANARY = "canary"


class Case(NamedTuple):
    """A file's text (bytes where it is none) and what it is, or a command line on it."""

    kind: str
    text: bytes
    arguments: tuple[str, ...] = ()


# Values ---------------------------------------------------------------------------------------------------------------

EVIL = f"__import__('os').system('touch {CANARY}')"
NUMBERS = (0, -1, 1, 2, 10**400, 2**63, -(2**63), 1e308, -1e308, 5e-324, 1e-300, float("nan"), float("inf"), 0.5, 1e9)
UNITS = (
    "mm",
    "m",
    "kg",
    "deg",
    "rad",
    "rpm",
    "N",
    "N*m",
    "s",
    "N/mm^1.5",
    "percent",
    "µm",
    "°",
    "degC",
    "furlong",
    "dB",
    "m^99",
)
TEXTS = (
    "", " ", "mm", "--12 N*m", "9**9**9 kg", "nan mm", "1e999 m", "inf s", "ground", "crank", "slider", "none",
    "\u202e\U0001f529", "a.b", "a=b", "é" * 300, "x" * 5000, EVIL, f"1 mm; {EVIL}", "{0.__class__}", "%s%n",
    "../../etc/passwd",
    "/dev/zero", "/dev/stdin", "[bold]", "\\", "null", "true", "1 / (10 um)", "1 mm 2 mm", "((((1 m",
    "step(time, 0, 0, 1, 1 d)", "1e999 * time", "step(" * 200, "90 d * time", "-" * 4000 + "1",
)  # fmt: skip


def value(rng: random.Random, depth: int = 0) -> Any:
    """A value that a key may be given."""
    choice = rng.randrange(10)
    if choice < 3:
        return f"{rng.choice((*NUMBERS, rng.uniform(-10, 10), 10 ** rng.uniform(-12, 12)))} {rng.choice(UNITS)}"
    if choice < 5:
        return rng.choice(NUMBERS)
    if choice < 7:
        return rng.choice(TEXTS)
    if choice == 7:
        return rng.random() < 0.5
    if depth > 3:
        return []
    if choice == 8:
        return [value(rng, depth + 1) for _ in range(rng.randrange(4))]
    return {word(rng): value(rng, depth + 1) for _ in range(rng.randrange(3))}


def word(rng: random.Random) -> str:
    """A key, known or not."""
    return rng.choice((rng.choice(KEYS), rng.choice(TEXTS), "type", "law", "name", "x"))


def _examples() -> dict[str, list[Any]]:
    """Of every known key the examples of the reference: plausible values in the wrong places."""
    found: dict[str, list[Any]] = collections.defaultdict(list)
    for table in reference():
        for key in table.keys:
            found[key.name].append(tomllib.loads(f"x = {key.example}")["x"])
    return found


EXAMPLES = _examples()
KEYS = tuple(sorted(EXAMPLES))


# Changes --------------------------------------------------------------------------------------------------------------


def places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key or index) of a tree of tables and lists."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from places(tree[key])


def changed(tree: dict[str, Any], rng: random.Random) -> None:
    """One change of a tree, in place."""
    owner, key = rng.choice(list(places(tree)) or [(tree, "x")])
    kind = rng.randrange(14)
    if kind == 0:
        del owner[key]
    elif kind == 1 and isinstance(owner, dict):
        owner[word(rng)] = owner.pop(key)
    elif kind == 2 and isinstance(owner, dict):
        name = rng.choice(KEYS)
        owner[name] = rng.choice(EXAMPLES[name])
    elif kind == 3 and isinstance(owner, dict):
        owner[word(rng)] = value(rng)
    elif kind == 4:
        other, there = rng.choice(list(places(tree)))
        owner[key] = tomllib.loads(toml({"x": other[there]}))["x"]  # a copy of another part
    elif kind < 10 and isinstance(owner[key], str):
        owner[key] = scaled(owner[key], rng)
    elif kind < 10 and isinstance(owner[key], float):
        owner[key] *= rng.uniform(0.0, 2.0)
    else:
        owner[key] = value(rng)


def nudged(tree: dict[str, Any], rng: random.Random) -> None:
    """A number or a word of a tree changed, in place: what often still loads."""
    leaves = [(owner, key) for owner, key in places(tree) if not isinstance(owner[key], dict | list)]
    owner, key = rng.choice(leaves)
    if isinstance(owner[key], str):
        owner[key] = scaled(owner[key], rng)
    elif not isinstance(owner[key], bool):
        owner[key] = type(owner[key])(owner[key] * rng.uniform(0.0, 2.0))


def scaled(text: str, rng: random.Random) -> str:
    """A quantity with another number, or a text with a letter changed."""
    number, _, unit = text.partition(" ")
    try:
        factor = rng.choice((-1, 0, 0.5, 2, 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-400, 300)))
        return f"{float(number) * factor} {unit}"
    except (ValueError, OverflowError):
        at = rng.randrange(len(text) + 1)
        return text[:at] + rng.choice("aé \"'\\\0\n1.[") + text[at + 1 :]


def mangled(text: str, rng: random.Random) -> bytes:
    """The text of a file, spoiled as a text."""
    lines = text.splitlines()
    kind, at = rng.randrange(7), rng.randrange(len(lines))
    if kind == 0:
        lines[at : at + rng.randrange(1, 4)] = []
    elif kind == 1:
        lines.insert(at, rng.choice(lines))
    elif kind == 2:
        lines[at] = "x = " + "[" * rng.choice((50, 3000, 100_000))
    elif kind == 3:
        lines.insert(0, "x = " + "{a=" * rng.choice((60, 900, 3000)) + "1" + "}" * 900)
    elif kind == 4:
        lines.insert(at, f"[{'.'.join('a' * rng.choice((3, 2000)))}]")
    elif kind == 5:
        raw = bytearray(text.encode())
        for _ in range(rng.randrange(1, 5)):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
        return bytes(raw)
    else:
        lines[at] = lines[at].replace(
            "=", rng.choice(("= ", "==", ":", "= 0x" + "f" * 5000 + " #", "= " + "1" * 5000 + " #"))
        )
    return "\n".join(lines).encode()


def toml(tree: dict[str, Any]) -> str:
    """A tree as TOML, all tables inline."""
    return "".join(f"{_text(key)} = {_toml(entry)}\n" for key, entry in tree.items())


def _toml(entry: Any) -> str:
    if isinstance(entry, dict):
        return "{ " + ", ".join(f"{_text(key)} = {_toml(inner)}" for key, inner in entry.items()) + " }"
    if isinstance(entry, list):
        return "[" + ", ".join(_toml(inner) for inner in entry) + "]"
    if isinstance(entry, str):
        return _text(entry)
    return str(entry).lower() if isinstance(entry, bool | float) else str(entry)


def _text(text: str) -> str:
    escaped = (f"\\u{ord(c):04x}" if ord(c) < 32 or c in '"\\\x7f' else c for c in text)
    return '"' + "".join(escaped) + '"'


# Cases ----------------------------------------------------------------------------------------------------------------


def scene_case(rng: random.Random) -> Case:
    return Case("scene", _spoiled(rng.choice(SCENES), rng))


def study_case(rng: random.Random) -> Case:
    return Case("study", _spoiled(rng.choice(STUDIES), rng))


def trajectory_case(rng: random.Random) -> Case:
    return Case("trajectory", trajectory(rng))


def _spoiled(path: Path, rng: random.Random) -> bytes:
    text = path.read_text()
    if rng.random() < 0.15:
        return mangled(text, rng)
    tree = _with_scene(tomllib.loads(text), path)
    change = rng.choice((changed, nudged))
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        change(tree, rng)
    return toml(tree).encode()


def _with_scene(tree: dict[str, Any], path: Path) -> dict[str, Any]:
    """What a file says, with a study's scene found from wherever the study is put."""
    if "scene" in tree:
        tree["scene"] = str((path.resolve().parent / tree["scene"]).resolve())
    return tree


def command_case(rng: random.Random) -> Case:
    """A command on a shipped scene or study, under the name `scene.toml` or `study.toml`."""
    command = rng.choice(("simulate", "simulate", "info", "run", "plot", rng.choice(TEXTS)))
    source = rng.choice(STUDIES if command == "run" else SCENES)
    text = _with_scene(tomllib.loads(source.read_text()), source)
    given = [
        command,
        rng.choice(("study.toml" if command == "run" else "scene.toml", "scene.toml", odd_path(rng))),
    ]
    for _ in range(rng.choice((0, 1, 1, 2, 4))):
        given += rng.choice(OPTIONS)(rng)
    if rng.random() < 0.1:
        rng.shuffle(given)
    return Case("command", toml(text).encode(), tuple(given))


NAMES = (
    "wrist.radial_clearance",
    "slider.mass",
    "joint5.friction.coefficient",
    "drive.main.speed",
    "payload.mass",
    "gravity.y",
)
OPTIONS: tuple[Callable[[random.Random], list[str]], ...] = (
    lambda rng: ["--set", f"{rng.choice((*NAMES, *TEXTS))}={rng.choice((value(rng), '1 mm', '2kg', '0.3'))}"],
    lambda rng: ["--set", f"{rng.choice(NAMES)}=1mm", "--set", f"{rng.choice(NAMES)}=1mm"],
    lambda rng: ["--t1", str(rng.choice(("1ms", "1 ms", "0 s", value(rng))))],
    lambda rng: ["--rtol", str(rng.choice(("1e-6", "0", "2", value(rng))))],
    lambda rng: ["--samples", str(rng.choice((2, 11, 10**12, 10**30, value(rng))))],
    lambda rng: ["--solver", str(rng.choice(("tsit5", "dopri8", value(rng))))],
    lambda rng: [rng.choice(("-o", "--plot", "--report", "--record")), odd_path(rng)],
    lambda rng: ["--trajectory", rng.choice((LIFT, LIFT, odd_path(rng)))],
    lambda rng: ["--method", str(rng.choice(("slsqp", "cobyqa", value(rng))))],
    lambda rng: ["--starts", str(rng.choice((1, value(rng))))],
    lambda rng: [rng.choice(("--ideal", "--no-verify", "--help", "--nope", "-", "--", str(value(rng))))],
)  # fmt: skip


def odd_path(rng: random.Random) -> str:
    """Inside the folder, or where nothing can be written."""
    path = rng.choice(
        ("o.nc", "a.png", "r.html", "p.jsonl", "missing/o.nc", ".", "", "/dev/null", "/proc/1/o.nc", "scene.toml",
         "study.toml", "a\0b", "n" * 300, "né w.png", "a.xyz", "-o", CANARY + "/../x.nc")
    )  # fmt: skip
    return path


def urdf_case(rng: random.Random) -> Case:
    return Case("urdf", urdf(rng))


KINDS: tuple[Callable[[random.Random], Case], ...] = (
    scene_case,
    scene_case,
    scene_case,
    study_case,
    command_case,
    trajectory_case,
    urdf_case,
)


def cases(count: int, seed: int) -> Iterator[Case]:
    """So many cases; each has a seed of its own, so that one can be made again without those before it."""
    for i in range(count):
        rng = random.Random(f"{seed} {i}")
        yield rng.choice(KINDS)(rng)

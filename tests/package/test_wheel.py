"""The wheel: what is in it, and that it works installed alone, from an empty folder."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest
from places import ROOT

# Of the wheel [bytes].
MOST = 3_000_000
# What the environment of the tests has, other than the library itself, which an editable install adds by a finder.
SHARED = sysconfig.get_paths()["purelib"]
SOLVE = """
import sys
from clearance_jax.cli.main import main
sys.argv = ["clearance", *sys.argv[1:]]
try:
    main()
except SystemExit as ended:
    print(ended.code or 0, "matplotlib" in sys.modules)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    pytest.importorskip("hatchling.build", reason="the build backend is part of the extra `dev`")
    home = tmp_path_factory.mktemp("wheel")
    code = f"from hatchling.build import build_wheel; build_wheel({str(home)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True)
    (built,) = home.glob("*.whl")
    return built


def test_the_wheel_has_what_its_users_need(wheel):
    assert wheel.stat().st_size <= MOST
    with zipfile.ZipFile(wheel) as inside:
        names = inside.namelist()
        (about,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        told = Parser().parsestr(inside.read(about).decode())
    for file in (ROOT / "clearance_jax" / "examples").rglob("*.*"):
        if "__pycache__" not in file.parts:
            assert str(file.relative_to(ROOT)) in names
    assert "clearance_jax/py.typed" in names
    assert any(name.endswith("LICENSE") for name in names)
    assert not [name for name in names if name.startswith(("tests", "experiments", "docs", "optimize"))]
    assert told["Author"]
    assert "Typing :: Typed" in told.get_all("Classifier", [])
    # On an index nothing of the repository lies beside the text.
    assert "](docs/" not in told.get_payload()
    assert "clearance simulate" in told.get_payload()


@pytest.mark.slow
def test_the_wheel_simulates_alone(wheel, tmp_path):
    """Installed into an environment that has the other packages, started in an empty folder."""
    home, empty = tmp_path / "venv", tmp_path / "empty"
    venv.create(home, with_pip=False, symlinks=True)
    (place,) = home.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as inside:
        inside.extractall(place)
    # A plain path: `.pth` files of that folder, an editable install among them, are not read.
    (place / "shared.pth").write_text(SHARED)
    empty.mkdir()
    given = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "XLA_FLAGS")}
    python = home / "bin" / "python"

    def ran(code: str, *words: str) -> str:
        asked = [python, "-c", code, *words]
        return subprocess.run(asked, cwd=empty, env=given, capture_output=True, text=True, check=True).stdout

    where = Path(ran("import clearance_jax; print(clearance_jax.__file__)").strip())
    assert where.is_relative_to(home)
    assert ran(SOLVE, "examples", "arm").endswith("0 False\n")
    assert ran(SOLVE, "check", "arm.toml").endswith("0 False\n")
    assert ran(SOLVE, "simulate", "arm.toml", "--t1", "2ms", "-o", "b.nc").endswith("0 False\n")
    assert ran(SOLVE, "simulate", "arm.toml", "--t1", "2ms", "-o", "a.nc", "--plot", "a.png").endswith("0 True\n")
    assert {path.name for path in empty.iterdir()} == {"arm.toml", "a.nc", "b.nc", "a.png"}
    assert (empty / "a.png").read_bytes().startswith(b"\x89PNG")

"""The viewer's page, read as text: its numbers are the dataset's, names are text, it is written whole or not."""

import base64
import hashlib
import html
import json
import re
from typing import Any

import numpy as np
import pytest
from motions import arm, crank
from places import ROOT, refused
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax.cli.main import app
from clearance_jax.errors import ClearanceError
from clearance_jax.results.play import outline_of
from clearance_jax.viewer.samples import keep

TYPES = {"f4": np.float32, "f8": np.float64, "i2": np.int16, "u1": np.uint8, "u4": np.uint32}
LARGEST = 2_000_000
HARD = cj.laws.HuntCrossley(1e9, 0.5)
KINDS = [
    cj.RevoluteClearance(1e-4, 0.01, HARD),
    cj.RevoluteClearance(1e-4, 0.01, HARD, depth=np.linspace(0, 2e-5, 16)),
    cj.SleeveClearance(1e-4, 0.01, 0.04, HARD),
    cj.SleeveClearance(1e-4, 0.01, 0.04, HARD, axial_clearance=5e-5, pin="inside"),
    cj.SphericalClearance(1e-4, 0.01, HARD),
    cj.GuideClearance(1e-4, 0.06, 0.03, HARD, width=0.05),
]


class Read:
    """A page as a browser reads it, by its own few lines."""

    def __init__(self, page: str):
        self.scene = json.loads(self._inside(page, "scene"))
        data = base64.b64decode(self._inside(page, "numbers"))
        self.arrays = [self._array(data, **entry) for entry in self.scene["arrays"]]

    @staticmethod
    def _inside(page: str, name: str) -> str:
        found = re.search(rf'id="{name}">(.*?)</script>', page, re.DOTALL)
        assert found is not None
        return found.group(1)

    @staticmethod
    def _array(data: bytes, kind: str, at: int, rows: int, width: int, step: float = 1.0) -> np.ndarray:
        raw = np.frombuffer(data, TYPES[kind], rows * width, at)
        return raw.reshape(rows, width) * step

    def table(self, index: int, times: str, at: np.ndarray) -> np.ndarray:
        """An array at times, column by column."""
        table, clock = self.arrays[index], self.arrays[self.scene[times]][:, 0]
        if len(table) == 1:
            return np.repeat(table, len(at), axis=0)
        return np.stack([np.interp(at, clock, column) for column in table.T], axis=1)

    def mark(self, k: int, at: np.ndarray) -> np.ndarray:
        mark = self.scene["marks"][k]
        ideal = self.table(mark["ideal"], "time", at)
        return ideal if mark["error"] is None else ideal + self.table(mark["error"], "time", at)


@pytest.mark.parametrize("samples", [30, 90, None])
def test_places_are_the_datasets_within_the_stated_error(samples):
    dataset = crank()
    view = cj.view(dataset, samples=samples)
    read, time = Read(view.html), dataset["time"].values
    actual = np.stack([read.mark(k, time) for k in range(dataset.sizes["mark"])], axis=1)
    off = np.linalg.norm(actual - dataset["mark_position"].values, axis=-1).max()
    assert off == pytest.approx(view.fidelity.place_error, rel=1e-6)
    assert view.fidelity.kept == (samples or 201)
    assert f"{view.fidelity.place_error:.2g} m" in read.scene["notes"][0]
    # Fewer samples are worse, all of them are exact to the digits of a 32-bit number.
    assert off < {30: 2e-2, 90: 2e-3, None: 1e-7}[samples]
    assert repr(view).endswith(read.scene["notes"][0])


def test_errors_and_pins_have_their_own_stated_error():
    dataset = arm(301)
    view = cj.view(dataset, samples=150)
    read, time = Read(view.html), dataset["time"].values
    wrong = dataset["mark_position"].values - dataset["ideal_mark_position"].values
    off = [
        np.linalg.norm(read.table(m["error"], "time", time) - wrong[:, k], axis=1).max()
        for k, m in enumerate(read.scene["marks"])
    ]
    assert max(off) == pytest.approx(view.fidelity.ideal_error, rel=1e-6)
    pins = dataset["eccentricity"].values
    off = [
        np.linalg.norm(read.table(joint["contact"]["place"], "contact_time", time) - pins[:, k], axis=1).max()
        for k, joint in enumerate(read.scene["joints"])
    ]
    assert max(off) == pytest.approx(view.fidelity.play_error, rel=1e-6)


def test_an_impact_of_one_sample_is_kept():
    dataset = crank(5001)
    dataset["contact_force"][3217] = 9e3
    read = Read(cj.view(dataset, samples=40).html)
    force = read.arrays[read.scene["joints"][1]["contact"]["force"]]
    assert force.max() == 9e3
    assert dataset["time"].values[3217] in read.arrays[read.scene["contact_time"]]


def test_the_next_sample_kept_is_the_farthest_from_the_lines():
    time, values = np.linspace(0, 1, 101), np.zeros((101, 1))
    values[37], values[80] = 5.0, -1.0
    assert set(keep(time, values, 3)) == {0, 37, 100}
    # The lines to 37 are now worst just beside it.
    assert set(keep(time, values, 5)) == {0, 36, 37, 38, 100}


@pytest.mark.parametrize("kind", KINDS, ids=lambda joint: joint.kind)
def test_every_outline_comes_into_the_page(kind):
    outline = kind.outline()
    dataset = crank(outline=outline)
    shown = Read(cj.view(dataset).html).scene["joints"][1]["contact"]["outline"]
    if outline.height is not None:  # of a block in the plane that closes a loop nobody knows the tilt
        assert shown is None
        return
    known = outline_of(dataset, "wrist")
    assert known is not None
    assert shown["radius"] == float(outline.radius)
    numbers = {name: x for name, x in known._asdict().items() if x is not None and (name != "depth" or np.any(x))}
    assert shown.keys() == numbers.keys()
    assert all(np.array_equal(shown[name], numbers[name]) for name in numbers)


def test_a_mechanism_without_play_has_no_contacts():
    read = Read(cj.view(crank(play=False)).html)
    assert [joint["contact"] for joint in read.scene["joints"]] == [None, None]
    assert read.scene["contact_time"] is None
    assert not read.scene["ideal"]
    assert len(read.scene["notes"]) == 1


def test_the_page_says_why_the_ideal_mechanism_is_not_shown():
    dataset = crank().drop_vars("ideal_mark_position").assign_attrs(ideal="it has two loops")
    assert "The ideal mechanism is not shown: it has two loops." in Read(cj.view(dataset).html).scene["notes"]


def test_what_is_no_motion_is_refused():
    with refused("dataset", 1):
        cj.view(crank().isel(time=[0]))
    with refused("dataset", 0):
        cj.view(crank().isel(time=0, drop=True))
    with refused("samples", 1):
        cj.view(crank(), samples=1)


def test_names_stay_text():
    name = "</script><script>alert('\"1\"')</script><!--"
    page = cj.view(crank(name=name, wrist=name)).html
    assert len(re.findall("</script", page, re.IGNORECASE)) == 3
    assert page.count("<!--") == 0
    assert html.escape(name) in page.partition("</title>")[0]
    read = Read(page)
    assert read.scene["title"] == name
    assert read.scene["joints"][1]["name"] == name


def test_a_notebook_shows_the_page_in_a_frame():
    view = cj.view(crank())
    frame: Any = re.fullmatch(r'<iframe title="crank" style="[^"]*" srcdoc="([^"]*)"></iframe>', view._repr_html_())
    assert html.unescape(frame.group(1)) == view.html


def test_a_page_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    view, path = cj.view(crank()), tmp_path / "page.html"
    path.write_text("before")

    def full(self, *_, **__):
        self.write_bytes(b"a part")
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("pathlib.Path.write_text", full)
        with pytest.raises(ClearanceError) as caught:
            view.save(path)
    assert "No space left on device" in str(caught.value)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
    view.save(path)
    assert path.read_text(encoding="utf-8") == view.html


def test_a_second_of_an_arm_stays_below_two_megabytes():
    view = cj.view(arm())
    assert len(view.html.encode()) < LARGEST
    assert view.fidelity.kept == 1001
    # A motion of ten times as many samples keeps fewer of them, and says so.
    longer = cj.view(arm(20_001))
    assert len(longer.html.encode()) < LARGEST
    assert longer.fidelity.kept < longer.fidelity.of == 20_001


def test_the_command_writes_a_page(tmp_path):
    file = tmp_path / "crank.nc"
    cj.save(crank(), file)
    result = CliRunner().invoke(app, ["view", str(file), "--title", "A crank"])
    assert result.exception is None, result.output
    assert Read((tmp_path / "crank.html").read_text(encoding="utf-8")).scene["title"] == "A crank"
    wrong = CliRunner().invoke(app, ["view", str(file), "-o", str(tmp_path / "crank.png")])
    assert isinstance(wrong.exception, ClearanceError)
    assert "must end in .html" in str(wrong.exception)


def test_the_bundle_belongs_to_the_sources():
    """As `viewer/build.mjs` computes it; `make viewer` bundles anew."""
    folder = ROOT / "viewer"
    names = [
        "build.mjs",
        "package-lock.json",
        "package.json",
        *sorted(f"src/{path.name}" for path in (folder / "src").iterdir()),
    ]
    digest = hashlib.sha256(b"".join((folder / name).read_bytes() for name in names)).hexdigest()
    bundle = (ROOT / "clearance_jax" / "viewer" / "static" / "viewer.js").read_text(encoding="utf-8")
    assert bundle.startswith(f"/* sources {digest};"), "run `make viewer`"
    assert "</script" not in bundle.lower()
    assert "MIT" in (ROOT / "clearance_jax" / "viewer" / "static" / "three-LICENSE.txt").read_text(encoding="utf-8")

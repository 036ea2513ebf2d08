"""A sweep's store: whoever dies, writes beside it, fills the disk or damages it, it goes on, to the same answers."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import sweeping
import xarray as xr
from places import refused
from running import allow, lanes_kept, no_longer_than, somebody
from sweeping import CLEARANCES, SPEEDS, same, swept

import clearance_jax as cj
from clearance_jax.runs.journal import RunWarning

LANES = 512
STORE, PARTIAL = sys.modules["clearance_jax.sweep.store"], sys.modules["clearance_jax.runs.partial"]


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    sweeping.small_regions(monkeypatch)


@pytest.fixture(scope="module")
def whole():
    """The answers in memory."""
    return swept()


def stopped(path, done, **options):
    """A sweep into a store, stopped once so many lanes are done."""

    def stop(progress):
        if progress.done >= done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(path, progress=stop, **options)


@pytest.mark.slow
def test_a_store_holds_the_same(tmp_path, whole):
    plans, seen = [], []
    found = swept(tmp_path / "a.zarr", plan=plans.append, progress=seen.append, provenance={"scene": "a text"})
    same(found, whole)
    assert found.attrs["scene"] == "a text"
    (plan,) = plans
    assert (plan.lanes, plan.known, plan.regions, plan.programs) == (512, 0, 8, 1)
    assert plan.seconds is not None
    assert plan.disk == 512 * (1 + 4 + 4 + 1 + 8 + 16)
    assert "512 samples in 8 regions, 1 programs" in str(plan)
    assert (seen[-1].done, seen[-1].failed, seen[-1].left) == (512, 0, 0.0)
    # Whoever has only xarray reads it, and sees its units.
    plain = xr.open_zarr(tmp_path / "a.zarr")
    assert plain["peak"].attrs["units"] == "m"
    assert plain["peak"].encoding["chunks"] == (4, 16)


def test_resuming_runs_only_what_is_missing(tmp_path, whole):
    path, calls = tmp_path / "a.zarr", []

    def interrupt(progress):
        if progress.done >= 200:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(path, progress=interrupt)
    part = xr.open_zarr(path)
    assert (part["code"].values == -1).sum() == 512 - 192
    assert np.isnan(part["peak"].values).sum() == 512 - 192
    same(swept(path, resume=True, progress=calls.append), whole)
    assert min(call.done for call in calls) > 192
    assert sorted(STORE.Regions(path).records) == list(range(8))


def test_another_question_is_refused_in_words(tmp_path, monkeypatch):
    path = tmp_path / "a.zarr"
    swept(path)
    with refused(path):
        swept(path)
    with refused(path, "axis drive.main.speed"):
        swept(path, resume=True, speeds=SPEEDS[:15])
    with refused(tmp_path, None):
        swept(tmp_path, resume=True)
    # More outputs than the store has would stay empty there.
    with monkeypatch.context() as patch:
        patch.setattr(sweeping, "OUTPUTS", {**sweeping.OUTPUTS, "more": "piston.position"})
        with refused(path, "structure of the model (output more)"):
            swept(path, resume=True)


@pytest.mark.slow
def test_a_function_of_the_users_is_part_of_the_question(tmp_path, monkeypatch):
    """What it does, what it keeps, and the functions that it calls; not where it lies."""

    def asked(factor, path=tmp_path / "a.zarr", **options):
        def end(solution):
            return factor * helped(solution["piston.position"])

        monkeypatch.setattr(sweeping, "OUTPUTS", {"end": end})
        return swept(path, clearances=CLEARANCES[:2], speeds=SPEEDS[:2], **options)

    code = "code of test_a_function_of_the_users_is_part_of_the_question.<locals>.asked.<locals>.end (output end)"
    first = asked(2.0).load()
    same(asked(2.0, resume=True), first)
    with refused(tmp_path / "a.zarr", code):
        asked(3.0, resume=True)
    monkeypatch.setitem(globals(), "helped", lambda value: 2 * value)
    with refused(tmp_path / "a.zarr", code):
        asked(2.0, resume=True)


def helped(value):
    return value


def test_an_output_may_be_called_as_a_store_calls_things_inside(tmp_path, monkeypatch):
    """Only names that a folder of the store cannot have are refused, in a sentence and before anything is written."""
    names = "place", "c", "region", "question", "variables", "0", "lanes", "fingerprint"
    monkeypatch.setattr(sweeping, "OUTPUTS", dict.fromkeys(names, "piston.position"))
    few = {"clearances": CLEARANCES[:2], "speeds": SPEEDS[:2]}
    same(swept(tmp_path / "a.zarr", **few), swept(**few))
    own = "zarr.json", "Journal.jsonl", "writer.lock", "partial", "question.1"
    for name in (*own, "__a", "a" * 201, "..", "a/b", ""):
        monkeypatch.setattr(sweeping, "OUTPUTS", {name: "piston.position"})
        with refused(name):
            swept(tmp_path / "b.zarr", **few)
    assert not (tmp_path / "b.zarr").exists()


# Partial results -----------------------------------------------------------------------------------------------------


def test_partial_results_are_not_solved_again(tmp_path, whole, monkeypatch):
    """Stopped within a region; what was torn then, or damaged since, is solved again, the rest is not."""
    sweeping.small_regions(monkeypatch, LANES)
    path, seen = tmp_path / "a.zarr", []
    stopped(path, 300)
    assert lanes_kept(path) == (0, 320)
    (file,) = (path / "partial").iterdir()
    file.write_bytes(file.read_bytes()[:-1])
    stopped(path, 400, resume=True)
    assert lanes_kept(path) == (0, 448)
    (later,) = set((path / "partial").iterdir()) - {file}
    data = bytearray(later.read_bytes())
    data[30] ^= 1
    later.write_bytes(bytes(data))
    assert lanes_kept(path) == (0, 256)
    same(swept(path, resume=True, progress=seen.append), whole)
    # Two parts that end at once are told of once.
    assert {512} <= {p.done for p in seen} <= {320, 384, 448, 512}
    assert not (path / "partial").exists()


def test_a_pilots_lanes_are_kept(tmp_path, whole):
    path, plans = tmp_path / "a.zarr", []

    def stop(plan):
        plans.append(plan)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(path, plan=stop)
    assert plans[0].seconds > 0
    assert lanes_kept(path) == (0, 64)
    same(swept(path, resume=True), whole)


def test_widening_takes_over_partial_results(tmp_path, whole, monkeypatch):
    sweeping.small_regions(monkeypatch, LANES)
    path, seen = tmp_path / "a.zarr", []
    stopped(path, 100, clearances=CLEARANCES[::2])
    same(swept(path, resume=True, progress=seen.append), whole)
    # The first chunk starts the clock.
    assert max(p.new for p in seen) == LANES - 128 - 64


# Damage --------------------------------------------------------------------------------------------------------------


def test_a_damaged_chunk_is_said_and_computed_again(tmp_path, whole):
    path = tmp_path / "a.zarr"
    swept(path)
    chunk = path / "peak/c/3/0"
    data = bytearray(chunk.read_bytes())
    data[len(data) // 2] ^= 1
    chunk.write_bytes(bytes(data))
    (path / "end/c/5/0/0").unlink()
    # Whole, but of another region.
    (path / "steps/c/6/0").write_bytes((path / "steps/c/7/0").read_bytes())
    with pytest.raises(ValueError, match="checksum"):
        xr.open_zarr(path)["peak"].load()
    with pytest.warns(RunWarning, match=r"3 of its regions are damaged \(3, 5, 6\); they are computed again"):
        found = swept(path, resume=True)
    same(found, whole)


def test_a_damaged_coordinate_is_mended(tmp_path, whole):
    path = tmp_path / "a.zarr"
    swept(path)
    chunk = path / "drive.main.speed/c/0"
    chunk.write_bytes(chunk.read_bytes()[:-1])
    with refused("drive.main.speed", str(path)):
        swept(path, resume=True, speeds=np.append(SPEEDS, 600.0))
    (path / "wrist.radial_clearance/c/0").unlink()
    with pytest.warns(RunWarning, match="the coordinate .* is damaged; it is mended"):
        found = swept(path, resume=True)
    same(found, whole)


def test_a_store_that_does_not_say_what_it_is_is_mended_by_its_own_question(tmp_path, whole):
    path, seen = tmp_path / "a.zarr", []
    swept(path)
    (path / "zarr.json").write_text("{")
    with refused(path, None):
        swept(path, resume=True, t1=6e-4)
    with pytest.warns(RunWarning, match=r"its `zarr.json` is damaged; it is mended"):
        found = swept(path, resume=True, progress=seen.append)
    same(found, whole)
    assert seen == []


def test_chunks_wait_for_each_other_before_they_are_written(tmp_path, monkeypatch):
    """Written when the first has waited long enough, or nothing follows; or not at all, where their region is."""
    clock = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    folder = tmp_path / "partial"
    kept = PARTIAL.PartialResults(folder, {"x": (np.dtype("f8"), ())})
    monkeypatch.setattr(PARTIAL, "PATIENCE", 1.0)

    def add(region, place):
        kept.add(region, np.array([place]), {"x": np.array([float(place)])})

    add(0, 1)
    add(1, 2)
    assert not folder.exists()
    kept.forget(0)
    clock[0] = 1.0
    add(1, 3)
    assert [file.name.split(".")[0] for file in folder.iterdir()] == ["1"]
    add(1, 4)
    kept.close()
    found = {"x": np.zeros(5)}
    PARTIAL.PartialResults(folder, {"x": (np.dtype("f8"), ())}).fill(1, found)
    np.testing.assert_array_equal(found["x"], [0, 0, 2, 3, 4])


# Disks ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("done", [100, LANES])
def test_no_more_room(tmp_path, whole, monkeypatch, done):
    """For partial results; for a chunk of the region."""
    sweeping.small_regions(monkeypatch, LANES)
    path, seen = tmp_path / "a.zarr", []
    stopped(path, done)
    before = lanes_kept(path)
    (file,) = (path / "partial").iterdir()
    room = 3000 if done == LANES else file.stat().st_size + 100
    with no_longer_than(room), pytest.raises(cj.ClearanceError, match=r"Cannot write region 0.*make room, and go on"):
        swept(path, resume=True)
    kept = lanes_kept(path)
    assert before[1] <= kept[1] < LANES + (done == LANES)
    assert kept[0] == 0
    same(swept(path, resume=True, progress=seen.append), whole)
    assert min(p.done for p in seen) >= kept[1]


def test_a_disk_full_while_a_region_is_written(tmp_path, monkeypatch, whole):
    put, calls, path = STORE.put, [], tmp_path / "a.zarr"

    def full(*args):
        calls.append(args)
        if len(calls) == 4:
            raise OSError(28, "No space left on device")
        put(*args)

    with monkeypatch.context() as patch:
        patch.setattr(STORE, "put", full)
        with pytest.raises(cj.ClearanceError, match=r"Cannot write region 3 of .*No space left.*make room, and go on"):
            swept(path)
    assert lanes_kept(path) == (192, 64)
    same(swept(path, resume=True), whole)


def test_a_region_that_cannot_be_written(whole):
    with tempfile.TemporaryDirectory() as name:  # not below a folder that is one user's
        folder, path = Path(name), Path(name) / "a.zarr"
        stopped(path, 100)
        allow(folder, writable=False)
        with somebody():
            assert int((xr.open_zarr(path)["code"] == 0).sum()) == 64
        allow(folder, writable=True)
        allow(path / "peak", writable=False)
        said = r"Cannot write region 1 of .*Permission denied.*see to that, and go on"
        with somebody(), pytest.raises(cj.ClearanceError, match=said):
            swept(path, resume=True)
        allow(folder, writable=True)
        same(swept(path, resume=True), whole)
    with pytest.raises(cj.ClearanceError, match="Cannot write"):
        swept("/proc/a.zarr")

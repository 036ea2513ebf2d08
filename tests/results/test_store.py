"""Files of results are there completely, or not at all."""

import pytest
import xarray as xr

from clearance_jax import ClearanceError
from clearance_jax.results.store import load_dataset, save, whole_file

pytestmark = pytest.mark.quick


def write(path, text, error=None, *words):
    with whole_file(path, *words) as partial:
        partial.write_text(text)
        if error is not None:
            raise error


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_what_is_not_finished_leaves_the_old_file(tmp_path, error):
    path = tmp_path / "result.txt"
    write(path, "old")
    with pytest.raises(error):
        write(path, "new, but half", error)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_dataset_whose_writing_is_interrupted_leaves_nothing(tmp_path, monkeypatch):
    def half(dataset, path, **_):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(xr.Dataset, "to_netcdf", half)
    with pytest.raises(KeyboardInterrupt):
        save(xr.Dataset(), tmp_path / "o.nc")
    assert list(tmp_path.iterdir()) == []


def test_a_path_below_a_file_is_refused_in_words(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ClearanceError) as error:
        write(tmp_path / "file" / "page.html", "page", None, "the report ", "Take another")
    assert str(error.value).startswith("Cannot write the report `")
    assert str(error.value).endswith("Not a directory. Take another.")


def test_a_file_gets_its_name_at_the_end(tmp_path):
    path = tmp_path / "o.nc"
    with whole_file(path) as partial:
        partial.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    save(xr.Dataset({"x": 1.0}), path)
    assert float(load_dataset(path)["x"]) == 1.0

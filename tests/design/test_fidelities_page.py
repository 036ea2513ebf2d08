"""The script that counts solves by each route, in its quick mode."""

import numpy as np
import pytest

from optimize import fidelities


@pytest.mark.slow
def test_routes_agree_and_poses_save_solves(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = fidelities.main(quick=True)
    auto, alone = rows
    assert auto[1] == "auto"
    assert np.isclose(float(auto[2]), float(alone[2]), rtol=1e-3)
    assert auto[3] <= alone[3]
    assert auto[6] > 0
    assert (tmp_path / "out" / "fidelities_slider-crank_quick.md").exists()

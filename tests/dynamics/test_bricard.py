"""Bricard's mechanism, problem A04 of the IFToMM library of multibody benchmarks, against its published reference.

Five slender rods of 1 m and 1 kg and the ground make a loop along edges of a cube, six revolute joints, each square to
both rods that meet in it. By Gruebler's count nothing moves; one of the loop's conditions repeats others. It falls from
rest, and is looked at for 10 s: at P3, where the second rod meets the third.

Gonzalez, Dopico, Lugris, Cuadrado (2006): A benchmarking system for MBS simulation software: problem standardization
and performance measurement. Multibody System Dynamics 16, 179-190. The reference's numbers (every 0.2 s, six digits:
`experiments/reference/data/bricard_p3.csv`) are those of the grey lines of the figure in which Tagliapietra et al.
compare OpenSim with it (github.com/RehabEngGroup/MBSbenchmarksInOpenSim, help/images/4MBS_PlotResults.pdf).
"""

import numpy as np
import pytest
from places import REFERENCE

import clearance_jax as cj
from experiments.iftomm import bricard

KNOWN = np.loadtxt(REFERENCE / "bricard_p3.csv", delimiter=",", skiprows=1, unpack=True)


@pytest.mark.slow
@pytest.mark.parametrize("cut", [5, 3])
def test_bricards_mechanism_moves_as_published(cut):
    """To the last digit of the reference, wherever the loop is cut; its energy stays."""
    mechanism = bricard(cut)
    assert cj.mobility(mechanism) == (5, 5, 4)
    times, *known = KNOWN
    solution = cj.simulate(mechanism, 10.0, save_at=times, rtol=1e-10)
    position, velocity = (np.asarray(solution[f"P3.{name}"]) for name in ("position", "velocity"))
    # Half of the sixth digit; one time, 1.19992 s, has no more digits than the places have.
    late = np.where(np.isclose(np.round(times / 0.2) * 0.2, times, atol=1e-9), 0.0, 5e-6)
    error = np.abs(position - np.stack(known, 1))
    assert np.max(error - late[:, None] * np.abs(velocity)) < 5e-7
    energy = np.asarray(solution["kinetic_energy"] + solution["potential_energy"])
    assert np.ptp(energy) < 1e-8
    assert float(solution.energy_residual) < 1e-10

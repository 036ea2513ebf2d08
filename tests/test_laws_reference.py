"""The laws answer what they answered when tests/data/laws_reference.npz was written (see its maker)."""

import numpy as np
import pytest

from experiments.reference import laws_today


def check_close(new, old):
    """To 1e-14 of the array's largest value everywhere, and of the value itself all but where terms cancel."""
    gap = np.abs(new - old)
    assert np.all(gap <= 1e-14 * np.max(np.abs(old)))
    assert np.mean(gap <= 1e-14 * np.abs(old)) > 0.95


@pytest.mark.slow
def test_laws_are_what_they_were():
    with np.load(laws_today.FILE) as file:
        old = dict(file)
    new = laws_today.answers(old)
    assert new.keys() == old.keys() - {"normal", "friction"}
    for name, values in new.items():
        check_close(values, old[name])


def test_the_file_holds_the_samples_of_its_maker():
    with np.load(laws_today.FILE) as file:
        for name, columns in laws_today.samples().items():
            np.testing.assert_allclose(columns, file[name], rtol=1e-14)


def test_a_wrong_answer_is_seen():
    old = np.geomspace(1e-9, 1.0, 100)
    check_close(old * (1 + 1e-15), old)
    for wrong in (old + 1e-13 * (old == 1.0), old * (1 + 1e-13)):
        with pytest.raises(AssertionError):
            check_close(wrong, old)

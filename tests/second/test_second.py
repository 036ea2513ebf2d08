"""Thirty random scenes by the library and by the second simulator; a thousand are `make nightly`."""

import pytest

from tests.second.compare import _values, compare, truth
from tests.second.scenes import changed, scene, value

# Six scenes each that differ in their numbers.
CASES = {
    "film": "pendulum, johnson, none, load, off the centre, round, short-bearing, batch, clearance",
    "four-bar": "four-bar, lankarani-nikravesh, lugre, harmonic, restarted, round, none, jit, mass",
    "worn": "pendulum, tsuji, dahl, step5, off the centre, worn, preloaded-bearing, vmap, stiffness",
    "guide": "guide, hunt-crossley, cubic, actuator servo, centre, round, none, alone, clearance",
    "sleeve": "sleeve, standard-linear-solid, tanh, step5, off the centre, round, none, jit, mass",
}
KEYS = ("mechanism", "normal", "friction", "motion", "start", "bore", "filling", "solved", "by")
SCENES = 6


def case_of(name):
    return dict(zip(KEYS, CASES[name].split(", "), strict=True)) | {"times": "uneven"}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_both_simulators_agree(name, tmp_path):
    case = case_of(name)
    scenes = [scene(case, 0, k) for k in range(SCENES)]
    found = compare(scenes, tmp_path, contacts=name == "film", derivatives=1)
    assert len(found) > 12 * SCENES  # quantities of one joint and one body
    assert found[0].ratio <= 1, found[:5]


def test_what_is_wrong_by_a_thousandth_is_seen():
    """The comparison itself: the motion with a clearance that is a thousandth larger does not agree."""
    one = scene(case_of("guide"), 0)
    other = one._replace(tables=changed(one.tables, one.keys, 1.001 * value(one.tables, one.keys)))
    right, wrong = truth(one), truth(other)
    assert max(found.ratio for found in _values(one, right.motion.values, right.senses, right)) == 0
    assert max(found.ratio for found in _values(one, wrong.motion.values, {}, right)) > 10

"""Thirty random scenes by the library and by the second simulator; a thousand are `make nightly`."""

import pytest
from second.compare import compare
from second.scenes import scene

# Five scenes each that differ in their numbers.
CASES = {
    "four-bar": ("four-bar", "lankarani-nikravesh", "lugre", "harmonic", "restarted", "round", "none", "jit", "mass"),
    "six-bar": ("stephenson-2", "adams-impact", "dahl", "constant-speed", "centre", "round", "none", "vmap", "clearance"),
    "two plays": ("loop, two plays", "tsuji", "brown-mcphee", "step5", "centre", "round", "damper", "vmap", "stiffness"),
    "guide": ("guide", "hunt-crossley", "cubic", "actuator servo", "off the centre", "round", "none", "jit", "clearance"),
    "film": ("pendulum", "johnson", "none", "load", "off the centre", "round", "short-bearing", "batch", "clearance"),
    "sleeve": ("sleeve", "standard-linear-solid", "tanh", "load", "off the centre", "round", "none", "jit", "mass"),
}
KEYS = ("mechanism", "normal", "friction", "motion", "start", "bore", "filling", "solved", "by")
SCENES = 5


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_both_simulators_agree(name, tmp_path):
    case = dict(zip(KEYS, CASES[name], strict=True)) | {"times": "uneven"}
    scenes = [scene(case, 0, k) for k in range(SCENES)]
    found = compare(scenes, tmp_path, contacts=case["solved"] != "vmap")
    assert len(found) > 20 * SCENES
    assert found[0].ratio <= 1, found[:5]

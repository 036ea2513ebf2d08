"""Designs whose clearances are made in classes: branch and bound against enumeration."""

import dataclasses
import itertools
from types import SimpleNamespace
from unittest.mock import Mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from places import refused

import clearance_jax as cj
from clearance_jax import design
from clearance_jax.cli.design import _search
from clearance_jax.cli.pace import Pace, ProgressDisplay
from clearance_jax.design.asked.classes import NONE_CHOSEN, SMALLEST, ChosenClasses, classes_of
from clearance_jax.design.judge.findings import _fits
from clearance_jax.design.search.class_search import BranchAndBound, without_classes
from clearance_jax.design.search.run import INTERRUPTED, SPENT
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.fits import fit
from experiments.common import SCENES
from optimize.allocate_planar_arm import problem
from optimize.allocate_slider_crank import problem as slider_crank

FITS = ("H6/g5", "H7/g6", "H7/f7", "H8/e8", "H9/d9")
COSTS = (10.0, 7.0, 5.0, 3.5, 2.6)
ARM = [f"joint{i + 1}.radial_clearance" for i in range(3)]
CLASSES = {name: {f: 1.7 ** (2 - i) * c for f, c in zip(FITS, COSTS, strict=True)} for i, name in enumerate(ARM)}


@pytest.fixture(scope="module")
def asked():
    """The three pins of a planar arm."""
    return problem(3, quick=True)


@pytest.fixture(scope="module")
def chosen(asked):
    return asked.solve(classes=CLASSES)


@pytest.fixture(scope="module")
def enumerated(asked):
    """Cost and worst limit, at the greatest and at the least clearances, of every combination; by a loop of its own."""
    whole = asked.specification
    (limit,) = whole.limits

    @jax.jit
    def error(values):
        moved = cj.replace(whole.mechanism, dict(zip(ARM, values, strict=True)))
        return cj.measure(moved, {"error": limit.metric}, whole.t1)["error"]

    found = {}
    for names in itertools.product(FITS, repeat=3):
        ends = np.array([fit(0.02, name).radial_clearance for name in names])
        cost = sum(CLASSES[v][name] for v, name in zip(ARM, names, strict=True))
        found[names] = cost, max(float(error(jnp.maximum(end, SMALLEST))) for end in ends.T[::-1]) / limit.bound - 1
    return found


@pytest.mark.slow
def test_three_joints_of_five_classes_equal_enumeration(chosen, enumerated):
    names, (cost, worst) = min(((n, v) for n, v in enumerated.items() if v[1] <= 0), key=lambda pair: pair[1][0])
    found = chosen.classes
    assert found is not None
    assert tuple(one.name for one in found.chosen.values()) == names
    assert_allclose(chosen.objective, cost, rtol=1e-12)
    assert_allclose(chosen.evaluation.x, [fit(0.02, name).radial_clearance[1] for name in names], rtol=1e-12)
    assert chosen.feasible
    assert chosen.evaluation.worst <= worst + 1e-6
    assert found.gap == 0.0
    assert found.relaxed <= cost
    # Enumeration solves 125 combinations, at both ends.
    assert found.combinations == len(enumerated) == 125
    assert found.solves <= 40
    assert f"{found.nodes} nodes, {found.solves} solves for 125 combinations" in str(chosen)
    assert f"({names[0]}: " in str(chosen)


@pytest.mark.slow
def test_another_bound_has_another_answer(asked, enumerated):
    """The same evaluations, with the bound half as wide again and half as narrow."""
    for factor in (0.6, 1.5):
        limits = [design.Limit(one.metric, factor * one.bound, one.name) for one in asked.specification.limits]
        whole = asked.specification
        moved = design.ToleranceProblem(whole.mechanism, whole.t1, whole.variables, limits)
        found = moved.solve(classes=CLASSES)
        assert found.feasible
        best = min(cost for cost, worst in enumerated.values() if (1 + worst) / factor - 1 <= 0)
        assert_allclose(found.objective, best, rtol=1e-12)


@pytest.mark.slow
def test_a_combination_that_nothing_holds_is_refused_in_a_sentence(asked):
    loose = {name: {"H8/e8": 2.0, "H9/d9": 1.0} for name in ARM}
    found = asked.solve(classes=loose)
    assert not found.feasible
    assert found.classes is not None
    assert found.classes.chosen == {}
    assert found.classes.gap == np.inf
    assert "no combination of the classes holds every limit: with the tightest of each, tool" in found.note
    assert "A tighter class of `joint" in found.note
    assert "Without classes the design costs" in found.note
    assert str(found).startswith("NO FEASIBLE DESIGN: tool")


@pytest.mark.slow
def test_an_interrupted_search_keeps_its_best_and_goes_on(asked, chosen, tmp_path):
    file, count = tmp_path / "points.jsonl", itertools.count(1)
    whole = chosen.program.solves

    def stop(_point):
        if next(count) == whole - 4:
            raise KeyboardInterrupt

    cut = asked.solve(classes=CLASSES, record=file, progress=stop)
    assert cut.stop_reason == INTERRUPTED
    assert cut.feasible
    assert cut.classes is not None
    assert cut.classes.bound <= chosen.objective <= cut.objective or not cut.classes.chosen
    rest = asked.solve(classes=CLASSES, record=file)
    assert rest.program.solves == 4
    assert_allclose(rest.evaluation.x, chosen.evaluation.x, rtol=1e-12)
    # Before the first class nothing but a continuous design is known.
    early = asked.solve(classes=CLASSES, most=3)
    assert early.stop_reason == SPENT
    assert not early.feasible
    early = without_classes(chosen, NONE_CHOSEN, SPENT)
    assert early.stop_reason == SPENT
    assert "stopped before any class was chosen" in early.note
    assert not early.feasible
    assert str(early).startswith("NO FEASIBLE DESIGN: no classes were chosen")
    with pytest.raises(ClearanceError, match="no classes were chosen"):
        early.verify()


@pytest.mark.slow
def test_searched_by_poses_it_is_the_same_choice(asked, chosen):
    found = asked.solve(classes=CLASSES, fidelity="auto")
    assert found.classes is not None
    assert found.evaluation.fidelity == "dynamics"
    assert_allclose(found.evaluation.x, chosen.evaluation.x, rtol=1e-12)


@pytest.mark.slow
def test_what_is_said_of_chosen_classes(chosen):
    certificate = chosen.verify(sweep=2, solver="tsit5")
    assert certificate.holds
    assert certificate.least is not None
    assert "With every variable at the least of its class" in str(certificate)
    assert not dataclasses.replace(certificate, least=0.1).holds
    assert "no combination of classes is cheaper" in str(certificate)
    assert "Karush" not in str(certificate)
    with pytest.raises(ClearanceError, match="neither other starts nor prices"):
        chosen.verify(starts=2)
    found = _fits(None, chosen)["fits"]
    assert found is not None
    assert {name: one.name for name, one in found.fits.items()} == {n: c.name for n, c in chosen.classes.chosen.items()}
    assert_allclose(found.worst, chosen.evaluation.worst, atol=1e-6)
    assert found.least <= 0


# Without a mechanism ----------------------------------------------------------------------------------------------


def program(weights, bound):
    """The sum of weighted values against a bound; costs 1 / x."""
    weights = np.asarray(weights)

    def evaluate(x, gradient):
        return design.Evaluation(x, float((1 / x).sum()), np.array([weights @ x / bound - 1]), -1 / x**2, weights[None])

    count = len(weights)
    return design.Program(evaluate, [f"c{i}" for i in range(count)], np.full(count, 1e-3), np.ones(count), ["sum"])


def relax(box, start):
    return design.run(box, "slsqp", start)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_random_problems_equal_enumeration(seed):
    rng = np.random.default_rng(seed)
    weights, lists = rng.uniform(0.5, 3.0, 3), {i: np.sort(rng.uniform(0.01, 0.2, 5)) for i in range(3)}
    asked = program(weights, rng.uniform(0.2, 0.8))
    held = [x for x in map(np.array, itertools.product(*lists.values())) if weights @ x <= asked_bound(asked, weights)]
    costs = {i: 1 / values for i, values in lists.items()} if seed % 2 else None
    found = BranchAndBound(asked, lists, relax, costs=costs).search(np.full(3, 0.05))
    if not held:
        assert found.best is None
        assert found.bound == np.inf
        return
    assert found.best is not None
    assert_allclose(found.best.objective, min(float((1 / x).sum()) for x in held), rtol=1e-9)
    assert found.bound <= found.best.objective
    assert found.stop_reason == ""


def asked_bound(asked, weights):
    """The bound of a `program`, from one point of it."""
    x = np.full(3, 0.1)
    return weights @ x / (1 + asked.at(x).limits[0]) * (1 + 1e-9)


def test_variables_without_classes_stay_continuous():
    weights, values = np.array([1.0, 2.0, 1.0]), np.array([0.02, 0.03, 0.05])
    found = BranchAndBound(program(weights, 0.2), {1: values}, relax).search(np.full(3, 0.05))
    # The other two share what is left of the bound.
    expected = min(1 / v + 4 / (0.2 - 2 * v) for v in values)
    assert found.best is not None
    assert_allclose(found.best.objective, expected, rtol=1e-6)


def test_a_combination_that_fails_elsewhere_is_passed_over():
    weights, values = np.ones(3), np.array([0.02, 0.04, 0.06])
    lists = dict.fromkeys(range(3), values)

    def holds(x):
        return np.sum(x == 0.06) != 1

    found = BranchAndBound(program(weights, 0.15), lists, relax, holds).search(np.full(3, 0.05))
    combinations = map(np.array, itertools.product(values, repeat=3))
    held = [x for x in combinations if x.sum() <= 0.15 * (1 + 1e-9) and holds(x)]
    assert found.best is not None
    assert_allclose(found.best.objective, min(float((1 / x).sum()) for x in held), rtol=1e-9)


def test_a_search_that_fails_is_no_proof_that_nothing_holds():
    """Relaxations that find nothing, although a combination of each box holds."""
    weights, values = np.ones(3), np.array([0.02, 0.04, 0.06])
    asked = program(weights, 0.15)
    found = BranchAndBound(asked, dict.fromkeys(range(3), values), lambda box, start: "gave up").search(
        np.full(3, 0.05)
    )
    assert found.best is not None
    combinations = map(np.array, itertools.product(values, repeat=3))
    assert_allclose(found.best.objective, min(float((1 / x).sum()) for x in combinations if x.sum() <= 0.15), rtol=1e-9)
    assert found.relaxed is None
    assert found.doubts


@pytest.mark.slow
def test_without_gradients_no_slopes_are_asked_for():
    weights, values = np.ones(3), np.array([0.02, 0.04, 0.06])

    def search(gradients):
        asked, slopes = program(weights, 0.15), []

        def relax_without(box, start):
            return design.run(box, "cobyqa", start)

        def at(x, gradient=False, plain=asked.at):
            slopes.append(gradient)
            return plain(x, gradient)

        asked.at = at
        how = {"gradients": gradients, "resolution": 1e-4}
        found = BranchAndBound(asked, dict.fromkeys(range(3), values), relax_without, **how).search(np.full(3, 0.05))
        assert found.best is not None
        return any(slopes), found.best.objective

    (none, best), (some, other) = search(False), search(True)
    assert (none, some) == (False, True)
    assert_allclose(best, other)


def test_slopes_that_a_known_point_refutes_prune_nothing():
    """A limit that rises from the smallest values on, and falls beyond 0.03: the best value is the largest."""

    def evaluate(x, gradient):
        height = 1 - ((x[0] - 0.03) / 0.02) ** 2
        slope = np.array([[-2 * (x[0] - 0.03) / 0.02**2]])
        return design.Evaluation(x, float(1 / x[0]), np.array([height]), -1 / x**2, slope)

    asked = design.Program(evaluate, ["c"], np.array([1e-3]), np.array([0.1]), ["hump"])
    asked.at(np.array([0.08]))
    searched = BranchAndBound(asked, {0: np.array([0.005, 0.02, 0.08])}, lambda box, start: "gave up")
    assert searched._hopeless(np.array([0.02]), np.array([0.03]))
    assert not searched._hopeless(np.array([0.02]), np.array([0.08]))


def test_what_is_said_where_no_class_is_chosen():
    none = ChosenClasses({}, np.nan, -np.inf, np.nan, 3, 9, 27, ("gave up",))
    assert none.sentences == [
        "branch and bound: 3 nodes, 9 solves for 27 combinations",
        "a bound is in doubt, as its search gave up",
    ]
    early = dataclasses.replace(none, chosen={"a": design.ToleranceClass("fine", 0.0, 1e-5)}, cost=2.0, doubts=())
    assert "inf" not in early.optimality
    assert "another combination of classes may be cheaper" in early.optimality


# Classes ----------------------------------------------------------------------------------------------------------


def test_what_classes_there_are():
    whole = slider_crank().specification
    wrist, crankpin = "wrist.radial_clearance", "crankpin.radial_clearance"
    (listed,) = classes_of(whole, {wrist: ["H9/d9", "H7/g6", "G7/h6"]}, {wrist: 0.025}).values()
    # H7/g6 and G7/h6 have the same clearances.
    assert [one.name for one in listed] == ["H7/g6", "H9/d9"]
    assert listed[0].greatest == fit(0.025, "H7/g6").radial_clearance[1]
    own = design.ToleranceClass("fine", 1e-5, 3e-5, 4.0)
    assert classes_of(whole, {crankpin: [own]})[crankpin] == (own,)
    for wrong, message in (
        ({}, "at least one variable"),
        ({"wrist.radial": ["H7/g6"]}, "no variable"),
        ({wrist: []}, "no class for `wrist"),
        ({wrist: ["H7/p6"]}, "no clearance fit"),
        ({wrist: ["H7"]}, "hole and a shaft"),
        ({wrist: {"H7/g6": -1.0}}, "positive number"),
        ({wrist: [own, "H7/g6"]}, "Some classes of `wrist"),
        ({wrist: [design.ToleranceClass("wide", 1e-3, 2e-3)]}, "within the variable's bounds"),
    ):
        with pytest.raises(ClearanceError, match=message):
            classes_of(whole, wrong)


def test_a_class_without_cost_is_refused():
    whole = slider_crank().specification
    bare = design.ToleranceProblem(whole.mechanism, whole.t1, whole.variables, list(whole.limits))
    with refused("crankpin.radial_clearance", None):
        bare.solve(classes={"wrist.radial_clearance": {"H7/g6": 2.0, "H7/f7": 1.0}})


def test_classes_whose_costs_rise_are_refused(asked):
    rising = {ARM[0]: {"H7/g6": 3.0, "H7/f7": 4.0}}
    with refused(ARM[0], "H7/f7"):
        asked.solve(classes=rising)


def test_the_cost_of_a_fit_is_that_of_its_tolerances():
    found = design.fit_costs(["H7/g6", "H8/e8"], 0.02, design.Reciprocal(1e-4), design.Reciprocal(2e-4, fixed=1.0))
    assert_allclose(found["H7/g6"], 1e-4 / 21e-6 + 1 + 2e-4 / 13e-6, rtol=1e-12)
    assert_allclose(found["H8/e8"], 1e-4 / 33e-6 + 1 + 2e-4 / 33e-6, rtol=1e-12)


STUDY = f"""
scene = "{SCENES / "slider_crank_loaded.toml"}"
t1 = "1 ms"
[metric.piston]
kind = "peak"
signal = "position-error"
point = "piston"
[design.variable."wrist.radial_clearance"]
lower = "1 um"
upper = "1 mm"
classes = ["H7/g6", "H7/f7"]
class_costs = [9, 6]
[design.limit.piston]
bound = "0.1 mm"
"""


def test_a_study_says_the_classes(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(STUDY)
    asked = cj.load_study(file).design
    assert asked is not None
    assert asked.solve["classes"] == {"wrist.radial_clearance": {"H7/g6": 9.0, "H7/f7": 6.0}}
    for old, new, message in (
        ("[9, 6]", "[9]", "must be as many as `classes`"),
        ('classes = ["H7/g6", "H7/f7"]', "", "no effect without `classes`"),
        ('"H7/f7"', '"H7/p6"', "no clearance fit"),
        ("class_costs = [9, 6]", "", "chosen by cost"),
        (
            "[design.limit.piston]",
            "[design.verify]\nstarts = 3\n[design.limit.piston]",
            "has no effect where `classes`",
        ),
    ):
        file.write_text(STUDY.replace(old, new))
        with pytest.raises(ClearanceError, match=message):
            cj.load_study(file)


GEARS = f"""
scene = "{SCENES / "gears.toml"}"
t1 = "0.05 s"
[metric.rim]
kind = "peak"
signal = "position-error"
point = "rim"
[design]
fidelity = "dynamics"
[design.variable."mesh.backlash"]
lower = "1 arcmin"
upper = "60 arcmin"
classes = ["cd25", "e24", "22g"]
class_costs = [3, 5, 9]
gears = {{ module = "1 mm", teeth = [20, 40], centre_tolerance = "5 um" }}
[design.limit.rim]
bound = "0.14 mm"
"""
OWN = """class_least = ["10 arcmin", "5 arcmin", "0 arcmin"]
class_greatest = ["30 arcmin", "12 arcmin", "4 arcmin"]"""
OF_THE_GEARS = 'gears = { module = "1 mm", teeth = [20, 40], centre_tolerance = "5 um" }'


def test_a_study_chooses_among_classes_of_gears_as_python_does(tmp_path):
    file, name = tmp_path / "study.toml", "mesh.backlash"
    file.write_text(GEARS)
    asked = cj.load_study(file).design
    assert asked is not None
    pairs = {
        cj.gears.backlash(1e-3, (20, 40), word, centre_tolerance=5e-6): cost
        for word, cost in (("cd25", 3.0), ("e24", 5.0), ("22g", 9.0))
    }
    assert asked.solve["classes"] == {name: pairs}
    found = asked.problem.solve(**asked.solve)
    limit = asked.problem.specification.limits[0]
    mechanism = cj.load(SCENES / "gears.toml")

    def holds(pair):
        ends = [cj.replace(mechanism, {name: end}) for end in pair.wheel_angle]
        options = dict(asked.problem.specification.options)
        return all(float(cj.measure(m, {"rim": limit.metric}, 0.05, **options)["rim"]) <= limit.bound for m in ends)

    cheapest = min((pair for pair in pairs if holds(pair)), key=lambda pair: pairs[pair])
    assert cheapest.name == "e24"
    assert found.classes is not None
    assert (found.classes.chosen[name].name, found.classes.cost) == ("e24", 5.0)

    file.write_text(GEARS.replace(OF_THE_GEARS, OWN))
    own = cj.load_study(file).design
    assert own is not None
    entry = next(iter(own.solve["classes"][name]))
    assert entry.name == "cd25"
    assert_allclose(entry[1:3], np.radians([10 / 60, 30 / 60]), rtol=1e-14)

    file.write_text(GEARS.replace("20, 40", "20, 60").replace("centre_tol", "internal = true, centre_tol"))
    ring = cj.load_study(file).design
    assert ring is not None
    inside = cj.gears.backlash(1e-3, (20, -60), "cd25", centre_tolerance=5e-6)
    assert next(iter(ring.solve["classes"][name])) == inside


@pytest.mark.parametrize(
    ("old", "new", "name", "text"),
    [
        ('"e24"', '"ee24"', "tolerance_class", "design.variable.mesh.backlash.classes[1]: "),
        ('"1 mm", t', '"-1 mm", t', "design.variable.mesh.backlash.gears.module", "must be"),
        ("[20, 40]", "[20, 40.5]", "design.variable.mesh.backlash.gears.teeth", "two whole numbers"),
        ("[20, 40]", "[4, 40]", "teeth", "design.variable.mesh.backlash.gears: `teeth`"),
        ('"5 um"', '["5 um", "-5 um"]', "centre_tolerance", "backlash.gears: "),
        ('"5 um"', '"80 um"', "tolerance_class", "backlash.gears: Teeth of `tolerance_class` g22 may jam"),
        (OF_THE_GEARS, OWN.replace(', "4 arcmin"', ""), "design.variable.mesh.backlash.class_greatest", "as many as"),
        (OF_THE_GEARS, OWN.replace("12 ", "2 "), "mesh.backlash", "class e24"),
        (OF_THE_GEARS, OWN.splitlines()[0], "design.variable.mesh.backlash.class_greatest", "lacks the key"),
        (OF_THE_GEARS, OWN + "\n" + OF_THE_GEARS, "design.variable.mesh.backlash.gears", "beside `class_least`"),
        ("classes = [", "# classes = [", "design.variable.mesh.backlash.class_costs", "no effect without `classes`"),
    ],
)
def test_wrong_classes_of_gears_are_refused_with_their_key(tmp_path, old, new, name, text):
    file = tmp_path / "study.toml"
    assert old in GEARS
    file.write_text(GEARS.replace(old, new))
    with refused(name) as caught:
        cj.load_study(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert text in str(caught.value)


def test_classes_of_gears_are_those_of_an_angle():
    whole, wrist = slider_crank().specification, "wrist.radial_clearance"
    with refused(wrist, "cd25"):
        classes_of(whole, {wrist: [cj.gears.backlash(1e-3, (20, 40), "cd25")]})


@pytest.mark.parametrize(
    ("common", "classes", "word"), [(True, None, "best 2,"), (True, {"x": []}, "best -2,"), (False, None, "best -2,")]
)
def test_progress_shows_a_common_clearance_or_a_cost(common, classes, word):
    """The objective is minus a common clearance, but the cost where classes have costs."""
    shown, pace = Mock(spec=ProgressDisplay), Mock(spec=Pace)

    def solve(progress, **options):
        progress(design.Evaluation(np.ones(1), -2.0, np.array([-0.5])))

    specification = SimpleNamespace(common=common, fidelity="dynamics")
    study = SimpleNamespace(
        problem=SimpleNamespace(specification=specification, solve=solve), solve={"classes": classes}
    )
    _search(study, {}, shown, pace)
    assert word in f"{shown.update.call_args[0][0]},"

"""Conditions as a product of trajectories, payloads and speeds: their numbers, their motions, what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.design.asked.conditions import Payload, condition_product
from clearance_jax.design.asked.specification import scenarios_of

TIMES = [0.1, 0.25, 0.4]
DRIVES = {
    "quintic": cj.drives.Quintic([0.0, 0.3, 0.5], [0.1, 1.0, 0.2], [0.0, -1.0, 0.0]),
    "trapezoid": cj.drives.Trapezoid([0.0, 0.3], [0.5, -0.2], speed=3.0, acceleration=40.0, offset=0.1),
    "durations": cj.drives.Trapezoid([0.0, 0.3], [0.5, -0.2], duration=[0.25, 0.2], cruise=0.4),
    "steps": cj.drives.Step5Sum([0.0, 0.2], [0.2, 0.45], [0.3, 0.4]),
    "harmonic": cj.drives.Harmonic(0.3, 12.0, 0.4, 0.1),
    "speed": cj.drives.ConstantSpeed(2.0, 0.3),
    "spline": cj.drives.Spline([0.0, 0.1, 0.3, 0.4, 0.5], [0.0, 0.3, 0.2, 0.5, 0.1]),
    "held": cj.drives.Constant(0.4),
}


def two_links(shoulder, elbow=DRIVES["held"], hand=None):
    """A plane arm of two links, the second of which may carry a hand."""
    upper = cj.Body("upper", 2.0, 0.03, cj.Position(0.2, 0.0))
    fore = cj.Body("fore", 1.0, 0.01, cj.Position(0.1, 0.0))
    joints = [
        cj.Revolute("shoulder", "ground", "upper", motion=cj.Motion(shoulder)),
        cj.Revolute("elbow", "upper", "fore", at_parent=cj.Position(0.4), motion=cj.Motion(elbow)),
    ]
    bodies = [upper, fore]
    if hand is not None:
        bodies.append(hand)
        joints.append(cj.Fixed("grip", "fore", "hand"))
    point = cj.Point("tip", "fore", cj.Position(0.3))
    return cj.Mechanism(tuple(bodies), tuple(joints), points=(point,), gravity=cj.Gravity(y=-9.81))


@pytest.mark.parametrize("kind", list(DRIVES))
def test_twice_the_speed_is_half_the_time(kind):
    """The same course, with rates that are consistent with it."""
    mechanism = two_links(DRIVES[kind])
    (found,) = condition_product(mechanism, speeds=[2.0]).values()
    faster = cj.replace(mechanism, found)
    before, after = (next(m.coordinates()).motion.drive for m in (mechanism, faster))
    assert before is not None
    assert after is not None
    for time in TIMES:
        place, rate, second = (float(x) for x in before(jnp.asarray(time)))
        expected = place, 2 * rate, 4 * second
        np.testing.assert_allclose([float(x) for x in after(jnp.asarray(time / 2))], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_payload_is_a_body_that_is_fixed_to_its_carrier():
    """Torques of the motors with the payload as a body of its own, and with it in its carrier's numbers."""
    place, mass, inertia = (0.3, 0.05), 0.7, 2e-3
    shoulder, elbow = DRIVES["quintic"], DRIVES["harmonic"]
    carried = two_links(shoulder, elbow, cj.Body("hand", mass, inertia, cj.Position(*place)))
    plain = two_links(shoulder, elbow)
    (values,) = condition_product(plain, payloads={"hand": Payload("fore", mass, place, inertia)}).values()
    one, other = (cj.simulate(m, 0.4, save_at=TIMES) for m in (carried, cj.replace(plain, values)))
    for name in ("shoulder.drive_force", "elbow.drive_force"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-9)


def test_a_payload_in_space_moves_the_whole_tensor():
    """By the sum over point masses: eight corners of a box, and the payload as four more points."""
    rng = np.random.default_rng(2)
    box, load = rng.normal(0, 0.1, (8, 3)), rng.normal(0.1, 0.05, (4, 3))

    def of(points, masses):
        centre = masses @ points / masses.sum()
        arms = points - centre
        pairs = zip(masses, arms, strict=True)
        tensor = np.sum([m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in pairs], axis=0)
        return masses.sum(), centre, [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]

    ones, halves = np.full(8, 0.3), np.full(4, 0.2)
    mass, centre, tensor = of(box, ones)
    body = cj.Body("fore", mass, cj.Inertia(*tensor), cj.Position(*centre))
    held = cj.Motion(cj.drives.Constant(0.0))
    mechanism = cj.Mechanism((body,), (cj.Revolute("j", "ground", "fore", axis="z", motion=held),))
    extra, place, about = of(load, halves)
    found = Payload("fore", extra, tuple(place), tuple(about)).values(mechanism)
    mass, centre, tensor = of(np.concatenate([box, load]), np.concatenate([ones, halves]))
    names = ["mass", *(f"center_of_mass.{x}" for x in "xyz")]
    names += [f"inertia.{x}" for x in ("xx", "yy", "zz", "xy", "xz", "yz")]
    np.testing.assert_allclose([found[f"fore.{n}"] for n in names], [mass, *centre, *tensor], rtol=1e-12)


def test_a_product_names_its_conditions_and_they_are_solved_together():
    trajectories = {
        name: {"shoulder": cj.drives.Quintic([0.0, 0.2], [0.0, a])} for name, a in (("up", 1), ("down", -1))
    }
    mechanism = two_links(trajectories["up"]["shoulder"])
    loads = {"empty": Payload("fore", 0.0), "full": Payload("fore", 2.0, (0.3, 0.0))}
    others = {"cold": {"elbow.radial_clearance": 1e-5}}
    played = mechanism.with_clearance("elbow", radial_clearance=2e-5, pin_radius=0.01, length=0.02)
    found = condition_product(played, trajectories, loads, {"slow": 0.5, "fast": 1.0}, others)
    assert list(found)[:3] == ["up, empty, cold, slow", "up, empty, cold, fast", "up, full, cold, slow"]
    assert len(found) == 8
    assert len({tuple(values) for values in found.values()}) == 1  # one program
    np.testing.assert_allclose(found["down, full, cold, slow"]["drive.shoulder.times"], [0, 0.4])
    limit = design.Limit(metrics.Peak(metrics.PositionError("tip")), 1e-4)
    problem = design.ToleranceProblem(
        played,
        0.4,
        {"fore.mass": (0.5, 2.0)},
        [limit],
        conditions=condition_product(played, trajectories, None, {"slow": 0.5, "fast": 1.0}),
    )
    assert next(s.title for s in scenarios_of(problem.specification)) == " (up, slow)"
    with refused("t1", 0.3, 0.4):
        design.ToleranceProblem(
            played, 0.3, {"fore.mass": (0.5, 2.0)}, [limit], conditions=condition_product(played, speeds=[0.5])
        )


def test_what_makes_no_condition_is_refused():
    mechanism = two_links(DRIVES["quintic"])
    with refused("pick"):
        condition_product(mechanism, {"pick": {"shoulder": DRIVES["trapezoid"]}})
    with refused("pick"):
        condition_product(mechanism, {"pick": {"shoulder": cj.drives.Quintic([0.0, 1.0], [0.0, 1.0], [0.0, 0.0])}})
    with refused("for", allowed="fore"):
        condition_product(mechanism, payloads={"a": Payload("for", 1.0)})
    with refused("mass", -1.0):
        Payload("fore", -1.0)
    with refused("fore.center_of_mass.z"):
        condition_product(mechanism, payloads={"a": Payload("fore", 1.0, (0.1, 0.0, 0.2))})
    with refused("speed 0", 0.0):
        condition_product(mechanism, speeds=[0.0])
    with refused("b"):
        condition_product(mechanism, payloads={"a": Payload("fore", 1.0)}, others={"b": {"fore.mass": 3.0}})


# Tables that end before the motion does ------------------------------------------------------------------------------

GRID = np.linspace(0.0, 0.4, 21)
AT_REST = cj.drives.Spline(GRID, 0.2 + 0.5 * (GRID / 0.4) ** 3 * (10 - 15 * GRID / 0.4 + 6 * (GRID / 0.4) ** 2))


def asked_of(mechanism, conditions=None, t1=0.4):
    limit = design.Limit(metrics.Peak(metrics.PositionError("tip")), 1e-4)
    return design.ToleranceProblem(mechanism, t1, {"fore.mass": (0.5, 2.0)}, [limit], conditions=conditions)


def shoulder_of(problem, condition):
    whole = problem.specification
    moved = whole.move(whole.mechanism, whole.conditions[condition])
    drive = next(moved.coordinates()).motion.drive
    assert drive is not None
    return drive


def test_a_table_that_ends_before_the_motion_rests_at_its_last_value():
    """At twice the speed; at the given one, which covers the motion, no number changes."""
    plain = two_links(AT_REST).with_clearance("elbow", radial_clearance=2e-5, pin_radius=0.01, length=0.02)
    problem = asked_of(plain, condition_product(plain, speeds=[1.0, 2.0]))
    for time in (0.2, 0.25, 0.4):
        place, rate, second = shoulder_of(problem, "speed 2")(jnp.asarray(time))
        assert (float(place), float(rate), float(second)) == (float(AT_REST.values[-1]), 0.0, 0.0)
    assert abs(float(shoulder_of(problem, "speed 2")(jnp.asarray(0.2 - 1e-9))[1])) < 1e-5
    for time in (0.0, 0.13, 0.31, 0.399):
        own, other = (law(jnp.asarray(time)) for law in (AT_REST, shoulder_of(problem, "speed 1")))
        np.testing.assert_allclose([float(x) for x in other], [float(x) for x in own], rtol=1e-12, atol=1e-11)
    whole = problem.specification
    assert len({tuple(values) for values in whole.conditions.values()}) == 1  # one program


def test_a_table_that_covers_the_motion_stays_as_it_is():
    plain = two_links(AT_REST)
    assert asked_of(plain).specification.mechanism is plain
    assert asked_of(plain, t1=0.3).specification.mechanism is plain


def test_a_table_that_ends_in_motion_or_begins_late_is_refused():
    moving = two_links(DRIVES["spline"])
    with refused("drive.shoulder", 0.25):
        asked_of(moving, condition_product(moving, speeds=[2.0]), t1=0.5)
    late = two_links(cj.drives.Spline(GRID + 0.1, AT_REST.values))
    with refused("drive.shoulder", 0.1):
        asked_of(late)


# Scatter about a condition's numbers -------------------------------------------------------------------------------


def sampled(scatter, condition, mechanism=None):
    mechanism = two_links(AT_REST) if mechanism is None else mechanism
    limit = design.Limit(metrics.Peak(metrics.PositionError("tip")), 1e-4)
    scattered = design.Yield(scatter, target=0.5, samples=4)
    return design.ToleranceProblem(
        mechanism, 0.4, {"upper.mass": (0.5, 2.0)}, [limit], conditions=condition, manufacture=scattered
    ).specification


def test_a_relative_scatter_is_about_the_value_of_the_condition():
    conditions = {"full": {"fore.mass": 3.0}, "bent": {"drive.shoulder.values": np.asarray(AT_REST.values) + 1.0}}
    found = scenarios_of(sampled({"fore.mass": 0.1, "drive.shoulder.values.0": 0.01}, conditions))
    masses = [float(one.values["fore.mass"]) for one in found]
    factors = np.array(masses[4:]) / 1.0
    np.testing.assert_allclose(np.array(masses[:4]) / 3.0, factors, rtol=1e-12)
    firsts = [float(one.values["drive.shoulder.values.0"]) for one in found]
    np.testing.assert_allclose(np.array(firsts[4:]) / 1.2, np.array(firsts[:4]) / 0.2, rtol=1e-12)


def test_a_distribution_in_place_of_a_condition_s_value_is_refused():
    scatter = {"fore.mass": cj.scatter(1.0, 0.01)}
    with refused("fore.mass", 3.0):
        sampled(scatter, {"full": {"fore.mass": 3.0}})
    assert len(scenarios_of(sampled(scatter, {"empty": {"upper.inertia": 0.05}}))) == 4


def test_a_relative_scatter_of_zero_is_refused():
    with refused("fore.center_of_mass.y", 0.0):
        sampled({"fore.center_of_mass.y": 0.1}, None)
    with refused("fore.center_of_mass.x", 0.0):
        sampled({"fore.center_of_mass.x": 0.1}, {"none": {"fore.center_of_mass.x": 0.0}})


def test_entries_of_arrays_are_scaled_with_them():
    mechanism = two_links(DRIVES["spline"])
    (found,) = condition_product(mechanism, speeds=[2.0], others={"": {"drive.shoulder.times.3": 0.45}}).values()
    np.testing.assert_allclose(found["drive.shoulder.times"], [0.0, 0.05, 0.15, 0.225, 0.25])
    assert "drive.shoulder.times.3" not in found
    up = {"shoulder": DRIVES["spline"]}
    with refused("b"):
        condition_product(mechanism, {"up": up}, others={"b": {"drive.shoulder.values.1": 3.0}})


def test_many_entries_are_replaced_as_one_after_another():
    """Entries of two arrays, an array after one of its entries, and an entry after its array; plain and traced."""
    arm, of = two_links(AT_REST), "drive.shoulder."
    count, values = len(GRID), np.cos(GRID)
    changes = {f"{of}values.{i}": 0.1 * i for i in range(count - 1, 3, -1)}
    changes |= {f"{of}times.{i}": 2.0 * i for i in range(count)} | {"fore.mass": 2.0, f"{of}values": values}
    changes |= {f"{of}values.3": 7.0, f"{of}values.1": 8.0}
    one, expected = arm, values.copy()
    expected[[3, 1]] = 7.0, 8.0
    for name, value in changes.items():
        one = cj.replace(one, {name: value})
    # `jax.jit` would sort a dictionary.
    traced = jax.jit(lambda given: cj.replace(arm, dict(zip(changes, given, strict=True))))(list(changes.values()))
    for whole in (one, cj.replace(arm, changes), traced):
        numbers = {name: np.asarray(leaf.value) for name, leaf in cj.parameters(whole).items()}
        np.testing.assert_array_equal(numbers[f"{of}values"], expected)
        np.testing.assert_array_equal(numbers[f"{of}times"], 2.0 * np.arange(count))
        assert numbers["fore.mass"] == 2
    assert cj.replace(arm, {}) is arm

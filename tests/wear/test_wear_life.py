"""Cycle jumps against closed forms and against every cycle; resuming; life."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from places import refused

import clearance_jax as cj
from clearance_jax import laws, wear
from clearance_jax.errors import ClearanceError, WearFailure
from clearance_jax.joints import Sections
from clearance_jax.laws import Geometry
from clearance_jax.report import wear_figures
from clearance_jax.wear import Contacts
from clearance_jax.wear import worn as sectors

SHAPE = np.cos(np.linspace(-1, 1, 20))
RATE, SLOWS = 1e-9, 2e-6


def slowing(depth, _):
    """dh/dN = a s / (1 + h / h0): h + h^2 / (2 h0) = a s N."""
    return RATE * SHAPE / (1 + depth / SLOWS)


def exact(cycles):
    return SLOWS * (np.sqrt(1 + 2 * RATE * SHAPE * cycles / SLOWS) - 1)


@pytest.mark.optimised
def test_jumps_follow_the_closed_form_and_their_error_the_tolerance():
    errors, work = [], []
    for tolerance in (1e-1, 1e-2, 1e-3):
        found = wear.march(slowing, np.zeros(20), 100_000, tolerance=tolerance)
        assert found.cycles[-1] == 100_000
        errors.append(np.max(np.abs(found.depth[-1] / exact(100_000) - 1)))
        work.append(found.evaluations)
    assert errors[-1] < 1e-3
    assert errors[-1] < 0.1 * errors[0]
    assert work[-1] < 300
    every = wear.march(slowing, np.zeros(20), 301, longest=1)
    assert every.evaluations == 301
    one = np.zeros(20)
    for n in range(301):
        one = one + slowing(one, n)
    assert np.allclose(every.depth[-1], one, rtol=1e-12)


def test_jumps_add_up_cycles_as_a_sum():
    """Of depths that settle, 1 - (1 - l)^n: an integral's 1 - exp(-l n) has any life half a cycle longer."""
    part, cycles = 0.02, 150
    limit = 1 - (1 - part) ** 50 * (1 - 0.5 * part)  # in the middle of cycle 51
    found = wear.march(
        lambda depth, _: part * (1 - depth), np.zeros(1), cycles, tolerance=3e-3, until=lambda depth: depth[0] - limit
    )
    assert found.evaluations < 50
    assert found.end == pytest.approx(50.5, abs=0.02)
    assert -np.log(1 - limit) / part - 50.5 > 0.5


def test_kinks_of_a_life_over_a_parameter_are_those_of_whole_cycles():
    """Off a smooth curve by a part of a cycle of a jump: of parts that wear a hundredth as fast by a hundredth."""

    def roughness(size: float) -> float:
        shares = np.linspace(1, 1.1, 21) - 1.05
        bound = {"until": lambda depth: depth.max() - 1e-6, "tolerance": 1e-2}

        def ends(share):
            found = wear.march(lambda depth, _: size * (1 + share) / (1 + depth / 2e-7), np.zeros(3), 10**9, **bound)
            assert found.end is not None
            return found.end * (1 + share)

        found = np.array([ends(share) for share in shares])
        return float(np.abs(found / np.polyval(np.polyfit(shares, found, 3), shares) - 1).max())

    assert 1e-6 < roughness(1e-10) < 1e-4
    assert roughness(1e-12) < 0.03 * roughness(1e-10)


def test_life_ends_where_the_criterion_is_reached():
    limit = 5e-6
    found = wear.march(slowing, np.zeros(20), 10**6, tolerance=1e-4, until=lambda depth: np.max(depth) - limit)
    assert found.end == pytest.approx((limit + limit**2 / (2 * SLOWS)) / (RATE * SHAPE.max()), rel=1e-3)
    assert found.cycles[-2] < found.end <= found.cycles[-1]


def faster(depth, cycles):
    return 2 * slowing(depth, cycles)


def until(bound):
    return lambda depth: depth.max() - bound


def test_a_journal_of_another_march_is_refused_in_words(tmp_path):
    """Numbers, functions by what they do and keep, and the profile at first."""
    path, begin = tmp_path / "journal", np.zeros(20)
    first = wear.march(slowing, begin, 1000, until=until(1e-6), journal=path)
    same = wear.march(slowing, begin, 1000, until=until(1e-6), journal=path)
    assert np.array_equal(first.depth, same.depth)
    before = path.read_bytes()
    for name, rate, cycles, bound, start in (
        ("cycles", slowing, 5000, 1e-6, begin),
        ("code of slowing (rate)", faster, 1000, 1e-6, begin),
        ("code of until.<locals>.<lambda> (until)", slowing, 1000, 2e-6, begin),
        ("profile", slowing, 1000, 1e-6, begin + 1e-9),
    ):
        with refused(path, name):
            wear.march(rate, start, cycles, until=until(bound), journal=path)
    assert path.read_bytes() == before


def test_what_cannot_wear():
    assert np.all(wear.march(lambda depth, _: 0 * depth, np.zeros(20), 10**6).depth == 0)
    with pytest.raises(ClearanceError, match="must be at least 0"):
        wear.march(lambda depth, _: depth - np.nan, np.zeros(20), 10)
    with refused("until", -np.inf):
        wear.march(slowing, np.zeros(20), 10, until=lambda _: -np.inf)


@pytest.mark.slow
@pytest.mark.optimised
def test_jumps_agree_with_every_cycle_of_a_pin_that_swings():
    """A load that swings to and fro over a sleeve that wears by several times its elastic penetration."""
    sectors, cycles, force, length = 90, 2000, 3000.0, 0.05
    geometry = Geometry(*map(jnp.asarray, (25e-3, 25.1e-3, 1e-4, length)))
    sleeve = Sections(geometry, jnp.zeros(1), jnp.asarray([length]))
    angle = 0.3 * jnp.sin(2 * jnp.pi * (jnp.arange(12) + 0.5) / 12)[:, None]
    ones = jnp.ones((12, 1))
    seen = Contacts(ones[:, 0], ones[:, 0] / 12, force * ones, angle, 5e-3 * ones, 0 * ones, jnp.zeros((12, 1, 2)))
    law, pressure = wear.Archard(2e-13), wear.Foundation(2e13)

    def rate(depth, _):
        return wear.wear_of(seen, sleeve, law, pressure, depth=jnp.asarray(depth)).depth[0]

    every = wear.march(rate, np.zeros(sectors), cycles, longest=1)
    jumped = wear.march(rate, np.zeros(sectors), cycles, tolerance=3e-3)
    deepest = every.depth[-1].max()
    assert deepest > 1e-6
    assert np.max(np.abs(jumped.depth[-1] - every.depth[-1])) < 1e-3 * deepest
    assert jumped.evaluations <= cycles / 20


@pytest.mark.slow
@pytest.mark.optimised
def test_a_joint_wears_over_its_life():
    """A pin that turns under its weight, V = k F s a cycle and more; and its clearance grows where it bears."""
    play = cj.RevoluteClearance(1e-4, 25e-3, laws.HuntCrossley(1e10, 50.0), length=0.05)
    mechanism = cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1),),
        joints=(cj.Revolute("pin", "ground", "disc", motion=cj.Motion(cj.drives.ConstantSpeed(3.0)), clearance=play),),
        gravity=cj.Gravity(y=-9.81),
    )
    k, cycles = 1e-13, 4000
    model = wear.WearModel(mechanism, "pin", wear.Archard(k), wear.Foundation(2e13), 0.05)
    found = wear.simulate_wear(model, cycles, start="settled", tolerance=0.1)
    count = found.depth.shape[1]
    volume = np.sum(found.depth[-1]) * 2 * np.pi / count * 25.1e-3 * 0.05
    flat = k * 196.2 * 25e-3 * 3.0 * 0.05 * cycles
    assert flat < volume < 1.05 * flat
    assert found.depth[-1].argmax() == pytest.approx(0.75 * count, abs=2)
    assert found.evaluations < cycles / 20


def test_sectors_follow_from_the_patch():
    """Of a parabolic patch that stands still, a to either side, the largest mean lacks (w / a)^2 / 3 at worst."""
    geometry = Geometry(*map(jnp.asarray, (25e-3, 25.1e-3, 1e-4, 0.05)))
    sleeve, ones = Sections(geometry, jnp.zeros(1), jnp.asarray([0.05])), jnp.ones((3, 1))
    law, foundation = wear.Archard(6e-14), wear.Foundation(2e13)

    def seen(force, angle):
        force, angle = (jnp.asarray(x)[:, None] for x in (force, angle))
        return Contacts(ones[:, 0], ones[:, 0], force * ones, angle * ones, ones, 0 * ones, jnp.zeros((3, 1, 2)))

    half = float(foundation.half_angle(geometry, jnp.asarray(196.2 / 0.05)))
    still = sectors.wear_round(seen([196.2, 196.2, 0.0], [1.0, 1.0, 3.0]), sleeve, law, foundation)
    for count in (180, 360, 720):  # to what 7200 places around the sleeve resolve
        assert sectors.missed_part(still, count) == pytest.approx((2 * np.pi / count / half) ** 2 / 3, rel=2e-2)
    for count, fine in ((720, False), (780, True)):
        assert sectors.surely_fine(seen([196.2, 196.2, 0.0], [1.0, 1.0, 3.0]), sleeve, foundation, count) == fine
    chosen = sectors.fewest(still)
    assert (chosen, sectors.doubt(still, chosen, "pin")) == (780, "")
    said = sectors.doubt(still, 90, "pin")
    assert "90 sectors of 4 deg are too wide" in said
    assert "up to 53 % too small" in said
    assert "780 sectors would do" in said
    # What the library's own pressures wear off on such sectors, two of which meet below the patch.
    fine, wide = (
        wear.wear_of(seen([196.2] * 3, [np.pi / n] * 3), sleeve, law, foundation, depth=jnp.zeros(n))
        for n in (2160, 180)
    )
    assert 1 - float(wide.deepest / fine.deepest) == pytest.approx(sectors.missed_part(still, 180), rel=1e-2)
    # A little rubbing on a narrow patch elsewhere does not matter; a patch that never stands still is a smooth profile.
    beside = sectors.wear_round(seen([196.2, 196.2, 1.0], [1.0, 1.0, 3.0]), sleeve, law, foundation)
    assert sectors.missed_part(beside, 360) == pytest.approx(sectors.missed_part(still, 360), rel=1e-9)
    moved = sectors.wear_round(seen([196.2] * 3, np.array([0.9, 1.0, 1.1]) * half), sleeve, law, foundation)
    assert sectors.missed_part(moved, 360) < sectors.missed_part(still, 360) * 1.05
    flat = sectors.wear_round(seen([196.2] * 3, [1.0] * 3), sleeve, law, wear.Uniform(0.2))
    assert sectors.missed_part(flat, 60) == pytest.approx(0, abs=1e-9)
    thin = sectors.wear_round(seen([1e-3] * 3, [1.0] * 3), sleeve, law, wear.Foundation(2e15))
    assert sectors.fewest(thin) == sectors.MOST
    assert "are the most, and too few as well" in sectors.doubt(thin, 360, "pin")


# Derivatives ---------------------------------------------------------------------------------------------------------


def test_derivatives_of_the_depths_follow_the_closed_form():
    """Of h + h^2 / (2 h0) = a s N by a and h0; rows below the profile, marched as it is."""

    def rate(stack, after):
        depth, by_rate, by_slows = stack
        f = slowing(depth, after)
        along = -f / (SLOWS + depth)
        explicit = f * depth / SLOWS / (SLOWS + depth)
        return np.stack([f, f / RATE + along * by_rate, explicit + along * by_slows])

    found = wear.march(rate, np.zeros((3, 20)), 100_000, tolerance=1e-3)
    h = exact(100_000)
    assert found.slopes is not None
    assert np.allclose(found.depth[-1], h, rtol=1e-3)
    assert np.allclose(found.slopes[-1, 0], SHAPE * 1e5 / (1 + h / SLOWS), rtol=1e-3)
    assert np.allclose(found.slopes[-1, 1], h**2 / (2 * SLOWS**2) / (1 + h / SLOWS), rtol=2e-3)


def turning(k=1e-13, play=1e-4, friction=None):
    clearance = cj.RevoluteClearance(play, 25e-3, laws.HuntCrossley(1e10, 50.0), friction, length=0.05)
    mechanism = cj.Mechanism(
        bodies=(cj.Body("disc", 20.0, 0.1),),
        joints=(
            cj.Revolute("pin", "ground", "disc", motion=cj.Motion(cj.drives.ConstantSpeed(3.0)), clearance=clearance),
        ),
        gravity=cj.Gravity(y=-9.81),
        points=(cj.Point("axis", "disc"),),
    )
    return wear.WearModel(mechanism, "pin", wear.Archard(k), wear.Uniform(0.2), 0.05)


@pytest.mark.slow
def test_life_and_its_derivatives_of_a_pin_that_turns_under_its_weight():
    """A uniform patch of fixed width wears at k F v / (2 a R B) for ever: life = 2 a R B h / (k F v T)."""
    model = turning()
    names = ("wear.coefficient", "gravity.y", "pressure.spread", "pin.radial_clearance")
    asked = {"sectors": 90, "start": "settled", "tolerance": 1e-3, "by": names}
    found = wear.simulate_wear(model, 10_000, until=wear.Deepest(1e-6), **asked)
    reach = 25e-3 - (196.2 / 1e10) ** (2 / 3)
    life = 2 * 0.2 * 25.1e-3 * 0.05 * 1e-6 / (1e-13 * 196.2 * 3.0 * reach * 0.05)
    assert found.end == pytest.approx(life, rel=1e-5)
    assert found.by["wear.coefficient"] == pytest.approx(-life / 1e-13, rel=1e-4)
    assert found.by["gravity.y"] == pytest.approx(life / 9.81, rel=1e-3)
    assert found.by["pressure.spread"] == pytest.approx(life / 0.2, rel=1e-3)
    assert found.by["pin.radial_clearance"] == pytest.approx(life / 25.1e-3, rel=1e-3)
    assert "d life / d wear.coefficient" in str(found)
    watched = wear.to_dataset(found, model)["watched"]
    np.testing.assert_allclose(watched, found.depth.max(axis=1), rtol=1e-12)
    assert (watched.attrs["units"], watched.attrs["bound"]) == ("m", 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("t0", [0.0, 1.0, -0.04, 0.045])
def test_running_in_counts_the_time_that_the_joint_has_run(t0):
    """Whenever its cycles begin: of one cycle, new and later, its derivative, and a life."""
    steady, factor, duration, period = turning(), 10.0, 2.0, 0.05
    law = wear.RunningIn(steady.wear, factor, duration)
    model = dataclasses.replace(steady, wear=law, cycle=jnp.asarray(t0 + period))
    reach = 25e-3 - (196.2 / 1e10) ** (2 / 3)
    rate = 1e-13 * 196.2 * 3.0 * reach / (2 * 0.2 * 25.1e-3 * 0.05)

    def exact(begin, end):
        return rate * (end - begin - (factor - 1) * duration * (np.exp(-end / duration) - np.exp(-begin / duration)))

    asked = {"start": "settled", "t0": t0}
    for after in (0, 60):
        expected = exact(after * period, (after + 1) * period)
        stack = np.zeros((2, 90))
        off, slope = model.cycle_wears(stack, ("wear.law.coefficient",), after, asked)
        assert off.max() == pytest.approx(expected, rel=1e-6)
        assert slope.max() == pytest.approx(expected / 1e-13, rel=1e-6)
    found = wear.simulate_wear(model, 200, sectors=90, tolerance=1e-3, **asked)
    assert found.depth[-1].max() == pytest.approx(exact(0.0, 10.0), rel=1e-3)
    with refused("cycle"):
        model.cycle_wears(stack, ("cycle",), 0, asked)


@pytest.mark.slow
def test_a_life_of_another_question_is_not_gone_on_with(tmp_path):
    """Coefficient, pressure, criterion, derivatives: nothing is read before all are compared."""
    model = turning()
    path, asked = tmp_path / "journal", {"sectors": 90, "start": "settled", "tolerance": 1e-2}
    until: Any = wear.Deepest(1e-7)

    def lived(model=model, until=until, **other):
        return wear.simulate_wear(model, 10_000, until=until, **{**asked, "journal": path, **other})

    def of(**parts):
        return {"model": dataclasses.replace(model, **parts)}

    first, before = lived(), path.read_bytes()
    whole = wear.simulate_wear(model, 10_000, until=until, **asked)
    path.write_bytes(b"".join(before.splitlines(keepends=True)[:3]))
    again = lived()
    for found in (first, again):
        assert (found.end, found.evaluations) == (whole.end, whole.evaluations)
        assert np.array_equal(found.depth, whole.depth)
    assert path.read_bytes() == before
    for name, also, other in (
        ("coefficient (law of wear)", "", of(wear=wear.Archard(2e-13))),
        ("spread (pressure)", "", of(pressure=wear.Uniform(0.1))),
        ("spread (pressure)", "`stiffness (pressure)`", of(pressure=wear.Foundation(2e13))),
        ("bound (until)", "", {"until": wear.Deepest(2e-7)}),
        ("bound (until)", "<lambda> (until)` is", {"until": lambda depth: depth[0] - 1e-7}),
        ("by", "", {"by": ("wear.coefficient",)}),
        ("solver", "", {"solver": "tsit5"}),
    ):
        with refused(path, name) as caught:
            lived(**other)
        assert also in str(caught.value)
        assert path.read_bytes() == before


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::clearance_jax.wear.SectorsWarning")
def test_lives_that_end_at_once_or_never():
    model = turning()
    mechanism, play = model.mechanism, model.clearance

    def other(**parts):
        return dataclasses.replace(model, **parts)

    still = {"sectors": 90, "start": "settled"}
    none = wear.simulate_wear(other(wear=wear.Archard(0.0)), 10**6, until=wear.Deepest(1e-6), **still)
    assert none.end is None
    assert "nothing worn off" in str(none)
    apart = wear.simulate_wear(other(cycle=1e-4), 100, sectors=90)
    assert apart.depth.max() == 0
    worn = other(mechanism=mechanism.with_clearance("pin", play.worn(jnp.full(90, 3e-6))))
    assert wear.simulate_wear(worn, 10, until=wear.Deepest(2e-6), start="settled").end == 0
    with pytest.raises(ClearanceError, match="Check the unit of the law's coefficient"):
        wear.simulate_wear(other(wear=wear.Archard(1e-6)), 10, **still)
    with refused("wear.coeficient"):
        wear.simulate_wear(model, 10, by=("wear.coeficient",))
    # 0.4 um off, but 3 times what the pin stands in its sleeve: sectors that stood highest would stand lowest, by more.
    far = 3.0 * 0.05 * 25e-3
    soft = other(wear=wear.Archard(3 / (2e12 * far)), pressure=wear.Foundation(2e12))
    with pytest.raises(WearFailure, match="depths run away from one sector to the next"):
        wear.simulate_wear(soft, 10, **still)
    # Deeper than the clearance, and on from there.
    pocket = 3e-4 * np.maximum(-np.sin(2 * np.pi * np.arange(90) / 90), 0.0) ** 4
    sleeve = play.worn(pocket)
    worn = other(mechanism=mechanism.with_clearance("pin", sleeve), pressure=wear.Foundation(2e12))
    deep = wear.simulate_wear(worn, 20, tolerance=0.1, start="settled")
    volume = np.sum(deep.depth[-1] - pocket) * 2 * np.pi / 90 * 25.1e-3 * 0.05
    # Walls that lean press with more than their part of the force.
    assert volume > 1e-13 * 196.2 * 25e-3 * 3.0 * 0.05 * 20
    assert np.all(deep.depth[-1] >= pocket)


# Many lives ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.optimised
def test_lives_over_numbers_are_their_closed_forms(tmp_path):
    """Life = 2 a R B h / (k F v T) (R: of the sleeve, pin and play), of coefficients that scatter and of plays."""
    given = turning(), 30_000
    asked: Any = {"until": wear.Deepest(1e-6), "sectors": 90, "start": "settled"}
    coefficients = cj.Sampled({"wear.coefficient": cj.scatter(1e-13, 5e-14, distribution="log-normal")}, 8)
    found = wear.service_lives(*given, coefficients, journal=tmp_path / "lives", **asked)
    again = wear.service_lives(*given, coefficients, journal=tmp_path / "lives", **asked)
    np.testing.assert_array_equal(found.end, again.end)
    drawn = coefficients.draw()["wear.coefficient"]
    reach = 25e-3 - (196.2 / 1e10) ** (2 / 3)
    np.testing.assert_allclose(found.end, 2 * 0.2 * 25.1e-3 * 1e-6 / (drawn * 196.2 * 3.0 * reach), rtol=1e-4)
    assert found.interval(0.0) == found.end.min()
    assert found.interval(0.25) == np.sort(found.end)[2]
    with refused(tmp_path / "lives" / "0.jsonl", "coefficient (law of wear)"):
        wear.service_lives(*given, {"wear.coefficient": [2e-13]}, journal=tmp_path / "lives", **asked)
    for bound in (1e-6, 2e-6):
        other = {**asked, "until": lambda depth, bound=bound: jnp.max(depth) - bound}
        with refused(tmp_path / "lives" / "0.jsonl", "bound (until)"):
            wear.service_lives(*given, coefficients, journal=tmp_path / "lives", **other)
    plays = {"pin.radial_clearance": np.array([1e-4, 4e-4])}
    told: list[float] = []
    chosen = wear.service_lives(*given, plays, progress=told.append, **asked)
    assert told == [0.5, 1.0]
    assert chosen.end[1] / chosen.end[0] == pytest.approx(25.4 / 25.1, rel=1e-4)
    assert "2 lives over pin.radial_clearance 100 um to 400 um: 2 ended within 30000 cycles" in str(chosen)
    axis = wear_figures.intervals(chosen.to_dataset(), "pin.radial_clearance").axes[0]
    drawn = np.asarray(axis.lines[0].get_xydata())
    np.testing.assert_allclose(drawn, np.stack([[100, 400], chosen.end], 1), rtol=1e-12)
    assert axis.get_xlabel() == "pin.radial_clearance, µm"


def test_failures_are_shares_of_the_samples():
    """Of ten lives three have ended: bands are those of binomial shares, and what is left is not known to fail."""
    end = np.array([3e3, np.inf, 1e3, np.inf, 2e3, np.inf, np.inf, np.inf, np.inf, np.inf])
    lives = wear.ServiceLives({"k": np.arange(10.0)}, end, 5000, 0, {"k": ""})
    found = lives.failures(0.9)
    assert found.cycles.tolist() == [0, 1e3, 2e3, 3e3]
    np.testing.assert_allclose(found.probability, [0, 0.1, 0.2, 0.3])
    for failed, low, high in zip(range(4), found.low, found.high, strict=True):
        expected = scipy.stats.binomtest(failed, 10).proportion_ci(0.9)
        np.testing.assert_allclose([low, high], expected, rtol=1e-9, atol=1e-15)
    assert [lives.interval(share) for share in (0.0, 0.1, 0.29, 0.3)] == [1e3, 2e3, 3e3, np.inf]
    axis = wear_figures.failures(found).axes[0]
    np.testing.assert_allclose(np.asarray(axis.lines[0].get_ydata()), found.probability)
    with pytest.raises(ClearanceError, match="share that may fail"):
        lives.interval(1.0)

"""What of a reading's motions says whether a claim of the paper holds: one function a claim, numbers and all.

`claims` has the claims in words.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from experiments.paper import statistics as of
from experiments.paper.runs import FRICTIONS, SIZES, SPEEDS, Condition, Motion, Reading, solved

START = 0.1
"""The start-up: this part of a motion."""
SAME, MOST = 0.99, 0.5
"""Correlation from which on two curves have one trend; part in common from which on bursts go together."""
TENS = 10.0
WINDOW = 0.01
"""In which bursts are looked for [s]."""


class Finding(NamedTuple):
    """Whether a claim holds, and the numbers that say so."""

    holds: bool
    numbers: str


def over(reading: Reading, **varied: Sequence) -> list[Motion]:
    """The motions of one reading under conditions that differ in one thing."""
    ((name, values),) = varied.items()
    return [solved(reading, Condition(**{name: value})) for value in values]


def by_size(reading: Reading) -> list[Motion]:
    return over(reading, clearance=SIZES)


def by_speed(reading: Reading) -> list[Motion]:
    """From the slowest drive to the fastest."""
    return over(reading, speed=SPEEDS[::-1])


def by_friction(reading: Reading) -> list[Motion]:
    return over(reading, friction=FRICTIONS)


def start_and_rest(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """The samples of the start-up, and those after it."""
    start = motion.time <= START * motion.time[-1]
    return start, ~start


def listed(values: Iterable[float], unit: str = "", factor: float = 1.0) -> str:
    """Numbers in one row."""
    return " / ".join(digits(factor * value) for value in values) + (f" {unit}" if unit else "")


def digits(value: float) -> str:
    """A number to three digits, without a power of ten."""
    return np.format_float_positional(value, 3, fractional=False, trim="-")


# One motion: Fig. 6 ---------------------------------------------------------------------------------------------------


def alternates(reading: Reading) -> Finding:
    m = solved(reading)
    share = of.contact_share(m.starts, m.ends, m.time[-1])
    lasting = bool(np.isnan(m.ends[-1]))
    words = (
        f"touches: {m.starts.size}, the last at {1e3 * m.starts[-1]:.3g} ms; in contact {100 * share:.3g} % of the time"
    )
    return Finding(m.starts.size > 1 and lasting, words)


def force_at_start(reading: Reading) -> Finding:
    m = solved(reading)
    start, rest = start_and_rest(m)
    later = np.max(m.force[rest])
    decays = np.ptp(m.force[start]) > np.ptp(m.force[rest])
    top, when = m.peaks.max() / 1e3, 1e3 * of.peak_time(m.time, m.force)
    words = f"{top:.3g} kN at {when:.3g} ms, later at most {later / 1e3:.3g} kN"
    return Finding(bool(np.max(m.force[start]) > later and decays), words)


def motion_at_start(reading: Reading) -> Finding:
    m = solved(reading)
    start, rest = start_and_rest(m)
    speed, shaking = ((of.peak(x[start]), of.peak(x[rest])) for x in (m.fluctuation, m.shaking))
    words = f"speed {listed(speed, 'mm/s', 1e3)}, acceleration {listed(shaking, 'm/s²')}"
    return Finding(speed[0] > speed[1] and shaking[0] > shaking[1], words)


def around(reading: Reading) -> Finding:
    m = solved(reading)
    above = of.share_above(m.time, m.fluctuation)
    return Finding(0.25 <= above <= 0.75, f"above it {100 * above:.3g} % of the time")


def together(reading: Reading) -> Finding:
    m = solved(reading)
    force = of.ranges(m.time, m.force, WINDOW)
    found = [of.in_common(force, of.maxima(m.time, np.abs(x), WINDOW)) for x in (m.fluctuation, m.shaking)]
    return Finding(min(found) >= MOST, f"speed {found[0]:.2f}, acceleration {found[1]:.2f}")


# Clearance: Fig. 7 ----------------------------------------------------------------------------------------------------


def displacement_trend(reading: Reading) -> Finding:
    found = [
        of.correlation(of.size(m.position - m.ideal_position[0]), of.size(m.ideal_position - m.ideal_position[0]))
        for m in by_size(reading)
    ]
    return Finding(min(found) >= SAME, f"correlation at least {min(found):.6f}")


def deviation_grows(reading: Reading) -> Finding:
    found = [of.peak(m.deviation) for m in by_size(reading)]
    return Finding(of.rises(found), listed(found, "mm", 1e3))


def speed_trend(reading: Reading) -> Finding:
    found = [of.correlation(m.speed, of.size(m.ideal_velocity)) for m in by_size(reading)]
    return Finding(min(found) >= SAME, f"correlation {' / '.join(f'{x:.4f}' for x in found)}")


def peaks_of_acceleration(motions: Iterable[Motion]) -> list[float]:
    return [of.peak(of.size(m.acceleration)) for m in motions]


def acceleration_grows(reading: Reading) -> Finding:
    found = peaks_of_acceleration(by_size(reading))
    return Finding(of.rises(found), listed(found, "m/s²"))


def far_beyond_ideal(reading: Reading) -> Finding:
    motions = by_size(reading)
    wanted = [of.peak(of.size(m.ideal_acceleration)) for m in motions]
    found = np.array(peaks_of_acceleration(motions)) / wanted
    return Finding(bool(np.all(found >= TENS)), listed(found, "times"))


def speed_far_beyond_ideal(reading: Reading) -> Finding:
    motions = by_size(reading)
    found = np.array([of.peak(m.fluctuation) / of.peak(of.size(m.ideal_velocity)) for m in motions])
    return Finding(bool(np.all(found >= TENS)), listed(found, "times"))


def force_grows(reading: Reading) -> Finding:
    found = [m.peaks.max() for m in by_size(reading)]
    return Finding(of.rises(found), listed(found, "kN", 1e-3))


def first_touch_later(reading: Reading) -> Finding:
    found = np.array([m.starts[0] for m in by_size(reading)])
    return Finding(of.rises(found), f"{listed(found, 'ms', 1e3)}, as c^{of.power_of(np.array(SIZES), found):.2f}")


def settles_later(reading: Reading) -> Finding:
    motions = by_size(reading)
    last = [m.starts[-1] for m in motions]
    ripple = [of.spread(m.time[rest], m.force[rest]) for m in motions for _, rest in (start_and_rest(m),)]
    words = f"last touch {listed(last, 'ms', 1e3)}; ripple {listed(ripple, 'kN', 1e-3)}"
    return Finding(of.rises(last) and of.rises(ripple), words)


def frequency_falls(reading: Reading) -> Finding:
    found = np.array([of.centre_frequency(m.time, m.fluctuation) for m in by_size(reading)])
    return Finding(of.falls(found), f"{listed(found, 'Hz')}, as c^{of.power_of(np.array(SIZES), found):.2f}")


# Speed: Figs. 8 to 10 -------------------------------------------------------------------------------------------------


def speed_shakes(reading: Reading) -> Finding:
    found = [of.rms(m.time, m.fluctuation) for m in by_speed(reading)]
    return Finding(of.rises(found), listed(found, "mm/s", 1e3))


def speed_peaks(reading: Reading) -> Finding:
    found = [of.peak(m.fluctuation) for m in by_speed(reading)]
    return Finding(of.rises(found), listed(found, "mm/s", 1e3))


def faster_accelerates(reading: Reading) -> Finding:
    found = peaks_of_acceleration(by_speed(reading))
    return Finding(of.rises(found), listed(found, "m/s²"))


def faster_loads(reading: Reading) -> Finding:
    motions = by_speed(reading)
    mean, spread = ([f(m.time, m.force) for m in motions] for f in (of.mean, of.spread))
    words = f"mean {listed(mean, 'kN', 1e-3)}; amplitude {listed(spread, 'kN', 1e-3)}"
    return Finding(of.rises(mean) and of.rises(spread), words)


def touches_per_second(reading: Reading) -> Finding:
    motions = by_speed(reading)
    found = [m.starts.size / m.time[-1] for m in motions]
    words = f"{listed(found, '1/s')} ({listed([m.starts.size for m in motions])} touches in all)"
    return Finding(of.rises(found), words)


def touches_per_turn(reading: Reading) -> Finding:
    found = [2 * np.pi * m.starts.size / m.turned for m in by_speed(reading)]
    return Finding(of.rises(found), listed(found, "a revolution"))


def frequency_by_speed(reading: Reading) -> list[float]:
    return [of.centre_frequency(m.time, m.fluctuation) for m in by_speed(reading)]


def frequency_rises_with_speed(reading: Reading) -> Finding:
    found = frequency_by_speed(reading)
    return Finding(of.rises(found), listed(found, "Hz"))


def frequency_falls_with_speed(reading: Reading) -> Finding:
    found = frequency_by_speed(reading)
    return Finding(of.falls(found), listed(found, "Hz"))


# Friction: Figs. 11 to 13 ---------------------------------------------------------------------------------------------


def fluctuations(reading: Reading) -> list[float]:
    return [of.rms(m.time, m.fluctuation) for m in by_friction(reading)]


def friction_calms(reading: Reading) -> Finding:
    without, *found = fluctuations(reading)
    return Finding(max(found) < without, listed([without, *found], "mm/s", 1e3))


def more_friction_calms(reading: Reading) -> Finding:
    found = fluctuations(reading)
    return Finding(of.falls(found), listed(found, "mm/s", 1e3))


def friction_centres(reading: Reading) -> Finding:
    above = [of.share_above(m.time, m.fluctuation) for m in by_friction(reading)]
    without, *found = (abs(share - 0.5) for share in above)
    return Finding(max(found) < without, f"above it {listed(above, '% of the time', 100)}")


def friction_delays(reading: Reading) -> Finding:
    motions = by_friction(reading)
    without = motions[0]
    early, _ = start_and_rest(without)
    found = []
    for m in motions[1:]:
        signal = np.interp(without.time[early], m.time, m.fluctuation)
        found.append(of.lag(without.time[early], signal, without.fluctuation[early]))
    # A delay that counts is beyond a twentieth of the time to the first touch.
    return Finding(min(found) > 0.05 * without.starts[0], listed(found, "ms", 1e3))


def friction_steadies(reading: Reading) -> Finding:
    found = [of.rms(m.time, m.shaking) for m in by_friction(reading)]
    return Finding(of.falls(found), listed(found, "m/s²"))


def friction_unloads(reading: Reading) -> Finding:
    found = [m.peaks.max() for m in by_friction(reading)]
    return Finding(of.falls(found), listed(found, "kN", 1e-3))


def friction_unloads_later(reading: Reading) -> Finding:
    found = [np.max(m.force[start_and_rest(m)[1]]) for m in by_friction(reading)]
    return Finding(of.falls(found), listed(found, "kN", 1e-3))


def friction_dissipates(reading: Reading) -> Finding:
    found = [m.friction_loss[-1] for m in by_friction(reading)]
    return Finding(of.rises(found), listed(found, "J"))

"""Two integrators that restart at every switching, and share nothing but the problem.

`dop853`  Dormand-Prince 8(5,3) in double precision, compiled. After every step it takes eight shorter steps from the
          same start to look at what happened inside, minimises every margin that dips, and bisects a sign change.
`gbs`     Gragg-Bulirsch-Stoer extrapolation of order 16 in extended precision (64-bit mantissa), plain Python. It
          looks inside on a cubic, halves the step near a graze, and finds a root by the Illinois rule.

In both a switching is located on steps that were really integrated, never on an interpolant, and both end a step
exactly at every output time and at every border of the drive.
"""

import itertools
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as dp

from experiments.reference.problems import Array, Problem, margins, mode_after, mode_of

A, C = np.ascontiguousarray(dp.A[:12, :12]), np.ascontiguousarray(dp.C[:12])
B, E3, E5 = np.ascontiguousarray(dp.B), np.ascontiguousarray(dp.E3), np.ascontiguousarray(dp.E5)
SAMPLES = 8
FIRST_STEP = 1e-9  # after every switching, s: d^1.5 is singular there, and a rejected step costs less than a lost digit
SHORTEST = 1e-14  # s; below it a step is accepted as it is, for round-off is all that its error estimate can show


class Solution(NamedTuple):
    """States at the output times, and the switchings that were found: time, margin that ended, contact state after."""

    y: Array
    switchings: Array
    steps: int


def stops_of(t: Array, p: Array, problem: Problem) -> tuple[Array, Array]:
    """All instants at which a step must end, and which of them are outputs."""
    borders = problem.borders(p)
    stops = np.union1d(t, borders[(borders > t[0]) & (borders < t[-1])])
    return stops, np.isin(stops, t)


# ---- DOP853, double precision ---------------------------------------------------------------------------------------


@njit
def dop853_step(field, mode, inside, t, y, h, p, size):
    """One step of length h and its error in units of `size`, by Hairer's combination of the two estimates."""
    count = len(y)
    k, new = np.empty((13, count)), np.empty(count)
    for i in range(13):
        row = A[i] if i < 12 else B
        for n in range(count):
            slope = 0.0
            for j in range(i):
                slope += row[j] * k[j, n]
            new[n] = y[n] + h * slope
        for n, rate in enumerate(field(mode, inside, t + (C[i] if i < 12 else 1.0) * h, new, p)):
            k[i, n] = rate
    third, fifth = 0.0, 0.0
    for n in range(count):
        e3, e5 = 0.0, 0.0
        for i in range(13):
            e3, e5 = e3 + E3[i] * k[i, n], e5 + E5[i] * k[i, n]
        third, fifth = third + (e3 / size[n]) ** 2, fifth + (e5 / size[n]) ** 2
    error = abs(h) * fifth / np.sqrt((fifth + 0.01 * third) * count) if fifth > 0 else 0.0
    return new, error


@njit
def margin_at(field, signals, margins, mode, inside, t, y, h, p, size, which):
    """One margin at t + h."""
    new, _ = dop853_step(field, mode, inside, t, y, h, p, size)
    return margins(mode, signals(t + h, new, p), p)[which]


@njit
def dip(field, signals, margins, mode, inside, t, y, low, high, p, size, which):
    """Golden section for a negative margin between two positive ones; returns where one was found, or -1."""
    ratio = (np.sqrt(5.0) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    fa = margin_at(field, signals, margins, mode, inside, t, y, a, p, size, which)
    fb = margin_at(field, signals, margins, mode, inside, t, y, b, p, size, which)
    for _ in range(40):
        if fa < 0:
            return a
        if fb < 0:
            return b
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - ratio * (high - low)
            fa = margin_at(field, signals, margins, mode, inside, t, y, a, p, size, which)
        else:
            low, a, fa = a, b, fb
            b = low + ratio * (high - low)
            fb = margin_at(field, signals, margins, mode, inside, t, y, b, p, size, which)
    return -1.0


@njit
def bisect(field, signals, margins, mode, inside, t, y, low, high, p, size, which):
    """Shortest step known to lie beyond the root of a margin, to the last bit of t + h."""
    while high - low > 1e-18:
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        if margin_at(field, signals, margins, mode, inside, t, y, middle, p, size, which) < 0:
            high = middle
        else:
            low = middle
    return high


@njit
def first_crossing(field, signals, margins, mode, inside, t, y, h, p, size):
    """(step to the first switching in (0, h], which margin), or (h, -1)."""
    first = margins(mode, signals(t, y, p), p)
    seen = np.empty((SAMPLES + 1, len(first)))
    seen[0] = first
    for j in range(1, SAMPLES + 1):
        new, _ = dop853_step(field, mode, inside, t, y, h * j / SAMPLES, p, size)
        seen[j] = margins(mode, signals(t + h * j / SAMPLES, new, p), p)
        best, which = h, -1
        for i in range(len(first)):
            low, high = h * (j - 1) / SAMPLES, -1.0
            if seen[j, i] < 0:
                high = h * j / SAMPLES
            elif j > 1 and seen[j - 2, i] > seen[j - 1, i] and seen[j - 1, i] <= seen[j, i]:
                low = h * (j - 2) / SAMPLES
                high = dip(field, signals, margins, mode, inside, t, y, low, h * j / SAMPLES, p, size, i)
            if high > 0:
                root = bisect(field, signals, margins, mode, inside, t, y, low, high, p, size, i)
                if which < 0 or root < best:
                    best, which = root, i
        if which >= 0:
            return best, which
    return h, -1


@njit
def _dop853(field, signals, mode_of, margins, mode_after, y, stops, p, size, limit):
    out = np.empty((len(stops), len(y)))
    log = [(stops[0], 0.0, 0.0)]
    t, out[0] = stops[0], y
    mode, h, steps = mode_of(signals(t, y, p), p), FIRST_STEP, 0
    for k in range(1, len(stops)):
        inside = 0.5 * (stops[k - 1] + stops[k])
        while t < stops[k]:
            trial = min(h, limit, stops[k] - t)
            last = trial == stops[k] - t
            new, error = dop853_step(field, mode, inside, t, y, trial, p, size)
            steps += 1
            if error > 1 and trial > SHORTEST:
                h = trial * max(0.2, 0.9 * error**-0.125)
                continue
            # A step shortened to reach an output time says nothing against the longer step planned before it.
            proposal = max(trial * min(5.0, 0.9 * max(error, 1e-9) ** -0.125), h if last else 0.0)
            found, which = first_crossing(field, signals, margins, mode, inside, t, y, trial, p, size)
            if which >= 0:
                new, error = dop853_step(field, mode, inside, t, y, found, p, size)
                if error > 1 and found > SHORTEST:
                    h = found * max(0.2, 0.9 * error**-0.125)
                    continue
            y, h = new, proposal
            if which < 0:
                t = stops[k] if last else t + trial
                continue
            t, h = t + found, FIRST_STEP
            mode = mode_after(mode, which, signals(t, y, p), p)
            log.append((t, float(which), float(mode[0])))
        out[k] = y
    return out, np.array(log[1:]).reshape(-1, 3) if len(log) > 1 else np.empty((0, 3)), steps


def dop853(problem: Problem, t: Array, p: Array, rtol: float = 1e-14, limit: float | None = None) -> Solution:
    """States at times t; `rtol` times the problem's scale is the error allowed per step, `limit` the longest step."""
    stops, wanted = stops_of(t, p, problem)
    size, limit = rtol * problem.scale(p), problem.step_limit if limit is None else limit
    y, log, steps = _dop853(problem.field, problem.signals, *problem.rules, problem.start(p), stops, p, size, limit)
    return Solution(y[wanted], log, steps)


# ---- extrapolation, extended precision ------------------------------------------------------------------------------

EXTENDED = np.longdouble
ROWS = tuple(range(2, 17, 2))
SEPARABLE = 1e-11  # s; two switchings within a twelfth of such a step are not told apart any further
HERMITE = np.linspace(0, 1, 13, dtype=EXTENDED)[1:]


class Gbs:
    """The smooth pieces of one problem, integrated by extrapolated modified midpoint steps."""

    def __init__(self, problem: Problem, p: Array, size: Array):
        self.field, self.signals = problem.plain_field, problem.plain_signals
        self.p, self.size = [EXTENDED(value) for value in p], size
        self.mode, self.inside = (0, 0, 0), EXTENDED(0)

    def slope(self, t, y):
        return np.array(self.field(self.mode, self.inside, t, y, self.p))

    def margins(self, t, y):
        return np.array(margins(self.mode, self.signals(t, y, self.p), self.p))

    def midpoint(self, t, y, f, h, n):
        """Increment of y by Gragg's method, n substeps and his smoothing; its error has only even powers of h / n.

        Increments, for Neville's weights add up to 120 and would magnify the round-off of y itself by as much.
        """
        small = h / n
        before, now = 0 * y, small * f
        for i in range(1, n):
            before, now = now, before + 2 * small * self.slope(t + i * small, y + now)
        return (before + now + small * self.slope(t + h, y + now)) / 2

    def step(self, t, y, f, h):
        """Neville's table over the substep numbers ROWS; the error is the last correction in it."""
        table: list[Array] = []
        for row, n in enumerate(ROWS):
            entry, previous = [self.midpoint(t, y, f, h, n)], table
            for k in range(1, row + 1):
                ratio = EXTENDED(n) / ROWS[row - k]
                entry.append(entry[k - 1] + (entry[k - 1] - previous[k - 1]) / (ratio * ratio - 1))
            table = entry
        return y + table[-1], float(np.max(np.abs(table[-1] - table[-2]) / self.size))

    def look_inside(self, t, y, f, new, h):
        """Walk along the cubic: 'clear', 'halve', or (h below the first crossing, h beyond it, which margin)."""
        end = self.slope(t + h, new)
        seen = [self.margins(t, y)]
        for j, s in enumerate(HERMITE, start=1):
            bend = s * (s - 1) * ((1 - 2 * s) * (new - y) + (s - 1) * h * f + s * h * end)
            state = new if j == len(HERMITE) else (1 - s) * y + s * new + bend
            seen.append(self.margins(t + s * h, state))
            low = HERMITE[j - 2] * h if j > 1 else EXTENDED(0)
            negative = [i for i in range(4) if seen[j][i] < 0]
            if len(negative) > 1 and h > SEPARABLE:
                return "halve"  # a pin soon apart may have left the clip just before: a shorter step shows the first
            if negative:
                return low, s * h, negative[0]
            for i in range(4):
                if j > 1 and seen[j - 2][i] > seen[j - 1][i] <= seen[j][i]:
                    change = max(m[i] for m in seen) - seen[j - 1][i]
                    if seen[j - 1][i] < 0.1 * change and h > 1e-8:
                        return "halve"
        return "clear"

    def locate(self, t, y, f, low, high, which):
        """Illinois rule on integrated steps; the step returned ends beyond the root, by a few units of round-off."""

        def margin(h):
            return self.margins(t + h, self.step(t, y, f, h)[0])[which]

        at_low = margin(low) if low > 0 else max(self.margins(t, y)[which], EXTENDED(0))
        at_high = margin(high)
        if at_low < 0 or at_high >= 0:
            return None  # the cubic was wrong here: the caller takes a shorter step
        unit = 4 * np.finfo(EXTENDED).eps * max(abs(t), EXTENDED(1e-3))
        for _ in range(100):
            if high - low <= unit:
                break
            guess = low + (high - low) * at_low / (at_low - at_high)
            # Pushed off the ends by a unit: then the bracket closes from both sides once the secant has converged.
            guess = min(max(guess, low + unit / 2), high - unit / 2)
            value = margin(guess)
            if value < 0:
                if high - guess < (high - low) / 2:
                    at_low = at_low / 2
                high, at_high = guess, value
            else:
                if guess - low < (high - low) / 2:
                    at_high = at_high / 2
                low, at_low = guess, value
        return high


def gbs(problem: Problem, t: Array, p: Array, rtol=1e-17, limit: float | None = None, dtype: type = float) -> Solution:
    """As `dop853`, by the other method; the default step limit is twice as long. The states are rounded to `dtype`."""
    stops, wanted = stops_of(t, p, problem)
    limit = 2 * problem.step_limit if limit is None else limit
    run = Gbs(problem, p, rtol * problem.scale(p).astype(EXTENDED))
    now, y = EXTENDED(stops[0]), problem.start(p).astype(EXTENDED)
    run.mode = mode_of(run.signals(now, y, run.p), run.p)
    out, log, steps, h = [y], [], 0, EXTENDED(FIRST_STEP)
    for begin, stop in itertools.pairwise(stops):
        run.inside, stop = EXTENDED(0.5) * (begin + stop), EXTENDED(stop)
        f = run.slope(now, y)
        while now < stop:
            trial = min(h, EXTENDED(limit), stop - now)
            last = trial == stop - now
            new, error = run.step(now, y, f, trial)
            steps += 1
            factor = 0.9 * max(error, 1e-12) ** (-1 / 15)
            if error > 1 and trial > SHORTEST:
                h = trial * max(0.2, factor)
                continue
            proposal = max(trial * min(4.0, factor), h if last else 0)
            seen = run.look_inside(now, y, f, new, trial)
            if seen == "halve":
                h = trial / 2
                continue
            if seen == "clear":
                now, y, h = stop if last else now + trial, new, proposal
                f = run.slope(now, y)
                continue
            found = run.locate(now, y, f, *seen)
            if found is None:
                h = trial / 2
                continue
            new, error = run.step(now, y, f, found)
            if error > 1 and found > SHORTEST:
                h = found * max(0.2, 0.9 * error ** (-1 / 15))
                continue
            now, y, h = now + found, new, EXTENDED(FIRST_STEP)
            run.mode = mode_after(run.mode, seen[2], run.signals(now, y, run.p), run.p)
            f = run.slope(now, y)
            log.append((float(now), float(seen[2]), float(run.mode[0])))
        out.append(y)
    return Solution(np.array(out)[wanted].astype(dtype), np.array(log).reshape(-1, 3), steps)

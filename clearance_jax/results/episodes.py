"""Contact episodes of a trace, their impacts, contact states, and works.

Steps end just past every touch and separation, so an episode is a span of step ends. Everything is about one joint.
Arrays have one entry per step end or per episode, and no function loops over either.

A contact takes up work, and gives back a part of it. The ratio of the speeds after and before tells this part only if
nothing else acts on the two bodies meanwhile: a pin that a load, a drive or another joint pushes may leave faster than
it came. The ratio of the works is a property of the contact alone, and at most 1. If nothing else acts, it is the
square of the ratio of the speeds (Stronge 1990, doi 10.1098/rspa.1990.0125).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

# Halvings of a step, to the place in it where a contact begins or ends.
HALVINGS = 60
# Of the largest penetration, or distance: what changes by less over a step may be round-off; so is what changes by less
# than the second, and not as the rates say.
NOISE, SMALL = 1e-12, 1e-8
# A contact or a gap that is shorter than this is round-off [s].
SHORTEST = 1e-12
# An impact is over once, from step end to step end, the rate is below this part of its speed for as long as before.
LIVELY = 0.05
# Begins and ends of impacts, where there are none.
NO_IMPACTS = np.zeros(0), np.zeros(0)
# Parts of a step, in each of which the contact either takes up work or gives it back.
PARTS = 32
# Places inside the first and the last step of a contact at which its power is evaluated. At the very ends the rate of
# the power is not that of the contact: a law may not yet remember this touch, or the pin has left.
FIRST, LAST = (0.2, 0.5), (0.5, 0.8)
# A contact of at most so many steps is an impact: its power is evaluated in the middle of every step too.
IMPACT = 64
# Above this restitution a contact adds energy: the works of solves at rtol up to 1e-3 are right within a tenth of it.
ADDS = 1.02


class StepEnds(NamedTuple):
    """What is known of one joint at every step end: time [s], penetration [m] and its rate, normal force [N] and its
    rate [N/s] along the motion, the power that it takes up [W] and the rate of that [W/s].
    """

    time: np.ndarray
    penetration: np.ndarray
    penetration_rate: np.ndarray
    force: np.ndarray
    force_rate: np.ndarray
    power: np.ndarray
    power_rate: np.ndarray


class Inside(NamedTuple):
    """Contact forces [N] and powers [W] inside steps, and their slopes per step."""

    force: Any
    force_slope: Any
    power: Any
    power_slope: Any


Look = Callable[[np.ndarray, np.ndarray], Inside]
"""A function of steps (indices of their starts) and fractions of them (0 to 1): the contact there."""


class Spans(NamedTuple):
    """Episodes by indices of step ends: first touch, last touch or separation; `lasting`: contact goes on there."""

    first: np.ndarray
    last: np.ndarray
    lasting: np.ndarray


class Members(NamedTuple):
    """The step ends of all spans in one row: their indices, the span of each, and where in the row each span starts."""

    index: np.ndarray
    span: np.ndarray
    start: np.ndarray


def spans(time: np.ndarray, penetration: np.ndarray) -> Spans:
    """The contact episodes of a joint. Contacts and gaps as short as round-off are ignored."""
    touching = np.concatenate([[False], penetration > 0, [False]])
    first = np.flatnonzero(touching[1:] & ~touching[:-1])
    end = np.flatnonzero(~touching[1:] & touching[:-1])
    if first.size == 0:
        return Spans(first, end, np.zeros(0, bool))
    apart = time[first[1:]] - time[end[:-1]] >= SHORTEST
    first, end = first[np.concatenate([[True], apart])], end[np.concatenate([apart, [True]])]
    lasting, last = end >= time.size, np.minimum(end, time.size - 1)
    kept = lasting | (time[last] - time[first] > SHORTEST)
    return Spans(first[kept], last[kept], lasting[kept])


def members(spans: Spans) -> Members:
    """The step ends of all spans in one row."""
    length = spans.last - spans.first + 1
    start = np.cumsum(length) - length
    index = np.arange(np.sum(length, dtype=int)) + np.repeat(spans.first - start, length)
    return Members(index, np.repeat(np.arange(length.size), length), start)


def impact_ends(time: np.ndarray, rate: np.ndarray, spans: Spans) -> np.ndarray:
    """When each episode stops being an impact: at separation, or, where contact goes on, when the penetration has been
    through one compression and restitution (the second change of sign of its rate), or the rate has died away.
    """
    ends = time[spans.last]
    if ends.size == 0:
        return ends
    index, span, start = members(spans)
    t, r = time[index], rate[index]
    turns = (np.sign(r[1:]) != np.sign(r[:-1])) & (span[1:] == span[:-1])
    count = np.concatenate([[0], np.cumsum(turns)])
    second = 1 + np.flatnonzero(turns & (count[1:] - count[start[span[1:]]] == 2))
    ends[span[second]] = np.minimum(ends[span[second]], t[second])

    lively = np.flatnonzero(np.abs(r) >= LIVELY * np.abs(r[start])[span])
    here, following = lively[:-1], lively[1:]
    lasted, pause = t[here] - t[start[span[here]]], t[following - 1] - t[here + 1]
    calm = here[(following - here > 1) & (span[here] == span[following]) & (pause >= lasted)]
    calmed, first = np.unique(span[calm], return_index=True)
    ends[calmed] = np.minimum(ends[calmed], t[calm[first]])
    # If a contact goes on without such a pause, the impact ends at the last lively step end.
    restless = spans.lasting.copy()
    restless[calmed] = False
    last = lively[np.searchsorted(span[lively], np.flatnonzero(restless), side="right") - 1]
    ends[restless] = np.minimum(ends[restless], t[last])
    return ends


def contact_states(time: np.ndarray, penetration: np.ndarray, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """0 free, 1 contact, 2 impact, at any times of one joint whose impacts, in order, last from `begins` to `ends`."""
    states = (penetration > 0).astype(np.int8)
    if begins.size:
        latest = np.searchsorted(begins, time, side="right") - 1
        impact = (latest >= 0) & (time <= ends[np.maximum(latest, 0)])
        states[impact & (penetration > 0)] = 2
    return states


def table(seen: StepEnds, spans: Spans) -> dict[str, np.ndarray]:
    """Start, end and speeds of every episode, from the step ends. A contact at the start has no impact speed."""
    (start, speed), (end, parting) = _crossed(seen, spans.first), _crossed(seen, spans.last)
    return {
        "episode_start": start,
        "episode_end": np.where(spans.lasting, np.nan, end),
        "impact_speed": np.where(spans.first > 0, speed, np.nan),
        "separation_speed": np.where(spans.lasting, np.nan, -parting),
    }


def _crossed(seen: StepEnds, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """When the penetration passes zero in the steps with these ends, and its rate then: by the cubic through both ends
    of a step, as one that was cut ends a little past the event.
    """
    h, finish = np.where(at > 0, seen.time[at] - seen.time[at - 1], 1.0), seen.penetration_rate[at]
    (before, after), begin = seen.penetration[[at - 1, at]], seen.penetration_rate[at - 1]
    bend = 2 * (before - after) + (begin + finish) * h
    # Over a short step the change of a place is round-off, and the rates alone tell more: also where a small change is
    # not what they say.
    bent, largest = np.abs(bend), np.max(np.abs(seen.penetration))
    told = (bent < 0.1 * h * np.maximum(np.abs(begin), np.abs(finish))) | (bent > SMALL * largest)
    cubic = np.where(told & (bent > NOISE * largest), bend, 0.0) / h**3
    square = (finish - begin + 3 * cubic * h**2) / (2 * h)
    low, high = np.where((at > 0) & (before * after < 0), -h, 0.0), np.zeros(at.size)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        passed = (after + middle * (finish + middle * (square + middle * cubic)) > 0) == (after > 0)
        low, high = np.where(passed, low, middle), np.where(passed, middle, high)
    return seen.time[at] + high, finish + high * (2 * square + 3 * high * cubic)


class ContactWarning(UserWarning):
    """A contact gave back more work than it took up."""


class ContactPowers(NamedTuple):
    """The power taken up [W] at instants [s] and its rate [W/s]; `known`: whether that is the contact's own rate."""

    time: np.ndarray
    power: np.ndarray
    rate: np.ndarray
    known: np.ndarray


def restitutions(seen: StepEnds, spans: Spans, inside: Look) -> np.ndarray:
    """The root of the work [J] given back over that taken up, of every episode of one joint (NaN: not known as a
    whole); `inside` evaluates its contact inside steps.
    """
    powers, place = _powers(seen, spans, inside)
    until = [np.append(0.0, np.cumsum(part)) for part in _exchange(powers)]
    taken, given = (work[place[spans.last]] - work[place[spans.first]] for work in until)
    whole = (spans.first > 0) & ~spans.lasting & (taken > 0)
    return np.where(whole, np.sqrt(given / np.where(whole, taken, 1.0)), np.nan)


def doubt(joint: str, restitution: np.ndarray) -> str:
    """A warning of restitutions above 1; empty if there are none."""
    largest = np.nanmax(restitution, initial=0.0)
    if largest <= ADDS:
        return ""
    return (
        f"Contacts of `{joint}` gave back more work than they took up: their restitution must be at most 1, but it is "
        f"up to {largest:.3g}. Either the law of the normal force adds energy, or rtol is too large: try a smaller one."
    )


def _powers(seen: StepEnds, spans: Spans, inside: Look) -> tuple[ContactPowers, np.ndarray]:
    """The powers at the step ends, inside the first and last steps, and in the middle of an impact's other ones; and
    the places of the step ends among them.
    """
    first, last = spans.first[spans.first > 0], spans.last[~spans.lasting]
    known, here = np.ones(seen.time.size, bool), np.arange(seen.time.size)
    known[first] = known[last] = False
    whole = ContactPowers(seen.time, seen.power, seen.power_rate, known)
    first = first[first + 1 < seen.time.size]
    asked = [(step, s) for some, places in ((first, FIRST), (last - 1, LAST)) for step in some for s in places]
    short = (spans.first > 0) & ~spans.lasting & (spans.last - spans.first <= IMPACT)
    impacts = zip(spans.first[short], spans.last[short], strict=True)
    asked += [(step, 0.5) for begin, end in impacts for step in range(begin + 1, end - 1)]
    if not asked:
        return whole, here
    steps, places = np.array(sorted(set(asked))).T
    steps = steps.astype(int)
    h = seen.time[steps + 1] - seen.time[steps]
    looked = inside(steps, places)
    more = ContactPowers(seen.time[steps] + places * h, looked.power, looked.power_slope / h, np.ones(steps.size, bool))
    joined = ContactPowers(*(np.insert(a, steps + 1, b) for a, b in zip(whole, more, strict=True)))
    return joined, here + np.searchsorted(steps + 1, here, side="right")


def _exchange(powers: ContactPowers) -> tuple[np.ndarray, np.ndarray]:
    """Work taken up and given back between instants, of the cubic through powers and rates (a parabola of one rate)."""
    h, begin, rise = np.diff(powers.time), powers.power[:-1], np.diff(powers.power)
    first, last = powers.rate[:-1] * h, powers.rate[1:] * h
    known, later = powers.known[:-1], powers.known[1:]
    first, last = np.where(known, first, 2 * rise - last), np.where(later, last, 2 * rise - first)
    square, cubic = 3 * rise - 2 * first - last, first + last - 2 * rise
    x = np.linspace(0, 1, PARTS + 1)[:, None]
    done = np.diff(h * x * (begin + x * (first / 2 + x * (square / 3 + x * cubic / 4))), axis=0)
    return np.sum(np.maximum(done, 0.0), axis=0), np.sum(np.maximum(-done, 0.0), axis=0)

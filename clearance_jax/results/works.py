"""How much work every contact takes up, and how much of it it gives back.

The ratio of the speeds after and before tells what a contact did only where nothing else acts on the two bodies while
it lasts. A pin that a load, a drive or another joint pushes may leave faster than it came, from a wall that gave back
less than it took. The ratio of the works is the contact's own: at most 1, whatever else acts, and that of the speeds,
squared, where nothing does (Stronge 1990, doi 10.1098/rspa.1990.0125).
"""

from typing import NamedTuple

import numpy as np

from clearance_jax.results.episodes import Look, Spans, StepEnds

# Parts of a step, in each of which the contact either takes up work or gives it back.
PARTS = 32
# Places that are looked at inside the first and the last step of a contact. At the very ends of a contact the power's
# rate is not its own: a law may not yet remember this touch, and a pin that has left is apart.
FIRST, LAST = (0.2, 0.5), (0.5, 0.8)
# Above this restitution a contact adds energy: the works of solves at rtol up to 1e-3 are right within a tenth of it.
ADDS = 1.02


class ContactWarning(UserWarning):
    """A contact gave back more work than it took up."""


class Works(NamedTuple):
    """Of every episode the work taken up and given back [J], and the root of their ratio (NaN: unknown as a whole)."""

    taken: np.ndarray
    given: np.ndarray
    restitution: np.ndarray


class ContactPowers(NamedTuple):
    """The power taken up [W] at instants [s] and its rate [W/s]; `known`: whether that is the contact's own rate."""

    time: np.ndarray
    power: np.ndarray
    rate: np.ndarray
    known: np.ndarray


def works(seen: StepEnds, spans: Spans, inside: Look) -> Works:
    """The works of every episode of one joint; `inside` evaluates its contact inside steps."""
    powers, place = _powers(seen, spans, inside)
    until = [np.append(0.0, np.cumsum(part)) for part in _exchange(powers)]
    taken, given = (work[place[spans.last]] - work[place[spans.first]] for work in until)
    whole = (spans.first > 0) & ~spans.lasting & (taken > 0)
    return Works(taken, given, np.where(whole, np.sqrt(given / np.where(whole, taken, 1.0)), np.nan))


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
    """The powers at the step ends and inside the first and last steps, and the places of the step ends among them."""
    first, last = spans.first[spans.first > 0], spans.last[~spans.lasting]
    known, here = np.ones(seen.time.size, bool), np.arange(seen.time.size)
    known[first] = known[last] = False
    whole = ContactPowers(seen.time, seen.power, seen.power_rate, known)
    first = first[first + 1 < seen.time.size]
    asked = [(step, s) for some, places in ((first, FIRST), (last - 1, LAST)) for step in some for s in places]
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
    """The work taken up and given back between instants: of the cubic through powers and rates at both; of a parabola,
    where one of the rates is not known.
    """
    h, begin, rise = np.diff(powers.time), powers.power[:-1], np.diff(powers.power)
    first, last = powers.rate[:-1] * h, powers.rate[1:] * h
    first, last = (
        np.where(powers.known[:-1], first, 2 * rise - last),
        np.where(powers.known[1:], last, 2 * rise - first),
    )
    square, cubic = 3 * rise - 2 * first - last, first + last - 2 * rise
    x = np.linspace(0, 1, PARTS + 1)[:, None]
    done = np.diff(h * x * (begin + x * (first / 2 + x * (square / 3 + x * cubic / 4))), axis=0)
    return np.sum(np.maximum(done, 0.0), axis=0), np.sum(np.maximum(-done, 0.0), axis=0)

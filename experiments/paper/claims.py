"""The paper's claims about joint 5, each with the statistic that tests it and a verdict that is computed.

The keys T1 to T19 number the claims of the paper's section 4 in their order; a claim that says several things has a row
for each. Where the paper says a thing and its opposite both are tested. `judges` computes.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from experiments.paper import judges
from experiments.paper.judges import Finding
from experiments.paper.runs import DIAMETRAL, EQ7, PLANE, RADIAL, SPACE, TABLE1, Reading

READINGS = tuple(Reading(*words) for words in itertools.product((PLANE, SPACE), (EQ7, TABLE1), (RADIAL, DIAMETRAL)))


class Claim(NamedTuple):
    """What the paper says, what is looked at, and how it is judged in one reading."""

    key: str
    says: str
    statistic: str
    judge: Callable[[Reading], Finding]


class Verdict(NamedTuple):
    """What was found of a claim in every reading, and the verdict in words."""

    claim: Claim
    findings: dict[Reading, Finding]

    @property
    def words(self) -> str:
        holding = {reading for reading, found in self.findings.items() if found.holds}
        if len(holding) in (0, len(self.findings)):
            return "holds" if holding else "does not hold"
        return f"holds {described(holding, self.findings)}"


def described(chosen: set[Reading], known: Iterable[Reading]) -> str:
    """Some of the known readings in few words: by what they have in common, or by what the others have."""
    known = list(known)
    these, others = (_covered(part, known) for part in (chosen, set(known) - chosen))
    shorter = these if len(these) <= len(others) else others
    words = "; ".join(", ".join(word for word in fixed if isinstance(word, str)) for fixed in shorter)
    return f"only for {words}" if shorter is these else f"but for {words}"


def _covered(chosen: set[Reading], known: list[Reading]) -> list[tuple]:
    """What readings have in common (None: anything), as few as a greedy choice finds that together are the chosen."""
    choices = [[None, *dict.fromkeys(values)] for values in zip(*known, strict=True)]
    parts = {}
    for fixed in itertools.product(*choices):
        part = {r for r in known if all(word in (None, own) for word, own in zip(fixed, r, strict=True))}
        if part and part <= chosen:
            parts[fixed] = part
    found, left = [], set(chosen)
    while left:
        best = max(parts, key=lambda fixed: (len(parts[fixed] & left), fixed.count(None)))
        found.append(best)
        left -= parts[best]
    return found


C, V, MU = "c 0.1 / 0.2 / 1 mm", "Velocity_4 / 3 / 2 / 1", "mu 0 / 0.3 / 0.5"
CLAIMS = (
    Claim(
        "T1", "start-up: free flight, impact and contact alternate; then contact for good", "touches", judges.alternates
    ),
    Claim(
        "T2",
        "the contact force is largest at the start, then decays",
        "largest in and after the start-up",
        judges.force_at_start,
    ),
    Claim(
        "T3",
        "the end's speed and acceleration fluctuate most at the start",
        "largest in / after the start-up",
        judges.motion_at_start,
    ),
    Claim("T3b", "the speed fluctuates around the ideal curve", "time above it, 25 to 75 %", judges.around),
    Claim(
        "T4",
        "bursts of speed and acceleration come with those of the contact force",
        "10 ms windows: of the tenth with the largest, part in common",
        judges.together,
    ),
    Claim("T5", "the displacement keeps its trend", f"correlation with the ideal one, {C}", judges.displacement_trend),
    Claim("T5b", "the end deviates more with more clearance", f"largest, {C}", judges.deviation_grows),
    Claim("T6", "the end's speed keeps its trend", f"correlation with the ideal one, {C}", judges.speed_trend),
    Claim("T7", "the peak of acceleration grows with clearance", f"largest, {C}", judges.acceleration_grows),
    Claim(
        "T7b", "it is tens, even hundreds of times the ideal one", f"over the ideal peak, {C}", judges.far_beyond_ideal
    ),
    Claim(
        "T7c",
        "the same of the fluctuation of speed, as the text to Fig. 7d has it",
        f"over the ideal peak, {C}",
        judges.speed_far_beyond_ideal,
    ),
    Claim("T8", "the peak of the contact force grows with clearance", f"largest, {C}", judges.force_grows),
    Claim("T9", "the first impact comes later with more clearance", f"first touch, {C}", judges.first_touch_later),
    Claim(
        "T10",
        "the contact force takes longer to settle with more clearance",
        f"last touch, ripple after start-up, {C}",
        judges.settles_later,
    ),
    Claim(
        "T11",
        "fluctuations are slower with more clearance",
        f"centre of the spectrum of speed, {C}",
        judges.frequency_falls,
    ),
    Claim("T12", "a faster drive: the speed fluctuates more", f"RMS, {V}", judges.speed_shakes),
    Claim("T12b", "and has higher peaks of it", f"largest, {V}", judges.speed_peaks),
    Claim("T13", "a faster drive: higher peaks of acceleration", f"largest, {V}", judges.faster_accelerates),
    Claim(
        "T14",
        "a faster drive: larger contact force, mean and amplitude",
        f"mean, standard deviation, {V}",
        judges.faster_loads,
    ),
    Claim(
        "T15",
        "a faster drive: more frequent collisions (sections 4.1.2, 5)",
        f"touches a second, {V}",
        judges.touches_per_second,
    ),
    Claim("T15b", "the same, per revolution", f"touches a revolution, {V}", judges.touches_per_turn),
    Claim(
        "T15c",
        "a faster drive: fluctuations of higher frequency (section 4.1.2)",
        f"centre of the spectrum of speed, {V}",
        judges.frequency_rises_with_speed,
    ),
    Claim(
        "T15d",
        "a faster drive: fluctuations of lower frequency (abstract)",
        f"centre of the spectrum of speed, {V}",
        judges.frequency_falls_with_speed,
    ),
    Claim("T16", "with friction the speed fluctuates less than without", f"RMS, {MU}", judges.friction_calms),
    Claim("T16b", "and the less, the larger the coefficient", f"RMS, {MU}", judges.more_friction_calms),
    Claim(
        "T16c",
        "with friction it is more nearly symmetric about the ideal",
        f"time above it, {MU}",
        judges.friction_centres,
    ),
    Claim("T16d", "with friction it is delayed", "lag in the start-up, mu 0.3 / 0.5", judges.friction_delays),
    Claim("T17", "more friction: the acceleration fluctuates less (section 5)", f"RMS, {MU}", judges.friction_steadies),
    Claim("T18", "more friction: lower peaks of contact force", f"largest, {MU}", judges.friction_unloads),
    Claim("T18b", "the same, after the start-up", f"largest, {MU}", judges.friction_unloads_later),
    Claim("T19", "more friction: more energy lost in it", f"at the end, {MU}", judges.friction_dissipates),
)


def verdicts(readings: Sequence[Reading] = READINGS) -> list[Verdict]:
    """Judge every claim in the readings, one reading after another: motions of one are needed many times."""
    found = [[claim.judge(reading) for claim in CLAIMS] for reading in readings]
    return [
        Verdict(claim, dict(zip(readings, findings, strict=True)))
        for claim, *findings in zip(CLAIMS, *found, strict=True)
    ]

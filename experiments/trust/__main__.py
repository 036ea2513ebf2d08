"""What `gradient_report` is worth: `python -m experiments.trust` writes out/trust_*.md.

- Horizon: until when a derivative means anything, as the report predicts it from how neighbouring motions part, against
  the time from which the derivatives of 64 motions within the scatter have a signal-to-noise ratio below 3 for good.
  The scene is a pin on a guide, in a sleeve that is shaken along it: chaotic with little damping in the impacts,
  periodic with much.
- Verdicts: cases drawn at random: this pin; a pendulum in a worn sleeve; a pendulum in space whose pin tilts in its
  sleeve; an arm of two axes from a URDF file with a sleeve in its elbow. Metrics are a position at the end and the peak
  force, parameters the clearance, the shaker's amplitude, the amount of wear, and the sleeve's length. Each case is
  labelled by a sweep of the metric's values at 101 points over a step of 2 % to both sides, without any derivative. The
  gradient is *misleading* where the slope of the sweep, or the change to either end, contradicts it by more than half
  of it. It is *good* where all of these agree to a fifth of it, and no point of the sweep is farther from its
  prediction than half of the change that it predicts for the step. Other cases are *in between*. No threshold of the
  report was chosen on these cases.
- Islands: a metric that follows the clearance, but for an interval of the clearance in which it lies higher by as much
  as a whole step changes it. The interval is anywhere within the step. How often is it seen, by its width?
"""

from experiments.publish import command, say
from experiments.trust.horizon import Horizon, horizons
from experiments.trust.verdicts import Verdict, islands, refused, tally, verdicts


def main(quick: bool = False) -> tuple[list[Horizon], list[Verdict], dict[float, float]]:
    found = verdicts(quick)
    tally(found, quick)
    seen = islands(quick)
    far = horizons(quick)
    count = 2 if quick else 6
    say(f"Laws of class C-1: {refused(count)} of {count} refused.")
    return far, found, seen


if __name__ == "__main__":
    command(main, __doc__)

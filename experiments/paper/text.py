"""What the page says between its tables; numbers are put in as the run finds them."""

VERDICTS = """\
## Verdicts

Of {statements} statements {everywhere} hold in every reading, {somewhere} in some, {nowhere} in none. The numbers are
those of the literal reading. The start-up is the first {start:.0f} % of a motion. Numbers in a row rise or fall if each
does and the last differs from the first by 5 %. Touches are episodes of contact of the joint as a whole. A fluctuation
is the end's speed, or the magnitude of the difference of accelerations, against the ideal robot at the same time. T4
hangs on how bursts are compared: by the largest value in each window, as here, it holds; by rank correlation, or by the
range in each window, which were tried first, it failed in several readings."""

SWINGING = """\
Why the drive does not change the frequency (T15c, T15d) and clearance does (T11): the drive says how the payload turns,
so that with its pin it can but swing in the sleeve, as a pendulum as long as the centres of pin and sleeve are apart.
In the plane at c = 0.1 / 0.2 / 1 mm these are {lengths} mm apart on average, of which follow {known} Hz; found are
{found} Hz. What makes it swing are the jumps of the drive's acceleration where its steps meet."""

READINGS = "Of every reading: whether the statement holds in it."

PRINTED = """\
## The two printed numbers

The largest speed and acceleration of the end under Velocity_1, and how many times the printed one each is. The speed is
right by the choice of the arm's length. The acceleration of the first impact depends on all that is unknown; where the
pin lies in its sleeve already there is no such impact."""

NEAREST = "The printed acceleration is nearest to that of: {nearest}."

FIGURES = """\
## Figures

The literal reading (Fig. 6: with either damping). Dashed: the robot without clearance. Forces and accelerations are on
logarithmic axes."""

CHOICES = """\
## Which choices matter

Each choice alone against the literal reading: every number over that of the literal reading, ranked by the geometric
mean of these factors, up or down. The paper's own are its contradictions, its slip in Table 1 (K has lost a root, and R
is that of a pin beside a pin) and how it starts; the others are unknown."""

RANKED = """\
In {world} what matters most is: {most} (a factor of {by:.1f}). Next of what is the paper's own: {next}
({next_by:.1f}). Least: {least} ({least_by:.1f})."""

COMPENSATION = """\
## Outlook: error compensation

Friction 0.3, Velocity_1. A model predicts the end's error; averaged over 100 ms, it is taken off the drives, once and
twice. Errors are RMS from {since:.0f} ms on; in brackets that part of them which the drives can reach at all: the
direction in which joint 5 moves the end, the arm's plane, or all of space. A wrong model reckons with {wrong:.0f} % of
the clearance. In space the wrist also swings across the arm, along its pin, where nothing but friction holds it."""

TRAJECTORY = """\
## Outlook: the trajectory

Joint 5 in the plane, friction 0.3. Derivatives by the durations of the three segments of Velocity_1 (0.5 s each), from
one solve to {horizon:g} s; their largest error against central differences of further solves, relative to the largest
of them; and what the value becomes where {moved:.0f} ms are moved between the segments, down the gradient with their
sum kept: as the derivatives predict it, and as it is."""

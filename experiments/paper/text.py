"""What the page says between its tables; numbers are put in as the run finds them."""

VERDICTS = """\
## Verdicts

{everywhere} of {statements} statements hold in every reading, {somewhere} in some, {nowhere} in none. The numbers in
the table are those of the literal reading. The start-up is the first {start:.0f} % of a motion. A series of numbers
counts as rising if each number is larger than the one before, and the last is larger than the first by at least 5 %
(and likewise for falling). Touches are contact episodes of the joint as a whole. The fluctuation of the speed is the
end's speed minus that of the ideal robot at the same time. The fluctuation of the acceleration is the magnitude of the
difference of the two accelerations. The verdict on T4 depends on the way in which bursts are compared. By the largest
value in each window (as here) T4 holds. Two other ways were tried first, rank correlation and the range in each window.
With these T4 failed in several readings."""

SWINGING = """\
The clearance changes the frequency (T11), but the drive does not (T15c, T15d). The reason is this. The
drive prescribes the angle of the payload. So the payload can only move together with its pin, which swings in the
sleeve like a pendulum. The length of this pendulum is the distance between the centres of pin and sleeve. In the plane
with c = 0.1 / 0.2 / 1 mm this distance is {lengths} mm on average. Pendulums of these lengths have frequencies of
{known} Hz. The simulation has {found} Hz. The acceleration of the drive jumps where its steps meet, and these jumps
start the swinging."""

READINGS = "The next table shows for every reading whether the statement holds."

PRINTED = """\
## The two printed numbers

The table has the largest speed and the largest acceleration of the end under Velocity_1, and each of them divided by
the printed number. The speed agrees because the arm's length was chosen for it. The acceleration of the first impact
depends on everything that is unknown. There is no such impact if the pin lies on its sleeve at the start."""

NEAREST = "The reading whose acceleration is nearest to the printed one: {nearest}."

FIGURES = """\
## Figures

The figures show the literal reading (Fig. 6 with both dampings). Dashed lines show the robot without clearance. Forces
and accelerations are on logarithmic axes."""

CHOICES = """\
## Which choices matter

Each choice is changed alone. The table has every number, divided by that of the literal reading. The choices are ranked
by the geometric mean of these factors (a factor below 1 counts as its inverse). "Its own" marks contradictions of the
paper, its error in Table 1 (K lacks a root, and R is that of a pin beside a pin) and the start of its pin. The paper
says nothing about the other choices ("unknown")."""

RANKED = """\
In {world} this choice matters most: {most} (a factor of {by:.1f}). The next of the paper's own choices:
{next} ({next_by:.1f}). This choice matters least: {least} ({least_by:.1f})."""

COMPENSATION = """\
## Outlook: error compensation

The friction coefficient is 0.3, and the drive is Velocity_1. A model predicts the error of the end. This error is
averaged over 100 ms and subtracted from the targets of the drives. This is done once, and then a second time for the
error that remains. Errors are RMS values from {since:.0f} ms on. In brackets stands the part of the error in directions
in which the drives can move the end: one direction (joint 5), the plane of the arm, or all directions. A wrong model
has {wrong:.0f} % of the true clearance. In space the wrist also moves across the arm, along its pin. Only friction
resists this motion."""

TRAJECTORY = """\
## Outlook: the trajectory

Joint 5 in the plane, friction 0.3. The table has the derivatives by the durations of the three segments of Velocity_1
(0.5 s each), from one solve to {horizon:g} s. *Error* is their largest difference from central differences of further
solves, divided by the largest derivative. The durations are then changed by {moved:.0f} ms in the direction in which
the value falls fastest, without a change of their sum. *Predicted* is the value that the derivatives predict for this
change, and *found* is the simulated value."""

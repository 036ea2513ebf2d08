"""Drives with backlash: `python -m experiments.drives` writes out/drives.md.

Four tables.

- Error against cost: motions with closed forms or exact solutions, at four tolerances. The numbers of Modelica's
  example `Backlash` and of the limit cycles are of other programs, with 12 digits and more.
- Limit cycles of a servo that sees the place of its link and the speed of its motor: the period found by
  `periodic_motion`, its largest multiplier but 1, and the period by the describing function of the gap.
- A measured loop: the stiffness test of a 3D-printed cycloidal actuator, torque and deflection with its input locked
  (JelmerV, Anti-Backlash-Cycloidal-Actuator, figures of the repository on GitHub, CC BY-SA 4.0; 34 of the 398 points of
  the curve after run-in). `calibrate` finds gap, stiffness and friction. The width of the loop at zero torque must be
  b + 2 T_f / k. Other tests of the same actuator gave 1.56 deg of play, 337 N m/rad and 2.76 N m.
- What backlash costs an arm of six axes: compile time and time of an attempt, beside elastic drives without a gap.
"""

import dataclasses
import time
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

import clearance_jax as cj
from experiments.common import SCENES, output, seconds, table
from experiments.publish import command, say

TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)


class Motion(NamedTuple):
    """A motion with a known end: its name, mechanism, end [s], start, and the exact values of quantities there."""

    name: str
    mechanism: cj.Mechanism
    end: float
    y0: Any
    exact: dict[str, float]


def wheel(inertia: float, *actuators: Any, drive: Any = None) -> cj.Mechanism:
    """A wheel on the ground."""
    joint = cj.Revolute("hub", "ground", "wheel", motion=cj.Motion(drive, actuators=actuators))
    return cj.Mechanism(bodies=(cj.Body("wheel", 1.0, inertia),), joints=(joint,))


def servo(gain: float, damping: float, teeth: float = 0.0, limited: bool = True) -> cj.Mechanism:
    """A servo on the place of its link and the speed of its motor, with 1 mrad of backlash."""
    both, target = ("hub_motor", "hub"), cj.drives.Constant(0.0)
    steers = cj.actuators.Servo(target, gain, damping, encoder=both, rate_encoder=("hub_motor",))
    compliance = cj.Compliance(5e4, teeth, 2.0, backlash=1e-3, limited=limited)
    return cj.with_compliance(wheel(5.0, steers), "hub", compliance)


def motions() -> list[Motion]:
    still = wheel(5.0, drive=cj.drives.Constant(0.0))
    begin = jnp.array([np.pi / 2, 0.0])
    out = []
    for limited, place, speed in ((True, -0.155581413573, -7.02293727584), (False, 0.103475039596, -6.21339713847)):
        loose = cj.with_compliance(still, "hub", cj.Compliance(2e4, 50.0, backlash=np.pi / 4, limited=limited))
        name = f"Modelica's example, {'ElastoBacklash' if limited else 'ElastoBacklash2'}"
        out.append(Motion(name, loose, 1.0, begin, {"hub.position": place, "hub.velocity": speed}))
    push = cj.actuators.ConstantEffort(0.0)
    free = cj.with_compliance(wheel(5e-3, push), "hub", cj.Compliance(4000.0, 0.0, 2e-3, backlash=2e-3))
    flight = jnp.array([0.0, 0.0, 0.0, 0.6])
    swing = 2 * np.pi / np.sqrt(4000 * (1 / 2e-3 + 1 / 5e-3)) + 4e-3 / 0.6
    out.append(
        Motion("free oscillation, 20 periods", free, 20 * swing, flight, {"hub.position": 0.0, "hub.velocity": 0.6})
    )
    touch = jnp.array([-1.01781502096e-4, -5e-4, 0.0204070525212, -0.0195485579962 - 0.0204070525212])
    exact = {"hub_motor.position": float(touch[0]), "hub.velocity": float(touch[3])}
    out.append(Motion("limit cycle, one period", servo(1e4, 200.0), 0.168021626822516, touch, exact))
    return out


def errors(size: int) -> list[list[str]]:
    """A row for each motion and tolerance."""
    rows = []
    for motion in motions():
        for rtol in TOLERANCES[-size:]:

            def solve(motion=motion, rtol=rtol):
                return cj.simulate(motion.mechanism, motion.end, y0=motion.y0, rtol=rtol)

            solution, took = solve(), seconds(lambda: solve().final, 3)
            off = max(
                abs(float(solution[name]) - exact) / max(abs(exact), 1e-3) for name, exact in motion.exact.items()
            )
            counts = int(solution.steps), int(solution.rejected)
            rows.append([motion.name, f"{rtol:g}", f"{off:.1e}", *map(str, counts), f"{1e3 * took:.3g}"])
    return rows


CYCLES = ((1e4, 200.0, 0.168021626822516, 7.2775e-4), (3e4, 400.0, 0.0828182608281348, 1.564008e-3),
          (1e3, 60.0, 0.66037627633783, 5.35141e-4))  # fmt: skip


def cycles() -> list[list[str]]:
    """A row for each limit cycle."""
    rows = []
    for gain, damping, period, place in CYCLES:
        begin = jnp.array([0.0, place, 0.0, 0.0])
        found = cj.periodic_motion(
            servo(gain, damping), 1.03 * period, guess=begin, free_period=True, rtol=1e-10, solver="dopri8"
        )
        guess = 2 * np.pi * np.sqrt(5.0 / gain)
        slow = float(np.sort(np.abs(found.multipliers))[-2])
        off = abs(float(found.period) / period - 1)
        rows.append(
            [f"{gain:g}", f"{damping:g}", f"{float(found.period):.12f}", f"{off:.0e}", f"{slow:.4f}", f"{guess:.4f}"]
        )
    return rows


# Torque [N m] and deflection [deg].
LOOP = """
0.3 -1.097, 3.38 1.033, 7.15 1.629, 9.54 2.124, 13.06 2.652, 17.05 3.28, 20.82 3.867, 24.81 4.423, 24.94 4.569,
24.92 4.597, 24.94 4.644, 24.93 4.663, 13.54 4.487, 8.52 4.052, 4.13 3.5, 1.39 2.738, -1.45 1.611, -3.16 -0.303,
-6.04 -1.37, -11.07 -2.212, -15.18 -2.805, -21.17 -3.828, -24.93 -4.53, -24.91 -4.718, -24.94 -4.806, -24.94 -4.84,
-24.91 -4.876, -24.9 -4.905, -24.92 -4.932, -16.27 -4.726, -11.08 -4.291, -6.1 -3.73, -2.97 -2.968, -0.2 -1.729
"""
GAP, STIFFNESS, FRICTION = "hub.backlash", "hub.actuator.compliance.stiffness", "hub.actuator.friction.effort"


def measured() -> tuple[cj.Mechanism, xr.Dataset]:
    """The actuator with its input locked under the torques of the test, a second apart, and what was measured."""
    torque, angle = np.array([point.split() for point in LOOP.replace("\n", " ").split(",")], float).T
    when, angle = np.arange(len(torque), dtype=float), np.radians(angle)
    ramp = cj.Wrench("ramp", "wheel", torque=cj.Torque(z=1.0), course=cj.drives.Spline(when, torque))
    # So heavy that it follows slowly, and so light that it still follows.
    still = dataclasses.replace(wheel(0.5, drive=cj.drives.Constant(0.0)), wrenches=(ramp,))
    rub = cj.actuators.JointFriction(2.5, 2e-3)
    loose = cj.with_compliance(still, "hub", cj.Compliance(300.0, 5.0, backlash=0.04, friction=rub))
    joint: Any = loose.joint("hub")
    begun = dataclasses.replace(joint.motion, position=angle[0])
    loose = loose.with_joint(dataclasses.replace(joint, motion=begun))
    return loose, xr.Dataset({"angle": ("time", angle, {"units": "rad"})}, {"time": ("time", when, {"units": "s"})})


def loop() -> Any:
    """The calibration of the measured loop."""
    mechanism, data = measured()
    bounds = {GAP: (5e-3, 0.2), STIFFNESS: (100.0, 1000.0), FRICTION: (0.1, 8.0)}
    return cj.calibrate(mechanism, data, bounds, signals={"angle": "hub.position"}, rtol=1e-6)


def told(found: Any) -> list[str]:
    """What the loop says of its width at zero torque."""
    gap, stiffness, friction = (found.values[name] for name in (GAP, STIFFNESS, FRICTION))
    _, data = measured()
    torque = np.array([float(point.split()[0]) for point in LOOP.replace("\n", " ").split(",")])
    angle = data.angle.values
    back = np.interp(0.0, -torque[12:20], angle[12:20])
    forth = angle[-1] + (0.0 - torque[-1]) * (angle[-1] - angle[-2]) / (torque[-1] - torque[-2])
    width = gap + 2 * friction / stiffness
    # The interval of the width from those of its parts: half of each, independent of the others.
    halves = [0.5 * (found.intervals[name][1] - found.intervals[name][0]) for name in (GAP, STIFFNESS, FRICTION)]
    slopes = 1.0, 2 * friction / stiffness**2, 2 / stiffness
    spread = float(np.linalg.norm([slope * half for slope, half in zip(slopes, halves, strict=True)]))
    degrees = (np.degrees(x) for x in (width, spread, back - forth))
    return [str(found), "b + 2 T_f / k = {:.2f} deg (+- {:.2f}); measured at zero torque {:.2f} deg".format(*degrees)]


def arm(backlash: float | None) -> cj.Mechanism:
    """The six axes with elastic drives."""
    moves = {1: (0, 15), 2: (30, 40), 3: (60, 45), 4: (0, 20), 5: (30, 10), 6: (0, 40)}
    drives: dict[str, Any] = {
        f"axis_{i}": cj.drives.Quintic([0.0, 0.25], np.radians(ends)) for i, ends in moves.items()
    }
    drives |= {f"finger_{side}": cj.drives.Constant(0.02) for side in ("left", "right")}
    out: Any = cj.load(SCENES / "six_axes.urdf").with_drives(drives)
    for i, stiffness in zip(moves, (2e5, 2e5, 1e5, 3e4, 2e4, 1e4), strict=True):
        out = cj.with_compliance(out, f"axis_{i}", cj.Compliance(stiffness, 2e-3 * stiffness, backlash=backlash))
    return out


def costs() -> list[list[str]]:
    """A row for the arm without backlash, and one with it."""
    rows = []
    for name, backlash in (("elastic", None), ("with backlash", 5.8e-4)):
        moved, begin = arm(backlash), time.perf_counter()
        solution = cj.simulate(moved, 0.25, rtol=1e-6, start="settled")
        jax.block_until_ready(solution.final)
        cold = time.perf_counter() - begin
        took = seconds(lambda moved=moved: cj.simulate(moved, 0.25, rtol=1e-6, start="settled").final, 5)
        attempts = int(solution.steps) + int(solution.rejected)
        rows.append([name, f"{cold:.1f}", str(attempts), f"{1e3 * took:.1f}", f"{1e6 * took / attempts:.1f}"])
    return rows


def main(quick: bool = False) -> dict[str, Any]:
    """Write the tables; returns their rows."""
    found: dict[str, Any] = {"errors": errors(1 if quick else 4), "cycles": cycles()}
    page = output(f"drives{'_quick' * quick}.md")
    table(("motion", "rtol", "error", "steps", "rejected", "ms"), found["errors"], page)
    head = ("gain [N m/rad]", "damping [N m s/rad]", "period [s]", "error", "multiplier", "describing function [s]")
    table(head, found["cycles"], output(f"drives_cycles{'_quick' * quick}.md"))
    if quick:
        return found
    found["loop"] = loop()
    say(*told(found["loop"]))
    found["costs"] = costs()
    table(("drives", "first call [s]", "attempts", "ms", "us an attempt"), found["costs"], output("drives_costs.md"))
    return found


if __name__ == "__main__":
    command(main, __doc__, quick="one tolerance; neither the measured loop nor the arm")

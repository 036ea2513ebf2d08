"""A motion: DOP853 at a tight tolerance, restarted wherever a contact begins or ends, a force starts or ceases to be
cut off, at the breaks of drives and at the samples. In between the regime stays, so that all is smooth, but for
bristles where their slip turns round: a step errs no more than it may there, but what is read off within it does, so
that a step ends at every sample.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import minimize_scalar

from . import kernels
from .model import read
from .play import Push
from .quantities import Vector
from .start import initial
from .system import Now, Regime, System

# Tolerances: relative, of places [m] and of velocities [m/s].
RELATIVE, PLACES, SPEEDS = 1e-12, 1e-15, 1e-12
# Places within a step at which the regime is looked at.
WITHIN = (0.2, 0.4, 0.6, 0.8, 1.0)


class Episode(NamedTuple):
    """A contact: joint, begin and end [s] (NaN: it lasts), approach at touch [m/s] and largest normal force [N]."""

    joint: str
    begin: float
    end: float
    speed: float
    peak: float


class Solution(NamedTuple):
    """A motion: `time` (samples,), quantities by name over it, contacts, and steps of the integrator."""

    time: Vector
    values: dict[str, Vector]
    episodes: list[Episode]
    steps: int


class Motion:
    """The solve of one scene."""

    def __init__(self, scene: dict, t1: float):
        self.system, self.t1 = System(read(scene)), t1
        self.y = initial(self.system)
        self.plays = self.system.model.plays
        speeds = tuple(np.full(j.play.count, j.play.normal.least_speed) for j in self.plays if j.play)
        self.regime = self._regime(self.y, speeds)
        now = self.system.now(self.y)
        self.stored = sum(joint.play.stored(self.system.pose(joint, now)) for joint in self.plays if joint.play)
        self.open = {i: [0.0, np.nan, []] for i in range(len(self.plays)) if self.regime.touches[i].any()}
        self.episodes: list[Episode] = []
        self.steps = 0

    def _regime(self, y: Vector, speeds) -> Regime:
        now = self.system.now(y)
        touches, presses = [], []
        for joint, memory, speed in zip(self.plays, self.system.memory(y), speeds, strict=True):
            assert joint.play is not None
            depth, _, force = joint.play.depths(self.system.pose(joint, now), memory, speed)
            touches.append(depth > 0)
            presses.append((depth > 0) & ((force > 0) | (not joint.play.normal.clipped)))
        return Regime(tuple(touches), tuple(presses), speeds)

    def _differs(self, y: Vector) -> bool:
        new = self._regime(y, self.regime.speeds)
        return any(
            (a != b).any()
            for olds, news in ((self.regime.touches, new.touches), (self.regime.presses, new.presses))
            for a, b in zip(olds, news, strict=True)
        )

    def run(self, times: Vector) -> Solution:
        """The motion, with quantities at the given times."""
        # A trial step may go so far that forces overflow; it is rejected.
        with np.errstate(all="ignore"):
            return self._run(times)

    def _run(self, times: Vector) -> Solution:
        t, samples, left = 0.0, [], [s for s in times if s > 0]
        if len(left) < len(times):
            samples.append(self._observe(self.y))
        ends = sorted({*(b for b in (*self.system.model.breaks, *times) if 0 < b < self.t1), self.t1})
        while ends:
            t, self.y = self._until(t, ends[0])
            if t >= ends[0]:
                ends.pop(0)
                if left and left[0] <= t:
                    left.pop(0)
                    samples.append(self._observe(self.y))
        for i in list(self.open):
            self._finish(i, np.nan)
        keys = samples[0].keys()
        self.episodes.sort(key=lambda episode: episode.begin)
        return Solution(times, {key: np.array([s[key] for s in samples]) for key in keys}, self.episodes, self.steps)

    def _until(self, t: float, end: float) -> tuple[float, Vector]:
        """Integrates to the end or the next change of regime."""
        n, y = len(self.system.names), self.y
        small = np.full(len(y), SPEEDS)
        small[: 7 * n] = PLACES
        small[13 * n : -3] = 1e-17
        system, regime = self.system, self.regime
        solver = DOP853(lambda t, y: system.rates(t, y, regime), t, y, end, rtol=RELATIVE, atol=small)
        while solver.status == "running":
            said = solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"The second simulator stops at {solver.t} s: {said}")
            self.steps += 1
            assert solver.t_old is not None
            begin, length, dense = solver.t_old, solver.t - solver.t_old, solver.dense_output()
            change = self._change(begin, length, dense)
            length = length if change is None else change - begin
            for i in self.open:
                self.open[i][2].append((begin, begin + length, dense, self.regime))
            if change is not None:
                return change, self._switch(change, dense(change))
        return end, solver.y

    def _change(self, begin: float, length: float, dense) -> float | None:
        """Just after the first change of the regime in a step, if there is one."""
        low = begin
        for share in WITHIN:
            high = begin + share * length
            if self._differs(dense(high)):
                break
            low = high
        else:
            return None
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (low, middle) if self._differs(dense(middle)) else (middle, high)
        return high

    def _switch(self, t: float, y: Vector) -> Vector:
        """The state with the regime that begins: touches rewrite impact speeds, and straighten bristles."""
        old, at = self.regime, self._regime(y, self.regime.speeds)
        y, now = y.copy(), self.system.now(y)
        speeds, memories = [], self.system.memory(y)
        for i, joint in enumerate(self.plays):
            assert joint.play is not None
            _, rate, _ = joint.play.depths(self.system.pose(joint, now), memories[i], old.speeds[i])
            began, ended = at.touches[i] > old.touches[i], at.touches[i] < old.touches[i]
            least = joint.play.normal.least_speed
            speeds.append(np.where(began, np.maximum(rate, least), old.speeds[i]))
            if joint.play.friction is not None and joint.play.friction.remembers:
                bend = joint.play.split(memories[i])[1]
                bend[began | ended] = 0.0
            if at.touches[i].any() and not old.touches[i].any():
                self.open[i] = [t, float(rate[began].max()), []]
            if old.touches[i].any() and not at.touches[i].any():
                self._finish(i, t)
        self.regime = self._regime(y, tuple(speeds))._replace(touches=at.touches)
        return y

    def _finish(self, i: int, end: float) -> None:
        """Closes a contact, with the largest normal force of its steps."""
        begin, speed, pieces = self.open.pop(i)
        ends = [self._push(i, dense(b), regime).normal for _, b, dense, regime in pieces]
        peak = self._push(i, pieces[0][2](pieces[0][0]), pieces[0][3]).normal if pieces else 0.0
        top = int(np.argmax(ends)) if ends else 0
        for a, b, dense, regime in pieces[max(top - 1, 0) : top + 2]:

            def weaker(t, dense=dense, regime=regime):
                return -self._push(i, dense(t), regime).normal

            found: Any = minimize_scalar(weaker, bounds=(a, b), method="bounded", options={"xatol": 1e-6 * (b - a)})
            peak = max(peak, -weaker(found.x), -weaker(b))
        self.episodes.append(Episode(self.plays[i].name, begin, end, speed, peak))

    def _push(self, i: int, y: Vector, regime: Regime) -> Push:
        joint, memory = self.plays[i], self.system.memory(y)[i]
        assert joint.play is not None
        pose = self.system.pose(joint, self.system.now(y))
        return joint.play.act(pose, memory, regime.speeds[i], regime.touches[i], regime.presses[i])

    def _observe(self, y: Vector) -> dict[str, Vector | float]:
        """Quantities by the library's names."""
        system, now = self.system, self.system.now(y)
        out: dict[str, Vector | float] = {}
        for name, (body, at) in system.model.points.items():
            place, velocity, _ = system.point(body, at, now)
            out[f"{name}.position"], out[f"{name}.velocity"] = place, velocity
        stored = []
        for i, joint in enumerate(self.plays):
            assert joint.play is not None
            pose, push = system.pose(joint, now), self._push(i, y, self.regime)
            out[f"{joint.name}.play"] = pose.place
            out[f"{joint.name}.contact_force"] = push.normal
            out[f"{joint.name}.friction_force"] = float(np.sqrt(push.traction @ push.traction))
            stored.append(joint.play.stored(pose))
        out["kinetic_energy"] = 0.5 * self._twice_kinetic(now)
        springs = 0.0
        for spring in system.model.springs:
            a, b = (system.point(body, at, now)[0] for body, at in zip(spring.bodies, spring.ends, strict=True))
            springs += 0.5 * spring.stiffness * (np.linalg.norm(b - a) - spring.free_length) ** 2
        out["potential_energy"] = -float(system.mass @ (now.place[:-1] @ system.model.gravity))
        out["elastic_energy"] = sum(stored) + springs
        out["drive_work"], out["friction_loss"] = y[-3], y[-1]
        out["damping_loss"] = y[-2] - sum(stored) + self.stored
        return out

    def _twice_kinetic(self, now: Now) -> float:
        """Of bodies and rotors."""
        system = self.system
        both = np.concatenate([now.velocity, now.turning], 1).ravel()
        matrix, _ = kernels.mass_and_weight(now.matrix, now.turning, system.mass, system.inertia, np.zeros(3))
        rates = system.jacobian(now)[0][len(system.held) :] @ both
        return float(both[:-6] @ matrix @ both[:-6]) + sum(system.own[i][1].rotor * rates[i] ** 2 for i in system.free)

"""A motion: DOP853 at a tight tolerance, restarted wherever a contact begins or ends, a force starts or ceases to be
cut off, at the breaks of drives and at the samples. In between the regime stays, so that all is smooth, but for
bristles where their slip turns round: a step errs no more than it may there, but what is read off within it does, so
that a step ends at every sample.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import minimize_scalar

from .gears import Along, Gap
from .model import read
from .play import Push
from .quantities import Vector
from .start import initial
from .system import Now, Regime, System

# Tolerances: relative, of places [m] and of velocities [m/s].
RELATIVE, PLACES, SPEEDS = 1e-12, 1e-15, 1e-12
# Steps at least: a longer one was fooled by the bend of a stiffness in pieces (1e-8 of a motion's energy).
STEPS = 100
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
        self.plays = self.system.plays
        speeds = tuple(np.full(j.play.count, j.play.normal.least_speed) for j in self.plays if j.play)
        self.regime = self._regime(0.0, self.y, speeds)
        now = self.system.now(self.y)
        self.stored = sum(joint.play.stored(self.system.pose(joint, now)) for joint in self.plays if joint.play)
        self.open = {i: [0.0, np.nan, []] for i in range(len(self.plays)) if self.regime.touches[i].any()}
        self.episodes: list[Episode] = []
        self.steps = 0

    def _regime(self, t: float, y: Vector, speeds) -> Regime:
        now = self.system.now(y, t)
        touches, presses = [], []
        for joint, memory, speed in zip(self.plays, self.system.memory(y), speeds, strict=True):
            assert joint.play is not None
            touching, pressing = joint.play.regime(self.system.pose(joint, now), memory, speed)
            touches.append(touching)
            presses.append(pressing)
        return Regime(tuple(touches), tuple(presses), speeds)

    def _differs(self, t: float, y: Vector) -> bool:
        new = self._regime(t, y, self.regime.speeds)
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
            samples.append(self._observe(0.0, self.y))
        measured = [
            [effort.period * k for k in range(int(np.ceil(self.t1 / effort.period)))]
            for _, effort, _, _ in (self.system.efforts[k] for k in self.system.digital)
        ]
        breaks = (*self.system.model.breaks, *times, *(b for every in measured for b in every))
        ends = sorted({*(b for b in breaks if 0 < b < self.t1), self.t1})
        self._measure(t, measured)
        while ends:
            t, self.y = self._until(t, ends[0])
            if t >= ends[0]:
                ends.pop(0)
                if left and left[0] <= t:
                    left.pop(0)
                    samples.append(self._observe(t, self.y))
                self._measure(t, measured)
        for i in list(self.open):
            self._finish(i, np.nan)
        keys = samples[0].keys()
        self.episodes.sort(key=lambda episode: episode.begin)
        return Solution(times, {key: np.array([s[key] for s in samples]) for key in keys}, self.episodes, self.steps)

    def _measure(self, t: float, measured: list[list[float]]) -> None:
        """Digital servos whose time it is hold a new effort."""
        now = self.system.now(self.y, t)
        moves = self.system.moves(now, *self.system.jacobian(now))
        for at, (k, every) in enumerate(zip(self.system.digital, measured, strict=True)):
            if t in every:
                self.y[self.system.held_efforts + at] = self.system.asks(k, t, moves)

    def _until(self, t: float, end: float) -> tuple[float, Vector]:
        """Integrates to the end or the next change of regime."""
        n, y = len(self.system.names), self.y
        small = np.full(len(y), SPEEDS)
        small[: 7 * n] = PLACES
        system, regime = self.system, self.regime
        small[13 * n : system.motors] = 1e-17
        small[system.motors : system.motors + len(system.turned)] = PLACES
        small[system.integrals : system.integrals + len(system.integrating)] = PLACES

        def rates(t, y):
            return system.rates(t, y, regime)

        solver = DOP853(rates, t, y, end, max_step=self.t1 / STEPS, rtol=RELATIVE, atol=small)
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
            if self._differs(high, dense(high)):
                break
            low = high
        else:
            return None
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (low, middle) if self._differs(middle, dense(middle)) else (middle, high)
        return high

    def _switch(self, t: float, y: Vector) -> Vector:
        """The state with the regime that begins: touches rewrite impact speeds, and straighten bristles."""
        old, at = self.regime, self._regime(t, y, self.regime.speeds)
        y, now = y.copy(), self.system.now(y, t)
        speeds, memories = [], self.system.memory(y)
        for i, joint in enumerate(self.plays):
            assert joint.play is not None
            _, rate, _ = joint.play.depths(self.system.pose(joint, now), memories[i], old.speeds[i])
            began, ended = at.touches[i] > old.touches[i], at.touches[i] < old.touches[i]
            least = joint.play.normal.least_speed
            speeds.append(np.where(began, np.maximum(rate, least), old.speeds[i]))
            if not isinstance(joint, Gap) and joint.play.friction is not None and joint.play.friction.remembers:
                bend = joint.play.split(memories[i])[1]
                bend[began | ended] = 0.0
            if at.touches[i].any() and not old.touches[i].any():
                self.open[i] = [t, float(rate[began].max()), []]
            if old.touches[i].any() and not at.touches[i].any():
                self._finish(i, t)
        self.regime = self._regime(t, y, tuple(speeds))._replace(touches=at.touches)
        return y

    def _finish(self, i: int, end: float) -> None:
        """Closes a contact, with the largest normal force of its steps."""
        begin, speed, pieces = self.open.pop(i)
        ends = [self._push(i, b, dense(b), regime).normal for _, b, dense, regime in pieces]
        peak = self._push(i, pieces[0][0], pieces[0][2](pieces[0][0]), pieces[0][3]).normal if pieces else 0.0
        top = int(np.argmax(ends)) if ends else 0
        for a, b, dense, regime in pieces[max(top - 1, 0) : top + 2]:

            def weaker(t, dense=dense, regime=regime):
                return -self._push(i, t, dense(t), regime).normal

            found: Any = minimize_scalar(weaker, bounds=(a, b), method="bounded", options={"xatol": 1e-6 * (b - a)})
            peak = max(peak, -weaker(found.x), -weaker(b))
        self.episodes.append(Episode(self.plays[i].name, begin, end, speed, peak))

    def _push(self, i: int, t: float, y: Vector, regime: Regime) -> Push | Along:
        joint, memory = self.plays[i], self.system.memory(y)[i]
        assert joint.play is not None
        pose = self.system.pose(joint, self.system.now(y, t))
        return joint.play.act(pose, memory, regime.speeds[i], regime.touches[i], regime.presses[i])

    def _observe(self, t: float, y: Vector) -> dict[str, Vector | float]:
        """Quantities by the library's names."""
        system, now = self.system, self.system.now(y, t)
        out: dict[str, Vector | float] = {}
        for name, (body, at) in system.model.points.items():
            place, velocity, _ = system.point(body, at, now)
            out[f"{name}.position"], out[f"{name}.velocity"] = place, velocity
        stored = []
        for i, joint in enumerate(self.plays):
            assert joint.play is not None
            pose, push = system.pose(joint, now), self._push(i, t, y, self.regime)
            stored.append(joint.play.stored(pose))
            if isinstance(push, Along):
                out[f"{joint.name}.gap"], out[f"{joint.name}.torque"] = push.place, push.effort
                continue
            out[f"{joint.name}.play"] = pose.place
            out[f"{joint.name}.contact_force"] = push.normal
            out[f"{joint.name}.friction_force"] = float(np.sqrt(push.traction @ push.traction))
        moves = system.moves(now, *system.jacobian(now))
        out |= {f"{motor}.turned": moves.value[i] for motor, i in system.number.items() if i >= len(system.own)}
        if system.model.couplings:
            bears = system.accelerations(t, y, now, system.pushes(y, now, self.regime))[-1]
            out |= {f"{one.name}.torque": b for one, b in zip(system.model.couplings, bears, strict=True)}
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
        speeds, moves = system.speeds(now), system.moves(now, *system.jacobian(now))
        return float(speeds @ system.masses(now, moves, np.zeros(3))[0] @ speeds)

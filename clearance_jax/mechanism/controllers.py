"""Controllers, which command several free coordinates at once by a model of the mechanism."""

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.mechanism.actuators import check_period, names_key, period_key
from clearance_jax.mechanism.motion.motion_laws import AbstractMotionLaw
from clearance_jax.parameters import apart, lead, physical
from clearance_jax.spatial import Term

__all__ = ["AbstractController", "ComputedTorque", "Reference"]


class Reference(Module):
    """The target of one free coordinate for a controller.

    **Arguments:** `name`: of the coordinate; `target`: a drive; `encoder`: names of the coordinates whose sum is
    measured, by default the coordinate itself (see `Servo`).
    """

    name: str = eqx.field(static=True)
    target: AbstractMotionLaw = lead()
    encoder: tuple[str, ...] = names_key("coordinates whose sum is measured", "its own")


class AbstractController(Module):
    """A controller: it says which accelerations it wants, and the inverse dynamics of its model gives the efforts for
    them.

    - `references`: the coordinates that it commands: all that its model leaves free.
    - `model`: the mechanism that it assumes; `None`: the mechanism itself, without play.
    - `period` [s]: it measures and commands at whole multiples of the period; `None`: all the time.
    """

    name: eqx.AbstractVar[str]
    references: eqx.AbstractVar[tuple[Reference, ...]]
    model: eqx.AbstractVar[Any]
    period: eqx.AbstractVar[float | None]

    @abc.abstractmethod
    def accelerations(self, time: Scalar, positions: Sequence[Term], velocities: Sequence[Term]) -> list[Term]:
        """The wanted accelerations for measured positions and velocities, in the order of the references."""

    def prepare(self, model: Any) -> "AbstractController":
        """The controller with what follows from its numbers computed (once a solve); `model`: its prepared model."""
        references = tuple(dataclasses.replace(r, target=r.target.prepare()) for r in self.references)
        return dataclasses.replace(self, references=references, model=model)


class ComputedTorque(AbstractController):
    """Computed torque (inverse dynamics control): the efforts with which its model, at the measured state, would
    accelerate by target'' + 2 d w (target' - q') + w^2 (target - q).

    So the error of each coordinate q decays like a damped oscillator of its own, if the model is true (Siciliano et
    al., Robotics, 2009, section 8.5.2).

    **Arguments:**

    - `name`: the controller's name, with which the names of its numbers begin.
    - `references`: targets of all coordinates that the model leaves free (`Reference`).
    - `frequency` w [rad/s] and `damping` ratio d, with which the errors decay.
    - `model`: a mechanism without loops and play, whose coordinates have the same names. By default it is the mechanism
      itself without its play: a perfect model.
    - `period` [s]: it measures at whole multiples of the period, and holds its efforts in between; `None`: it acts all
      the time.
    """

    name: str = eqx.field(static=True)
    references: tuple[Reference, ...] = eqx.field(converter=tuple)
    frequency: Scalar = physical("rad/s", "natural frequency w of the errors' decay", '"50 rad/s"', above=0.0)
    damping: Scalar = physical("", "damping ratio d of the errors' decay", "0.7", least=0.0, default=1.0)
    model: Any = apart(default=None)
    period: float | None = period_key()

    def __check_init__(self):
        check_period(self.period, f"Controller `{self.name}`")
        if not self.references or not all(isinstance(reference, Reference) for reference in self.references):
            raise ClearanceError(
                f"Controller `{self.name}` needs a list of `Reference(coordinate, drive)`, but it was given "
                f"{quote(list(self.references))}."
            )

    def accelerations(self, time, positions, velocities):
        out = []
        for reference, q, v in zip(self.references, positions, velocities, strict=True):
            goal, rate, acceleration = reference.target(time)
            pull = self.frequency**2 * (goal - q) + 2 * self.damping * self.frequency * (rate - v)
            out.append(acceleration + pull)
        return out

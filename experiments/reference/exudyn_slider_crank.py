"""The slider-crank with play in its piston pin, built of Exudyn's own bodies and joints.

Crank, conrod and slider are rigid bodies of the plane. Exudyn joins them by constraints: revolute joints at the ground
and at the crank pin, a prescribed angle of the crank, and a slider that neither turns nor leaves its line. Between
conrod and slider stands a spring-damper whose force is a function of this file: ADAMS IMPACT with a tanh friction, as
in `experiments.reference.problems`, with the same numbers. So the bodies, the joints and the integrator are Exudyn's,
and only the formula of the force is shared. Nothing here imports the library.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from experiments.reference.problems import slider_crank_parameters

# Of the crank, which is driven: they move nothing else.
CRANK_MASS, CRANK_INERTIA = 0.30, 1.0e-4


class Numbers(NamedTuple):
    """The numbers of `slider_crank_parameters` by name, in SI units."""

    pin_radius: float
    clearance: float
    stiffness: float
    damping: float
    full_depth: float
    friction: float
    transition: float
    corner: float
    speed: float
    crank: float
    rod: float
    rod_mass: float
    rod_inertia: float
    slider_mass: float


def impact(depth: float, rate: float, p: Numbers) -> float:
    """The normal force of ADAMS IMPACT [N]."""
    if depth <= 0:
        return 0.0
    s = min(depth / p.full_depth, 1.0)
    return max(0.0, p.stiffness * depth**1.5 + p.damping * s * s * (3 - 2 * s) * rate)


def force_of(p: Numbers) -> Callable:
    """The force on the slider and the torque about the pin's centre that Exudyn's spring-damper is to exert: its
    displacement and velocity are those of the slider's pin less those of the conrod's end, in the conrod's axes, and
    what it returns acts on the conrod.
    """
    sleeve_radius = p.pin_radius + p.clearance

    def force(mbs, t, item, displacement, rotation, velocity, turning, *_):
        x, y = displacement[0], displacement[1]
        distance = math.hypot(x, y)
        if distance <= p.clearance:
            return np.zeros(6)
        nx, ny = x / distance, y / distance
        normal = impact(distance - p.clearance, velocity[0] * nx + velocity[1] * ny, p)
        # The pin does not turn; the sleeve does, with the conrod.
        slip = velocity[1] * nx - velocity[0] * ny + sleeve_radius * turning[2]
        traction = -p.friction * math.tanh(slip / p.transition) * normal
        return np.array([normal * nx + traction * ny, normal * ny - traction * nx, 0, 0, 0, -sleeve_radius * traction])

    return force


def simulate(clearance: float, t1: float, steps: int) -> np.ndarray:
    """The conrod's angle [rad] and the slider's position [m] at `t1`, by so many steps of the trapezoidal rule."""
    import exudyn
    from exudyn import itemInterface as items

    p = Numbers(*slider_crank_parameters(clearance))
    container = exudyn.SystemContainer()
    mbs = container.AddSystem()

    def body(mass, inertia, place, velocity):
        node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*place, 0.0], initialVelocities=velocity))
        return node, mbs.AddObject(items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node))

    def marker(number, x):
        return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=number, localPosition=[x, 0.0, 0.0]))

    def fix(node, coordinate, **moved):
        own = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[origin, own], **moved))

    ground = mbs.AddObject(items.ObjectGround())
    still = mbs.AddNode(items.NodePointGround())
    origin = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=still, coordinate=0))
    spin = -p.speed * p.crank / p.rod
    crank = body(CRANK_MASS, CRANK_INERTIA, (p.crank / 2, 0.0), [0.0, p.speed * p.crank / 2, p.speed])
    rod = body(p.rod_mass, p.rod_inertia, (p.crank + p.rod / 2, 0.0), [0.0, p.speed * p.crank / 2, spin])
    slider = body(p.slider_mass, 1e-5, (p.crank + p.rod, 0.0), [0.0, 0.0, 0.0])
    for pair in (
        [marker(ground, 0.0), marker(crank[1], -p.crank / 2)],
        [marker(crank[1], p.crank / 2), marker(rod[1], -p.rod / 2)],
    ):
        mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=pair))
    fix(
        crank[0],
        2,
        offsetUserFunction=lambda mbs, t, item, offset: p.speed * t,
        offsetUserFunction_t=lambda mbs, t, item, offset: p.speed,
    )
    fix(slider[0], 1)
    fix(slider[0], 2)
    mbs.AddObject(
        items.ObjectConnectorRigidBodySpringDamper(
            markerNumbers=[marker(rod[1], p.rod / 2), marker(slider[1], 0.0)],
            springForceTorqueUserFunction=force_of(p),
        )
    )
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = steps, t1
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.timeIntegration.newton.absoluteTolerance = 1e-11
    settings.timeIntegration.newton.relativeTolerance = 1e-11
    mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    at = [mbs.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates) for node, _ in (rod, slider)]
    return np.array([at[0][2], p.crank + p.rod + at[1][0]])

"""clearance_jax: mechanisms and robots with clearance joints in JAX.

Names are imported when they are first asked for: the command's help must not wait for JAX.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from clearance_jax._version import __version__ as __version__
from clearance_jax.errors import ClearanceError, suggest

if TYPE_CHECKING:
    from clearance_jax import design, joints, laws, metrics, wear
    from clearance_jax.analysis.cycle import PeriodicMotion
    from clearance_jax.analysis.modes import Mode, seated_modes
    from clearance_jax.analysis.periodic import periodic_motion
    from clearance_jax.analysis.sensitivity import Hessian, Sensitivities, hessian, sensitivities
    from clearance_jax.analysis.trust import GradientReport, TrustThresholds, UntrustedGradient, gradient_report
    from clearance_jax.configure import configure
    from clearance_jax.dynamics.follow import Drives, follow
    from clearance_jax.dynamics.inverse import Posture, inverse_kinematics
    from clearance_jax.dynamics.mobility import Mobility, mobility
    from clearance_jax.io.scene import load
    from clearance_jax.io.trajectory import read_trajectory
    from clearance_jax.io.trajectory_writer import write_trajectory
    from clearance_jax.io.urdf import load_urdf
    from clearance_jax.joints import (
        AbstractClearance,
        AbstractElement,
        GuideClearance,
        PlayDamper,
        PreloadedBearing,
        RevoluteClearance,
        SleeveClearance,
        SphericalClearance,
    )
    from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, AbstractStiffness
    from clearance_jax.mechanism.actuators import AbstractActuator, ConstantEffort, JointFriction, JointSpring, Servo
    from clearance_jax.mechanism.body import Body, Motion, Point, Spring
    from clearance_jax.mechanism.compliance import Compliance, with_compliance
    from clearance_jax.mechanism.compounds import Ball, Cylindrical, Free, Planar, Spherical, Spin, Universal
    from clearance_jax.mechanism.controllers import AbstractController, ComputedTorque, Reference
    from clearance_jax.mechanism.drives import AbstractDrive, ConstantSpeed, Harmonic, Spline, Step5Sum, StepSum
    from clearance_jax.mechanism.limits import Limits
    from clearance_jax.mechanism.loads import Force, Torque, Wrench
    from clearance_jax.mechanism.mechanism import Mechanism
    from clearance_jax.mechanism.paths import Arc, CartesianPath, Curve, Line, Pose, Waypoint
    from clearance_jax.mechanism.placement import Axis, Gravity, Inertia, Orientation, Position
    from clearance_jax.mechanism.profiles import Constant, Quintic, Trapezoid
    from clearance_jax.mechanism.tree import Fixed, Prismatic, Revolute
    from clearance_jax.metrics.measure import AbstractMetric, Reply, Request, measure
    from clearance_jax.metrics.signals import AbstractSignal
    from clearance_jax.parameters import parameters, physical, replace
    from clearance_jax.report import sweep_figures, wear_figures
    from clearance_jax.report.animation import Film, animate
    from clearance_jax.results.dataset import to_dataset
    from clearance_jax.results.sobol import sobol_indices
    from clearance_jax.results.store import load_dataset, save
    from clearance_jax.solve.batch import BatchReport, batch
    from clearance_jax.solve.settings import SolveOptions
    from clearance_jax.solve.simulate import simulate
    from clearance_jax.solve.solution import Solution
    from clearance_jax.solve.trace import Trace, trace
    from clearance_jax.sweep.axes import Choice, Sampled, Zipped
    from clearance_jax.sweep.distributions import LogNormal, Normal, TruncatedNormal, Uniform
    from clearance_jax.sweep.run import sweep
    from clearance_jax.sweep.saltelli import sobol_samples

# The same once more, for the interpreter (a test compares the two): modules as they are, and what is in which module.
_MODULES = {
    "design": "design",
    "joints": "joints",
    "laws": "laws",
    "metrics": "metrics",
    "sweep_figures": "report.sweep_figures",
    "wear": "wear",
    "wear_figures": "report.wear_figures",
}
_NAMES = {
    "metrics.measure": ("AbstractMetric", "Reply", "Request", "measure"),
    "analysis.modes": ("Mode", "seated_modes"),
    "analysis.cycle": ("PeriodicMotion",),
    "analysis.periodic": ("periodic_motion",),
    "analysis.sensitivity": ("Hessian", "Sensitivities", "hessian", "sensitivities"),
    "metrics.signals": ("AbstractSignal",),
    "analysis.trust": ("GradientReport", "TrustThresholds", "UntrustedGradient", "gradient_report"),
    "configure": ("configure",),
    "dynamics.follow": ("Drives", "follow"),
    "dynamics.inverse": ("Posture", "inverse_kinematics"),
    "dynamics.mobility": ("Mobility", "mobility"),
    "io.scene": ("load",),
    "io.trajectory": ("read_trajectory",),
    "io.trajectory_writer": ("write_trajectory",),
    "io.urdf": ("load_urdf",),
    "joints": (
        "AbstractClearance",
        "AbstractElement",
        "GuideClearance",
        "PlayDamper",
        "PreloadedBearing",
        "RevoluteClearance",
        "SleeveClearance",
        "SphericalClearance",
    ),
    "laws": ("AbstractFrictionLaw", "AbstractNormalLaw", "AbstractStiffness"),
    "mechanism.actuators": ("AbstractActuator", "ConstantEffort", "JointFriction", "JointSpring", "Servo"),
    "mechanism.body": ("Body", "Motion", "Point", "Spring"),
    "mechanism.compliance": ("Compliance", "with_compliance"),
    "mechanism.compounds": ("Ball", "Cylindrical", "Free", "Planar", "Spherical", "Spin", "Universal"),
    "mechanism.controllers": ("AbstractController", "ComputedTorque", "Reference"),
    "mechanism.drives": ("AbstractDrive", "ConstantSpeed", "Harmonic", "Spline", "Step5Sum", "StepSum"),
    "mechanism.limits": ("Limits",),
    "mechanism.loads": ("Force", "Torque", "Wrench"),
    "mechanism.mechanism": ("Mechanism",),
    "mechanism.paths": ("Arc", "CartesianPath", "Curve", "Line", "Pose", "Waypoint"),
    "mechanism.placement": ("Axis", "Gravity", "Inertia", "Orientation", "Position"),
    "mechanism.profiles": ("Constant", "Quintic", "Trapezoid"),
    "mechanism.tree": ("Fixed", "Prismatic", "Revolute"),
    "parameters": ("parameters", "physical", "replace"),
    "report.animation": ("Film", "animate"),
    "results.dataset": ("to_dataset",),
    "results.sobol": ("sobol_indices",),
    "results.store": ("load_dataset", "save"),
    "solve.batch": ("BatchReport", "batch"),
    "solve.settings": ("SolveOptions",),
    "solve.simulate": ("simulate",),
    "solve.solution": ("Solution",),
    "solve.trace": ("Trace", "trace"),
    "sweep.axes": ("Choice", "Sampled", "Zipped"),
    "sweep.distributions": ("LogNormal", "Normal", "TruncatedNormal", "Uniform"),
    "sweep.run": ("sweep",),
    "sweep.saltelli": ("sobol_samples",),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "AbstractActuator",
    "AbstractClearance",
    "AbstractController",
    "AbstractDrive",
    "AbstractElement",
    "AbstractFrictionLaw",
    "AbstractMetric",
    "AbstractNormalLaw",
    "AbstractSignal",
    "AbstractStiffness",
    "Arc",
    "Axis",
    "Ball",
    "BatchReport",
    "Body",
    "CartesianPath",
    "Choice",
    "ClearanceError",
    "Compliance",
    "ComputedTorque",
    "Constant",
    "ConstantEffort",
    "ConstantSpeed",
    "Curve",
    "Cylindrical",
    "Drives",
    "Film",
    "Fixed",
    "Force",
    "Free",
    "GradientReport",
    "Gravity",
    "GuideClearance",
    "Harmonic",
    "Hessian",
    "Inertia",
    "JointFriction",
    "JointSpring",
    "Limits",
    "Line",
    "LogNormal",
    "Mechanism",
    "Mobility",
    "Mode",
    "Motion",
    "Normal",
    "Orientation",
    "PeriodicMotion",
    "Planar",
    "PlayDamper",
    "Point",
    "Pose",
    "Position",
    "Posture",
    "PreloadedBearing",
    "Prismatic",
    "Quintic",
    "Reference",
    "Reply",
    "Request",
    "Revolute",
    "RevoluteClearance",
    "Sampled",
    "Sensitivities",
    "Servo",
    "SleeveClearance",
    "Solution",
    "SolveOptions",
    "Spherical",
    "SphericalClearance",
    "Spin",
    "Spline",
    "Spring",
    "Step5Sum",
    "StepSum",
    "Torque",
    "Trace",
    "Trapezoid",
    "TruncatedNormal",
    "TrustThresholds",
    "Uniform",
    "Universal",
    "UntrustedGradient",
    "Waypoint",
    "Wrench",
    "Zipped",
    "animate",
    "batch",
    "configure",
    "design",
    "follow",
    "gradient_report",
    "hessian",
    "inverse_kinematics",
    "joints",
    "laws",
    "load",
    "load_dataset",
    "load_urdf",
    "measure",
    "metrics",
    "mobility",
    "parameters",
    "periodic_motion",
    "physical",
    "read_trajectory",
    "replace",
    "save",
    "seated_modes",
    "sensitivities",
    "simulate",
    "sobol_indices",
    "sobol_samples",
    "sweep",
    "sweep_figures",
    "to_dataset",
    "trace",
    "wear",
    "wear_figures",
    "with_compliance",
    "write_trajectory",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        hint = "" if name.startswith("_") else " " + suggest(name, __all__)
        raise AttributeError(f"clearance_jax has no `{name}`.{hint}", name=name)
    module = importlib.import_module(f"{__name__}.{_MODULES.get(name) or _HOME[name]}")
    found = module if name in _MODULES else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(ModuleType):
    """Two functions are called as the modules that they are in (`parameters`, `configure`). Python puts every module
    that it imports into its package under its own name: these two would hide the functions.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (isinstance(value, ModuleType) and name in _HOME):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

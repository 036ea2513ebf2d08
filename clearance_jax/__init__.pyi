# Every public name, once: for type checkers, and for `__init__`, which finds a name here when it is first asked for.
__all__: list[str]
from . import design as design
from . import joints as joints
from . import laws as laws
from . import metrics as metrics
from . import wear as wear
from ._version import __version__ as __version__
from .analysis.cycle import PeriodicMotion as PeriodicMotion
from .analysis.modes import Mode as Mode
from .analysis.modes import seated_modes as seated_modes
from .analysis.periodic import periodic_motion as periodic_motion
from .analysis.sensitivity import Hessian as Hessian
from .analysis.sensitivity import Sensitivities as Sensitivities
from .analysis.sensitivity import hessian as hessian
from .analysis.sensitivity import sensitivities as sensitivities
from .analysis.trust import GradientReport as GradientReport
from .analysis.trust import TrustThresholds as TrustThresholds
from .analysis.trust import UntrustedGradient as UntrustedGradient
from .analysis.trust import gradient_report as gradient_report
from .configure import configure as configure
from .dynamics.follow import Drives as Drives
from .dynamics.follow import follow as follow
from .dynamics.inverse import Posture as Posture
from .dynamics.inverse import inverse_kinematics as inverse_kinematics
from .dynamics.mobility import Mobility as Mobility
from .dynamics.mobility import mobility as mobility
from .errors import ClearanceError as ClearanceError
from .io.scene import load as load
from .io.study import Study as Study
from .io.study import load_study as load_study
from .io.trajectory import read_trajectory as read_trajectory
from .io.trajectory_writer import write_trajectory as write_trajectory
from .io.urdf import load_urdf as load_urdf
from .joints import (
    AbstractClearance as AbstractClearance,
)
from .joints import (
    AbstractElement as AbstractElement,
)
from .joints import (
    GuideClearance as GuideClearance,
)
from .joints import (
    PlayDamper as PlayDamper,
)
from .joints import (
    PreloadedBearing as PreloadedBearing,
)
from .joints import (
    RevoluteClearance as RevoluteClearance,
)
from .joints import (
    SleeveClearance as SleeveClearance,
)
from .joints import (
    SphericalClearance as SphericalClearance,
)
from .laws import AbstractFrictionLaw as AbstractFrictionLaw
from .laws import AbstractNormalLaw as AbstractNormalLaw
from .laws import AbstractStiffness as AbstractStiffness
from .mechanism.actuators import AbstractActuator as AbstractActuator
from .mechanism.actuators import ConstantEffort as ConstantEffort
from .mechanism.actuators import JointFriction as JointFriction
from .mechanism.actuators import JointSpring as JointSpring
from .mechanism.actuators import Servo as Servo
from .mechanism.body import Body as Body
from .mechanism.body import Motion as Motion
from .mechanism.body import Point as Point
from .mechanism.body import Spring as Spring
from .mechanism.compliance import Compliance as Compliance
from .mechanism.compliance import with_compliance as with_compliance
from .mechanism.compounds import Ball as Ball
from .mechanism.compounds import Cylindrical as Cylindrical
from .mechanism.compounds import Free as Free
from .mechanism.compounds import Planar as Planar
from .mechanism.compounds import Spherical as Spherical
from .mechanism.compounds import Spin as Spin
from .mechanism.compounds import Universal as Universal
from .mechanism.controllers import AbstractController as AbstractController
from .mechanism.controllers import ComputedTorque as ComputedTorque
from .mechanism.controllers import Reference as Reference
from .mechanism.drives import AbstractDrive as AbstractDrive
from .mechanism.drives import ConstantSpeed as ConstantSpeed
from .mechanism.drives import Harmonic as Harmonic
from .mechanism.drives import Spline as Spline
from .mechanism.drives import Step5Sum as Step5Sum
from .mechanism.drives import StepSum as StepSum
from .mechanism.limits import Limits as Limits
from .mechanism.loads import Force as Force
from .mechanism.loads import Torque as Torque
from .mechanism.loads import Wrench as Wrench
from .mechanism.mechanism import Mechanism as Mechanism
from .mechanism.paths import Arc as Arc
from .mechanism.paths import CartesianPath as CartesianPath
from .mechanism.paths import Curve as Curve
from .mechanism.paths import Line as Line
from .mechanism.paths import Pose as Pose
from .mechanism.paths import Waypoint as Waypoint
from .mechanism.placement import Axis as Axis
from .mechanism.placement import Gravity as Gravity
from .mechanism.placement import Inertia as Inertia
from .mechanism.placement import Orientation as Orientation
from .mechanism.placement import Position as Position
from .mechanism.profiles import Constant as Constant
from .mechanism.profiles import Quintic as Quintic
from .mechanism.profiles import Trapezoid as Trapezoid
from .mechanism.tree import Fixed as Fixed
from .mechanism.tree import Prismatic as Prismatic
from .mechanism.tree import Revolute as Revolute
from .metrics.measure import AbstractMetric as AbstractMetric
from .metrics.measure import Reply as Reply
from .metrics.measure import Request as Request
from .metrics.measure import measure as measure
from .metrics.signals import AbstractSignal as AbstractSignal
from .parameters import parameters as parameters
from .parameters import physical as physical
from .parameters import replace as replace
from .report import sweep_figures as sweep_figures
from .report import wear_figures as wear_figures
from .report.animation import Film as Film
from .report.animation import animate as animate
from .results.dataset import to_dataset as to_dataset
from .results.sobol import sobol_indices as sobol_indices
from .results.store import load_dataset as load_dataset
from .results.store import save as save
from .solve.batch import BatchReport as BatchReport
from .solve.batch import batch as batch
from .solve.settings import SolveOptions as SolveOptions
from .solve.simulate import simulate as simulate
from .solve.solution import Solution as Solution
from .solve.trace import Trace as Trace
from .solve.trace import trace as trace
from .sweep.axes import Choice as Choice
from .sweep.axes import Sampled as Sampled
from .sweep.axes import Zipped as Zipped
from .sweep.run import sweep as sweep
from .sweep.saltelli import sobol_samples as sobol_samples
from .sweep.scatter import scatter as scatter

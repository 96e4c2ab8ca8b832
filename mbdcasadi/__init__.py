"""Constrained multibody dynamics of planar mechanisms on CasADi.

A model is written in bodies, joints, drivers and forces; every quantity of it
is a CasADi expression. Each analysis is one function that takes the mechanism
and returns a result, and a result evaluates any expression.

The notation is that of E. J. Haug, *Computer Aided Kinematics and Dynamics of
Mechanical Systems*, Allyn & Bacon 1989. Units are SI, angles are in radians.
"""

import typing as _typing
from importlib import import_module as _import_module

from .arguments.inputs import SampledController
from .assembly.impact import impact
from .equations.public import Equations, equations
from .errors import (
    AssemblyError,
    ConditionError,
    EquilibriumError,
    ExpressionError,
    FileError,
    Interrupted,
    MechanismError,
    MechanismWarning,
    ModelError,
    OptimizationError,
    SimulationError,
    SingularityError,
)
from .integrators import BDF, DOP853, IDAS, Integrator, Rosenbrock, RungeKutta
from .inverse_dynamics.inverse_dynamics import inverse_dynamics
from .kinematics.check import Report, check
from .kinematics.kinematics import kinematics
from .model import expressions as _expressions
from .model.bodies import Body, Marker, ground
from .model.conditions import bounded, soft
from .model.drivers import Actuator, Driver
from .model.element import ConstraintElement, Element, Reaction
from .model.events import Event
from .model.expressions import *  # noqa: F403  (elementary functions, safe on symbols)
from .model.forces.applied import Force, GeneralizedForce, Torque
from .model.forces.backlash import Backlash
from .model.forces.contact.contact import Contact
from .model.forces.contact.outlines import Circle, HalfPlane, HollowCircle, Point, PolygonEdges, Segment
from .model.forces.contact.rigid import RigidContact
from .model.forces.controllers import EnergyMeter, FirstOrderLag, PIController
from .model.forces.cylinders import Cylinder, GasSpring, HydraulicCylinder
from .model.forces.field import FieldForce, Gravity
from .model.forces.friction.joint_friction import JointFriction, LoadIndependentFriction
from .model.forces.friction.laws import Coulomb, DryFriction, FrictionLaw, LuGre, Resistance, Stribeck, Viscous
from .model.forces.laws import HuntCrossley, hertz_stiffness
from .model.forces.mass_flow import MassFlow
from .model.forces.motors import DCMotor
from .model.forces.orifice import orifice_flow
from .model.forces.springs import RSDA, TSDA, Bushing, DataLaw
from .model.forces.stops import EndStop
from .model.forces.wheel import Wheel
from .model.geometry.cam_outlines import CamOutline
from .model.geometry.curves import Curve
from .model.geometry.motion_programs import MotionProgram, dwell, fall, rise
from .model.geometry.shapes import Disc, Polygon, Rectangle, Rod, Shape
from .model.geometry.smoothing import smoothing_spline
from .model.joints.base import Joint
from .model.joints.cams import CamCam, CamFlatFollower, CamPointFollower, PointOnCurve
from .model.joints.clutches import Clutch, OneWayClutch
from .model.joints.constraints import Constraint, KnifeEdge, NonholonomicConstraint
from .model.joints.coordinates import (
    AbsoluteAngle,
    AbsoluteDistance,
    AbsoluteX,
    AbsoluteY,
    RelativeAngle,
    RelativeX,
    RelativeY,
)
from .model.joints.gears import Belt, Coupler, Gear, RackAndPinion, Rolling
from .model.joints.lower_pairs import Distance, PointOnLine, Revolute, Translational, Weld
from .model.joints.rolling_on_curve import RollingOnCurve
from .model.mechanism import Mechanism
from .model.rates import time_derivative
from .model.ropes.belt import ElasticBelt
from .model.ropes.cable import Cable
from .model.ropes.pulleys import Drum, Pulley
from .model.ropes.rope import Rope
from .model.shaking import ShakingForce, shaking_force
from .model.symbols import Coordinate, Input, Parameter, StateVariable, t
from .model.validity import Smoothing, ValidityCondition
from .results.state import State
from .results.trajectory import Trajectory
from .results.trajectory_files import read_trajectory
from .simulation.assemble import assemble
from .simulation.simulate import simulate

#: The one place of the version.
__version__ = "0.1.0"

if _typing.TYPE_CHECKING:
    from . import library
    from .control.controller import Controller, ControlPlan, ControlStep, ControlTiming
    from .control.estimator import Estimator
    from .control.fed import FedController
    from .files.acf import read_acf
    from .files.adm import read_adm
    from .files.mjcf import read_mjcf
    from .files.mjcf_keyframes import Keyframe, read_keyframes
    from .files.sdf import read_sdf
    from .files.urdf import read_urdf
    from .fmu.export import export_fmu
    from .identification.data import Experiment, IdentificationError
    from .identification.fit import Fit
    from .identification.identify import identify
    from .integrators.stepping import IntegratorStep, RunEquations, SteppingMethod
    from .kinematics.reachable import Reachability, reachable
    from .linear.linearize import linearize
    from .linear.model import LinearModel
    from .model.placeholders import absolute, at_end, at_start, integral, positive_part
    from .optimal_control.motion.feedback import LinearFeedback
    from .optimal_control.optimize import optimize
    from .optimal_control.problem import OptimalControlProblem
    from .optimal_control.search.proposal import Proposal
    from .optimal_control.search.strategies import STRATEGIES
    from .optimal_control.search.strategy import Strategy
    from .optimal_control.solution import Solution, read_solution
    from .optimal_control.statement.phase import Phase, Waypoint
    from .optimal_control.statement.time_span import between
    from .optimal_control.transcription import GaussLegendre, HermiteSimpson, Transcription
    from .optimal_control.transcription.points import CollocationPoint
    from .sensitivity.cost import CostFunction, cost_function
    from .sensitivity.return_map import Stability
    from .sensitivity.sensitivities import Sensitivities, sensitivities
    from .sensitivity.stability import stability
    from .statics.equilibrium import Equilibrium, equilibrium
    from .statics.holding_range import HoldingRange, holding_range
    from .statics.path import EquilibriumPath, equilibrium_path
    from .sweeping.cases import full_factorial, latin_hypercube
    from .sweeping.result import Sweep
    from .sweeping.sweep import sweep
    from .synthesis.linkage import Linkage
    from .synthesis.linkage_files import read_linkages
    from .synthesis.linkages import Linkages
    from .synthesis.synthesize import synthesize
    from .visual.animate import animate
    from .visual.animation import Animation
    from .visual.drawing.draw import draw
    from .visual.plots.charts import plot_energy, plot_path, plot_phase
    from .visual.plots.identification_plots import plot_residuals
    from .visual.plots.modes import plot_modes
    from .visual.plots.plot import plot
    from .visual.plots.solution_plots import plot_solution
    from .visual.symbols import Glyph, glyph
    from .writing.mjcf import write_mjcf

#: Modules that are imported at the first use of one of their names, and these names.
_LATER = {
    "": "library",
    "control.controller": "ControlPlan ControlStep ControlTiming Controller",
    "control.estimator": "Estimator",
    "control.fed": "FedController",
    "files.acf": "read_acf",
    "files.adm": "read_adm",
    "files.mjcf": "read_mjcf",
    "files.mjcf_keyframes": "Keyframe read_keyframes",
    "files.sdf": "read_sdf",
    "files.urdf": "read_urdf",
    "fmu.export": "export_fmu",
    "identification.data": "Experiment IdentificationError",
    "identification.fit": "Fit",
    "identification.identify": "identify",
    "integrators.stepping": "IntegratorStep RunEquations SteppingMethod",
    "kinematics.reachable": "Reachability reachable",
    "linear.linearize": "linearize",
    "linear.model": "LinearModel",
    "model.placeholders": "absolute at_end at_start integral positive_part",
    "optimal_control.motion.feedback": "LinearFeedback",
    "optimal_control.optimize": "optimize",
    "optimal_control.problem": "OptimalControlProblem",
    "optimal_control.search.proposal": "Proposal",
    "optimal_control.search.strategies": "STRATEGIES",
    "optimal_control.search.strategy": "Strategy",
    "optimal_control.solution": "Solution read_solution",
    "optimal_control.statement.phase": "Phase Waypoint",
    "optimal_control.statement.time_span": "between",
    "optimal_control.transcription": "GaussLegendre HermiteSimpson Transcription",
    "optimal_control.transcription.points": "CollocationPoint",
    "sensitivity.cost": "CostFunction cost_function",
    "sensitivity.return_map": "Stability",
    "sensitivity.sensitivities": "Sensitivities sensitivities",
    "sensitivity.stability": "stability",
    "statics.equilibrium": "Equilibrium equilibrium",
    "statics.holding_range": "HoldingRange holding_range",
    "statics.path": "EquilibriumPath equilibrium_path",
    "sweeping.cases": "full_factorial latin_hypercube",
    "sweeping.result": "Sweep",
    "sweeping.sweep": "sweep",
    "synthesis.linkage": "Linkage",
    "synthesis.linkage_files": "read_linkages",
    "synthesis.linkages": "Linkages",
    "synthesis.synthesize": "synthesize",
    "visual.animate": "animate",
    "visual.animation": "Animation",
    "visual.drawing.draw": "draw",
    "visual.plots.charts": "plot_energy plot_path plot_phase",
    "visual.plots.identification_plots": "plot_residuals",
    "visual.plots.modes": "plot_modes",
    "visual.plots.plot": "plot",
    "visual.plots.solution_plots": "plot_solution",
    "visual.symbols": "Glyph glyph",
    "writing.mjcf": "write_mjcf",
}
_PLACES = {name: module for module, names in _LATER.items() for name in names.split()}
#: All public names: type checkers, ``import *``, ``help`` and ``inspect`` go by these.
__all__ = [
    "BDF", "DOP853", "IDAS", "RSDA", "STRATEGIES", "TSDA", "AbsoluteAngle", "AbsoluteDistance", "AbsoluteX",
    "AbsoluteY", "Actuator", "Animation", "AssemblyError", "Backlash", "Belt", "Body", "Bushing", "Cable",
    "CamCam", "CamFlatFollower", "CamOutline", "CamPointFollower", "Circle", "Clutch", "CollocationPoint",
    "ConditionError",
    "Constraint", "ConstraintElement", "Contact", "ControlPlan", "ControlStep", "ControlTiming", "Controller",
    "Coordinate", "CostFunction", "Coulomb", "Coupler", "Curve", "Cylinder", "DCMotor", "DataLaw", "Disc", "Distance",
    "Driver", "Drum", "DryFriction", "ElasticBelt", "Element", "EndStop", "EnergyMeter", "Equations", "Equilibrium",
    "EquilibriumError", "EquilibriumPath", "Estimator", "Event", "Experiment", "ExpressionError",
    "FedController", "FieldForce", "FileError", "FirstOrderLag", "Fit", "Force", "FrictionLaw", "GasSpring",
    "GaussLegendre", "Gear", "GeneralizedForce", "Glyph", "Gravity", "HalfPlane", "HermiteSimpson", "HoldingRange",
    "HollowCircle", "HuntCrossley", "HydraulicCylinder",
    "IdentificationError", "Input", "Integrator", "IntegratorStep", "Interrupted", "Joint", "JointFriction",
    "Keyframe", "KnifeEdge", "LinearFeedback", "LinearModel", "Linkage", "Linkages", "LoadIndependentFriction",
    "LuGre", "Marker", "MassFlow", "Mechanism",
    "MechanismError", "MechanismWarning", "ModelError", "MotionProgram", "NonholonomicConstraint", "OneWayClutch",
    "OptimalControlProblem", "OptimizationError", "PIController", "Parameter", "Phase", "Point", "PointOnCurve",
    "PointOnLine", "Polygon", "PolygonEdges", "Proposal", "Pulley", "RackAndPinion", "Reachability", "Reaction",
    "Rectangle", "RelativeAngle", "RelativeX", "RelativeY", "Report", "Resistance", "Revolute", "RigidContact", "Rod",
    "Rolling", "RollingOnCurve", "Rope", "Rosenbrock", "RunEquations", "RungeKutta", "SampledController", "Segment",
    "Sensitivities", "ShakingForce", "Shape", "SimulationError", "SingularityError", "Smoothing", "Solution",
    "Stability", "State", "StateVariable", "SteppingMethod", "Strategy", "Stribeck", "Sweep", "Torque", "Trajectory",
    "Transcription", "Translational", "ValidityCondition", "Viscous", "Waypoint", "Weld", "Wheel", "absolute",
    "animate",
    "assemble", "at_end", "at_start", "between", "bounded", "check", "cost_function", "draw", "dwell", "equations",
    "equilibrium", "equilibrium_path", "export_fmu", "fall", "full_factorial", "glyph", "ground", "hertz_stiffness",
    "holding_range", "identify", "impact", "integral", "inverse_dynamics", "kinematics", "latin_hypercube", "library",
    "linearize", "optimize", "orifice_flow", "plot", "plot_energy", "plot_modes", "plot_path", "plot_phase",
    "plot_residuals", "plot_solution", "positive_part", "reachable", "read_acf", "read_adm", "read_keyframes",
    "read_linkages", "read_mjcf", "read_sdf", "read_solution", "read_trajectory", "read_urdf", "rise",
    "sensitivities", "shaking_force", "simulate", "smoothing_spline", "soft", "stability", "sweep", "synthesize", "t",
    "time_derivative", "write_mjcf",
]  # fmt: skip
__all__ += _expressions.__all__


if not _typing.TYPE_CHECKING:  # a checker knows the names above, and no others

    def __getattr__(name: str) -> _typing.Any:
        """Import a name at its first use: simulations do not wait for rooms that they do not need."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = _PLACES[name]
        owner = _import_module(f".{module or name}", __name__)
        value = getattr(owner, name) if module else owner
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})

"""Constrained multibody dynamics of planar mechanisms on CasADi.

A model is written in bodies, joints, drivers and forces; every quantity of it
is a CasADi expression. Each analysis is one function that takes the mechanism
and returns a result, and a result evaluates any expression.

The notation is that of E. J. Haug, *Computer Aided Kinematics and Dynamics of
Mechanical Systems*, Allyn & Bacon 1989. Units are SI, angles are in radians.
"""

from . import library
from .analysis.assemble import assemble
from .analysis.check import Report, check
from .analysis.equilibrium.find import Equilibrium, EquilibriumError, equilibrium
from .analysis.equilibrium.path import EquilibriumPath, equilibrium_path
from .analysis.identification.data import Experiment, IdentificationError
from .analysis.identification.fit import Fit
from .analysis.identification.identify import identify
from .analysis.inputs import SampledController
from .analysis.inverse_dynamics import inverse_dynamics
from .analysis.kinematics import kinematics
from .analysis.linear.linearize import linearize
from .analysis.linear.model import LinearModel
from .analysis.sensitivity.cost import CostFunction, cost_function
from .analysis.sensitivity.sensitivities import Sensitivities, sensitivities
from .analysis.simulate import simulate
from .analysis.sweeping.cases import full_factorial, latin_hypercube
from .analysis.sweeping.result import Sweep
from .analysis.sweeping.sweep import sweep
from .equations import Equations, equations
from .errors import (
    AssemblyError,
    ConditionError,
    ExpressionError,
    FileError,
    Interrupted,
    MechanismError,
    MechanismWarning,
    ModelError,
    SimulationError,
    SingularityError,
)
from .files.acf import read_acf
from .files.adm import read_adm
from .model.bodies import Body, Marker, ground
from .model.cam_outlines import CamOutline
from .model.conditions import bounded
from .model.curves import Curve
from .model.drivers import Driver
from .model.events import Event
from .model.expressions import *  # noqa: F403  (elementary functions, safe on symbols)
from .model.forces.applied import Force, GeneralizedForce, Torque
from .model.forces.bushing import Bushing
from .model.forces.contact_laws import HuntCrossley
from .model.forces.contacts.contact import Contact
from .model.forces.contacts.outlines import Circle, HalfPlane, HollowCircle, Point, PolygonEdges, Segment
from .model.forces.controllers import EnergyMeter, FirstOrderLag, PIController
from .model.forces.cylinders import Cylinder, GasSpring, HydraulicCylinder
from .model.forces.data_laws import DataLaw
from .model.forces.field import FieldForce
from .model.forces.friction.coulomb import Coulomb
from .model.forces.friction.dry import DryFriction
from .model.forces.friction.joint_friction import JointFriction, LoadIndependentFriction
from .model.forces.friction.lugre import LuGre
from .model.forces.friction.stribeck import Stribeck
from .model.forces.friction.viscous import Viscous
from .model.forces.gravity import Gravity
from .model.forces.hertz import hertz_stiffness
from .model.forces.motors import DCMotor
from .model.forces.springs import RSDA, TSDA
from .model.forces.stops import EndStop
from .model.joints.belts import Belt, Coupler
from .model.joints.cams import CamCam, CamFlatFollower, CamPointFollower, PointOnCurve
from .model.joints.composite import Distance, PointOnLine
from .model.joints.coordinates import (
    AbsoluteAngle,
    AbsoluteDistance,
    AbsoluteX,
    AbsoluteY,
    RelativeAngle,
    RelativeX,
    RelativeY,
)
from .model.joints.gears import Gear, RackAndPinion
from .model.joints.general import Constraint
from .model.joints.lower_pairs import Revolute, Translational, Weld
from .model.joints.nonholonomic import KnifeEdge, NonholonomicConstraint
from .model.joints.rolling import Rolling
from .model.mechanism import Mechanism
from .model.motion_programs import MotionProgram, dwell, fall, rise
from .model.rates import time_derivative
from .model.shaking import ShakingForce, shaking_force
from .model.shapes import Disc, Polygon, Rectangle, Rod, Shape
from .model.symbols import Coordinate, Input, Parameter, StateVariable, t
from .optimal_control.failure import OptimizationError
from .optimal_control.optimize import optimize
from .optimal_control.placeholders import at_end, at_start, integral
from .optimal_control.problem import OptimalControlProblem
from .optimal_control.solution import Solution
from .optimal_control.storage import read_solution
from .optimal_control.waypoints import Waypoint
from .results.export import read_trajectory
from .results.state import State
from .results.trajectory import Trajectory
from .visual.animation import Animation, animate
from .visual.charts import plot_energy, plot_path, plot_phase
from .visual.drawing import draw
from .visual.fits import plot_residuals
from .visual.modes import plot_modes
from .visual.optimum import plot_solution
from .visual.plots import plot
from .visual.symbols import symbol as glyph

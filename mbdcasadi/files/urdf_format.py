"""Elements of URDF: those that are read with their attributes, and those that change no equation of motion."""

from __future__ import annotations

from .markup import table_of

#: Attributes and elements inside by element, and by its place if it has another meaning there.
_KNOWN = {
    "robot": ("name version", "link joint transmission material gazebo sensor ros2_control mujoco "
              "verification_properties frame drake:collision_filter_group drake:joint drake:linear_spring_damper "
              "drake:distance_constraint drake:ball_constraint"),
    "link": ("name type", "inertial visual collision contact verbose self_collision_checking"),
    "contact": ("", "lateral_friction"),
    "inertial": ("", "origin mass inertia"),
    "origin": ("xyz rpy", ""),
    "mass": ("value", ""),
    "inertia": ("ixx iyy izz ixy ixz iyz", ""),
    "joint": ("name type", "origin parent child axis calibration dynamics limit mimic safety_controller"),
    "drake:joint": ("name type", "origin parent child axis dynamics limit mimic"),
    "parent": ("link", ""),
    "child": ("link", ""),
    "axis": ("xyz", ""),
    "dynamics": ("damping friction", ""),
    "limit": ("lower upper effort velocity drake:acceleration", ""),
    "mimic": ("joint multiplier offset", ""),
    "transmission": ("name type", "type joint actuator mechanicalReduction"),
    "transmission joint": ("name", "hardwareInterface role offset mechanicalReduction"),
    "transmission actuator": ("name", "hardwareInterface role mechanicalReduction drake:rotor_inertia "
                             "drake:gear_ratio"),
    "gazebo": ("reference", "joint material sensor visual collision mu mu1 mu2 kp kd fdir1 maxVel minDepth maxContacts "
               "selfCollide self_collide laserRetro provideFeedback preserveFixedJoint disableFixedJointLumping "
               "static"),
    # of SDF
    "gazebo joint": ("name type", "parent child pose axis physics sensor"),
    "gazebo joint axis": ("", "xyz limit dynamics use_parent_model_frame initial_position"),
    "gazebo joint axis limit": ("", "lower upper effort velocity stiffness dissipation"),
    "gazebo joint axis dynamics": ("", "damping friction spring_reference spring_stiffness"),
}  # fmt: skip
#: The table for :func:`unread`.
TABLE = table_of(_KNOWN)

#: Elements inside the outermost one; others may hold a part of the robot.
KNOWN_PARTS = TABLE["robot"][1]

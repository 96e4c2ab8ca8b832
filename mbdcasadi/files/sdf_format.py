"""Elements of SDF: those that are read with their values, and those that change no equation of motion."""

from __future__ import annotations

from .markup import table_of

#: Values and elements inside by element, with values that are elements of a text as attributes.
_KNOWN = {
    "sdf": ("version", "world model light actor"),
    "world": ("name gravity magnetic_field", "model include frame joint physics scene light actor gui plugin audio "
              "wind road spherical_coordinates atmosphere"),
    "model": ("name canonical_link placement_frame static self_collide pose allow_auto_disable enable_wind",
              "link joint frame model include pose drake:joint drake:linear_spring_damper drake:distance_constraint "
              "drake:ball_constraint"),
    "frame": ("name attached_to pose", "pose"),
    "include": ("uri name pose static placement_frame", "pose"),
    "pose": ("relative_to rotation_format degrees", ""),
    "link": ("name pose gravity enable_wind kinematic must_be_base_link self_collide",
             "inertial collision visual sensor light projector audio_sink audio_source pose"),
    "inertial": ("mass pose auto density", "inertia pose"),
    "inertia": ("ixx iyy izz ixy ixz iyz", ""),
    "collision": ("name pose laser_retro max_contacts density", "geometry surface pose drake:proximity_properties"),
    "joint": ("name type parent child pose", "axis pose sensor physics drake:mimic"),
    "drake:joint": ("name type drake:parent drake:child drake:damping pose", "pose"),
    "axis": ("xyz use_parent_model_frame initial_position", "xyz limit dynamics mimic"),
    "xyz": ("expressed_in", ""),
    "limit": ("lower upper effort velocity stiffness dissipation drake:acceleration", ""),
    "dynamics": ("damping friction spring_reference spring_stiffness", ""),
    "drake:mimic": ("joint multiplier offset", ""),
    "mimic": ("joint axis multiplier offset reference", ""),
}  # fmt: skip
#: The table for :func:`unread`.
TABLE = table_of(_KNOWN)
#: Elements of a model that hold no part of its mechanics; others that are not in the table may.
BESIDES = ("plugin", "gripper", "sensor", "light", "audio", "drake:collision_filter_group")

"""How fast may a cam turn before its follower lifts off, and what torque does it take?

The profile is made for a rise, a dwell and a return; a spring presses the
roller on. The contact force at one speed comes from inverse dynamics; since
its inertia part grows with the square of the speed, the speed at lift-off
follows, and a simulation stops there.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

program = mbd.MotionProgram(
    mbd.rise(np.radians(120), 0.012, "modified trapezoidal"),
    mbd.dwell(np.radians(60)),
    mbd.fall(np.radians(120), "3-4-5"),
    mbd.dwell(np.radians(60)),
)
valve = mbd.library.cam_follower(
    program, base_radius=0.030, roller_radius=0.010, masses=(2.0, 0.4), stiffness=6000, preload=80
)
contact = valve.contact
sharpest = np.max(valve.outline.curvatures(valve.outline.samples))
print(f"smallest radius of curvature of the profile: {1e3 / sharpest:.1f} mm")


def turned_at(speed):
    """One turn at constant speed."""
    return mbd.inverse_dynamics(valve.driven(cam=speed * mbd.t), np.linspace(0, 2 * np.pi / speed, 721))


slow, run = turned_at(1.0), turned_at(60.0)
print(f"at 60 rad/s: contact {run[contact.normal_force].min():.0f} to {run[contact.normal_force].max():.0f} N")
pressure = np.abs(np.tan(slow[contact.pressure_angle]))  # of the normal against the guide, up or down
print(f"pressure angle at most {np.degrees(np.arctan(pressure.max())):.1f}°")

# N = static part + speed² · inertia part, at every angle of the cam
static = slow[contact.normal_force]
inertia = (run[contact.normal_force] - static) / (60.0**2 - 1)
limit = np.sqrt(np.min(-static[inertia < 0] / inertia[inertia < 0]))
print(f"lift-off from {limit:.1f} rad/s ({limit * 30 / np.pi:.0f} rev/min)")

fast = valve.driven(cam=1.02 * limit * mbd.t)
flight = mbd.simulate(fast, duration=2 * np.pi / limit, events=[contact.lift_off()])
print(f"2 % faster it happens when the cam has turned by {np.degrees(flight.final[valve.cam.phi]):.1f}°")

figure = mbd.plot(
    run,
    {
        "lift, m": valve.follower.y,
        "contact force, N": contact.normal_force,
        "torque on the cam, N m": run.mechanism.joint("cam drive").effort,
    },
)
figure.savefig(OUTPUT / "cam.png", dpi=120)
mbd.animate(run, OUTPUT / "cam.html", plots={"lift, m": valve.follower.y, "contact force, N": contact.normal_force})

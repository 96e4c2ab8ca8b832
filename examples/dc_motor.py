"""A motor swings a pendulum up to the horizontal: by a controller, and with the least heat. What does each cost?

The current of the motor, the integral of the controller and the energies are
first-order states of the model. In optimal control the voltage takes the
place of the controller.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

arm = mbd.Body("arm", mass=0.6, inertia=0.6 * 0.4**2 / 12, pose=(0, -0.2, -np.pi / 2))
pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.2, 0))
at_rest = [arm.phi == -np.pi / 2, arm.omega == 0]
WINDING = dict(constant=0.04, resistance=0.8, inductance=2e-3, ratio=20)

# --- a controller ------------------------------------------------------------------------
target = mbd.step(mbd.t, 0.0, -np.pi / 2, 0.8, 0.0)
speed = mbd.time_derivative(target)
position = mbd.PIController("position", target - arm.phi, proportional=60.0, integral=150.0)
motor = mbd.DCMotor("motor", arm, position.output + 4.0 * (speed - arm.omega), **WINDING)
supplied = mbd.EnergyMeter("supplied", motor.electric_power)
heat = mbd.EnergyMeter("heat", motor.heat)
controlled = mbd.Mechanism([arm], [pin], forces=[mbd.Gravity(), position, motor, supplied, heat])
run = mbd.simulate(controlled, duration=1.5, initial=at_rest)
lifted = run.energy.total[-1] - run.energy.total[0]
taken, lost = run[supplied.energy][-1], run[heat.energy][-1]
print(f"controller: {taken:.2f} J supplied, {lost:.2f} J of it heat, {lifted:.2f} J lifted")
print(f"  the budget closes to {taken - lost - lifted:.1e} J (what the coil holds)")
print(f"  angle left at the end {np.degrees(run[arm.phi][-1]):.4f}°")

# --- least heat ------------------------------------------------------------------------------
volts = mbd.Input("V", lower=-24, upper=24)
free_motor = mbd.DCMotor("motor", arm, volts, **WINDING)
free = mbd.Mechanism([arm], [pin], forces=[mbd.Gravity(), free_motor], inputs=[volts])
problem = mbd.OptimalControlProblem(
    free,
    duration=0.8,
    initial=[*at_rest, free_motor.current == 0],
    final=[arm.phi == 0, arm.omega == 0],
    path=[mbd.bounded(-24, volts, 24)],
    running_cost=free_motor.heat,
)
solution = mbd.optimize(problem, intervals=60)
until = run.at([0.8])[heat.energy][0]
print(f"least heat in 0.8 s: {solution.cost:.3f} J, where the controller took {until:.3f} J")
print(f"  replayed by IDAS: off by {solution.verify().final_error:.1e} rad")

figure = mbd.plot(
    run,
    {
        "angle, rad": arm.phi,
        "current, A": motor.current,
        "heat, J": heat.energy,
        "supplied, J": supplied.energy,
    },
)
figure.savefig(OUTPUT / "dc_motor.png", dpi=120)

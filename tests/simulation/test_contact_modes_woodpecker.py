"""The woodpecker toy: stick, slip and impacts of a sleeve and a beak on a pole, against Lagrange's equations by hand.

References
----------
Pfeiffer and Glocker, *Multibody Dynamics with Unilateral Contacts*, 1996, whose data these are; Leine, Glocker and van
Campen, "Nonlinear dynamics of the woodpecker toy", 2001.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mbdcasadi as mbd

SLEEVE, BIRD, STIFFNESS, G, MU = (0.0003, 5e-9), (0.0045, 7e-7), 0.0056, 9.81, 0.3
#: radii of pole and sleeve, half the height of the sleeve, its spring, the centre of the bird, its beak
R0, RM, HM, LM, LG, LS, HS = 0.0025, 0.0031, 0.0058, 0.010, 0.015, 0.0201, 0.02
PLACES = {"beak": (1, -LS, HS), "low": (0, RM, -HM), "high": (0, RM, HM)}
#: what follows: a contact that slides, sticks or hits, and how that ends
CYCLE = [
    ("low", "slides", "low stops"),
    ("low", "sticks", "low breaks away"),
    ("low", "slides", "low opens"),
    (None, "beak", "beak touches"),
    (None, "low", "low touches"),
    (None, "low", "low touches"),
    ("low", "slides", "low stops"),
]


def angle_at_pole():
    """Angle at which the lower edge of the sleeve touches the pole."""
    return brentq(lambda a: RM * np.cos(a) + HM * np.sin(a) - R0, -0.3, 0)


class ByHand:
    """The toy in the height of the sleeve and the angles of sleeve and bird."""

    def __init__(self):
        q, v = ca.SX.sym("q", 3), ca.SX.sym("v", 3)
        y, a, b = ca.vertsplit(q)
        spring = ca.vertcat(LM * ca.cos(a), y + LM * ca.sin(a))
        centre = spring + LG * ca.vertcat(ca.cos(b), ca.sin(b))
        bodies = ((ca.vertcat(0, y), a, *SLEEVE), (centre, b, *BIRD))
        speeds = [(ca.jtimes(place, q, v), ca.jtimes(angle, q, v), m, j) for place, angle, m, j in bodies]
        energy = sum(m * ca.sumsqr(s) / 2 + j * w**2 / 2 for s, w, m, j in speeds)
        height = sum(m * G * place[1] for place, _, m, _ in bodies)
        momentum = ca.gradient(energy, v)
        force = ca.gradient(energy - height - STIFFNESS * (a - b) ** 2 / 2, q) - ca.jtimes(momentum, q, v)
        terms = [ca.jacobian(momentum, v), force]
        for body, along, across in PLACES.values():
            place, angle, *_ = bodies[body]
            point = place + ca.vertcat(
                along * ca.cos(angle) - across * ca.sin(angle), along * ca.sin(angle) + across * ca.cos(angle)
            )
            rows = ca.jacobian(point, q)  # away from the pole, and up along it
            terms += [point[0] - R0, rows, ca.jtimes(rows @ v, q, v)]
        self._terms = ca.Function("terms", [q, v], terms)

    def at(self, x, place):
        mass, force, *rest = (part.full() for part in self._terms(x[:3], x[3:]))
        k = 3 * list(PLACES).index(place or "low")
        return mass, force.ravel(), rest[k].item(), rest[k + 1], rest[k + 2].ravel()

    def accelerations(self, x, place, status):
        """Accelerations, and the forces of the place."""
        mass, force, _, rows, bias = self.at(x, place)
        if place is None:
            return np.linalg.solve(mass, force), np.zeros(2)
        by = np.linalg.solve(mass, rows.T)
        missing = -(bias + rows @ np.linalg.solve(mass, force))
        forces = np.linalg.solve(rows @ by, missing)
        if status == "slides":  # down until it stops
            normal = missing[0] / (rows @ by @ [1, MU])[0]
            forces = normal * np.array([1, MU])
        return np.linalg.solve(mass, force) + by @ forces, forces

    def hit(self, x, place, restitution):
        """Velocities after an impact."""
        mass, _, _, rows, _ = self.at(x, place)
        by, speeds = np.linalg.solve(mass, rows.T), rows @ x[3:]
        impulse = np.linalg.solve(rows @ by, [-restitution * speeds[0], 0] - speeds)
        for sense in (1, -1):
            if abs(impulse[1]) <= MU * impulse[0]:
                break
            cone = np.array([1, -sense * MU])
            trial = cone * -(1 + restitution) * speeds[0] / (rows @ by @ cone)[0]
            if sense * (speeds + rows @ by @ trial)[1] > 0:
                impulse = trial
                break
        return np.r_[x[:3], x[3:] + by @ impulse]

    def times(self, x):
        """Times of the events of the cycle."""
        time, found = 0.0, []
        for place, status, name in CYCLE:

            def ends(t, x, place=place, status=status, name=name):
                if name.endswith("touches"):
                    return self.at(x, status)[2]
                if name.endswith("stops"):
                    return -(self.at(x, place)[3] @ x[3:])[1]
                normal, along = self.accelerations(x, place, status)[1]
                return normal if name.endswith("opens") else MU * normal - abs(along)

            ends.terminal, ends.direction = True, -1
            run = solve_ivp(
                lambda t, x, place=place, status=status: np.r_[x[3:], self.accelerations(x, place, status)[0]],
                (time, time + 0.1),
                x,
                "DOP853",
                rtol=1e-10,
                atol=1e-13,
                events=ends,
            )
            time, x = run.t_events[0][0], run.y_events[0][0]
            if name.endswith("touches"):
                x = self.hit(x, status, 0.5 if status == "beak" else 0.0)
            found.append(time)
        return found


@pytest.mark.slow
def test_a_cycle_of_the_woodpecker():
    sleeve = mbd.Body("sleeve", mass=SLEEVE[0], inertia=SLEEVE[1])
    bird = mbd.Body("bird", mass=BIRD[0], inertia=BIRD[1], pose=(LM + LG, 0, 0))
    joints = [mbd.Constraint("on the pole", sleeve.x), mbd.Revolute("hinge", sleeve.at(LM, 0), bird.at(-LG, 0))]
    spring = mbd.Torque("spring", bird, STIFFNESS * (sleeve.phi - bird.phi), sleeve)
    pole, law = mbd.HalfPlane(mbd.ground.at(R0, 0, -np.pi / 2)), mbd.DryFriction(MU)
    contacts = [
        mbd.RigidContact(name, mbd.Point((sleeve, bird)[k].at(*at)), pole, law, 0.5 if k else 0.0)
        for name, (k, *at) in PLACES.items()
    ]
    toy = mbd.Mechanism([sleeve, bird], joints, forces=[mbd.Gravity(), spring, *contacts])
    start = [0.0, angle_at_pole(), -0.2788, -0.3411, 0.0, -7.4583]
    symbols = [sleeve.y, sleeve.phi, bird.phi, sleeve.vy, sleeve.omega, bird.omega]
    initial = [symbol == value for symbol, value in zip(symbols, start, strict=True)]
    motion = mbd.simulate(toy, np.linspace(0, 0.16, 81), initial=initial)
    assert [event.name for event in motion.events] == [name for *_, name in CYCLE]
    np.testing.assert_allclose([event.t for event in motion.events], ByHand().times(np.array(start)), atol=1e-8)

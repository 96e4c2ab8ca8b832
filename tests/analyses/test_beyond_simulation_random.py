"""Linear models, equilibria and sensitivities of random mechanisms against differences."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_case

import mbdcasadi as mbd

SEEDS = range(12)


def indices(eom, names):
    """Where named coordinates and rates stand among q and v."""
    rates = [s.name() for s in ca.vertsplit(eom.v)]
    return [eom.coordinate_names.index(n) if n in eom.coordinate_names else rates.index(n) for n in names]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_linear_model_of_a_random_motion(seed):
    case = random_case(seed)
    eom = mbd.equations(case.mechanism)
    dof = case.degrees_of_freedom
    inputs = {u: 0.3 * k + 0.2 for k, u in enumerate(case.mechanism.inputs)}
    generator = np.random.default_rng(seed)
    first = mbd.assemble(case.mechanism, inputs=inputs)
    model = mbd.linearize(case.mechanism, first, wrt=list(inputs))
    where = indices(eom, model.state_names[:dof])
    assert model.A.shape == (2 * dof + eom.z.numel(),) * 2
    w, rates, a = eom.q[where], eom.v[where], eom.a[where]
    # a motion at some speed, and states beside it
    speed = generator.uniform(-0.5, 0.5, dof)

    def at(x, given=inputs):
        conditions = [*(w[k] == x[k] for k in range(dof)), *(rates[k] == x[dof + k] for k in range(dof))]
        return mbd.assemble(case.mechanism, conditions, inputs=given)

    base = np.r_[np.atleast_1d(first[w]), speed]
    here = at(base)
    model = mbd.linearize(case.mechanism, here, wrt=list(inputs), coordinates=[w[k] for k in range(dof)])
    direction, step = generator.uniform(-1, 1, 2 * dof), 1e-5
    ends = [np.atleast_1d(at(base + s * step * direction)[ca.vertcat(rates, a)]) for s in (-1, 1)]
    found = model.A[: 2 * dof, : 2 * dof] @ direction
    size = 1 + np.max(np.abs(found))
    assert found == pytest.approx((ends[1] - ends[0]) / (2 * step), abs=2e-6 * size)
    for k, u in enumerate(inputs):
        ends = [np.atleast_1d(at(base, inputs | {u: inputs[u] + s})[a]) for s in (-0.1, 0.1)]
        assert model.B[dof : 2 * dof, k] == pytest.approx((ends[1] - ends[0]) / 0.2, abs=1e-7 * size)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_sensitivity_of_a_random_motion_to_its_start(seed):
    case = random_case(seed)
    eom = mbd.equations(case.mechanism)
    first = mbd.assemble(case.mechanism)
    model = mbd.linearize(case.mechanism, first)
    where = indices(eom, model.state_names[: case.degrees_of_freedom])
    starts = [*(eom.q[k] == first.q[k] for k in where), *(eom.v[k] == 0.2 for k in where)]
    times = np.linspace(0, 0.2, 5)
    tight = {"reltol": 1e-11, "abstol": 1e-11, "method": "erk"}
    output = eom.q[where[-1]]
    redundant = case.redundant > 0
    if redundant:  # the regularised form holds the constraints to some 1e-9 only
        tight = {"reltol": 1e-10, "abstol": 1e-10}
    found = mbd.sensitivities(case.mechanism, times, [output], wrt=[starts[0], starts[-1]], initial=starts, **tight)

    def run(k, change):
        moved = list(starts)
        value = first.q[where[0]] if k == 0 else 0.2
        symbol = eom.q[where[0]] if k == 0 else eom.v[where[-1]]
        moved[k] = symbol == value + change
        return mbd.simulate(case.mechanism, times, initial=moved, **tight)[output]

    for k in (0, -1):
        difference = (run(k, 1e-5) - run(k, -1e-5)) / 2e-5
        size = 1 + np.max(np.abs(difference))
        assert found[output, starts[k]] == pytest.approx(difference, abs=(1e-4 if redundant else 1e-5) * size)


#: Random mechanisms of which no constraint moves in time.
STILL = (1, 9, 11, 14, 22, 23, 24, 27, 28, 30)


@pytest.mark.slow
@pytest.mark.parametrize("seed", STILL)
def test_equilibrium_of_a_random_mechanism_does_no_virtual_work(seed):
    """With springs that hold every body there is an equilibrium; there the forces do no work on any free motion."""
    case = random_case(seed)
    assert not ca.depends_on(mbd.equations(case.mechanism).Phi, mbd.t)
    held = [
        force
        for k, body in enumerate(case.mechanism.bodies)
        for force in (
            mbd.TSDA(f"hold {k}", mbd.ground.at(-3, 4 + k), body.at(0, 0), stiffness=400, free_length=0.5),
            mbd.RSDA(f"turn {k}", mbd.ground.at(0, 0), body.at(0, 0), stiffness=100, free_angle=0.2),
        )
    ]
    model = case.mechanism.replace(forces=[mbd.Gravity(), *held])
    rest = mbd.equilibrium(model)
    eom = mbd.equations(model)
    free = np.linalg.svd(np.atleast_2d(rest[eom.Phi_q]))[2][-case.degrees_of_freedom :]
    assert free @ rest[eom.Q] == pytest.approx(0, abs=1e-7)
    assert rest[eom.Phi] == pytest.approx(0, abs=1e-11)
    assert rest[eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q] == pytest.approx(0, abs=1e-7)
    # the potential rises in every free direction: what stable means for forces that have one
    assert rest.stable
    growth = mbd.linearize(model, rest).eigenvalues.real
    assert np.max(growth) < 1e-5

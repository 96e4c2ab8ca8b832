"""What holds symbols is not pickled, and says what to do; it is copied, and its errors reach other processes."""

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import mbdcasadi as mbd


@pytest.fixture(scope="module")
def swing():
    """A pendulum and its motion."""
    model = mbd.library.pendulum_chain(1)
    return model, mbd.simulate(model.mechanism, np.linspace(0, 0.5, 6))


def test_what_holds_symbols_says_what_to_do(swing):
    """Alone, within other things, and in every protocol."""
    model, motion = swing
    mechanism = model.mechanism
    things = [
        model, mechanism, mechanism.bodies[0], mechanism.joints[0], mechanism.forces[0], mechanism.joints[0].markers[0],
        mbd.Input("u"), mbd.Parameter("k", 1.0), mbd.StateVariable("z"), mbd.Event("e", mechanism.bodies[0].x),
        motion, motion.initial, [motion], {"motion": motion},
    ]  # fmt: skip
    for thing in things:
        for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
            with pytest.raises(
                mbd.MechanismError, match="cannot be pickled.*the same function.*save, and read_trajectory"
            ):
                pickle.dumps(thing, protocol)


def test_sensitivities_say_what_to_do_and_are_copied():
    g = mbd.Parameter("g", 9.81)
    stone = mbd.Body("stone", mass=1, inertia=1)
    fall = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g])
    found = mbd.sensitivities(fall, [0, 1], outputs=[stone.y], wrt=[g])
    with pytest.raises(mbd.MechanismError, match="Sensitivities objects cannot be pickled"):
        pickle.dumps(found)
    assert np.array_equal(copy.copy(found)[stone.y, g], found[stone.y, g])


def test_what_is_made_of_numbers_is_pickled(swing):
    """Arrays and statistics of a motion, laws, and errors with what they say."""
    _, motion = swing
    assert pickle.loads(pickle.dumps(motion.statistics)) == motion.statistics
    assert np.array_equal(pickle.loads(pickle.dumps(motion.energy)).total, motion.energy.total)
    law = pickle.loads(pickle.dumps(mbd.HuntCrossley(1e5, damping=0.2)))
    assert law.stiffness == 1e5
    for method in (mbd.IDAS(options={"max_num_steps": 7}), mbd.BDF(1e-6, 1e-5), mbd.DOP853(max_step=0.1)):
        assert pickle.loads(pickle.dumps(method)).key == method.key


@pytest.mark.parametrize("kind", [mbd.SimulationError, mbd.Interrupted])
def test_errors_are_pickled_without_what_had_been_computed(swing, kind):
    error = kind("the run stopped", time=0.3, partial=swing[1])
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.time, again.partial, type(again)) == ("the run stopped", 0.3, None, kind)
    assert error.partial is swing[1]
    missed = pickle.loads(pickle.dumps(mbd.AssemblyError("no pose", residuals={"pin": 0.1})))
    assert missed.residuals == {"pin": 0.1}


def fails():
    """A run that stops part way, in another process."""
    model = mbd.library.slider_crank()
    return len(mbd.kinematics(model.driven(slider=0.2 + 0.5 * mbd.t), np.linspace(0, 2, 50)))


def runs():
    """A motion that should be returned as it is."""
    return mbd.simulate(mbd.library.pendulum_chain(1).mechanism, [0, 0.1])


@pytest.mark.slow
def test_a_process_pool_reports_both():
    """The error of a run as it is; a motion that is returned, by what to do instead."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        with pytest.raises(mbd.MechanismError, match="t = ") as said:
            pool.submit(fails).result()
        assert said.value.time is not None and said.value.partial is None
        with pytest.raises(Exception, match="read_trajectory"):
            pool.submit(runs).result()


def test_copies_are_copies(swing):
    """Of a motion its arrays; the mechanism stays the same."""
    model, motion = swing
    for again in (copy.copy(motion), copy.deepcopy(motion)):
        assert again is not motion and again.mechanism is motion.mechanism
        assert np.array_equal(again[model.mechanism.bodies[0].phi], motion[model.mechanism.bodies[0].phi])
        assert again.at([0.25]).q == pytest.approx(motion.at([0.25]).q)
    again = copy.deepcopy(motion)
    again.q[0] = 7
    assert motion.q[0, 0] != 7
    state = copy.deepcopy(motion.initial)
    assert state is not motion.initial and np.array_equal(state.q, motion.initial.q)
    assert copy.copy(model.mechanism) is model.mechanism


def test_results_that_keep_compiled_functions_are_copied_too():
    """Deep copies of linear models, derivatives and optimal motions give the same numbers."""
    torque, stiffness = mbd.Input("torque"), mbd.Parameter("stiffness", 6.0)
    rod = mbd.Body("rod", mass=1.2, inertia=0.05, pose=(0.35, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.35, 0))
    drive = mbd.Torque("drive", rod, torque - stiffness * hinge.angle)
    lever = mbd.Mechanism([rod], [hinge], forces=[mbd.Gravity(), drive], inputs=[torque], parameters=[stiffness])
    start, times = [hinge.angle == 0.3, rod.omega == 0], np.linspace(0, 1, 11)
    model = mbd.linearize(lever, mbd.equilibrium(lever), wrt=[torque], outputs=[hinge.angle])
    assert copy.deepcopy(model).modes()[0].frequency == model.modes()[0].frequency
    found = mbd.sensitivities(lever, times, [hinge.angle], [stiffness], start)
    assert np.array_equal(copy.deepcopy(found)[hinge.angle, stiffness], found[hinge.angle, stiffness])
    problem = mbd.OptimalControlProblem(lever, 1.0, start, [hinge.angle == 0], running_cost=torque**2)
    best = mbd.optimize(problem, intervals=10)
    again = copy.deepcopy(best)
    assert again is not best and again.cost == best.cost and again.verify().final_error < 1e-6
    assert np.array_equal(again.trajectory[torque], best.trajectory[torque])

"""Identification against known parameters, SciPy's least squares, and the statistics of noise."""

from __future__ import annotations

import numpy as np
import pytest
from keyboard import interrupted
from linkages import G, pendulum
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import mbdcasadi as mbd
from mbdcasadi.identification.loss import Loss
from mbdcasadi.identification.shooting import Shooting


def lever(k=6.0, c=0.15, first=0.4):
    """Rod on a torsional spring and damper; its length is 0.7 m and its mass 1.2 kg."""
    spring, damper = mbd.Parameter("k", k, lower=0.1, upper=50), mbd.Parameter("c", c, lower=0.0)
    start = mbd.Parameter("first", first)
    rod = mbd.Body("rod", mass=1.2, inertia=1.2 * 0.7**2 / 12, pose=(0.35, 0, 0))
    ends = mbd.ground.at(0, 0), rod.at(-0.35, 0)
    hinge = mbd.Revolute("hinge", *ends)
    forces = [mbd.Gravity(), mbd.RSDA("spring", *ends, stiffness=spring, damping=damper)]
    model = mbd.Mechanism(bodies=[rod], joints=[hinge], forces=forces, parameters=[spring, damper, start])
    return rod, hinge, model, (spring, damper, start)


def lever_by_hand(times, k, c, first, rate=0.0):
    inertia, weight = 1.2 * 0.7**2 / 3, 1.2 * G * 0.35
    run = solve_ivp(
        lambda t, y: [y[1], (-k * y[0] - c * y[1] - weight * np.cos(y[0])) / inertia],
        (times[0], times[-1]),
        [first, rate],
        method="DOP853",
        t_eval=times,
        rtol=1e-11,
        atol=1e-12,
    )
    return run.y


IRREGULAR = np.sort(np.r_[0.0, np.random.default_rng(3).uniform(0.01, 2.0, 60)])


@pytest.mark.slow
@pytest.mark.parametrize("segments", [1, 4, None])
def test_irregular_samples_with_gaps_against_least_squares_of_scipy(segments):
    rod, _, model, (k, c, first) = lever()
    record = lever_by_hand(IRREGULAR, 7.5, 0.3, 0.45)[0] + 2e-3 * np.random.default_rng(1).standard_normal(61)
    record[[5, 6, 30]] = np.nan
    released = [rod.phi == first, rod.omega == 0]
    fit = mbd.identify(model, IRREGULAR, {rod.phi: record}, [k, c, first], released, segments=segments)
    there = np.isfinite(record)
    best = least_squares(
        lambda x: (lever_by_hand(IRREGULAR, *x)[0] - record)[there], [6, 0.15, 0.4], xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    assert fit.values == pytest.approx(best.x, rel=2e-6)
    variance = 2 * best.cost / (58 - 3)
    assert fit.covariance == pytest.approx(np.linalg.inv(best.jac.T @ best.jac) * variance, rel=1e-3)
    assert fit.standard_error[k] == pytest.approx(np.sqrt(fit.covariance[0, 0]))
    assert np.isnan(fit.residuals[0][0, 5]) and fit.noise[0]["rod.phi"] == pytest.approx(2e-3, rel=0.2)
    assert fit.trajectory[rod.phi][there] == pytest.approx(fit.model[0][0][there], abs=1e-6)
    assert fit.identifiability == ()


@pytest.mark.slow
def test_standard_errors_cover_the_truth():
    """Over many records of noise the normalised errors have mean 0 and variance 1."""
    rod, _, model, (k, c, first) = lever()
    times = np.linspace(0, 1.5, 31)
    clean = lever_by_hand(times, 6.0, 0.15, 0.4)[0]
    generator = np.random.default_rng(11)
    scores = []
    for _ in range(25):
        data = {rod.phi: clean + 1e-3 * generator.standard_normal(31)}
        fit = mbd.identify(model, times, data, [k, c], [rod.phi == first], segments=1)
        scores.append([(fit[k] - 6.0) / fit.standard_error[k], (fit[c] - 0.15) / fit.standard_error[c]])
    scores = np.array(scores)
    assert np.all(np.abs(np.mean(scores, axis=0)) < 3 / np.sqrt(25))
    assert np.all((np.std(scores, axis=0) > 0.6) & (np.std(scores, axis=0) < 1.5))


@pytest.mark.slow
def test_several_experiments_and_quantities_of_different_noise():
    rod, hinge, model, (k, c, _) = lever()
    push = hinge.reaction_on(rod).force[0]
    generator = np.random.default_rng(5)
    experiments = []
    for name, angle, rate in (("low", 0.2, 0.0), ("kicked", -0.5, 2.0)):
        times = np.linspace(0, 1.2, 41)
        phi, omega = lever_by_hand(times, 8.0, 0.4, angle, rate)
        alpha = (-8 * phi - 0.4 * omega - 1.2 * G * 0.35 * np.cos(phi)) / (1.2 * 0.7**2 / 3)
        force = -1.2 * 0.35 * (np.sin(phi) * alpha + np.cos(phi) * omega**2)
        data = {rod.phi: phi + 1e-4 * generator.standard_normal(41), push: force + 0.2 * generator.standard_normal(41)}
        experiments.append(mbd.Experiment(times, data, [rod.phi == angle, rod.omega == rate], name=name))
    fit = mbd.identify(model, unknowns=[k, c], experiments=experiments)
    assert abs(fit[k] - 8.0) < 4 * fit.standard_error[k] < 0.05
    assert abs(fit[c] - 0.4) < 4 * fit.standard_error[c] < 0.02
    for noise in fit.noise:
        assert [*noise.values()] == pytest.approx([1e-4, 0.2], rel=0.4)
    figure = mbd.plot_residuals(fit)
    assert len(figure.axes) == 8 and figure.axes[0].get_title() == "low"
    figure = mbd.plot_residuals(fit, ["angle, rad", "bearing load, N"])
    assert {"angle, rad", "bearing load, N"} <= {axes.get_ylabel() for axes in figure.axes}
    with pytest.raises(mbd.MechanismError, match="labels= needs a text for each of 2 quantities"):
        mbd.plot_residuals(fit, ["angle, rad"])


def test_weights_and_missing_weight():
    """A sample of no weight does not count, however wrong it is."""
    rod, _, model, (k, c, first) = lever()
    times = np.linspace(0, 1, 21)
    record = lever_by_hand(times, 7.0, 0.2, 0.4)[0]
    wrong = record.copy()
    wrong[10] += 1.0
    weight = np.where(np.arange(21) == 10, 0.0, 1.0)
    released = [rod.phi == first]
    fit = mbd.identify(model, times, {rod.phi: wrong}, [k, c], released, weights={rod.phi: weight})
    assert fit.values == pytest.approx([7.0, 0.2], rel=1e-5)


@pytest.mark.slow
def test_limits_hold_and_are_told():
    rod, _, model, (_, c, first) = lever()
    times = np.linspace(0, 1, 21)
    soft = mbd.Parameter("k", 6.0, lower=0.1, upper=6.5)
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), rod.at(-0.35, 0), stiffness=soft, damping=c)
    bound = model.replace(forces=[mbd.Gravity(), spring], parameters=[soft, c, first])
    record = lever_by_hand(times, 7.0, 0.2, 0.4)[0]
    fit = mbd.identify(bound, times, {rod.phi: record}, [soft, c], [rod.phi == first])
    assert fit[soft] == 6.5 and fit.standard_error[soft] == 0
    assert "'k' is at its limit 6.5" in fit.identifiability[0]
    best = least_squares(lambda x: lever_by_hand(times, 6.5, x[0], 0.4)[0] - record, [0.1], xtol=1e-14, ftol=1e-14)
    assert fit[c] == pytest.approx(best.x[0], rel=1e-5)


@pytest.mark.slow
def test_led_segments_settle_at_once_where_a_single_shot_wanders():
    """A rod that balances upright and falls: small changes of the start decide on which side, and when."""
    gain, rate = mbd.Parameter("gain", 1.0), mbd.Parameter("rate", 0.0)
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0, 0.5, np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    push = mbd.Torque("push", rod, gain * mbd.sin(3 * mbd.t))
    stand = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity(), push], parameters=[gain, rate])
    times = np.linspace(0, 4, 81)
    upright = [rod.phi == np.pi / 2, rod.omega == rate]
    truth = {gain: 2.0, rate: -2.0 * 3 * 3 / (9 + 1.5 * G)}
    motion = mbd.simulate(stand, times, initial=upright, parameters=truth, method="erk", reltol=1e-11, abstol=1e-12)
    led, single = (
        mbd.identify(stand, times, {rod.phi: motion[rod.phi]}, [gain, rate], upright, segments=s) for s in (10, 1)
    )
    for fit in (led, single):
        assert fit.values == pytest.approx([2.0, truth[rate]], rel=1e-6)
    assert led.iterations < 10 < single.iterations


def test_what_cannot_be_distinguished_is_reported():
    """Of a compound pendulum the motion shows m h / J only, never mass and inertia apart."""
    mass, inertia = mbd.Parameter("mass", 1.0, lower=0.01), mbd.Parameter("inertia", 0.4, lower=0.001)
    spare = mbd.Parameter("spare", 3.0)
    rod = mbd.Body("rod", mass=mass, inertia=inertia, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    swing = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity()], parameters=[mass, inertia, spare])
    times = np.linspace(0, 1.5, 31)
    true = {mass: 1.5, inertia: 0.2}
    record = mbd.simulate(swing, times, parameters=true)[rod.phi]
    with pytest.warns(
        mbd.MechanismWarning, match="'mass' and 'inertia' cannot be distinguished|'inertia' and 'mass' cannot"
    ):
        fit = mbd.identify(swing, times, {rod.phi: record}, [mass, inertia])
    assert fit[mass] / fit[inertia] == pytest.approx(1.5 / 0.2, rel=1e-4)
    assert np.isinf(fit.standard_error[mass]) and "by +1 %" in fit.identifiability[0]
    with pytest.warns(mbd.MechanismWarning, match="'spare' leaves no trace in the data"):
        fit = mbd.identify(swing, times, {rod.phi: record}, [inertia, spare], parameters={mass: 1.5})
    assert fit[inertia] == pytest.approx(0.2, rel=1e-5) and np.isinf(fit.standard_error[spare])


@pytest.mark.slow
def test_closed_loop_with_a_length_to_find():
    """A four-bar whose rocker length is found from the angle of its crank alone."""
    from linkages import four_bar

    reach = mbd.Parameter("reach", 0.19, lower=0.15, upper=0.25)
    f = four_bar(0.8)
    c = mbd.Revolute("C", f.coupler.at(0.25, 0), f.rocker.at(reach, 0))
    linkage = f.mechanism.replace(joints=[f.A, f.B, c, f.D], forces=[mbd.Gravity()], parameters=[reach])
    times = np.linspace(0, 0.8, 33)
    released = [f.crank.phi == 0.8, f.crank.omega == 4]
    record = mbd.simulate(linkage, times, initial=released, parameters={reach: 0.21}, method="erk")[f.crank.phi]
    fit = mbd.identify(linkage, times, {f.crank.phi: record}, [reach], released)
    assert fit[reach] == pytest.approx(0.21, abs=1e-7)


def test_bad_data():
    p = pendulum()
    g = mbd.Parameter("g", G)
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    times, good = [0, 0.1, 0.2], {p.rod.phi: [0, 0.1, 0.2]}

    def refused(text, *args, **kwargs):
        with pytest.raises(mbd.ModelError, match=text):
            mbd.identify(model, *args, **kwargs)

    refused("unknowns= is empty", times, good)
    refused("data= is empty", times, {}, [g])
    refused(r"2 samples of 1 values are given for rod\.phi at 3 times", times, {p.rod.phi: [0, 1]}, [g])
    refused("a sample of rod.phi is infinite", times, {p.rod.phi: [0, np.inf, 1]}, [g])
    refused("every sample is missing", times, {p.rod.phi: [np.nan] * 3}, [g])
    refused("not among data=", times, good, [g], weights={p.rod.x: 1})
    refused("must be finite and not negative", times, good, [g], weights={p.rod.phi: -1})
    refused("'k', which is not in the mechanism", times, good, [mbd.Parameter("k", 1.0)])
    refused("segments must be a whole number from 1 to 2", times, good, [g], segments=9)
    refused("1 samples cannot determine", times, {p.rod.phi: [np.nan, 1, np.nan]}, [g, g])
    refused("are given in these", times, good, [g], experiments=[mbd.Experiment(times, good)])
    with pytest.raises(mbd.ModelError, match="'g' was not among|was not among the unknowns"):
        fit = mbd.identify(model, times, good, [g])
        fit[mbd.Parameter("other", 1.0)]


def test_what_is_no_number_and_what_is_named_twice():
    p = pendulum()
    g = mbd.Parameter("g", G)
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    times, data = [0, 0.1, 0.2], {p.rod.phi: [0, -0.07, -0.3]}
    for text, given in {
        "'g' twice": {"unknowns": [g, g], "times": times, "data": data},
        "weights must be numbers": {"unknowns": [g], "times": times, "data": data, "weights": {p.rod.phi: "a"}},
        "list of Experiment": {"unknowns": [g], "experiments": 3},
        "iterations must be": {"unknowns": [g], "times": times, "data": data, "iterations": "a"},
    }.items():
        with pytest.raises(mbd.ModelError, match=text):
            mbd.identify(model, **given)


@pytest.mark.filterwarnings("error")
def test_a_quantity_without_any_sample():
    p = pendulum()
    g = mbd.Parameter("g", 9.0)
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    times = np.linspace(0, 0.5, 11)
    record = mbd.simulate(model, times, parameters={g: G})[p.rod.phi]
    fit = mbd.identify(model, times, {p.rod.phi: record, p.rod.x: np.full(11, np.nan)}, [g])
    assert fit[g] == pytest.approx(G, rel=1e-5) and np.isnan(fit.noise[0]["rod.x"])
    mbd.plot_residuals(fit)


# --- jumps ----------------------------------------------------------------------------------------
def switched_sled():
    """A sled under a force that is given up at a time, and braked beyond a place."""
    end, place, size = mbd.Parameter("end", 0.5), mbd.Parameter("place", 1.2), mbd.Parameter("size", 2.0)
    sled = mbd.Body("sled", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    push = mbd.Force("push", sled.at(0, 0), (mbd.if_else(mbd.t < end, size, -0.3), 0))
    brake = mbd.Force("brake", sled.at(0, 0), (mbd.if_else(sled.x > place, -2, 0), 0))
    model = mbd.Mechanism(bodies=[sled], joints=[rail], forces=[push, brake], parameters=[end, place, size])
    return sled, model, (end, place, size)


def switched_by_hand(times, end, place, size):
    """Place of the sled from rest, in three pieces of constant force; past the end of the push it is braked."""
    speed, x = size * end, size * end**2 / 2
    s = np.maximum(times - end, 0)
    braked = (speed - np.sqrt(speed**2 - 2 * 0.3 * (place - x))) / 0.3
    late = np.maximum(s - braked, 0)
    free = np.minimum(s, braked)
    v = speed - 0.3 * braked
    first = size * np.minimum(times, end) ** 2 / 2
    return first + speed * free - 0.15 * free**2 + v * late - 2.3 * late**2 / 2


@pytest.mark.slow
@pytest.mark.parametrize("segments", [None, 1])
def test_a_switching_time_and_a_switching_place(segments):
    """Against a fit of the closed form by SciPy, with the same noise: values and standard errors."""
    sled, model, unknowns = switched_sled()
    times, true = np.linspace(0, 2, 81), [0.63, 1.5, 2.5]
    record = switched_by_hand(times, *true) + 1e-3 * np.random.default_rng(0).standard_normal(81)
    fit = mbd.identify(model, times, {sled.x: record}, unknowns, [sled.x == 0, sled.vx == 0], segments=segments)
    best = least_squares(lambda x: switched_by_hand(times, *x) - record, true, xtol=1e-14, ftol=1e-14)
    errors = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)) * 2 * best.cost / (81 - 3))
    assert fit.values == pytest.approx(best.x, rel=1e-5) and not fit.identifiability
    assert [fit.standard_error[u] for u in unknowns] == pytest.approx(errors, rel=1e-3)


# --- outliers ---------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("loss", ["huber", "soft_l1"])
def test_a_robust_loss_against_scipy(loss):
    """Gravity from a fall with outliers: SciPy's fit of the closed form at the same noise and the same scale."""
    g = mbd.Parameter("g", 5.0)
    stone = mbd.Body("stone", mass=1, inertia=1)
    fall = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g])
    times, generator = np.linspace(0, 2, 61), np.random.default_rng(3)
    record = -9.81 * times**2 / 2 + 0.01 * generator.standard_normal(61)
    record[[5, 20, 41, 58]] += [0.5, -0.8, 0.6, 1.0]
    fit = mbd.identify(fall, times, {stone.y: record}, [g], loss=loss, f_scale=1.5)
    noise = fit.noise[0]["stone.y"]
    assert noise == pytest.approx(0.01, rel=0.25)
    best = least_squares(lambda x: -x[0] * times**2 / 2 - record, [9.0], loss=loss, f_scale=1.5 * noise, xtol=1e-14)
    # the scale is that of the last round but one, within one per cent of the noise
    assert fit[g] == pytest.approx(best.x[0], abs=0.02 * fit.standard_error[g])
    squares = mbd.identify(fall, times, {stone.y: record}, [g])
    assert abs(squares[g] - 9.81) > 5 * abs(fit[g] - 9.81)
    assert squares.standard_error[g] > 5 * fit.standard_error[g] and fit.loss == loss


@pytest.mark.slow
def test_standard_errors_of_a_robust_fit_are_those_of_its_scatter():
    """Two hundred falls with one outlier in ten: deviations in standard errors have a variance of one."""
    g, speed = mbd.Parameter("g", 9.0), mbd.Parameter("speed", 3.0)
    times = np.linspace(0, 2, 60)
    design = np.column_stack([-(times**2) / 2, times])
    scores = []
    for seed in range(200):
        generator = np.random.default_rng(seed)
        noise = 0.01 * generator.standard_normal(60)
        noise[generator.choice(60, 6, replace=False)] += 0.2 * generator.choice([-1, 1], 6)
        best = least_squares(lambda x, e=noise: design @ x - e, [0.0, 0.0], loss="huber", f_scale=0.01345, xtol=1e-12)
        residual = (design @ best.x - noise) / 0.01
        variance = Loss("huber", 1.345).variance(residual, 2)
        errors = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design))) * 0.01
        scores.append(best.x / errors)
    assert np.mean(np.array(scores) ** 2, axis=0) == pytest.approx(1.0, abs=0.25)
    # and of one fit of the package
    stone = mbd.Body("stone", mass=1, inertia=1)
    thrown = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g, speed])
    record = design @ [9.81, 4.0] + noise
    fit = mbd.identify(thrown, times, {stone.y: record}, [g, speed], [stone.vy == speed], loss="huber")
    assert [fit.standard_error[u] for u in (g, speed)] == pytest.approx(errors, rel=0.3)
    assert fit.values == pytest.approx([9.81, 4.0], abs=4 * errors.max())


@pytest.mark.slow
def test_weights_and_a_robust_loss_need_no_common_factor():
    g = mbd.Parameter("g", 5.0)
    stone = mbd.Body("stone", mass=1, inertia=1)
    fall = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g])
    times, generator = np.linspace(0, 2, 61), np.random.default_rng(3)
    record = -9.81 * times**2 / 2 + 0.01 * generator.standard_normal(61)
    record[[5, 41]] += [0.5, 0.6]
    fits = [mbd.identify(fall, times, {stone.y: record}, [g], weights={stone.y: w}, loss="huber") for w in (1.0, 1e4)]
    assert fits[0][g] == pytest.approx(fits[1][g], rel=1e-9)
    assert fits[0].standard_error[g] == pytest.approx(fits[1].standard_error[g], rel=1e-6)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"loss": "cauchy"}, "loss must be one of linear, huber, soft_l1"),
        ({"loss": "huber", "f_scale": 0}, "f_scale must be positive"),
        ({"loss": "huber", "f_scale": "a"}, "f_scale must be a number"),
    ],
)
def test_losses_that_are_refused(given, text):
    p, g = pendulum(), mbd.Parameter("g", G)
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    with pytest.raises(mbd.ModelError, match=text):
        mbd.identify(model, [0, 0.1, 0.2], {p.rod.phi: [0, -0.07, -0.3]}, [g], **given)


# --- Ctrl-C ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("delay", [0.05, 0.6, 1.2])
def test_ctrl_c_keeps_the_best_fit_so_far(delay):
    rod, _, model, (k, c, first) = lever()
    times = np.linspace(0, 2, 401)
    record = lever_by_hand(times, 7.0, 0.2, 0.4)[0]

    def again_and_again():  # until it comes, wherever that is
        for _ in range(50):
            mbd.identify(model, times, {rod.phi: record}, [k, c], [rod.phi == first], reltol=1e-12, abstol=1e-12)

    partial = interrupted(again_and_again, delay * 2.0 ** np.arange(8)).partial
    assert partial is None or np.all(np.isfinite(partial.values))


def test_ctrl_c_after_the_first_steps_has_a_fit(monkeypatch):
    rod, _, model, (k, c, first) = lever()
    times = np.linspace(0, 1, 41)
    record = lever_by_hand(times, 7.0, 0.2, 0.4)[0]
    real, calls = Shooting.linearise, []

    def counted(self, theta):
        calls.append(theta)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return real(self, theta)

    monkeypatch.setattr(Shooting, "linearise", counted)
    with pytest.raises(mbd.Interrupted, match="after 2 steps") as caught:
        mbd.identify(model, times, {rod.phi: record}, [k, c], [rod.phi == first])
    assert caught.value.partial.values == pytest.approx(calls[2])
    assert caught.value.partial.standard_error[k] > 0


@pytest.mark.slow
def test_data_that_the_model_cannot_follow_take_no_more_steps():
    """If closing the gaps makes the residuals larger, the penalty of the gaps outweighs it: full steps are taken."""
    damping, weight = mbd.Parameter("damping", 0.3), mbd.Parameter("weight", 9.0)
    p = pendulum(
        forces=lambda rod: [
            mbd.Torque("damper", rod, -damping * rod.omega), mbd.Force("rest of weight", rod.at(0, 0), (0, G - weight))
        ],
        parameters=[damping, weight],
    )  # fmt: skip
    times, start = np.linspace(0, 2, 41), [p.rod.phi == -0.3, p.rod.omega == 2]
    motion = mbd.simulate(p.mechanism, times, initial=start, parameters={damping: 0.1, weight: G})
    seen = motion[p.rod.phi] + 0.01 * np.sin(37 * times)
    fits = [
        mbd.identify(p.mechanism, times, {p.rod.phi: seen}, [damping, weight], start, segments=segments, method="erk")
        for segments in (5, 1)
    ]
    assert fits[0].iterations <= 6
    np.testing.assert_allclose(fits[0].values, fits[1].values, rtol=1e-7)


@pytest.mark.slow
def test_a_standing_double_pendulum_from_a_tenth_of_its_springs():
    """It falls with the first values, within a tenth of the samples."""
    true = (150.0, 12.0, 60.0, 5.0)
    unknowns = [mbd.Parameter(f"p{k}", 0.1 * value, lower=0, upper=1e4) for k, value in enumerate(true)]
    legs = mbd.Body("legs", 5, 0.4, pose=(0, 0.5, np.pi / 2))
    trunk = mbd.Body("trunk", 3, 0.2, pose=(0, 1.4, np.pi / 2))
    ankle, hip = (mbd.ground.at(0, 0), legs.at(-0.5, 0)), (legs.at(0.5, 0), trunk.at(-0.4, 0))
    k1, c1, k2, c2 = unknowns
    springs = [
        mbd.RSDA("ankle spring", *ankle, stiffness=k1, free_angle=np.pi / 2, damping=c1),
        mbd.RSDA("hip spring", *hip, stiffness=k2, damping=c2),
    ]
    joints = [mbd.Revolute("ankle", *ankle), mbd.Revolute("hip", *hip)]
    model = mbd.Mechanism([legs, trunk], joints=joints, forces=[mbd.Gravity(), *springs], parameters=unknowns)
    start = [legs.phi == np.pi / 2 + 0.03, trunk.phi == np.pi / 2 - 0.02, legs.omega == 0, trunk.omega == 0]
    times = np.linspace(0, 4, 201)
    seen = mbd.simulate(model, times, initial=start, parameters=dict(zip(unknowns, true, strict=True)))
    fit = mbd.identify(model, times, {legs.phi: seen[legs.phi], trunk.phi: seen[trunk.phi]}, unknowns, start)
    np.testing.assert_allclose(fit.values, true, rtol=1e-5)

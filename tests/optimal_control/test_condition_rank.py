"""Conditions that say what solved constraints say already."""

import pytest

import mbdcasadi as mbd
from mbdcasadi import at_end, at_start


@pytest.mark.parametrize("where", ["boundary", "waypoint on an acceleration", "waypoint on a reaction"])
def test_what_holds_anyway_does_no_harm(where):
    """A cart on a rail, rest to rest over one metre: 12 m² d² / T³, whether or not its angle is spoken of."""
    cart, force = mbd.Body("cart", mass=5.0, inertia=1.0), mbd.Input("F", lower=-60, upper=60)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    push = mbd.Force("push", cart.at(0, 0), (force, 0))
    mechanism = mbd.Mechanism(bodies=[cart], joints=[rail], forces=[mbd.Gravity(), push], inputs=[force])
    more = {
        "boundary": dict(boundary=[at_end(cart.phi) == at_start(cart.phi)]),
        "waypoint on an acceleration": dict(waypoints=[mbd.Waypoint(0.5, [cart.ay == 0])]),
        "waypoint on a reaction": dict(waypoints=[mbd.Waypoint(0.5, [rail.reaction_on(cart).torque == 0])]),
    }[where]
    problem = mbd.OptimalControlProblem(
        mechanism, 1.5, [cart.x == 0, cart.vx == 0], [cart.x == 1, cart.vx == 0], running_cost=force**2, **more
    )
    assert mbd.optimize(problem, intervals=15).cost == pytest.approx(12 * 5.0**2 / 1.5**3, rel=1e-6)

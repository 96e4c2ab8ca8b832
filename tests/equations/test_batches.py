"""Elements whose expressions differ in numbers alone."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.equations.batches import Values, batches_of


def parts(element):
    """Displacements and forces of an element as two columns."""
    return [ca.vertcat(ca.SX(0, 1), *[ca.vec(ca.SX(pair[k])) for pair in element.virtual_work]) for k in (0, 1)]


def bodies(count):
    return [mbd.Body(f"b{k}", mass=1.0 + k, inertia=0.1, pose=(0.3 * k, 0.1 * k, 0.2 * k)) for k in range(count)]


def spring(name, a, b, **numbers):
    return mbd.TSDA(name, a.at(0.1, 0.0), b.at(-0.2, 0.05), **numbers)


def test_springs_with_other_numbers_are_one_batch():
    """Three springs between other bodies and with other numbers give one batch, a contact another one."""
    b = bodies(4)
    springs = [spring(f"s{k}", b[k], b[k + 1], stiffness=100.0 + k, free_length=0.2 + 0.1 * k) for k in range(3)]
    floor = mbd.Contact(
        "floor", mbd.Circle(b[0].at(0, 0), 0.3), mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.HuntCrossley(1e4)
    )
    eom = mbd.equations(mbd.Mechanism(b, forces=[*springs, floor]))
    found = batches_of(eom, Values(eom), [*springs, floor], parts)
    assert [batch.numbers.tolist() for batch in found] == [[0, 1, 2], [3]]


def test_a_batch_evaluates_to_the_elements_own_values():
    """Values of a batch are those of the elements' own expressions to the last bit, at all and at chosen moments."""
    b = bodies(5)
    law = mbd.HuntCrossley(1e4, damping=0.3)
    discs = [mbd.Circle(body.at(0.01 * k, 0), 0.2 + 0.01 * k) for k, body in enumerate(b)]
    pairs = [
        mbd.Contact(f"c{j}{k}", discs[j], discs[k], law, mbd.Coulomb(0.2 + 0.1 * j, 1e-3))
        for k in range(5)
        for j in range(k)
    ]
    eom = mbd.equations(mbd.Mechanism(b, forces=pairs))
    values, rng, n = Values(eom), np.random.default_rng(3), eom.q.numel()
    table = values.table(
        np.zeros(4), rng.normal(size=(4, n)) / 5, rng.normal(size=(4, n)), np.zeros((4, 0)), np.zeros(0)
    )
    q, v = table[1 : 1 + n], table[1 + n : 1 + 2 * n]
    batches = batches_of(eom, values, pairs, parts)
    assert sum(batch.numbers.size for batch in batches) == len(pairs) > len(batches)
    for batch in batches:
        function = batch.function("parts", ca.vertcat(*batch.parts))
        found = batch.evaluated(function, table)
        for row, number in enumerate(batch.numbers):
            own = ca.Function("own", [eom.q, eom.v], [ca.densify(ca.vertcat(*parts(pairs[number])))])
            np.testing.assert_array_equal(found[row], own(q, v).full())
        chosen = rng.integers(batch.numbers.size, size=4)
        np.testing.assert_array_equal(batch.evaluated(function, table, chosen)[0], found[chosen, :, np.arange(4)].T)


def test_rates_of_a_batch_follow_the_chain_rule():
    """The rate of an expression in positions, time and parameters is its change along the velocities."""
    body, other = bodies(2)
    rest = mbd.Parameter("rest", 0.4)
    springs = [spring(f"s{k}", body, other, stiffness=10.0 + k, free_length=rest * (1 + mbd.t)) for k in range(2)]
    eom = mbd.equations(mbd.Mechanism([body, other], forces=springs, parameters=[rest]))
    values, rng = Values(eom), np.random.default_rng(4)
    (batch,) = batches_of(eom, values, springs, parts)
    q, v = rng.normal(size=(1, 6)), rng.normal(size=(1, 6))
    table = values.table(np.array([0.7]), q, v, np.zeros((1, 0)), np.array([0.4]))
    displacement, _ = batch.parts
    rate = batch.evaluated(batch.function("rate", batch.rate(displacement)), table)
    step = 1e-6
    place = batch.function("place", displacement)
    ahead, behind = (
        batch.evaluated(place, values.table(np.array([0.7 + s]), q + s * v, v, np.zeros((1, 0)), np.array([0.4])))
        for s in (step, -step)
    )
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * step), atol=1e-8)


def test_elements_that_belong_to_bodies_otherwise_are_another_batch():
    """The same formula in coordinates of one body and of two is not one batch: bounds of speeds differ."""
    a, b = bodies(2)
    law = mbd.HuntCrossley(1e4)
    alone = mbd.EndStop("alone", 1 - a.x * a.y, law)
    both = mbd.EndStop("both", 1 - a.x * b.y, law)
    eom = mbd.equations(mbd.Mechanism([a, b], forces=[alone, both]))
    assert len(batches_of(eom, Values(eom), [alone, both], parts)) == 2


def test_a_symbol_of_another_mechanism_is_named():
    a, b = bodies(2)
    eom = mbd.equations(mbd.Mechanism([a], forces=[mbd.Gravity()]))
    with pytest.raises(mbd.ExpressionError, match="b1"):
        batches_of(eom, Values(eom), [b], lambda body: [body.x * 2])


def test_what_differs_in_its_bodies_alone_is_looked_at_once():
    """Contacts that are alike have the batches that they have one by one; other numbers and laws are not alike."""
    b, ask = bodies(5), []
    law, rough = mbd.HuntCrossley(1e4, damping=0.3), mbd.Coulomb(0.2, 1e-3)
    radius = mbd.Parameter("radius", 0.1)
    discs = [mbd.Circle(body.at(0.01, 0), radius if k < 3 else 0.2) for k, body in enumerate(b)]
    floors = [mbd.HalfPlane(mbd.ground.at(x, 0)) for x in (0.0, 1.0)]
    forces = [
        mbd.Contact(f"f{k}{j}", disc, floor, law) for j, floor in enumerate(floors) for k, disc in enumerate(discs)
    ]
    forces += [mbd.Contact(f"c{j}{k}", discs[j], discs[k], law, rough) for k in range(5) for j in range(k)]
    forces += [mbd.Contact("other", discs[0], discs[1], mbd.HuntCrossley(1e4, damping=0.3), rough)]
    eom = mbd.equations(mbd.Mechanism(b, forces=forces, parameters=[radius]))

    def parts_asked(element):
        ask.append(element)
        return parts(element)

    class Own:
        """An element that is not known to be like others."""

        def __init__(self, element):
            self.virtual_work, self.bodies = element.virtual_work, element.bodies

    values = Values(eom)
    found = batches_of(eom, values, forces, parts_asked)
    alone = batches_of(eom, values, [Own(element) for element in forces], parts)
    assert len(ask) == len({element.likeness_of_expressions for element in forces}) == 2 * 2 + 3 + 1
    assert [batch.numbers.tolist() for batch in found] == [batch.numbers.tolist() for batch in alone]
    for one, other in zip(found, alone, strict=True):
        np.testing.assert_array_equal(one.places, other.places)
        np.testing.assert_array_equal(one.constants, other.constants)

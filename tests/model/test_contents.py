"""Contents of models: equal for a model that is stated again, different for anything that is changed in it."""

import functools
import math

import numpy as np
import pytest
from machines import MACHINES

import mbdcasadi as mbd
from mbdcasadi.errors import warn
from mbdcasadi.model.cache import Cache
from mbdcasadi.model.contents import contents_of, values_of_contents
from mbdcasadi.model.element import Element


def pendulum(mass=1.0, name="bob", point=-0.5, upper=20.0, gravity=9.81, pose=0.0, load="torque", on="arm", **more):
    """A pendulum of two bars with a torque."""
    arm = mbd.Body("arm", mass=2.0, inertia=0.1, pose=(0, -0.5, pose))
    bob = mbd.Body(name, mass=mass, inertia=0.1, pose=(0, -1.5, 0))
    torque = mbd.Input("u", upper=upper)
    k = mbd.Parameter("k", more.get("stiffness", 3.0))
    joints = [
        mbd.Revolute("first", mbd.ground.at(0, 0), arm.at(0, 0.5)),
        mbd.Revolute("second", arm.at(0, point), bob.at(0, 0.5)),
    ]
    body = arm if on == "arm" else bob
    power = {"torque": torque, "spring": torque - k * body.phi, "damper": torque - k * body.omega}[load]
    forces = [mbd.Gravity((0, -gravity)), mbd.Torque("motor", body, power)]
    return mbd.Mechanism([arm, bob], joints, forces=forces, inputs=[torque], parameters=[k])


CHANGES = [
    {"mass": math.nextafter(1.0, 2.0)},
    {"name": "weight"},
    {"point": -0.5001},
    {"upper": 19.0},
    {"gravity": 9.8},
    {"pose": 0.1},
    {"pose": -0.0},
    {"load": "spring"},
    {"load": "damper"},
    {"load": "spring", "on": "bob"},
    {"on": "bob"},
    {"stiffness": 4.0},
]


@pytest.mark.parametrize("change", CHANGES, ids=str)
def test_a_model_stated_again_is_alike_and_a_changed_one_is_not(change):
    """One number, name, place of a symbol or the sign of a zero is a difference."""
    assert contents_of(pendulum()) is not None
    assert contents_of(pendulum(**change)) == contents_of(pendulum(**change)) != contents_of(pendulum())


@pytest.mark.slow
def test_machines_with_every_element_differ_from_each_other_alone():
    """Each of the catalogue is alike if it is stated again."""
    contents = {name: contents_of(machine().mechanism) for name, machine in MACHINES.items()}
    assert all(contents[name] == contents_of(machine().mechanism) for name, machine in MACHINES.items())
    known = [x for x in contents.values() if x is not None]
    assert len(set(known)) == len(known) > 0.9 * len(MACHINES)


def test_what_is_made_on_demand_does_not_count():
    """Expressions that an element makes when they are asked for, and what is compiled for a mechanism."""
    used = pendulum()
    mbd.simulate(used, duration=0.01)
    _ = used.bodies[0].position, used.joints[0].impulses
    assert contents_of(used) == contents_of(pendulum())


STRENGTH = 2.0


class Magnet(Element):
    """A force of an own class, which reads a global and an attribute of its class when it is asked for."""

    factor = 1.0

    def __init__(self, body):
        super().__init__("magnet")
        self.body = body

    @property
    def virtual_work(self):
        return ((self.body.x, -STRENGTH * self.factor * self.body.x),)


def test_what_own_classes_and_functions_read_besides_is_not_known(monkeypatch):
    """A global that has changed is another model: nothing is shared, and each is simulated as it is."""
    found = []
    for strength, factor in [(2.0, 1.0), (8.0, 1.0), (2.0, 4.0)]:
        monkeypatch.setitem(globals(), "STRENGTH", strength)
        monkeypatch.setattr(Magnet, "factor", factor)
        block = mbd.Body("block", mass=1.0, inertia=1.0, pose=(1.0, 0, 0))
        mechanism = mbd.Mechanism([block], forces=[Magnet(block)])
        assert contents_of(mechanism) is None
        found.append(mbd.simulate(mechanism, [0, 0.5], method="dop853").final[block.x])
    assert found == pytest.approx([np.cos(0.5 * np.sqrt(2)), np.cos(0.5 * np.sqrt(8)), np.cos(0.5 * np.sqrt(8))])


def closure(number):
    """A function that holds a number."""
    return lambda: number


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({1, 2}, {1, 3}),
        (np.array([0.0, 1.0]), np.array([0, 1])),
        (1, True),
        ([1, 2], (1, 2)),
        ({"a": 1}, {"b": 1}),
        (mbd.Body, Element),
    ],
    ids=["sets", "arrays", "types of numbers", "sequences", "mappings", "classes"],
)
def test_types_and_numbers_count(one, other):
    """Sequences, arrays and classes."""
    assert contents_of(one) == contents_of(one) != contents_of(other)


def of_text(name):
    """Function, class and object that a text defines, which belongs to no module."""
    names = {}
    exec("def function(): pass\nclass Kind: pass\nobject = Kind()", names)
    return names[name]


@pytest.mark.parametrize(
    "tag",
    [
        closure(1),
        functools.partial(print, 1),
        iter([1]),
        type("Bag", (dict,), {})(a=1),
        Magnet,
        *map(of_text, ("function", "Kind", "object")),
    ],
    ids=["function", "partial", "iterator", "kind of dict", "own class", "text", "class of a text", "object of a text"],
)
def test_state_that_attributes_do_not_show_is_not_known(tag):
    """Nothing is shared then."""
    assert contents_of(tag) is None
    assert values_of_contents(None) is not values_of_contents(None)


def test_symbols_that_no_key_tells_apart_are_not_known():
    """An expression may contain the symbols that are named, and no others."""
    x, y, other_x, other_y = (mbd.Input(name) for name in "xyxy")
    assert contents_of(x / y, symbols=[x, y]) == contents_of(other_x / other_y, symbols=[other_x, other_y])
    assert contents_of(x / y, symbols=[x, y]) != contents_of(y / x, symbols=[x, y])
    assert contents_of(x / y, symbols=[x]) is None


def test_a_value_with_a_warning_is_not_kept():
    """The warning is given again with the value."""
    cache, made = Cache(), []

    def make():
        made.append(1)
        warn("remark")
        return 3.0

    for _ in range(2):
        with pytest.warns(mbd.MechanismWarning, match="remark"):
            assert cache.get_or_create_quietly("key", make) == 3.0
    assert len(made) == 2
    assert [cache.get_or_create_quietly("other", lambda: made.append(1)) for _ in range(2)] == [None, None]
    assert len(made) == 3

"""The widget of a live page: values to the page and back, and what it refuses; in a browser without a notebook."""

import json
import sys

import pytest

import mbdcasadi as mbd
from mbdcasadi.visual.page import widget as module

#: A model as a notebook has it, with the parts that a widget uses.
MODEL = """
(async ({ code, data }) => {
  const handlers = {}, state = data;
  window.model = {
    state, saved: 0, get: name => state[name], save_changes() { this.saved++; },
    on(name, f) { (handlers[name] ||= []).push(f); },
    set(name, value) { state[name] = value; for (const f of handlers["change:" + name] || []) f(); },
  };
  const { default: widget } = await import(URL.createObjectURL(new Blob([code], { type: "text/javascript" })));
  widget.render({ model, el: document.body });
})
"""


@pytest.fixture
def page():
    """The page of a crank with a torque."""
    torque = mbd.Input("torque, N m", 0.5, lower=-3, upper=3)
    crank = mbd.Body("crank", mass=0.5, inertia=1e-3, pose=(0.05, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), crank.at(-0.05, 0))
    motor = mbd.Torque("motor", crank, torque)
    return mbd.animate(mbd.Mechanism([crank], [pin], forces=[mbd.Gravity(), motor], inputs=[torque]), live=True)


def test_values_go_both_ways(page, browser):
    """A value that the notebook sets moves the slider; one that the page sets arrives, with time and state."""
    code = (module.files(module.__package__) / "template" / "live" / "widget.js").read_text(encoding="utf-8")
    data = {"html": page.html, "height": 500, "values": {"torque, N m": 1.5}, "playing": False}
    tab = browser.new_page()
    tab.evaluate(f"{MODEL}({json.dumps({'code': code, 'data': data})})")
    tab.wait_for_function("model.state.q && model.state.q.length === 3")
    frame = tab.frames[1]
    assert frame.evaluate("mechanism.values()") == {"torque, N m": 1.5}
    tab.evaluate("model.set('values', { 'torque, N m': -2 })")
    frame.wait_for_function("mechanism.values()['torque, N m'] === -2")
    frame.evaluate("mechanism.run(0.1); mechanism.set('torque, N m', 0.25)")
    tab.wait_for_function("model.state.values['torque, N m'] === 0.25 && model.saved > 0")
    assert tab.evaluate("model.state.time") == pytest.approx(0.1)
    tab.evaluate("model.set('playing', true)")
    frame.wait_for_function("mechanism.playing && mechanism.time > 0.2")
    tab.close()


def test_a_widget_takes_values_of_its_sliders_alone(page):
    """Others are refused by name, and by their limits."""
    pytest.importorskip("anywidget", reason="anywidget is not installed (pip install .[notebook])")
    widget = page.widget()
    assert widget.values == {"torque, N m": 0.5}
    widget.values = {"torque, N m": 2.0}
    wrong = [("couple", 1.0, "no slider 'couple'"), ("torque, N m", 4.0, "from -3 to 3, got 4")]
    for name, value, message in [*wrong, ("torque, N m", "2", "must be a number, got '2'")]:
        with pytest.raises(mbd.MechanismError, match=message):
            widget.values = {name: value}
    assert widget.values == {"torque, N m": 2.0}


def test_without_anywidget_it_says_what_to_install(page, monkeypatch):
    """By name of the extra."""
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(mbd.MechanismError, match=r"widget needs anywidget.*mbdcasadi\[notebook\]"):
        page.widget()

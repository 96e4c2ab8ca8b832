"""Pages that solve a mechanism: size, frames a second, constraints, and the difference to `simulate`.

    python benchmarks/live_pages.py
    python benchmarks/live_pages.py four-bar "Jansen's leg" --models FOLDER

Every page runs two seconds in a headless Chromium (Playwright's own, or the one on the path), as fast as it can, and
is compared with :func:`mbdcasadi.simulate` at a tolerance of 1e-12 (IDAS: 1e-11); then it plays for two seconds while
frames are counted, and the time that the browser spends in scripts, of which a frame of sixty a second has 16.7 ms. A
frame is also timed on its own, as the median of clicks on "step", which solve a thirtieth of a second and draw: other
work on the machine changes that less. ``--models`` adds the model files (``.adm``) of a folder.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine

import mbdcasadi as mbd

SECONDS = 2.0
HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results" / "live_pages.json"
COLUMNS = (
    "mechanism", "bodies", "kB", "s to run 2 s", "frames a second", "ms of scripts a frame", "ms a step", "residual",
    "difference",
)  # fmt: skip
LINE = (
    "| {name} | {bodies} | {kB:.0f} | {run:.2f} | {frames:.0f} | {script:.1f} | {step:.1f} | {violation:.0e} "
    "| {error:.0e} |"
)
#: Frames a second as the page sees them, while it plays.
FRAMES = """new Promise(done => { mechanism.play(); let n = 0; const t0 = performance.now();
  (function tick() { n += 1; const t = performance.now() - t0;
    t > 2000 ? (mechanism.pause(), done(1000 * n / t)) : requestAnimationFrame(tick); })(); })"""

#: Median of the milliseconds in which the page solves a thirtieth of a second and draws.
STEP = """(() => { const times = []; for (let k = 0; k < 60; k++) { const t0 = performance.now();
  document.getElementById("step").click(); times.push(performance.now() - t0); }
  return times.sort((a, b) => a - b)[30]; })()"""

Model = tuple[mbd.Mechanism, list]


def _library() -> dict[str, Callable[[], Model]]:
    library = mbd.library

    def turning(model: Any, rate: float, body: Any = None) -> Model:
        body = model.mechanism.bodies[0] if body is None else body
        return model.mechanism, [body.omega == rate]

    def chain(count: int) -> Model:
        model = library.pendulum_chain(count)
        return turning(model, 3.0)

    return {
        "four-bar": lambda: turning(library.four_bar(), 5.0),
        "five-bar": lambda: (library.five_bar().mechanism, []),
        "slider-crank": lambda: turning(library.slider_crank(), 10.0),
        "quick-return": lambda: turning(library.quick_return(), 5.0),
        "Scotch yoke": lambda: turning(library.scotch_yoke(), 5.0),
        "Jansen's leg": lambda: turning(library.jansen(), 2.0),
        "planetary gear": lambda: turning(library.planetary_gear(planets=3), 4.0),
        "cam and follower": lambda: turning(
            library.cam_follower(lambda x: 0.005 * (1 - mbd.cos(x)), stiffness=500, preload=20), 8.0
        ),
        "double pendulum": lambda: chain(2),
        "chain of 12": lambda: chain(12),
    }


def reference(mechanism: mbd.Mechanism, initial: dict) -> mbd.Trajectory:
    """Return the motion by the method of high order, which chaotic motions need, or by IDAS if that is refused."""
    try:
        return mbd.simulate(mechanism, [0, SECONDS], **initial, method="dop853", reltol=1e-12, abstol=1e-12)
    except mbd.MechanismError:
        return mbd.simulate(mechanism, [0, SECONDS], **initial, reltol=1e-11, abstol=1e-11)


def script_seconds(session: Any) -> float:
    """Return the time that a tab has spent in scripts, s."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return next(float(metric["value"]) for metric in metrics if metric["name"] == "ScriptDuration")


def measure(browser: Any, name: str, make: Callable[[], Model], folder: Path) -> dict[str, Any]:
    """Write, run and play one page."""
    mechanism, start = make()
    initial = {"initial": start} if start else {}
    path = folder / "page.html"
    began = time.perf_counter()
    mbd.animate(mechanism, path, live=True, **initial)
    written = time.perf_counter() - began
    tab = browser.new_page(viewport={"width": 1280, "height": 800})
    tab.goto(path.as_uri())
    tab.wait_for_function("window.mechanism && window.mechanism.live")
    began = time.perf_counter()
    tab.evaluate(f"mechanism.run({SECONDS})")
    ran = time.perf_counter() - began
    state, violation = tab.evaluate("mechanism.state()"), tab.evaluate("mechanism.violation()")
    motion = reference(mechanism, initial)
    sizes = [np.maximum(1.0, np.abs(x)) for x in (motion.q[-1], motion.v[-1])]
    error = max(
        float(np.max(np.abs(np.array(state[key]) - x) / size))
        for key, x, size in zip("qv", (motion.q[-1], motion.v[-1]), sizes, strict=True)
    )
    tab.evaluate("mechanism.reset()")
    session = tab.context.new_cdp_session(tab)
    session.send("Performance.enable")
    before = script_seconds(session)
    frames = tab.evaluate(FRAMES)
    script = 1e3 * (script_seconds(session) - before) / (frames * SECONDS)
    tab.evaluate("mechanism.reset()")
    step = tab.evaluate(STEP)
    violation = max(violation, tab.evaluate("mechanism.violation()"))
    tab.close()
    return {
        "name": name, "bodies": len(mechanism.bodies), "kB": path.stat().st_size / 1e3, "written": written, "run": ran,
        "frames": frames, "script": script, "step": step, "violation": violation, "error": error,
    }  # fmt: skip


def main() -> None:
    """Measure the pages and print a table."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="some of the mechanisms")
    parser.add_argument("--models", type=Path, help="a folder with model files")
    options = parser.parse_args()
    models = _library()
    for path in sorted([*HERE.parent.glob("examples/models/*.adm"), *(options.models or HERE).glob("*.adm")]):
        models[path.stem] = lambda path=path: (mbd.read_adm(path), [])
    chosen = options.names or list(models)
    rows = []
    print("| " + " | ".join(COLUMNS) + " |")
    print("|---" + "|---:" * (len(COLUMNS) - 1) + "|")
    with sync_playwright() as tool, tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        own = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
        browser = tool.chromium.launch(executable_path=own, args=["--no-sandbox"])
        for name in chosen:
            try:
                row = measure(browser, name, models[name], Path(folder))
            except mbd.MechanismError as error:
                print(f"| {name} | {error} |", flush=True)
                continue
            rows.append(row)
            print(LINE.format(**row), flush=True)
        browser.close()
    if not options.names and not options.models:
        RESULTS.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())

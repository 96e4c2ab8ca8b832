"""The page of an animation in a real browser: it plays, scrubs, tells numbers, and shows the pose that it should.

Needs the extra ``browser`` and a Chromium: Playwright's own, or one on the path.
"""

import shutil

import numpy as np
import pytest

import mbdcasadi as mbd

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (pip install .[browser])")
DESKTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium."""
    with playwright.sync_playwright() as started:
        own = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
        try:
            running = started.chromium.launch(executable_path=own, args=["--no-sandbox"])
        except playwright.Error as error:
            pytest.skip(f"no Chromium that starts: {str(error).splitlines()[0]}")
        yield running
        running.close()


@pytest.fixture(scope="module")
def crank():
    """A driven slider-crank, its motion, and its page."""
    model = mbd.library.slider_crank()
    motion = mbd.inverse_dynamics(model.driven(crank=0.3 + 2 * np.pi * mbd.t / 4), np.linspace(0, 4, 161))
    speed = {"slider, m/s": model.slider.vx, "pin, m": model.pin.a.position}
    model_page = mbd.animate(motion, trace=[model.pin.a], plots=speed, title="a <crank> & </script>")
    return model, motion, model_page


@pytest.fixture
def page(browser, crank, tmp_path):
    """The page, opened with the network off; what goes wrong in it fails the test."""
    path = tmp_path / "motion.html"
    crank[2].save(path)
    opened = browser.new_page(viewport=DESKTOP, color_scheme="light")
    wrong, asked = [], []
    opened.on("pageerror", lambda error: wrong.append(str(error)))
    opened.on("console", lambda said: wrong.append(said.text) if said.type in ("error", "warning") else None)
    opened.on("request", lambda request: asked.append(request.url))
    opened.context.set_offline(True)
    opened.goto(path.as_uri())
    opened.wait_for_function("window.mechanism")
    yield opened
    opened.close()
    assert wrong == []
    assert asked == [path.as_uri()]  # nothing is fetched from anywhere


def drawn(page):
    """The picture as the browser shows it."""
    return page.evaluate("document.getElementById('stage').toDataURL()")


def test_numbers_and_poses_are_those_of_the_motion(page, crank):
    """Between frames too; the mark of a pin is drawn where the marker is."""
    model, motion, _ = crank
    for time in (0.0, 0.333, 1.7, 4.0):
        page.evaluate(f"mechanism.seek({time})")
        state = motion.at(time).initial
        told = page.evaluate("mechanism.reading('rod')")
        expected = {
            "x, m": model.rod.x,
            "y, m": model.rod.y,
            "phi, rad": model.rod.phi,
            "omega, rad/s": model.rod.omega,
        }
        for label, expression in expected.items():
            assert told[label] == pytest.approx(state[expression], abs=2e-4), label
        load = page.evaluate("mechanism.reading('wrist pin')")["force on slider, x, N"]
        assert load == pytest.approx(state[model.wrist.reaction_on(model.slider).force[0]], abs=1e-3)
        pin, wrist, main = (
            page.evaluate(f"mechanism.place('{n}')") for n in ("crank pin", "wrist pin", "main bearing")
        )
        # pixels to metres, by the distance of two pins
        scale = np.hypot(*(np.subtract(wrist, main))) / np.hypot(*state[model.slider.position])
        where = np.subtract(pin, main) * [1, -1] / scale
        np.testing.assert_allclose(where, state[model.pin.a.position], atol=2e-4)


def test_pins_stay_together_between_frames(browser, tmp_path):
    """A fast crank, half a radian from frame to frame: on chords the pin would be off by 3 % of the crank."""
    model = mbd.library.slider_crank()
    motion = mbd.inverse_dynamics(model.driven(crank=15 * mbd.t), np.linspace(0, 4, 1201))
    path = tmp_path / "fast.html"
    mbd.animate(motion, path, trace=[model.pin.a])
    opened = browser.new_page(viewport=DESKTOP)
    opened.goto(path.as_uri())
    opened.wait_for_function("window.mechanism")
    places = {}
    for time in (0.0, 61.5 / 30, 119.5 / 30):
        opened.evaluate(f"mechanism.seek({time})")
        main, pin, wrist = (
            np.array(opened.evaluate(f"mechanism.place('{n}')")) for n in ("main bearing", "crank pin", "wrist pin")
        )
        places[time] = np.hypot(*(pin - main)), np.hypot(*(wrist - pin))
    opened.close()
    for crank, rod in list(places.values())[1:]:
        assert crank == pytest.approx(places[0.0][0], rel=5e-3) and rod == pytest.approx(places[0.0][1], rel=5e-3)


def test_it_plays_pauses_repeats_and_scrubs(page):
    """By button, keys and slider; the picture changes."""
    assert page.evaluate("mechanism.time") == 0 and not page.evaluate("mechanism.playing")
    first = drawn(page)
    page.click("#play")
    page.wait_for_function("mechanism.time > 0.2")
    page.keyboard.press("k")  # no key of the page
    page.locator("#stage").focus()
    page.keyboard.press("Space")
    assert not page.evaluate("mechanism.playing")
    stopped = page.evaluate("mechanism.time")
    assert drawn(page) != first
    page.keyboard.press("ArrowRight")
    assert 0 < page.evaluate("mechanism.time") - stopped <= 4 / 120 + 1e-9
    page.keyboard.press("Home")
    assert page.evaluate("mechanism.time") == 0 and drawn(page) == first
    page.locator("#slider").fill("0.5")
    assert page.evaluate("mechanism.time") == pytest.approx(2.0, abs=1e-6)
    assert page.locator("#clock").text_content() == "t = 2.00 s"
    page.select_option("#speed", "4")
    page.keyboard.press("End")
    page.click("#play")
    page.wait_for_function("mechanism.time > 3.5")
    page.wait_for_function("mechanism.time < 1.5")  # round again
    page.evaluate("mechanism.seek(3.5)")
    page.click("#loop")
    page.wait_for_function("!mechanism.playing")
    assert page.evaluate("mechanism.time") == 4.0


def test_what_is_pointed_at_is_named(page):
    """A body and a joint, with numbers that follow the time; a click keeps them."""
    corner = page.locator("#stage").bounding_box()

    def point_at(name):
        x, y = page.evaluate(f"mechanism.place('{name}')")
        page.mouse.move(corner["x"] + x, corner["y"] + y)

    point_at("wrist pin")
    assert page.locator("#reading b").text_content() == "wrist pin"
    assert "force on slider" in page.locator("#reading").text_content()
    page.mouse.down()
    page.mouse.up()
    page.mouse.move(corner["x"] + 3, corner["y"] + 3)
    assert page.locator("#reading b").text_content() == "wrist pin"
    before = page.locator("#reading table").text_content()
    page.evaluate("mechanism.seek(1.0)")
    assert page.locator("#reading table").text_content() != before
    point_at("rod")
    page.mouse.down()
    page.mouse.up()
    assert page.locator("#reading b").text_content() in ("rod", "wrist pin", "crank pin")


def test_forces_and_darkness_are_switched(page):
    """Both change the picture; the choice of the reader's system is the start."""
    plain = drawn(page)
    page.keyboard.press("f")
    assert page.locator("#forces").get_attribute("aria-pressed") == "true"
    assert "N: arrow of" in page.locator("#scale").text_content() and page.locator("#scale").is_visible()
    assert drawn(page) != plain
    page.click("#forces")
    assert drawn(page) == plain
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    page.click("#theme")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 25, 30)"
    assert drawn(page) != plain


def test_plots_move_along_and_lead_to_a_time(page):
    """A click in the middle of a plot."""
    box = page.locator("#plots canvas").first.bounding_box()
    page.mouse.click(box["x"] + 56 + (box["width"] - 66) / 4, box["y"] + box["height"] / 2)
    assert page.evaluate("mechanism.time") == pytest.approx(1.0, abs=0.02)
    assert page.locator("#plots canvas").count() == 2


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_everything_fits_the_screen(page, size):
    """Nothing sticks out to the side; controls can be hit by a finger; title is text, not markup."""
    page.set_viewport_size(size)
    page.wait_for_timeout(50)
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    for control in ("#play", "#slider", "#speed", "#forces", "#theme", "#stage"):
        box = page.locator(control).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= size["width"] and box["height"] >= 28
    assert page.locator("h1").text_content() == "a <crank> & </script>"
    shot = page.screenshot()
    assert len(shot) > 15_000


def test_a_notebook_shows_it(browser, crank, tmp_path):
    """The page in the frame of its own that ``_repr_html_`` gives."""
    path = tmp_path / "notebook.html"
    path.write_text(f"<html><body>{crank[2]._repr_html_()}</body></html>", encoding="utf-8")
    opened = browser.new_page(viewport=DESKTOP)
    opened.goto(path.as_uri())
    inner = opened.frame_locator("iframe")
    assert inner.locator("h1").text_content() == "a <crank> & </script>"
    # the wheel turns the notebook's page on, until the drawing is clicked
    picture = "document.getElementById('stage').toDataURL()"
    frame = opened.frames[1]
    frame.wait_for_function("window.mechanism")
    inner.locator("#stage").hover(position={"x": 5, "y": 5})
    before = frame.evaluate(picture)
    opened.mouse.wheel(0, -200)
    opened.wait_for_timeout(100)
    assert frame.evaluate(picture) == before
    inner.locator("#stage").click(position={"x": 5, "y": 5})
    opened.mouse.wheel(0, -200)
    opened.wait_for_timeout(100)
    assert frame.evaluate(picture) != before
    inner.locator("#play").click()
    opened.wait_for_timeout(300)
    assert inner.locator("#clock").text_content() != "t = 0.00 s"
    opened.close()

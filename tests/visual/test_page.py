"""The page of an animation in a real browser: it plays, scrubs, shows numbers, and the pose the pose that it should.

Needs the extra ``browser`` and a Chromium: Playwright's own, or one on the path.
"""

import csv
from xml.etree import ElementTree

import numpy as np
import pytest

import mbdcasadi as mbd

DESKTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def crank():
    """A driven slider-crank, its motion, and its page."""
    model = mbd.library.slider_crank()
    motion = mbd.inverse_dynamics(model.driven(crank=0.3 + 2 * np.pi * mbd.t / 4), np.linspace(0, 4, 161))
    speed = {"slider, m/s": model.slider.vx, "pin, m": model.pin.a.position}
    model_page = mbd.animate(motion, trace=[model.pin.a], plots=speed, title="a <crank> & </script>")
    return model, motion, model_page


@pytest.fixture
def page(open_offline, crank, tmp_path):
    """The page, opened with the network off."""
    path = tmp_path / "motion.html"
    crank[2].save(path)
    opened = open_offline(path, DESKTOP)
    opened.wait_for_function("window.mechanism")
    return opened


def drawn(page):
    """The picture as the browser shows it."""
    return page.evaluate("document.getElementById('stage').toDataURL()")


@pytest.mark.slow
def test_numbers_and_poses_are_those_of_the_motion(page, crank):
    """Between frames too; the mark of a pin is drawn where the marker is."""
    model, motion, _ = crank
    for time in (0.0, 0.333, 1.7, 4.0):
        page.evaluate(f"mechanism.seek({time})")
        state = motion.at(time).initial
        shown = page.evaluate("mechanism.reading('rod')")
        expected = {
            "x, m": model.rod.x,
            "y, m": model.rod.y,
            "phi, rad": model.rod.phi,
            "omega, rad/s": model.rod.omega,
        }
        for label, expression in expected.items():
            assert shown[label] == pytest.approx(state[expression], abs=2e-4), label
        load = page.evaluate("mechanism.reading('wrist pin')")["force on slider, x, N"]
        assert load == pytest.approx(state[model.wrist.reaction_on(model.slider).force[0]], abs=1e-3)
        pin, wrist, main = (
            page.evaluate(f"mechanism.place('{n}')") for n in ("crank pin", "wrist pin", "main bearing")
        )
        # pixels to metres, by the distance of two pins
        scale = np.hypot(*(np.subtract(wrist, main))) / np.hypot(*state[model.slider.position])
        where = np.subtract(pin, main) * [1, -1] / scale
        np.testing.assert_allclose(where, state[model.pin.a.position], atol=2e-4)


@pytest.mark.slow
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


def point_at(page, name):
    """Move the mouse to where a part is drawn."""
    corner = page.locator("#stage").bounding_box()
    x, y = page.evaluate(f"mechanism.place('{name}')")
    page.mouse.move(corner["x"] + x, corner["y"] + y)


def test_what_is_pointed_at_is_named(page):
    """A body and a joint, with numbers that follow the time; a click keeps them."""
    corner = page.locator("#stage").bounding_box()
    point_at(page, "wrist pin")
    assert page.locator("#reading b").text_content() == "wrist pin"
    assert "force on slider" in page.locator("#reading").text_content()
    page.mouse.down()
    page.mouse.up()
    page.mouse.move(corner["x"] + 3, corner["y"] + 3)
    assert page.locator("#reading b").text_content() == "wrist pin"
    before = page.locator("#reading table").text_content()
    page.evaluate("mechanism.seek(1.0)")
    assert page.locator("#reading table").text_content() != before
    point_at(page, "rod")
    page.mouse.down()
    page.mouse.up()
    assert page.locator("#reading b").text_content() in ("rod", "wrist pin", "crank pin")


def legend(page):
    """Units of the arrows that are shown, and how much of each is a pixel, from the picture."""
    picture = ElementTree.fromstring(page.evaluate("mechanism.svg()"))
    found, unit, value = {}, None, None
    for part in picture.iter():
        if part.tag.endswith("text") and part.get("text-anchor") == "end" and part.get("stroke") is None:
            number, unit = part.text.removesuffix(" (radius)").split(" ", 1)
            value = float(number)
        elif part.tag.endswith("path") and unit is not None:
            x, _, u, _ = (float(x) for x in part.get("d")[1:].replace("L", " ").split())
            found[unit], unit = value / (u - x), None
    return found


def model_scale(crank, page):
    """Newtons, newton metres and metres per second of an arrow of one pixel."""
    model, motion, animation = crank
    main, wrist = (page.evaluate(f"mechanism.place('{name}')") for name in ("main bearing", "wrist pin"))
    place = motion.at(page.evaluate("mechanism.time")).initial[model.slider.position]
    metre = np.hypot(*np.subtract(wrist, main)) / np.hypot(*place)
    return {unit: of_one / metre for unit, of_one in animation.film.scale.items()}


def test_forces_and_darkness_are_switched(page, crank):
    """Both change the picture; the choice of the reader's system is the start."""
    plain = drawn(page)
    assert legend(page) == {}
    page.keyboard.press("f")
    assert page.locator("#forces").get_attribute("aria-pressed") == "true"
    assert legend(page)["N"] == pytest.approx(model_scale(crank, page)["N"], rel=1e-3)
    assert drawn(page) != plain
    page.click("#forces")
    assert drawn(page) == plain
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    page.click("#theme")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 25, 30)"
    assert drawn(page) != plain


def test_velocities_and_names_are_switched(page, crank):
    """The arrow at a body is its velocity to scale; both are off until they are asked for."""
    model, motion, animation = crank
    assert page.locator("#velocities").get_attribute("aria-pressed") == "false"
    page.evaluate("mechanism.seek(1.3)")
    plain = drawn(page)
    page.keyboard.press("n")
    named = drawn(page)
    assert named != plain
    page.keyboard.press("v")
    assert drawn(page) != named and legend(page) == {"m/s": pytest.approx(model_scale(crank, page)["m/s"], rel=1e-3)}
    state = motion.at(1.3).initial
    for body in (model.rod, model.slider):
        drawn_velocity = np.array(page.evaluate(f"mechanism.arrow('{body.name}')")) * animation.film.scale["m/s"]
        np.testing.assert_allclose(drawn_velocity, state[body.velocity], atol=2e-4)


def test_a_kept_number_is_plotted(page, crank):
    """By a click into its row; another one takes the plot away."""
    model, motion, _ = crank
    point_at(page, "rod")
    before = page.locator("#plots canvas").count()
    page.mouse.down()
    page.mouse.up()
    page.locator("#reading tr", has_text="phi").click()
    assert page.locator("#plots canvas").count() == before + 1
    points = np.array(page.evaluate("mechanism.plot('rod: phi, rad')")[""]["points"])
    np.testing.assert_allclose(points[:, 1], motion.at(points[:, 0])[model.rod.phi], atol=2e-4)
    last = page.locator("#plots canvas").last.bounding_box()
    page.mouse.click(last["x"] + 56 + (last["width"] - 66) / 2, last["y"] + last["height"] / 2)
    assert page.evaluate("mechanism.time") == pytest.approx(2.0, abs=0.02)
    page.locator("#reading tr", has_text="phi").click()
    assert page.locator("#plots canvas").count() == before


def test_names_stay_within_the_picture(page):
    """On a phone there is less room beside a part than where the names were placed."""
    page.set_viewport_size(PHONE)
    page.keyboard.press("n")
    outside = """() => {
        const picture = new DOMParser().parseFromString(mechanism.svg(), "text/xml").documentElement, off = [];
        document.body.append(picture);
        for (const text of picture.querySelectorAll("text[text-anchor=middle]")) {
            const box = text.getBBox();
            if (box.x < 0 || box.x + box.width > Number(picture.getAttribute("width"))) off.push(text.textContent);
        }
        picture.remove();
        return off;
    }"""
    for time in np.linspace(0, 4, 9):
        page.evaluate(f"mechanism.seek({time})")
        assert page.evaluate(outside) == [], time
    assert "main bearing" in page.evaluate("mechanism.svg()")


def test_plots_move_along_and_lead_to_a_time(page):
    """A click in the middle of a plot."""
    box = page.locator("#plots canvas").first.bounding_box()
    page.mouse.click(box["x"] + 56 + (box["width"] - 66) / 4, box["y"] + box["height"] / 2)
    assert page.evaluate("mechanism.time") == pytest.approx(1.0, abs=0.02)
    assert page.locator("#plots canvas").count() == 2


def test_the_picture_and_the_data_are_saved(page, crank):
    """The picture as SVG with the marks of the drawing, the data as CSV with the numbers of the motion."""
    model, motion, _ = crank
    page.evaluate("mechanism.seek(1.0)")
    page.locator("summary").click()
    with page.expect_download() as begun:
        page.click("#svg")
    picture = ElementTree.parse(begun.value.path()).getroot()
    marks = [node for node in picture.iter() if node.tag.endswith("path")]
    assert picture.tag.endswith("svg") and len(marks) > 20
    with page.expect_download() as begun:
        page.click("#csv")
    with open(begun.value.path(), newline="", encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    table = np.array(rows, float)
    assert names[0] == "t, s" and "rod: phi, rad" in names and table[-1, 0] == 4.0
    exact = motion.at(table[:, 0])
    np.testing.assert_allclose(table[:, names.index("rod: phi, rad")], exact[model.rod.phi], atol=1e-3)
    np.testing.assert_allclose(table[:, names.index("slider, m/s")], exact[model.slider.vx], atol=1e-3)


def test_the_view_moves_and_shrinks(page):
    """The background is dragged at any size; the wheel leads away from the whole drawing too."""
    corner = page.locator("#stage").bounding_box()
    before = np.array(page.evaluate("mechanism.place('main bearing')"))
    page.mouse.move(corner["x"] + 5, corner["y"] + 5)
    page.mouse.down()
    page.mouse.move(corner["x"] + 45, corner["y"] + 25, steps=4)
    page.mouse.up()
    np.testing.assert_allclose(page.evaluate("mechanism.place('main bearing')") - before, [40, 20], atol=1e-6)
    apart = (
        "(() => { const [a, b] = ['main bearing', 'crank pin'].map(mechanism.place);"
        " return Math.hypot(a[0] - b[0], a[1] - b[1]); })()"
    )
    whole = page.evaluate(apart)
    page.mouse.wheel(0, 400)
    page.wait_for_timeout(100)
    assert page.evaluate(apart) < 0.7 * whole
    page.keyboard.press("0")
    np.testing.assert_allclose(page.evaluate("mechanism.place('main bearing')"), before, atol=1e-9)


def test_numbers_do_not_cover_the_picture_of_a_phone(page):
    """They stand below it."""
    page.set_viewport_size(PHONE)
    page.wait_for_timeout(50)
    corner = page.locator("#stage").bounding_box()
    x, y = page.evaluate("mechanism.place('wrist pin')")
    page.mouse.click(corner["x"] + x, corner["y"] + y)
    assert page.locator("#reading").bounding_box()["y"] >= corner["y"] + corner["height"]


def test_a_page_in_a_dark_page_is_dark(browser, crank):
    """The documentation chooses its theme itself, and may change it."""
    inner = crank[2].html
    outer = '<html><body data-theme="dark"><iframe src="/motion.html"></iframe></body></html>'
    opened = browser.new_page(viewport=DESKTOP, color_scheme="light")
    opened.route(
        "**/*",
        lambda route: route.fulfill(
            body=inner if route.request.url.endswith("motion.html") else outer, content_type="text/html"
        ),
    )
    opened.goto("http://docs.test/")
    frame = opened.frames[1]
    frame.wait_for_function("window.mechanism")
    theme = "document.documentElement.dataset.theme"
    assert frame.evaluate(theme) == "dark"
    opened.evaluate("document.body.dataset.theme = 'light'")
    frame.wait_for_function(f"{theme} === 'light'")
    opened.close()


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


# --- the page shows what is true ------------------------------------------------------------------
def bouncing():
    """A ball on a stiff floor: a contact that lasts for some outputs; 601 outputs as a user would ask for."""
    ball = mbd.Body("ball", 1, 1e-3, pose=(0, 0.5, 0))
    law = mbd.HuntCrossley(1e5, damping=0.2)
    floor = mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.05), mbd.HalfPlane(mbd.ground.at(0, 0)), law)
    motion = mbd.simulate(mbd.Mechanism([ball], forces=[mbd.Gravity(), floor]), np.linspace(0, 3, 601))
    return motion, {"force, N": floor.normal_force, "height, m": ball.y}


def falling_four_bar():
    """Reactions of a linkage that swings."""
    model = mbd.library.four_bar()
    motion = mbd.simulate(model.mechanism, np.linspace(0, 2, 201))
    pin = model.mechanism.joint("A").reaction_on(model.crank).force
    return motion, {"pin, N": mbd.norm(pin), "coupler, m": model.coupler.position}


def rebounding():
    """Velocities that jump, between forty outputs."""
    ball = mbd.Body("ball", 1, 1, pose=(0, 1, 0))
    rebound = mbd.Event("floor", ball.y, direction=-1, reset={ball.vy: -0.8 * ball.vy})
    motion = mbd.simulate(mbd.Mechanism([ball], forces=[mbd.Gravity()]), np.linspace(0, 1.5, 40), events=[rebound])
    assert len(motion.events) == 2
    return motion, {"speed, m/s": ball.vy, "height, m": ball.y}


def kicked():
    """A force that jumps at a time that is not given."""
    model = mbd.library.pendulum_chain(2).mechanism
    (arm, _), push = model.bodies, mbd.if_else(mbd.t > 1 / 3, 5.0, 0.0)
    kick = mbd.Force("kick", arm.at(0, 0), (push, 0))
    motion = mbd.simulate(model.replace(forces=[*model.forces, kick]), np.linspace(0, 1, 51))
    return motion, {"ax, m/s^2": arm.ax, "kick, N": push}


def whirling():
    """A slider-crank with outputs so far apart that the motion between them bends a lot."""
    model = mbd.library.slider_crank()
    motion = mbd.simulate(model.mechanism, np.linspace(0, 4, 101), initial=[model.crank.omega == 20])
    return motion, {"slider, m/s": model.slider.vx}


@pytest.mark.slow
@pytest.mark.parametrize("example", [bouncing, falling_four_bar, rebounding, kicked, whirling])
def test_every_number_is_that_of_the_motion(browser, tmp_path, example):
    """At fifty random times: tooltips to the digits that are shown, plots, the drawing; and no peak is missing."""
    motion, plots = example()
    animation = mbd.animate(motion, tmp_path / "page.html", plots=plots)
    opened = browser.new_page(viewport=DESKTOP)
    opened.goto((tmp_path / "page.html").as_uri())
    opened.wait_for_function("window.mechanism")
    times = np.random.default_rng(3).uniform(motion.t[0], motion.t[-1], 50)
    items = [item for item in animation.film.scene.items if item.tooltip]
    read = opened.evaluate(
        """([times, items, plots]) => times.map(time => {
            mechanism.seek(time);
            return [items.map(name => mechanism.shown(name)), plots.map(label => mechanism.plot(label))];
        })""",
        [times.tolist(), [item.name for item in items], list(plots)],
    )
    exact = motion.at(times)
    off, compared = 0, 0
    for k, (shown, plotted) in enumerate(read):
        state = exact.state(k)
        for item, texts in zip(items, shown, strict=True):
            for label, expression in item.tooltip.items():
                number, _, unit = texts[label].replace("\u2212", "-").partition(" ")
                mantissa, _, power = number.partition("e")
                size = {"k": 1e3, "M": 1e6}.get(unit.removesuffix(label.rpartition(", ")[2]), 1.0)
                last_digit = size * 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
                error = abs(size * float(number) - state[expression])
                # a number may lie between two that can be shown, and the page be off by a tenth of a digit
                assert error <= 0.62 * last_digit or error < 1e-9, (item.name, label, texts[label], state[expression])
                off, compared = off + (error > 0.5 * last_digit * (1 + 1e-9)), compared + 1
        for lines, expression in zip(plotted, plots.values(), strict=True):
            values = [line["value"] for line in lines.values()]
            np.testing.assert_allclose(values, np.atleast_1d(state[expression]), atol=2e-5 * scale(motion, expression))
    assert compared > 250 and off < 0.05 * compared
    for label, expression in plots.items():
        lines = opened.evaluate("label => mechanism.plot(label)", label).values()
        for j, (line, values) in enumerate(zip(lines, motion[expression].reshape(len(motion), -1).T, strict=True)):
            points = np.array(line["points"])
            tolerance = 2e-5 * scale(motion, expression)
            assert points[:, 1].max() >= values.max() - tolerance and points[:, 1].min() <= values.min() + tolerance
            # what is drawn between the outputs is the motion, too
            drawn = points[np.linspace(0, len(points) - 1, 200).astype(int)]
            follows = motion.at(drawn[:, 0])[expression].reshape(len(drawn), -1)[:, j]
            np.testing.assert_allclose(drawn[:, 1], follows, atol=tolerance)
    opened.close()


def scale(motion, expression):
    """Largest size of an expression, between the outputs too."""
    return float(np.max(np.abs(motion.at(np.linspace(motion.t[0], motion.t[-1], 2000))[expression])))


def test_the_ball_is_drawn_where_it_is(browser, tmp_path):
    """To a tenth of a millimetre, in the moments of its impacts too; the disc is part of the contact."""
    motion, _ = bouncing()
    (ball,) = motion.mechanism.bodies
    mbd.animate(motion, tmp_path / "page.html")
    opened = browser.new_page(viewport=DESKTOP)
    opened.goto((tmp_path / "page.html").as_uri())
    opened.wait_for_function("window.mechanism")
    low = motion.t[np.argsort(motion[ball.y])[:20]]
    times = np.concatenate([low, np.random.default_rng(5).uniform(0, 3, 30)])
    places = np.array(opened.evaluate(
        "times => times.map(time => { mechanism.seek(time); return mechanism.place('floor'); })", times.tolist()
    ))  # fmt: skip
    heights = motion.at(times)[ball.y]
    slope, base = np.polyfit(places[:, 1], heights, 1)
    np.testing.assert_allclose(base + slope * places[:, 1], heights, atol=1e-4)
    assert np.ptp(heights) > 0.4
    opened.close()


def test_small_numbers_have_three_digits(browser, tmp_path):
    """The gap of a ball that is about to touch the floor, a hundredth of the height from which it fell."""
    motion, _ = bouncing()
    mbd.animate(motion, tmp_path / "page.html")
    opened = browser.new_page(viewport=DESKTOP)
    opened.goto((tmp_path / "page.html").as_uri())
    opened.wait_for_function("window.mechanism")
    gap = motion.mechanism.forces[1].gap
    time = next(t for t, value in zip(motion.t, motion[gap], strict=True) if 0.002 < value < 0.01)
    opened.evaluate(f"mechanism.seek({time})")
    shown = opened.evaluate("mechanism.shown('floor')")["gap, m"]
    assert shown == f"{motion.at(time).initial[gap]:#.3g} m"
    opened.close()


def test_a_gif_is_saved_by_the_page(page):
    """All of the motion, in the colours of the drawing."""
    image = pytest.importorskip("PIL.Image")
    page.locator("summary").click()
    page.select_option("#speed", "4")
    with page.expect_download() as begun:
        page.click("#gif")
    with image.open(begun.value.path()) as film:
        assert film.n_frames == 20 and film.size[0] == 640  # a second, at twenty frames
        film.seek(7)
        colours = {colour for _, colour in film.convert("RGB").getcolors(1 << 20)}
    blue = np.array([168, 196, 232])  # of the first body, #a9c4e8 or near
    assert min(np.abs(np.array(colour) - blue).max() for colour in colours) <= 8

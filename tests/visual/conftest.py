"""A browser for the tests of pages, and pages opened without a network."""

import shutil

import pytest


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium: Playwright's own, or one on the path; it needs the extra ``browser``."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed (pip install .[browser])"
    )
    with playwright.sync_playwright() as started:
        own = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
        try:
            running = started.chromium.launch(executable_path=own, args=["--no-sandbox"])
        except playwright.Error as error:
            pytest.skip(f"no Chromium that starts: {str(error).splitlines()[0]}")
        yield running
        running.close()


@pytest.fixture
def open_offline(browser):
    """Opens files with the network off; what goes wrong in a page, or is fetched from anywhere, fails the test."""
    tabs, wrong, asked = {}, [], []

    def open_file(path, viewport):
        tab = tabs[path.as_uri()] = browser.new_page(viewport=viewport, color_scheme="light")
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on("console", lambda said: wrong.append(said.text) if said.type in ("error", "warning") else None)
        tab.on("request", lambda request: asked.append(request.url))
        tab.context.set_offline(True)
        tab.goto(path.as_uri())
        return tab

    yield open_file
    for tab in tabs.values():
        tab.close()
    assert wrong == [] and asked == list(tabs)

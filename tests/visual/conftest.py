"""A browser for the tests of pages."""

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

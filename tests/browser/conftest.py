"""One chromium per file of tests; every test's pages are watched: nothing outside is asked for, nothing complains."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # modules that these tests share stand beside them

from browser_watch import Watch, launched
from playwright.sync_api import Browser, sync_playwright


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A chromium for this file; given up after it, for playwright holds an event loop that other tests may want."""
    with sync_playwright() as playwright, launched(playwright) as running:
        yield running


@pytest.fixture
def watch(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Watch]:
    """The watched browser of one test; at its end nothing may have been asked outside and no page may complain."""
    watched = Watch(browser, request.node.name)
    try:
        yield watched
    finally:
        watched.close()
    assert watched.outside() == []
    assert watched.unexpected() == []

"""One chromium per file of tests; every test's pages are watched: nothing outside is asked for, nothing complains."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # modules that these tests share stand beside them

from browser_watch import Watch, launched
from playwright.sync_api import Browser, sync_playwright

CORE = {
    "test_eigenvalues_are_those_of_the_scenario", "test_a_slider_moves_by_keys_and_by_hand",
    "test_a_value_is_typed_or_refused_in_words", "test_a_mode_is_picked_from_the_list_and_by_a_click",
    "test_an_upload_that_is_no_text_changes_nothing[binary.toml-content2-expected UTF-8 text]",
    "test_axe_has_nothing_serious[light]",
    "test_a_text_is_edited_and_applied", "test_downloaded_numbers_are_those_on_the_screen",
    "test_a_tap_on_the_map_moves_the_sliders",
}  # fmt: skip
"""What of the live page is tried every time; the rest takes a quarter of an hour, with MAGLEV_BROWSER=all."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The long part of the tests of the live page runs on request."""
    if os.environ.get("MAGLEV_BROWSER") == "all":
        return
    later = pytest.mark.skip(reason="takes long: with MAGLEV_BROWSER=all")
    for item in items:
        if item.path.name.startswith("test_workbench_") and "browser" in item.path.parts and item.name not in CORE:
            item.add_marker(later)


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

"""A chromium that cannot reach outside, and a record of everything its pages ask for and complain about."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Error, Page, Playwright

KEPT: Final = Path(__file__).resolve().parents[2] / "out" / "browser"
"""Screenshots and request logs, kept after the run."""
HERE: Final = ("127.0.0.1", "localhost")
ARGUMENTS: Final = (
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
)
HOW_TO_INSTALL: Final = (
    "no chromium was found: install it (Debian: apt-get install chromium; anywhere: python -m playwright install "
    "chromium), or name it with CHROMIUM=/path/to/chromium"
)


def find_chromium(own: str) -> str | None:
    """The browser to drive: the one named by CHROMIUM, the system's, or the one that playwright keeps (`own`)."""
    named = os.environ.get("CHROMIUM")
    if named:
        return named
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    found = [path for path in map(shutil.which, names) if path]
    return next((path for path in ("/usr/bin/chromium", *found, own) if Path(path).is_file()), None)


@contextmanager
def launched(playwright: Playwright) -> Iterator[Browser]:
    """A running chromium; the test is skipped without one, and fails where MAGLEV_BROWSER (required, all) says so."""
    path = find_chromium(playwright.chromium.executable_path)
    if path is None:
        if os.environ.get("MAGLEV_BROWSER") in ("required", "all"):
            pytest.fail(HOW_TO_INSTALL)
        pytest.skip(HOW_TO_INSTALL)
    browser = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
    try:
        yield browser
    finally:
        browser.close()


class Watch:
    """Everything the pages of one test asked for, and whatever they complained about."""

    def __init__(self, browser: Browser, name: str) -> None:
        self.name = re.sub(r"[^\w.-]+", "_", name).strip("_")
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.expected: list[str] = []
        """Patterns of complaints that the test provokes itself."""
        self._browser = browser
        self._contexts: list[BrowserContext] = []

    def person(
        self, *, dark: bool = False, width: int = 1280, height: int = 900, still: bool = False, scripts: bool = True
    ) -> BrowserContext:
        """A new person at a browser of their own: no cookies, nothing kept from others."""
        context = self._browser.new_context(
            color_scheme="dark" if dark else "light", viewport={"width": width, "height": height},
            reduced_motion="reduce" if still else "no-preference", accept_downloads=True,
            java_script_enabled=scripts,
        )  # fmt: skip
        context.set_default_timeout(45_000)
        context.on("request", lambda request: self.requests.append(f"{request.method} {request.url}"))
        context.on("console", self._heard)
        context.on("weberror", lambda error: self.complaints.append(f"page error: {error.error}"))
        context.on("page", self._joined)
        self._contexts.append(context)
        return context

    def _joined(self, page: Page) -> None:
        page.on("websocket", lambda socket: self.requests.append(f"SOCKET {socket.url}"))
        page.on("crash", lambda _: self.complaints.append("page error: the page crashed"))

    def _heard(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.complaints.append(f"console: {message.text} ({message.location.get('url', '')})")

    def page(self, address: str = "", **how: Any) -> Page:
        """A page of a new person, opened at an address."""
        opened = self.person(**how).new_page()
        if address:
            opened.goto(address)
        return opened

    def outside(self) -> list[str]:
        """Requests that do not stay on this machine."""
        return [one for one in self.requests if not stays_here(one.partition(" ")[2])]

    def unexpected(self) -> list[str]:
        """Complaints that the test did not provoke itself."""
        return [one for one in self.complaints if not any(re.search(pattern, one) for pattern in self.expected)]

    def close(self) -> None:
        """Close the browsers, and keep the log of requests."""
        for context in self._contexts:
            context.close()
        KEPT.mkdir(parents=True, exist_ok=True)
        log = [one if len(one) < 300 else f"{one[:300]}..." for one in self.requests]
        (KEPT / f"{self.name}.requests.txt").write_text("\n".join([*log, ""]), encoding="utf-8")


def stays_here(address: str) -> bool:
    """Whether an address needs no network: this machine, a file, or data within the page.

    Examples
    --------
    >>> stays_here("http://127.0.0.1:5006/"), stays_here("data:,"), stays_here("https://cdn.bokeh.org/bokeh.js")
    (True, True, False)
    """
    parts = urlsplit(address)
    return parts.scheme in ("data", "blob", "file", "about", "chrome-error") or parts.hostname in HERE


def picture(page: Page, name: str, *, whole: bool = True) -> Path:
    """A screenshot kept under out/browser."""
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / f"{name}.png"
    page.screenshot(path=path, full_page=whole)
    return path


def _axe_script() -> str:
    """The newest axe that is installed; both packages carry it as one file."""
    for package in ("axe_playwright_python", "axe_core_python"):
        found = importlib.util.find_spec(package)
        if found is not None and found.origin is not None:
            return Path(found.origin).with_name("axe.min.js").read_text(encoding="utf-8")
    pytest.fail("axe is not installed: pip install -e '.[test]'")


def findings(page: Page, *, impacts: Sequence[str] = ("serious", "critical"), without: str = "") -> list[str]:
    """What axe finds, worst kinds only: one line per rule and place.

    Parameters
    ----------
    without : selector of what is left out
    """
    page.evaluate(_axe_script())
    found = page.evaluate(
        "out => axe.run(out ? {exclude: [[out]]} : document, {resultTypes: ['violations']}).then(r => r.violations)",
        without,
    )
    return [
        f"{one['impact']} {one['id']}: {' '.join(map(json.dumps, node['target']))} {node['html'][:160]} | "
        f"{' '.join((node.get('failureSummary') or '').split())[:300]}"
        for one in found if one["impact"] in impacts
        for node in one["nodes"]
    ]  # fmt: skip


def gone(page: Page, expression: str) -> bool:
    """Whether a script expression is undefined on the page; words that were run as a script would have set it."""
    try:
        return bool(page.evaluate(f"typeof ({expression}) === 'undefined'"))
    except Error:
        return True

"""The watch itself: each of its checks is seen to catch what it is for."""

from __future__ import annotations

import pytest
from browser_watch import Watch, find_chromium, findings, launched, stays_here
from playwright.sync_api import Browser

PAGE = "<!DOCTYPE html><html lang='en'><head><title>t</title></head><body><main><h1>t</h1>{}</main></body></html>"


def test_a_request_outside_is_seen_and_does_not_get_there(browser: Browser) -> None:
    watch = Watch(browser, "outside")
    page = watch.page()
    page.set_content(PAGE.format("<img alt='' src='https://example.org/a.png'>"))
    page.wait_for_load_state("networkidle")
    watch.close()
    assert watch.outside() == ["GET https://example.org/a.png"]
    assert any("ERR_NAME_NOT_RESOLVED" in one for one in watch.unexpected())


def test_a_socket_outside_is_seen(browser: Browser) -> None:
    watch = Watch(browser, "socket")
    page = watch.page()
    page.set_content(PAGE.format(""))
    page.evaluate("new Promise(done => { new WebSocket('wss://example.org/ws').onerror = done })")
    watch.close()
    assert watch.outside() == ["SOCKET wss://example.org/ws"]


def test_errors_of_scripts_and_of_the_console_are_seen(browser: Browser) -> None:
    watch = Watch(browser, "errors")
    page = watch.page()
    page.set_content(PAGE.format(""))
    page.evaluate("console.error('it hurts'); setTimeout(() => { throw new Error('it broke') }, 0)")
    page.wait_for_timeout(100)
    watch.close()
    told = watch.unexpected()
    assert any("it hurts" in one for one in told) and any("it broke" in one for one in told)
    watch.expected = ["it hurts", "it broke"]
    assert watch.unexpected() == []


def test_axe_finds_what_is_wrong(watch: Watch) -> None:
    page = watch.page()
    page.set_content(PAGE.format("<p style='color:#ccc;background:#fff'>faint</p><button></button>"))
    told = findings(page)
    assert any("color-contrast" in one for one in told) and any("button-name" in one for one in told)
    page.set_content(PAGE.format("<p>ink</p>"))
    assert findings(page) == []


@pytest.mark.parametrize(
    "address", ["https://cdn.bokeh.org/x.js", "http://127.0.0.1.example.org/", "ws://[2001:db8::1]/", "//example.org/"]
)
def test_outside_addresses_are_known(address: str) -> None:
    assert not stays_here(address)


@pytest.mark.parametrize("address", ["http://127.0.0.1:5006/", "ws://localhost:1/ws", "blob:null/1", "data:,"])
def test_addresses_of_this_machine_are_known(address: str) -> None:
    assert stays_here(address)


class _Nowhere:
    """A playwright that has no browser of its own."""

    class chromium:
        executable_path = "/nowhere/chromium"


def test_a_missing_browser_is_told_and_required_where_it_must_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("browser_watch.find_chromium", lambda own: None)
    monkeypatch.delenv("MAGLEV_BROWSER", raising=False)
    with pytest.raises(pytest.skip.Exception, match="apt-get install chromium"), launched(_Nowhere()):  # type: ignore[arg-type]
        pass
    monkeypatch.setenv("MAGLEV_BROWSER", "required")
    with pytest.raises(pytest.fail.Exception, match="apt-get install chromium"), launched(_Nowhere()):  # type: ignore[arg-type]
        pass


def test_the_browser_named_by_the_environment_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CHROMIUM", "/opt/mine")
    assert find_chromium("/nowhere") == "/opt/mine"

"""The server behind the page: killed and started again, several people at once, and requests that are none of its."""

from __future__ import annotations

import asyncio
import http.client
import json
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from browser_watch import Watch, findings, picture
from page_server import PATIENCE, Bench, Server, number_of
from tornado.httpclient import HTTPError, HTTPRequest
from tornado.websocket import WebSocketError, websocket_connect

LOST = ["WebSocket", "ERR_CONNECTION", "Lost websocket", "Failed to load resource", "session", "connection"]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    running = Server(tmp_path_factory.mktemp("workbench"))
    yield running
    status = running.stop()
    assert (status, [line for line in running.complaints() if "Refusing websocket" not in line]) == (130, [])


def test_two_people_do_not_disturb_each_other(watch: Watch, server: Server) -> None:
    one, two = Bench.open(watch, server.address), Bench.open(watch, server.address)
    before, count = two.eigenvalues(), one.shown
    one.type("speed", "250")
    two.at("option").select_option(index=1)
    one.after(count)
    two.after(count)
    assert number_of(one.at("field-speed").input_value()) == 250.0
    assert number_of(two.at("field-speed").input_value()) == 360.0
    assert two.eigenvalues() not in (before, one.eigenvalues())
    assert one.at("option").input_value() != two.at("option").input_value()


def test_two_tabs_edit_one_scenario_and_neither_loses_its_own(watch: Watch, server: Server) -> None:
    person = watch.person()
    tabs = []
    for word in ("first", "second"):
        page = person.new_page()
        page.set_default_timeout(PATIENCE)
        page.goto(server.address)
        tab = Bench(page)
        tab.drawn()
        tabs.append((tab, word))
    for tab, word in tabs:
        tab.write(tab.text().replace("Heave and surge", f"The {word} tab: heave and surge"))
    for tab, _ in tabs:
        count = tab.shown
        tab.at("apply-text").click()
        tab.after(count)
    for tab, word in tabs:
        assert tab.at("title").inner_text().startswith(f"The {word} tab")
        assert f"The {word} tab" in tab.text()


def test_a_killed_server_is_said_and_all_comes_back(watch: Watch, server: Server) -> None:
    watch.expected = LOST
    bench = Bench.open(watch, server.address)
    count = bench.shown
    bench.at("option").select_option(index=1)
    bench.after(count)
    count = bench.shown
    bench.type("speed", "280")
    bench.after(count)
    before = bench.eigenvalues()
    bench.write(bench.text() + "\n# being written\n")
    server.kill()
    try:
        told_lost(bench)
    finally:
        server.start()  # at the same port
    bench.page.wait_for_function(
        "['preview', 'settled', 'failed'].includes(document.documentElement.dataset.state)", timeout=2 * PATIENCE
    )
    np.testing.assert_allclose(bench.eigenvalues(), before, rtol=1e-7, atol=1e-8)
    assert number_of(bench.at("field-speed").input_value()) == 280.0
    assert bench.text().endswith("# being written\n")
    assert bench.at("connection").is_hidden()
    bench.no_trace()


def told_lost(bench: Bench) -> None:
    """The page says that the connection is lost, and stays a page."""
    bench.settled("lost")
    assert bench.at("connection").inner_text().startswith("The connection to the workbench is lost")
    picture(bench.page, "page_lost", whole=False)
    assert findings(bench.page) == []
    bench.page.locator("#slide-height").focus()
    bench.page.keyboard.press("ArrowRight")  # a page that is lost does not break


def test_a_connection_cut_in_the_middle_comes_back(watch: Watch, server: Server) -> None:
    """The socket alone breaks, as it does when a laptop sleeps; the server lives on."""
    watch.expected = LOST
    person = watch.person()
    person.add_init_script(
        "const Plain = WebSocket; window.sockets = [];"
        "window.WebSocket = class extends Plain {"
        "constructor(...given) { super(...given); window.sockets.push(this) } }"
    )
    page = person.new_page()
    page.set_default_timeout(PATIENCE)
    page.goto(server.address)
    bench = Bench(page)
    bench.drawn()
    count = bench.shown
    bench.type("speed", "270")
    bench.after(count)
    before = bench.eigenvalues()
    page.evaluate("document.documentElement.dataset.old = 'yes'; window.sockets.at(-1).close()")
    page.wait_for_function(
        "!document.documentElement.dataset.old"
        " && ['preview', 'settled'].includes(document.documentElement.dataset.state)"
    )
    assert number_of(bench.at("field-speed").input_value()) == 270.0
    np.testing.assert_allclose(bench.eigenvalues(), before, rtol=1e-7, atol=1e-8)


def asked(server: Server, path: str, *, method: str = "GET", **headers: str) -> tuple[int, str, dict[str, str]]:
    """An answer to a plain request."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read().decode(errors="replace"), dict(answer.getheaders())
    finally:
        connection.close()


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "evil.example:{port}", "127.0.0.1:1", ""])
def test_another_name_for_this_machine_is_refused(server: Server, host: str) -> None:
    """A foreign page whose name was pointed here (DNS rebinding) gets nothing."""
    for path in ("/", "/live/ws", "/assets/workbench.js", "/alive"):
        status, body, _ = asked(server, path, Host=host.format(port=server.port))
        assert status in (400, 403), path
        assert "token" not in body


def test_only_what_the_page_needs_is_answered(server: Server) -> None:
    for path in (
        "/live", "/live/autoload.js", "/live/metadata", "/static/js/bokeh.min.js", "/reports/../../etc/passwd",
        "/reports/x/report.html", "/reports/%2e%2e/report.html", "/assets/..%2fpage.py", "/assets/page.py",
        "/files/guess/scenario.toml", "/files/guess/map.svg", "/out/workbench", "//etc/passwd",
    ):  # fmt: skip
        status, body, _ = asked(server, path)
        assert status == 404, path
        assert "Traceback" not in body and len(body) < 200
    assert asked(server, "/", method="POST")[0] in (403, 405)
    assert asked(server, "/alive")[1] == "alive"
    _, _, headers = asked(server, "/")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Frame-Options"] == "DENY"


def token(server: Server) -> str:
    """The token of a fresh page."""
    body = asked(server, "/")[1]
    item = re.search(r'data-item="([^"]*)"', body)
    assert item is not None
    return str(json.loads(item.group(1).replace("&#34;", '"').replace("&quot;", '"'))["token"])


async def connected(server: Server, origin: str | None, own: str) -> bool:
    """Whether a websocket with this origin is let in."""
    headers = {"Sec-WebSocket-Protocol": f"bokeh, {own}"} | ({} if origin is None else {"Origin": origin})
    request = HTTPRequest(f"ws://127.0.0.1:{server.port}/live/ws", headers=headers, request_timeout=20)
    try:
        socket = await websocket_connect(request, subprotocols=["bokeh", own])
    except (WebSocketError, HTTPError, OSError):
        return False
    message = await asyncio.wait_for(socket.read_message(), 20)
    socket.close()
    return message is not None


def test_foreign_pages_cannot_connect(server: Server) -> None:
    own = f"http://127.0.0.1:{server.port}"

    async def all_of_them() -> list[bool]:
        foreign = ["http://evil.example", f"http://evil.example:{server.port}", "null", "http://127.0.0.1:1"]
        return [await connected(server, origin, token(server)) for origin in (own, *foreign)]

    with ThreadPoolExecutor(1) as other:  # playwright's own loop runs in this thread
        found = other.submit(lambda: asyncio.run(all_of_them())).result(PATIENCE / 1000)
    assert found == [True, False, False, False, False]

"""The page's server asked by others: foreign names and sites, too large messages, paths elsewhere; in this process."""

from __future__ import annotations

import base64
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

pytest.importorskip("bokeh")

from maglev_ctrl.scenario.limits import SIZE_LIMIT
from maglev_ctrl.workbench import handlers, server
from maglev_ctrl.workbench.jobs import ReportJobs, report_folder
from maglev_ctrl.workbench.listening import PortTaken, bound_socket, loopback, own_hosts
from maglev_ctrl.workbench.page import Page
from maglev_ctrl.workbench.site import Site
from maglev_ctrl.workbench.sources import find_sources

EVIL = "evil.example"


@contextmanager
def running(folder: Path, *, also: frozenset[str] = frozenset()) -> Iterator[tuple[int, ReportJobs]]:
    """The server as `serve` makes it, its loop in a thread; `also`: names it answers to besides its own."""
    jobs = ReportJobs(folder / "reports")
    site = Site(find_sources(None, shipped=None, here=folder, empty_folder=folder), jobs)
    ready, ended = threading.Event(), threading.Event()
    known: dict[str, object] = {}

    def work() -> None:
        with server._loop() as loop, bound_socket("127.0.0.1", None) as listening:
            port = listening.getsockname()[1]
            hosts = own_hosts("127.0.0.1", port) | {name.format(port=port) for name in also}
            made = server._server(site, loop, hosts)
            made._http.add_sockets([listening])
            made.start()
            known.update(port=port, loop=loop)
            loop.add_callback(ready.set)
            loop.start()
            made.stop(wait=False)
            made._http.stop()
        ended.set()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(60.0)
    loop, port = known["loop"], known["port"]
    assert isinstance(port, int)
    try:
        yield port, jobs
    finally:
        loop.add_callback(loop.stop)  # type: ignore[attr-defined]
        assert ended.wait(30.0)
        site.pool.shutdown(wait=False, cancel_futures=True)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, ReportJobs]]:
    with running(tmp_path_factory.mktemp("page")) as found:
        yield found


def raw(port: int, request: str | bytes, *, head: bool = False) -> tuple[int, bytes]:
    """Status and all that comes back, or its head; 0 where the connection is closed without a word."""
    with socket.create_connection(("127.0.0.1", port), timeout=10.0) as line:
        content = b""
        with suppress(ConnectionError):
            line.sendall(request.encode("latin-1") if isinstance(request, str) else request)
            while not (head and b"\r\n\r\n" in content) and (piece := line.recv(65536)):
                content += piece
    return (int(content.split(b" ", 2)[1]) if content.startswith(b"HTTP/") else 0), content


def get(port: int, path: str, *lines: str, host: str = "127.0.0.1:{port}", method: str = "GET") -> tuple[int, bytes]:
    head = [f"{method} {path} HTTP/1.1", f"Host: {host.format(port=port)}", *lines, "Connection: close"]
    return raw(port, "\r\n".join(head) + "\r\n\r\n")


def shaken(port: int, origin: str | None, *, host: str = "127.0.0.1:{port}") -> int:
    """Status of a websocket's handshake from a page of this origin: 101 where it is let in."""
    key = base64.b64encode(b"0123456789abcdef").decode()
    lines = ["Upgrade: websocket", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
    lines += ["Sec-WebSocket-Protocol: bokeh, " + token(port)]
    lines += [] if origin is None else [f"Origin: {origin.format(port=port)}"]
    head = ["GET /live/ws HTTP/1.1", f"Host: {host.format(port=port)}", "Connection: Upgrade", *lines]
    return raw(port, "\r\n".join(head) + "\r\n\r\n", head=True)[0]


def token(port: int) -> str:
    """A token no server signed: where it comes from is looked at first, what it carries later."""
    return "eyJzZXNzaW9uX2lkIjoieCJ9"


FOREIGN_HOSTS = (
    EVIL, f"{EVIL}:{{port}}", "127.0.0.1", "127.0.0.1:1", f"127.0.0.1:{{port}}.{EVIL}", f"127.0.0.1.{EVIL}:{{port}}",
    "",
    "[::1]:{port}", "0.0.0.0:{port}", "2130706433:{port}", "localhost.:{port}", f"{EVIL}@127.0.0.1:{{port}}", "*",
    "127.1:{port}",
)  # fmt: skip


@pytest.mark.parametrize("host", FOREIGN_HOSTS)
def test_a_name_that_was_pointed_here_gets_nothing(served: tuple[int, ReportJobs], host: str) -> None:
    for path in ("/alive", "/assets/workbench.js", "/live/ws"):
        status, content = get(served[0], path, host=host)
        assert status in (0, 400, 403), (path, content[:200])
    assert shaken(served[0], f"http://{host}", host=host) in (0, 400, 403)


def test_without_its_guard_it_would(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(handlers.Guarded, "find_handler")
    with running(tmp_path) as (port, _):
        assert get(port, "/alive", host=f"{EVIL}:{{port}}")[0] == 200


def test_its_own_names_are_answered(served: tuple[int, ReportJobs]) -> None:
    for host in ("127.0.0.1:{port}", "localhost:{port}", "LOCALHOST:{port}"):
        assert get(served[0], "/alive", host=host)[0] == 200
    assert raw(served[0], "GET /alive HTTP/1.0\r\n\r\n")[0] in (0, 400, 403)  # no name at all
    twice = f"GET /alive HTTP/1.1\r\nHost: 127.0.0.1:{served[0]}\r\nHost: {EVIL}\r\nConnection: close\r\n\r\n"
    assert raw(served[0], twice)[0] in (0, 400, 403)
    assert get(served[0], f"http://{EVIL}/alive", host=EVIL)[0] in (0, 400, 403, 404)


@pytest.mark.parametrize(
    "origin",
    [
        f"http://{EVIL}", f"http://{EVIL}:{{port}}", "null", "http://127.0.0.1:1", "https://127.0.0.1", "file://", "",
        f"http://127.0.0.1:{{port}}.{EVIL}", f"http://{EVIL}/127.0.0.1:{{port}}", "chrome-extension://abc",
    ],
)  # fmt: skip
def test_a_foreign_page_cannot_open_the_connection(served: tuple[int, ReportJobs], origin: str) -> None:
    assert shaken(served[0], origin) in (0, 400, 403)


def test_its_own_page_can_and_a_foreign_one_could_if_its_name_were_listed(
    tmp_path: Path, served: tuple[int, ReportJobs]
) -> None:
    assert shaken(served[0], "http://127.0.0.1:{port}") == 101
    with running(tmp_path, also=frozenset({f"{EVIL}:{{port}}"})) as (port, _):  # the mutant
        assert shaken(port, f"http://{EVIL}:{{port}}") == 101


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH", "CONNECT", "FOO"])
def test_nothing_is_changed_by_a_request(served: tuple[int, ReportJobs], method: str) -> None:
    for path in ("/alive", "/assets/workbench.js", "/reports/x/report.html"):
        assert get(served[0], path, method=method)[0] in (0, 400, 403, 404, 405, 501)


@pytest.mark.parametrize(
    "path",
    [
        "/reports/", "/reports", "/assets/", "/files/", "/files/x/", "/live/", "/reports/car-0/",
        "/reports/../../etc/passwd",
        "/reports/%2e%2e/%2e%2e/etc/passwd", "/reports/..%2f..%2fetc/passwd", "/reports/car-0/..%2freport.html",
        "/reports/car-0/report.html%00.png", "/reports/car-0/report.toml", "/reports/link/report.html",
        "/reports/./report.html",
        "/reports/.../report.html", "/assets/%2e%2e%2fpage.py", "//etc/passwd", "/\\etc\\passwd",
        "/files/a/scenario.toml",
    ],
)  # fmt: skip
def test_no_path_leads_elsewhere_and_nothing_is_listed(served: tuple[int, ReportJobs], path: str) -> None:
    port, jobs = served
    place = jobs.folder / "car-0"
    place.mkdir(parents=True, exist_ok=True)
    (place / "report.html").write_text("<p>mine</p>")
    (place / "report.toml").write_text("secret")
    (jobs.folder.parent / "report.html").write_text("secret")
    if os.name != "nt" and not (jobs.folder / "link").exists():
        (jobs.folder / "link").symlink_to(jobs.folder.parent)
    status, content = get(port, path)
    assert status in (0, 400, 403, 404), content[:300]
    assert (
        b"root:" not in content and b"secret" not in content and b"Traceback" not in content and b"car-0" not in content
    )
    status, content = get(port, "/reports/car-0/report.html")
    assert status == 200 and b"mine" in content and b"sandbox" in content  # it can show itself, and nothing else


def test_a_report_that_is_a_link_elsewhere_is_not_handed_out(served: tuple[int, ReportJobs]) -> None:
    if os.name == "nt":
        pytest.skip("links need rights there")
    port, jobs = served
    place = jobs.folder / report_folder("thief", "0" * 12)
    place.mkdir(parents=True, exist_ok=True)
    (jobs.folder.parent / "passwords").write_text("secret")
    (place / "report.html").symlink_to(jobs.folder.parent / "passwords")
    assert get(port, f"/reports/{place.name}/report.html")[0] == 404


def test_what_is_too_large_is_not_taken(served: tuple[int, ReportJobs]) -> None:
    port = served[0]
    own = f"Host: 127.0.0.1:{port}\r\nConnection: close\r\n"
    assert raw(port, f"POST /alive HTTP/1.1\r\n{own}Content-Length: {SIZE_LIMIT + 1}\r\n\r\n")[0] in (0, 400, 413)
    assert raw(port, f"GET /alive HTTP/1.1\r\n{own}X: {'a' * 2**17}\r\n\r\n")[0] in (0, 400, 431)
    assert raw(port, f"GET /{'a' * 2**17} HTTP/1.1\r\n{own}\r\n")[0] in (0, 400, 414, 431)
    assert raw(port, b"\x16\x03\x01\x02\x00\x01\x00" + bytes(range(128, 192)) + b"\r\n\r\n")[0] in (0, 400)
    assert raw(port, f"GET /alive HTTP/1.1\r\n{own}Content-Length: -1\r\n\r\n")[0] in (0, 400)
    assert get(port, "/alive")[0] == 200  # and it still answers


def test_a_websocket_message_has_a_limit(tmp_path: Path) -> None:
    from tornado.ioloop import IOLoop

    site = Site(find_sources(None, shipped=None, here=tmp_path, empty_folder=tmp_path), ReportJobs(tmp_path / "r"))
    with server._loop() as loop:
        assert isinstance(loop, IOLoop)
        made = server._server(site, loop, frozenset({"127.0.0.1:1"}))
        settings = made._tornado.settings
        assert 2 * SIZE_LIMIT < settings["websocket_max_message_size"] <= 4 * SIZE_LIMIT
        assert made._http.conn_params.max_body_size == SIZE_LIMIT
    site.pool.shutdown(wait=False)


@pytest.mark.parametrize(
    "said",
    [
        {}, {"kind": "upload"}, {"kind": "__init__"}, {"kind": "_upload"}, {"kind": ["upload"]}, {"kind": None}, [],
        "x", None,
        {"kind": "upload", "name": 1, "text": 2}, {"kind": "upload", "name": "x" * 10**5, "text": "y" * 10**5},
        {"kind": "upload", "name": "../../x", "text": "\x00"}, {"kind": "edit", "text": 1e308}, {"kind": "choose",
        "key": {}},
    ],
    ids=range(14),
)  # fmt: skip
def test_only_named_deeds_can_be_asked_for(said: object) -> None:
    """What the browser may send is looked up in a table; no attribute is reached by its name."""
    from maglev_ctrl.workbench import page

    table = next(value for value in vars(page).values() if isinstance(value, dict) and "upload" in value)
    kind = said.get("kind") if isinstance(said, dict) else None
    found = table.get(kind) if isinstance(kind, str) else None
    assert found in (None, *(value for name, value in vars(Page).items() if name in {f"_{one}" for one in table}))
    assert not {"__init__", "_upload", "eval"} & set(table)


def test_nobody_else_is_listened_to_without_a_word(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The address is this machine's own where none is given; another one is warned of before the page is served."""
    from maglev_ctrl import cli

    monkeypatch.chdir(tmp_path)
    asked: list[str] = []

    def refuse(scenario: Path | None, *, address: str = "127.0.0.1", port: int | None = None, **rest: object) -> int:
        asked.append(address)
        raise PortTaken("not in a test")

    monkeypatch.setattr(server, "serve", refuse)
    for words, warned in (([], False), (["--address", "0.0.0.0"], True), (["--address", "::"], True),
                          (["--address", "localhost"], False), (["--address", "127.0.0.2"], False)):  # fmt: skip
        assert cli.main(["ui", "--no-open", *words]) == 2
        assert ("there is no password" in capsys.readouterr().err) == warned, words
    assert asked == ["127.0.0.1", "0.0.0.0", "::", "localhost", "127.0.0.2"]
    assert not any(loopback(one) for one in ("0.0.0.0", "::", "192.168.1.1", "", EVIL, "127.0.0.1.evil"))
    with bound_socket("127.0.0.1", None) as line:
        assert line.getsockname()[0] == "127.0.0.1"

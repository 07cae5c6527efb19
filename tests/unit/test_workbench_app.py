"""The server of the page as a browser, or somebody else's page, meets it."""

from __future__ import annotations

import http.client
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("bokeh")

SCENARIO = Path("scenarios/paper/heave_surge.toml").resolve()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[subprocess.Popen[str], int]]:
    folder = tmp_path_factory.mktemp("started_here")
    process = subprocess.Popen(
        [sys.executable, "-m", "maglev_ctrl", "ui", str(SCENARIO), "--no-open"],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.search(r"http://127\.0\.0\.1:(\d+)/", line)
    assert found, line
    yield process, int(found[1])
    if process.poll() is None:
        process.kill()
        process.wait()
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()


def ask(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    finally:
        connection.close()


def test_the_page_takes_nothing_from_outside(server: tuple[subprocess.Popen[str], int]) -> None:
    status, headers, content = ask(server[1], "/")
    page = content.decode()
    assert status == 200
    assert "https://" not in page and "http://" not in page
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "script-src 'self' 'unsafe-eval';" in policy
    assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"
    assert not re.search(r"<script(?![^>]*\ssrc=)", page)  # no script in the page itself
    for link in re.findall(r'(?:src|href)="(/assets/[^"]+)"', page):
        status, headers, _ = ask(server[1], link, Accept_Encoding="gzip")
        assert status == 200 and "immutable" in headers["cache-control"] and headers["content-encoding"] == "gzip"


def test_another_name_or_another_site_is_refused(server: tuple[subprocess.Popen[str], int]) -> None:
    """A foreign name that leads to this machine, and a foreign page that opens the document's connection."""
    port = server[1]
    assert ask(port, "/", Host=f"evil.example:{port}")[0] == 403
    assert ask(port, "/", Host=f"localhost:{port}")[0] == 200
    upgrade = {
        "Connection": "Upgrade", "Upgrade": "websocket", "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec_WebSocket_Protocol": "bokeh, x",
    }  # fmt: skip
    assert ask(port, "/live/ws", Origin="http://evil.example", **upgrade)[0] == 403


@pytest.mark.parametrize(
    "path",
    [
        "/reports/../../etc/passwd", "/reports/..%2f..%2fetc/passwd", "/reports/x/report.html", "/static/js/bokeh.js",
        "/live", "/live/autoload.js", "/files/nokey/map.svg", "/assets/../server.py", "/assets/nothing.js",
    ],
)  # fmt: skip
def test_nothing_else_is_there(server: tuple[subprocess.Popen[str], int], path: str) -> None:
    status, _, content = ask(server[1], path)
    assert status == 404
    assert b"Traceback" not in content and str(SCENARIO.parents[2]).encode() not in content


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT to a process there")
def test_an_interrupt_ends_it_in_a_moment(server: tuple[subprocess.Popen[str], int]) -> None:
    process = server[0]
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 130
    assert time.monotonic() - began < 20.0  # a second on an idle machine
    assert process.stderr is not None
    said = process.stderr.read()
    assert "closed" in said and "Traceback" not in said

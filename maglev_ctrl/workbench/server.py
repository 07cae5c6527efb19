"""The server of the page: one process on this machine, nothing fetched from outside, nothing offered to other sites."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop

from maglev_ctrl.scenario.limits import SIZE_LIMIT
from maglev_ctrl.workbench.arrangement import Arrangement
from maglev_ctrl.workbench.assets import assets
from maglev_ctrl.workbench.connection import OneMessage
from maglev_ctrl.workbench.faults import tell_terminal
from maglev_ctrl.workbench.handlers import LIVE, Guarded, patterns
from maglev_ctrl.workbench.jobs import ReportJobs
from maglev_ctrl.workbench.listening import bound_socket, own_hosts
from maglev_ctrl.workbench.live_thread import open_study, study_key
from maglev_ctrl.workbench.page import Page
from maglev_ctrl.workbench.site import Site
from maglev_ctrl.workbench.sources import find_sources, shipped_folder
from maglev_ctrl.workbench.state import PageState

REPORTS = Path("out") / "workbench"
SWITCH = 5e-4
"""Seconds after which a thread that computes lets the one that talks to the browser go on: ten times sooner than Python
does by itself, for a message takes many turns."""
_MESSAGE_LIMIT = 4 * SIZE_LIMIT  # of one message: a text of the largest size with every sign escaped, and some more
_QUIET = 4.0  # s after a page was opened until the next one's views are made
_SESSION_LIFETIME = 15_000  # ms a page may be away before its document goes; what it showed is in its address


class _Site(Guarded, BokehTornado):  # type: ignore[misc]
    """Bokeh's own server behind the guard that looks at each request first."""

    def new_connection(self, protocol: Any, socket: Any, application_context: Any, session: Any) -> OneMessage:
        """A page's connection."""
        connection = OneMessage(protocol, socket, application_context, session)
        self._clients.add(connection)
        return connection


def serve(
    scenario: Path | None, *, address: str = "127.0.0.1", port: int | None = None,
    ready: Callable[[str], None] = lambda url: None, reports: Path = REPORTS,
) -> int:  # fmt: skip
    """Serve the page until a signal to end comes; returns that signal's number, all processes ended.

    Parameters
    ----------
    scenario : file to begin with; None: the first of those shipped
    port : None: the first free one from 5006 on
    ready : told the page's address as soon as it answers
    reports : folder for the reports made on the page

    Raises
    ------
    PortTaken : the port or the address cannot be used
    """
    listening = bound_socket(address, port)
    number = listening.getsockname()[1]
    hosts = own_hosts(address, number)
    logging.getLogger("bokeh").setLevel(logging.ERROR)
    logging.getLogger("tornado.access").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory(prefix="maglev-ctrl-ui-", ignore_cleanup_errors=True) as empty:
        sources = find_sources(scenario, shipped=shipped_folder(), here=Path.cwd(), empty_folder=Path(empty).resolve())
        site = Site(sources, ReportJobs(reports))
        _prepare(site)
        with _signals() as ended, _loop() as loop:
            server = _server(site, loop, hosts)
            server._http.add_sockets([listening])
            server.start()
            shown = f"[{address}]" if ":" in address else address
            warm = threading.Thread(target=_warm, args=(site,), daemon=True)
            loop.add_callback(warm.start)
            loop.add_callback(ready, f"http://{shown}:{number}/")
            interval = sys.getswitchinterval()
            sys.setswitchinterval(SWITCH)
            try:
                while not ended:
                    loop.start()
            finally:
                sys.setswitchinterval(interval)
                site.jobs.close()
                site.pool.shutdown(wait=False, cancel_futures=True)
                server.stop(wait=False)
                listening.close()
    return ended[0]


def _server(site: Site, loop: IOLoop, hosts: frozenset[str]) -> Any:
    application = Application(FunctionHandler(lambda document: _open_page(document, site)))
    found = _Site(
        {LIVE: application}, extra_patterns=patterns(site), extra_websocket_origins=sorted(hosts),
        secret_key=os.urandom(32), sign_sessions=True, websocket_max_message_size_bytes=_MESSAGE_LIMIT,
        unused_session_lifetime_milliseconds=_SESSION_LIFETIME, check_unused_sessions_milliseconds=5_000,
        keep_alive_milliseconds=20_000, use_index=False, redirect_root=False, include_headers=[], include_cookies=[],
        ico_path="none",
    )  # fmt: skip
    found.hosts = hosts
    return BaseServer(loop, found, HTTPServer(found, max_body_size=SIZE_LIMIT, max_header_size=2**16))


def _open_page(document: Any, site: Site) -> None:
    try:
        Page(document, site)
        if not site.spares:
            IOLoop.current().call_later(_QUIET, lambda: site.pool.submit(_prepare, site))
    except Exception:
        tell_terminal("new page")
        raise


def _prepare(site: Site) -> None:
    """Have the scripts packed and the views of the next page made before it is asked for."""
    assets()
    if not site.spares:
        site.spares.append(Arrangement())


def _warm(site: Site) -> None:
    """Have the first scenario's study ready, and with it every module it takes."""
    try:
        first = site.sources.first
        if first is None:
            return
        state = PageState(first.key, first.path.stem, site.sources.text(first.key))
        scenario, study = open_study(site.sources, state)
        study.preview({})
        site.shelf.put(study_key(site.sources, state), (scenario, study))
    except Exception:  # the page will say in words what is wrong
        return


@contextmanager
def _loop() -> Iterator[IOLoop]:
    """A loop of its own, that ends with the block."""
    events = asyncio.new_event_loop()
    asyncio.set_event_loop(events)
    loop = IOLoop.current()
    try:
        yield loop
    finally:
        with suppress(Exception):
            for task in asyncio.all_tasks(events):
                task.cancel()
            events.run_until_complete(asyncio.sleep(0))
        asyncio.set_event_loop(None)


@contextmanager
def _signals() -> Iterator[list[int]]:
    """The signals to end that came; the first one stops the loop between two callbacks."""
    came: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        came.append(number)
        loop = IOLoop.current(instance=False)
        if loop is not None:
            loop.add_callback_from_signal(loop.stop)

    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

"""`maglev-ctrl ui`: the workbench page on this machine; everything heavy is loaded inside."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maglev_ctrl.cli_terminal import BAD_INPUT, Stopped


def ui(
    scenario: Annotated[
        Path | None,
        typer.Argument(metavar="[SCENARIO]", help="Scenario file (TOML) to begin with.", show_default=False),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option("--port", metavar="N", min=1, max=65535, help="Port.  [default: 5006, or the next free one]"),
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Open no browser; the address is printed.")] = False,
    address: Annotated[
        str, typer.Option("--address", metavar="A", help="Address to listen on.", show_default=True)
    ] = "127.0.0.1",
) -> None:
    """Open the workbench page: sliders, eigenvalues, resonance map, margins, live. Ctrl-C ends it.

    Everything runs on this machine and nothing is fetched from outside. Reports made on the page are kept in
    out/workbench.
    """
    from importlib.util import find_spec

    if find_spec("bokeh") is None:
        typer.echo('the page needs the extra "ui"; install it with: pip install "maglev-ctrl[ui]"', err=True)
        raise typer.Exit(BAD_INPUT)

    from maglev_ctrl.workbench.listening import PortTaken, loopback
    from maglev_ctrl.workbench.server import serve

    if scenario is not None:
        from maglev_ctrl.scenario import load

        load(scenario)  # what is wrong with the file is said here, before a browser opens
    if not loopback(address):
        typer.echo(
            f"warning: at {address} everyone who reaches this machine over the network can use the page, read the "
            "scenarios it offers and run studies; there is no password",
            err=True,
        )

    def ready(url: str) -> None:
        typer.echo(f"workbench: {url}  (Ctrl-C ends it)")
        if not no_open:
            _open(url)

    try:
        number = serve(scenario, address=address, port=port, ready=ready)
    except PortTaken as taken:
        typer.echo(str(taken), err=True)
        raise typer.Exit(BAD_INPUT) from None
    raise Stopped(128 + number, "the workbench is closed")


def _open(url: str) -> None:
    """Show the page in the default browser; starting one may take seconds, which the server must not wait for."""
    import threading
    import webbrowser

    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()

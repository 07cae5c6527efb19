"""Where the page listens: a free port on this machine, and which addresses a browser may call it by."""

from __future__ import annotations

import ipaddress
import socket
from contextlib import suppress

FIRST_PORT = 5006
_TRIES = 50


class PortTaken(Exception):
    """The port asked for, or every port tried, is in use, or the address is not one of this machine."""


def loopback(address: str) -> bool:
    """Whether only this machine can reach an address.

    Examples
    --------
    >>> loopback("127.0.0.1"), loopback("localhost"), loopback("::1"), loopback("0.0.0.0")
    (True, True, True, False)
    """
    if address == "localhost":
        return True
    with suppress(ValueError):
        return ipaddress.ip_address(address).is_loopback
    return False


def bound_socket(address: str, port: int | None) -> socket.socket:
    """A listening socket on the port asked for, or on the first free one from 5006 on.

    Raises
    ------
    PortTaken : in one sentence why not
    """
    ports = range(FIRST_PORT, FIRST_PORT + _TRIES) if port is None else (port,)
    try:
        family, _, _, _, place = socket.getaddrinfo(address, ports[0], type=socket.SOCK_STREAM)[0]
    except OSError:
        raise PortTaken(f'--address: expected an address of this machine, got "{address}"') from None
    reason = ""
    for number in ports:
        one = socket.socket(family, socket.SOCK_STREAM)
        try:
            if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows would share the port with another program otherwise
                one.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
            else:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            one.bind((place[0], number))
            one.listen(128)
        except OSError as error:
            one.close()
            reason = error.strerror or str(error)
            continue
        one.setblocking(False)
        return one
    if port is None:
        raise PortTaken(f"no port from {ports[0]} to {ports[-1]} can be used at {address} ({reason}); give --port")
    raise PortTaken(f"port {port} cannot be used at {address} ({reason}); choose another with --port, or leave it out")


def own_hosts(address: str, port: int) -> frozenset[str]:
    """Host headers under which the page may be asked for; any other was led here by a foreign name.

    Listening on every address, the names of this machine are allowed and all its numbers.

    Examples
    --------
    >>> sorted(own_hosts("127.0.0.1", 5006))
    ['127.0.0.1:5006', 'localhost:5006']
    """
    if loopback(address):
        names = {"localhost", "127.0.0.1"} if ":" not in address else {"localhost"}
        names.add(address)
    else:
        names = {"localhost", "127.0.0.1", address, socket.gethostname().lower(), socket.getfqdn().lower()}
        with suppress(OSError):
            names.update(str(found[4][0]) for found in socket.getaddrinfo(socket.gethostname(), None))
    plain = {f"[{name}]" if ":" in name else name for name in names}
    return frozenset({f"{name}:{port}" for name in plain} | (plain if port == 80 else set()))  # browsers leave out 80

"""Addresses of vehicles: where a link listens or connects.

udp://127.0.0.1:14550     listens there, as ground stations do; without a host on loopback, never on all interfaces
udpout://HOST:PORT        sends there first
tcp://HOST:PORT           connects there
serial:///dev/tty…:57600  a radio or a cable
"""

from __future__ import annotations

import re

_SCHEMES = {"udp": "udpin", "udpin": "udpin", "udpout": "udpout", "tcp": "tcpout", "tcpout": "tcpout"}
_EXPECTED = "expected udp://127.0.0.1:14550, udpout://HOST:PORT, tcp://HOST:PORT or serial:///dev/ttyUSB0:57600"


def is_address(text: str) -> bool:
    """Whether a text is meant for an address: it has a scheme."""
    return "://" in text


def connection_of(address: str) -> str:
    """An address as MAVSDK takes it.

    Raises:
        ValueError: if it is none.
    """
    scheme, _, rest = address.partition("://")
    if scheme == "serial" and re.fullmatch(r"/?[^:\s]+:\d+", rest):
        return address
    found = re.fullmatch(r"([^:/\s]*|\[[0-9a-fA-F:]+\]):(\d{1,5})", rest)
    if scheme not in _SCHEMES or found is None or not 0 < int(found[2]) < 2**16:
        raise ValueError(f"--autopilot: {_EXPECTED}, given {address!r}")
    host, port = found.groups()
    if not host and _SCHEMES[scheme] != "udpin":
        raise ValueError(f"--autopilot: expected a host to connect to, given {address!r}; {_EXPECTED}")
    return f"{_SCHEMES[scheme]}://{host or '127.0.0.1'}:{port}"

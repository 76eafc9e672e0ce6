"""Access to a page: for browsers that no other site sent here, and beyond this machine for those with the token.

Any site that a browser shows may open a WebSocket to any address, and may name one of its own hosts after this machine.
So Host and Origin of each request are compared with what is served; where others reach the address, a token is asked
for as well, once in the address and from then on in a cookie.
"""

from __future__ import annotations

import dataclasses
import functools
import hmac
import ipaddress
import logging
import secrets
import socket
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

LOG = logging.getLogger(__name__)
_HERE = ("localhost", "127.0.0.1", "::1")
_HEADERS = {"Referrer-Policy": "no-referrer", "X-Frame-Options": "SAMEORIGIN", "X-Content-Type-Options": "nosniff"}


@dataclasses.dataclass(frozen=True)
class Border:
    """The border of a page: the address that is served, and the token that a browser needs.

    Attributes:
        host: address that is listened on.
        token: that a browser must have; empty: none is asked for.
    """

    host: str
    token: str

    @staticmethod
    def of(host: str) -> Border:
        """Of an address: with a new token, unless this machine alone reaches it.

        Raises:
            OSError: if there is no such address.
        """
        found = {str(entry[4][0]) for entry in socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)}
        here = all(ipaddress.ip_address(one.partition("%")[0]).is_loopback for one in found)
        return Border(host, "" if here else secrets.token_urlsafe(24))

    def address(self, port: int) -> str:
        """The page's address, with the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}" + (f"/?token={self.token}" if self.token else "")

    def refusal(self, arrived: tuple[str, int], path: str, headers: Mapping[str, Sequence[str]]) -> str:
        """Why a request is refused; empty where it is not.

        Args:
            arrived: own address and port of its connection.
            path: that it asks for, with its query.
            headers: all values of `host`, `origin` and `cookie`.
        """
        given = _names(headers["host"])
        known = {*_HERE, self.host.lower(), arrived[0].lower().removeprefix("::ffff:")}
        known |= _own_names() if self.token else set()
        if given is None or given[0] not in known or given[1] != arrived[1]:
            return f"its Host is {_short(headers['host'])}, expected {self.host}:{arrived[1]}"
        origin = headers["origin"]
        if origin and (len(origin) > 1 or not origin[0].startswith("http://") or _names([origin[0][7:]]) != given):
            return f"its Origin is {_short(origin)}, expected http://{headers['host'][0]}"
        if self.token and not self._has_token(arrived[1], path, headers["cookie"]):
            return "it lacks the token; open the whole address that the command has printed"
        return ""

    def cookie(self, port: int, path: str) -> str:
        """The cookie to give for a request that brings the token in its address; empty: none."""
        held = bool(self.token) and self._has_token(port, path, [])
        return f"{_cookie_name(port)}={self.token}; Path=/; HttpOnly; SameSite=Strict" if held else ""

    def _has_token(self, port: int, path: str, cookies: Sequence[str]) -> bool:
        given = parse_qs(path.partition("?")[2], max_num_fields=20).get("token", []) if path.count("&") < 20 else []
        for pair in "; ".join(cookies).split(";"):
            name, _, value = pair.strip().partition("=")
            given += [value] if name == _cookie_name(port) else []
        # In constant time: how long it takes tells nothing of the token.
        return any(hmac.compare_digest(one.encode(errors="replace"), self.token.encode()) for one in given)


def refuse_strangers(border: Border, connection: ServerConnection, request: Request) -> Response | None:
    """The answer to a request that may not pass, and one line in the log; None: it may."""
    arrived = connection.local_address[:2]
    headers = {name: request.headers.get_all(name) for name in ("host", "origin", "cookie")}
    why = border.refusal(arrived, request.path, headers)
    if not why:
        return None
    LOG.warning("Refused a request from %s: %s", connection.remote_address[0], why)
    return connection.respond(403, f"Refused: {why}.\n")


def mark(border: Border, connection: ServerConnection, request: Request, response: Response) -> Response:
    """An answer with what keeps the token in the browser and the page out of others."""
    for name, value in _HEADERS.items():
        response.headers[name] = value
    cookie = border.cookie(connection.local_address[1], request.path)
    if cookie:
        response.headers["Set-Cookie"] = cookie
    return response


def _names(hosts: Sequence[str]) -> tuple[str, int] | None:
    """Name and port of the only one; None where there is no such thing."""
    try:
        (host,) = hosts
        parts = urlsplit(f"//{host}")
        port = 80 if parts.port is None else parts.port
    except ValueError:
        return None
    return (parts.hostname, port) if parts.hostname and parts.netloc == host and "@" not in host else None


def _cookie_name(port: int) -> str:
    return f"maxjax-{port}"  # cookies are shared by all ports of a host


@functools.cache
def _own_names() -> set[str]:
    return {socket.gethostname().lower(), socket.getfqdn().lower()}


def _short(values: Sequence[str]) -> str:
    return repr(values[0][:80]) if len(values) == 1 else f"given {len(values)} times"

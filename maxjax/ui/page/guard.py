"""The border in place: viser's WebSocket server, started so that each request and each message is judged first.

request → border → viser's files, or the socket → message → incoming → viser's handlers
"""

from __future__ import annotations

import contextlib
import functools
import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from maxjax.ui.page.border import LOG, Border, mark, refuse_strangers
from maxjax.ui.page.incoming import MOST_BYTES, fault_of, refusal_of

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

MOST_FAULTS = 20
"""Of a connection, before it is closed."""

_STARTING = threading.Lock()

# What returns viser's handles of a panel by their ids, and what a user is told by.
Panel = tuple[Callable[[], Mapping[str, Any]], Callable[[str], None]]


@contextlib.contextmanager
def guarding(
    border: Border, controls: Callable[[], Mapping[str, Any]], tell: Callable[[str], None] = lambda _: None
) -> Iterator[None]:
    """Within, a server that viser starts keeps to the border.

    Args:
        border: of the server.
        controls: returns viser's handles of its panel, by their ids.
        tell: called with a sentence for the user where a control's value is not taken.

    Raises:
        ImportError: if viser started it another way; then it is not guarded.
    """
    import websockets.asyncio.server as sockets

    plain, guarded = sockets.serve, list[bool]()

    def serve(handler: Any, host: Any = None, port: Any = None, **settings: Any) -> Any:
        guarded.append(True)
        files = settings["process_request"]
        return plain(handler, host, port, **settings | _settings(border, (controls, tell), files))

    with _STARTING:
        # viser hands no settings through; it looks the name up when it starts, and is awaited here until it has.
        sockets.serve = serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            sockets.serve = plain  # type: ignore[misc]
    if not guarded:
        raise ImportError("the page cannot be guarded with this viser; expected viser 1.1: pip install 'viser==1.1.*'")


def _settings(border: Border, panel: Panel, files: Any) -> dict[str, Any]:
    def answer(connection: ServerConnection, request: Request) -> Response | None:
        refused = refuse_strangers(border, connection, request)
        if refused is not None:
            return refused
        response: Response | None = files(connection, request)
        return None if response is None else mark(border, connection, request, response)

    log = logging.getLogger(f"{__name__}.socket")
    log.addFilter(_in_one_line)
    return {
        "process_request": answer,
        "create_connection": functools.partial(_connection_class(), panel),
        "max_size": MOST_BYTES,
        "logger": log,
    }


def _in_one_line(record: logging.LogRecord) -> bool:
    """Errors on the socket, without their traceback."""
    if record.exc_info:
        words = str(record.exc_info[1]).splitlines() or [type(record.exc_info[1]).__name__]
        record.msg, record.args = f"The page's socket: {record.getMessage()}: {words[0][:200]}", ()
        record.exc_info = record.exc_text = None
    return True


def _connection_class() -> Any:
    from websockets.asyncio.server import ServerConnection

    class Judged(ServerConnection):
        """A connection that receives only what a page can be told."""

        def __init__(self, panel: Panel, *args: Any, **settings: Any) -> None:
            super().__init__(*args, **settings)
            (self._panel, self._tell), self._faults = panel, 0

        async def recv(self, decode: bool | None = None) -> Any:
            """The next message that has no fault."""
            while True:
                content = await super().recv(decode)
                fault = fault_of(content, self._panel())
                if not fault:
                    return content
                self._faults += 1
                if said := refusal_of(content, self._panel()):
                    self._tell(said)
                LOG.warning("Dropped a message from %s: it %s", self.remote_address[0], fault)
                if self._faults == MOST_FAULTS:
                    LOG.warning("Closed the connection to %s after %d faults", self.remote_address[0], MOST_FAULTS)
                    await self.close(1008, "too many faults")

    return Judged

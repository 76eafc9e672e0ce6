"""Who may use a page and what it can be told, over a real WebSocket: strangers and faults leave it as it was."""

from __future__ import annotations

import http.client
import logging
import socket
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")

import msgspec
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from maxjax.ui.cli import page as page_of_command
from maxjax.ui.page.border import Border
from maxjax.ui.page.controls import add_controls
from maxjax.ui.page.guard import MOST_FAULTS, guarding
from maxjax.ui.page.server import address_of, serve
from maxjax.ui.request import Request
from tests.ui.page.test_page import listed, town

PROTOCOL = f"viser-v{viser.__version__}"
ENDS = ((8.0, 10.0, 10.0), (58.0, 50.0, 12.0))


class Page:
    """A server with the panel of a page."""

    def __init__(self, host: str) -> None:
        self.server = serve(town(), host=host, port=0)
        self.port: int = self.server.get_port()
        request = Request.between("town", *ENDS, floor=5.0, ceiling=60.0)
        self.controls = add_controls(self.server.gui, town(), request, listed(request), on_earth=False, dark=False)
        self.moved: list[np.ndarray] = []
        handle = self.server.scene.add_transform_controls("/start")
        handle.on_update(lambda event: self.moved.append(np.array(event.target.position)))

    def client(self, *, path: str = "/", **headers: str) -> ClientConnection:
        given = {name.capitalize(): value for name, value in headers.items()}
        host = given.pop("Host", f"127.0.0.1:{self.port}")
        return connect(
            f"ws://{host}{path}",
            sock=socket.create_connection(("127.0.0.1", self.port)),
            subprotocols=[PROTOCOL],  # type: ignore[list-item]
            additional_headers=given,
            proxy=None,
            max_size=None,
        )

    def get(self, path: str = "/", **headers: str) -> http.client.HTTPResponse:
        asked = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10.0)
        asked.request("GET", path, headers={name.capitalize(): value for name, value in headers.items()})
        answer = asked.getresponse()
        answer.read()
        return answer


@pytest.fixture(scope="module")
def served() -> Iterator[Page]:
    page = Page("127.0.0.1")
    yield page
    page.server.stop()


@pytest.fixture(scope="module")
def public() -> Iterator[Page]:
    page = Page("0.0.0.0")
    yield page
    page.server.stop()


def refused(page: Page, **given: str) -> bool:
    """Whether a WebSocket is refused; one that is not is sent the scene."""
    try:
        client = page.client(**given)
    except InvalidStatus as error:
        return error.response.status_code == 403 and b"Refused: " in (error.response.body or b"")
    with client:
        assert client.recv(timeout=10.0)
    return False


def update(handle: Any, value: Any) -> bytes:
    return msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": {"value": value}})


def camera(**changed: Any) -> bytes:
    message = {"type": "ViewerCameraMessage", "wxyz": (1, 0, 0, 0), "fov": 1.0, "near": 0.1, "far": 9.0}
    message |= {"position": (1.0, 2, 3), "look_at": (0, 0, 0), "up_direction": (0, 0, 1)}
    return msgspec.msgpack.encode(message | {"image_height": 600, "image_width": 800} | changed)


def drag(**changed: Any) -> bytes:
    message = {"type": "TransformControlsUpdateMessage", "name": "/start", "owner": "", "wxyz": (1, 0, 0, 0)}
    return msgspec.msgpack.encode(message | {"position": (1.0, 2.0, 3.0)} | changed)


def until(done: Any) -> None:
    end = time.monotonic() + 10.0
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_browser_of_this_machine_uses_the_page(served: Page) -> None:
    here = f"127.0.0.1:{served.port}"
    assert not refused(served)
    assert not refused(served, origin=f"http://{here}")
    assert not refused(served, host=f"localhost:{served.port}", origin=f"http://LOCALHOST:{served.port}")
    answer = served.get()
    assert (answer.status, answer.headers["Set-Cookie"]) == (200, None)
    assert answer.headers["X-Frame-Options"] == "SAMEORIGIN"
    assert address_of(served.server) == f"http://{here}"


@pytest.mark.parametrize(
    "given",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "https://127.0.0.1:{port}"},
        {"origin": "http://127.0.0.1:{port}@evil.example"},
        {"origin": "http://127.0.0.1:{other}"},
        {"origin": "http://localhost:{port}"},  # not the Host that it was asked for at
        {"host": "evil.example:{port}", "origin": "http://evil.example:{port}"},
        {"host": "evil.example:{port}"},
        {"host": "127.0.0.1.evil.example:{port}"},
    ],
)
def test_another_sites_page_does_not(served: Page, caplog: pytest.LogCaptureFixture, given: dict[str, str]) -> None:
    filled = {name: value.format(port=served.port, other=served.port + 1) for name, value in given.items()}
    with caplog.at_level(logging.WARNING, "maxjax"):
        assert refused(served, **filled)
    assert [record.getMessage().count("\n") for record in caplog.records] == [0]
    assert "expected" in caplog.text
    if "origin" in filled or "host" in filled:
        assert served.get(**filled).status == 403


def test_beyond_this_machine_a_token_is_needed(public: Page, capsys: pytest.CaptureFixture[str]) -> None:
    token = public.server.border.token
    assert len(token) >= 32
    assert address_of(public.server) == f"http://0.0.0.0:{public.port}/?token={token}"
    wrong = token[:-1] + ("a" if token[-1] != "a" else "b")
    for path in ("/", "/?token=", f"/?token={wrong}", f"/?token={token[:-1]}", "/?token=é".encode().decode("latin1")):
        assert public.get(path.replace("\xc3", "%C3").replace("\xa9", "%A9")).status == 403
    assert refused(public)
    assert refused(public, path=f"/?token={wrong}")
    assert refused(public, cookie=f"maxjax-{public.port}={wrong}")
    assert not refused(public, path=f"/?token={token}")
    answer = public.get(f"/?fixedDpr=0.5&token={token}")
    assert answer.status == 200
    cookie, *rest = answer.headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict"} <= set(rest)
    assert answer.headers["Referrer-Policy"] == "no-referrer"
    for path in ("/", "/assets/none.js"):
        assert public.get(path, cookie=f"other=1; {cookie}").status in (200, 404)
    assert not refused(public, cookie=f"a=b; {cookie}", origin=f"http://127.0.0.1:{public.port}")
    assert refused(public, cookie=cookie, origin="http://evil.example")
    assert refused(public, cookie=cookie, host=f"evil.example:{public.port}")

    class Ended:
        border, get_port = public.server.border, public.server.get_port

        def stop(self) -> None:
            pass

    def ended(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page_of_command.time, "sleep", ended)
        with pytest.raises(KeyboardInterrupt):
            page_of_command.wait(Ended())
    assert f"/?token={token}" in capsys.readouterr().out


def test_two_pages_have_two_tokens_and_loopback_none() -> None:
    assert Border.of("0.0.0.0").token != Border.of("0.0.0.0").token
    assert Border.of("127.0.0.9").token == Border.of("localhost").token == Border.of("::1").token == ""
    assert Border("fe80::1", "x").address(80) == "http://[fe80::1]:80/?token=x"


GONE = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "gone", "updates": {"value": 1}})
BAD_VALUES = [
    [],
    [1],
    [1e300],
    [np.nan, 2.0],
    [1, 2, 3],
    [60, 5],
    [True, 2],
    ["a", 2],
    None,
    "5",
    {},
    7,
    [-900, 5],
]


def test_a_control_takes_values_of_its_kind_and_range_alone(served: Page, caplog: pytest.LogCaptureFixture) -> None:
    """After the messages that once made every later client fail, others come, see the old values and set new ones."""
    controls = served.controls
    bad = [(controls.band, value) for value in BAD_VALUES]
    bad += [(controls.radius, value) for value in (np.nan, np.inf, -1e300, 1e4, True, "1", [], None)]
    bad += [(controls.method, value) for value in ("none", "", 1, ["field"], 10_000 * "a")]
    bad += [(controls.start, value) for value in (1, None, 10_000 * "1", ["1"])]
    bad += [(controls.beside, value) for value in (1, "true", None, [])]
    held = [handle.value for handle, _ in bad]
    with served.client() as other, caplog.at_level(logging.WARNING, "maxjax"):
        for begin in range(0, len(bad), MOST_FAULTS - 1):
            with served.client() as client:
                client.send(camera())
                for handle, value in bad[begin : begin + MOST_FAULTS - 1]:
                    client.send(update(handle, value))
                client.send(GONE)
                client.send(update(controls.margin, 6 + begin / 100))
                until(lambda begin=begin: controls.margin.value == 6 + begin / 100)
        assert [handle.value for handle, _ in bad] == held
        assert len(caplog.records) == len(bad)
        assert all("\n" not in record.getMessage() and len(record.getMessage()) < 300 for record in caplog.records)
        with served.client() as later:
            assert later.recv(timeout=10.0)
            later.send(update(controls.band, [7, 41]))
            later.send(update(controls.radius, 3))
            later.send(update(controls.method, "astar"))
            later.send(update(controls.beside, True))
            until(lambda: controls.beside.value is True)
        assert (controls.band.value, controls.radius.value, controls.method.value) == ((7.0, 41.0), 3.0, "astar")
        other.ping()
        assert other.recv(timeout=10.0)


GARBAGE = [
    b"",
    b"\xc1",
    bytes(range(256)),
    5000 * b"\x91" + b"\x01",
    "text",
    b"\x01",
    msgspec.msgpack.encode([1]),
    msgspec.msgpack.encode({"type": "GuiUpdateMessage"}),
    msgspec.msgpack.encode({"type": []}),
    msgspec.msgpack.encode({1: 2}),
    msgspec.msgpack.encode({"type": "ShareUrlRequest"}),
    msgspec.msgpack.encode({"type": "RunJavascriptMessage", "source": "1"}),
    msgspec.msgpack.encode({"type": "FileTransferStartUpload", "size_bytes": 2**40}),
    drag(position=(float("nan"), 0, 0)),
    drag(position=(1e300, 0, 0)),
    drag(position=()),
    drag(wxyz=(0, 0, 0, 0)),
    drag(more=1),
    camera(image_height=-1),
]


def test_garbage_is_one_line_each_and_does_no_harm(
    served: Page, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    count = len(served.moved)
    with caplog.at_level(logging.WARNING, "maxjax"), served.client() as client:
        client.send(camera())
        for content in GARBAGE:
            client.send(content)
        client.send(drag(position=(4, 5, 6)))
        until(lambda: len(served.moved) > count)
    np.testing.assert_array_equal(served.moved[count:], [[4.0, 5.0, 6.0]])
    assert len(caplog.records) == len(GARBAGE)
    assert not any("\n" in record.getMessage() or record.exc_info for record in caplog.records)
    assert "Traceback" not in capfd.readouterr().err


def test_who_sends_nothing_but_faults_is_sent_away(served: Page) -> None:
    with served.client() as client:
        for _ in range(MOST_FAULTS):
            client.send(b"")
        with pytest.raises(ConnectionClosed) as closed:
            list(client)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008
    assert not refused(served)


TWO_HOSTS = b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"


@pytest.mark.parametrize(
    "content",
    [
        b"\0\1\2\3\r\n\r\n",
        b"GET / HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: a\r\n\r\n",
        TWO_HOSTS,
    ],
)
def test_what_is_no_request_is_one_line(served: Page, caplog: pytest.LogCaptureFixture, content: bytes) -> None:
    with caplog.at_level(logging.WARNING, "maxjax"):
        with socket.create_connection(("127.0.0.1", served.port), timeout=10.0) as raw:
            raw.sendall(content)
            raw.shutdown(socket.SHUT_WR)
            while raw.recv(4096):
                pass
        until(lambda: caplog.records)
    assert len(caplog.records) == 1
    assert "\n" not in caplog.text.strip()
    assert not refused(served)


def test_a_viser_that_starts_otherwise_is_refused() -> None:
    with pytest.raises(ImportError, match=r"expected viser 1\.1"), guarding(Border("127.0.0.1", ""), dict):
        pass
